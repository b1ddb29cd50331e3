"""Gradients among walls in space: values are those of the compiled solver, gradients those of differences of it."""

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint.load import WorldForce
from rollingjoint.statics import sensitivity

torch = pytest.importorskip("torch")

from rollingjoint.differentiable import (  # noqa: E402 - needs torch
    DifferentiableSpatialChain,
    DifferentiableSpatialSurroundings,
    solve_lengths,
    solve_tensions,
)
from rollingjoint.differentiable.surroundings import numeric  # noqa: E402
from tests.rollingjoint.walls import test_space as scenes  # noqa: E402

torch.set_num_threads(1)

ARM, ROLLING = rj.SpatialChain.from_arm(scenes.ARM), rj.pitch_yaw()
SLACK = ROLLING.neutral_lengths - 2.0 / ROLLING.stiffnesses
COMMANDS = {ARM: scenes.COMMAND, ROLLING: SLACK + np.array([-2.0, -2.0, 1.0, -0.2])}
PLACE = 0.1, -0.2, 0.3, 0.02, -0.01, 0.03
TUBES = [
    rj.Tube([25, 40, 30], [0, 0.012, 0.02], [0, 0.4, 2.2], [12, 9, 8.2, 8], stiffness=2.0, toe=0.2),
    rj.Capsule((-6.0, -12.0, 40.0), (-6.0, 8.0, 48.0), 2.0, stiffness=3.0),
]
CASES = {
    "an arm at walls of all kinds": (ARM, scenes.around("all", 0.25, 0.4), scenes.BASE),
    "an arm between rigid walls": (ARM, scenes.around("sphere", 0.25, 0.4, rigid=True), scenes.BASE),
    "rolling joints in a tube that tapers, at a capsule": (
        ROLLING, rj.Surroundings(TUBES, rj.Sleeve(6.0), rj.WallFriction(0.25, 0.4)), PLACE,
    ),
    "naked rolling joints at a plane by length of outline": (
        ROLLING,
        rj.Surroundings(
            [rj.Plane((-1, -0.2, 0), -17.0, stiffness_per_length=0.3)], rj.Bare(1.0, 3, 6), rj.WallFriction(0.25, 0.4)
        ),
        PLACE,
    ),
}  # fmt: skip
FIELDS = ("tip", "poses", "tensions", "wall_forces", "insertion_force", "reactions", "lengths")
FORCE = WorldForce(-1, (0.1, -0.05, 0.02))
WAYS = {"slipping": (0.5, 0.6), "sticking": (0.5, -0.02)}


class Case:
    """Equilibria of one case by both solvers at numbers that can be changed."""

    def __init__(self, name, requires_grad=()):
        self.chain, around, base = CASES[name]
        self.walls = DifferentiableSpatialSurroundings.of(around, self.chain, requires_grad)
        self.leaves = {name: getattr(self.walls, name) for name in requires_grad if getattr(self.walls, name).numel()}
        table = torch.tensor(self.chain.load_table([FORCE]))
        for key, values in {"base": base, "commands": COMMANDS[self.chain], "loads": table}.items():
            self.leaves[key] = torch.as_tensor(values, dtype=torch.float64).clone().requires_grad_()

    @property
    def atol(self):
        return 2e-5 if self.walls.rigid else 1e-8

    def at(self, leaf=None, place=None, by=0.0, steps=(), start=None):
        """The equilibrium of the compiled solver, at the end of steps along z; one number may be changed."""
        numbers = {name: tensor.detach().clone() for name, tensor in self.leaves.items()}
        if leaf is not None:
            numbers[leaf][place] += by
        tables = self.walls.replace(**{name: numbers[name] for name in numbers if hasattr(self.walls, name)}).tables()
        walls, base = numeric(tables, self.walls.rigid), numbers["base"].numpy()
        force = [WorldForce(-1, tuple(numbers["loads"][0, 4:7].tolist()))]
        settings = {"tension_limits": scenes.LIMITS, "surroundings": walls}
        command = numbers["commands"].numpy()
        reached = rj.solve_lengths(self.chain, command, force, start, base=base, **settings)
        for k in range(len(steps)):
            there = base + sum(steps[: k + 1]) * np.eye(6)[2]
            reached = rj.solve_lengths(self.chain, command, force, base=there, history=reached, **settings)
        return reached

    def in_tensors(self, steps=()):
        design, settings = DifferentiableSpatialChain.from_mechanism(self.chain), {"tension_limits": scenes.LIMITS}
        settings |= {"surroundings": self.walls, "loads": self.leaves["loads"]}
        base, command = self.leaves["base"], self.leaves["commands"]
        reached = solve_lengths(design, command, base=base, **settings)
        for k in range(len(steps)):
            there = base + sum(steps[: k + 1]) * torch.eye(6, dtype=torch.float64)[2]
            starts = reached.joint_angles.detach()
            reached = solve_lengths(design, command, base=there, history=reached, starts=starts, **settings)
        return reached

    def numbers(self):
        """Names and places of all numbers that solves depend on smoothly."""
        for name, tensor in self.leaves.items():
            for at in np.ndindex(*tensor.shape):
                outline = name in ("points", "bars") and at[1] in (0, 5 if name == "points" else 0)  # link, length
                begins = name == "toes" and tensor[at] == 0.0  # to one side only
                end = name == "capsules" and self.walls.spheres[at[0]]  # a sphere would become a capsule
                if not (outline or begins or end) and (name != "loads" or at == (0, 4)):
                    yield name, at


def fields_of(equilibrium):
    return [getattr(equilibrium, name) for name in FIELDS]


def weights_of(equilibrium, seed):
    """Weights of the sum of all fields, each of about the same size."""
    rng = np.random.default_rng(seed)
    sizes = [max(1.0, np.abs(np.asarray(values)).max()) for values in fields_of(equilibrium)]
    shapes = [np.shape(values) for values in fields_of(equilibrium)]
    return [rng.normal(size=shape) / size for shape, size in zip(shapes, sizes, strict=True)]


def gradients_of(case, found, weights):
    total = sum((values * torch.as_tensor(w)).sum() for values, w in zip(fields_of(found), weights, strict=True))
    found = torch.autograd.grad(total, list(case.leaves.values()), materialize_grads=True)
    return dict(zip(case.leaves, found, strict=True))


def value_of(equilibrium, weights):
    assert equilibrium.ok
    return sum(float((np.asarray(v) * w).sum()) for v, w in zip(fields_of(equilibrium), weights, strict=True))


def check_values(found, expected, atol):
    for name, values in zip(FIELDS, fields_of(expected), strict=True):
        np.testing.assert_allclose(getattr(found, name).detach(), values, atol=atol, err_msg=name)
    pressing = expected.walls.normals > 0.0
    np.testing.assert_array_equal(found.wall_normals.detach().numpy() > 0.0, pressing)
    np.testing.assert_allclose(found.wall_gaps.detach().numpy()[pressing], expected.walls.gaps[pressing], atol=1e-9)
    assert pressing.any()


@pytest.mark.parametrize("name", CASES)
def test_values_are_those_of_the_compiled_solver(name):
    case = Case(name)
    found, expected = case.in_tensors(), case.at()
    check_values(found, expected, case.atol)
    H = expected.stiffness
    np.testing.assert_allclose(found.stiffness.detach(), H, atol=1e-8 * np.abs(H).max())


RATHER_SLOW = list(CASES)[2:]


def slow_ones(*names):
    """Cases, of which some run with the slow tests."""
    return [pytest.param(name, marks=[pytest.mark.slow] * (name in names)) for name in CASES]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", slow_ones(*RATHER_SLOW))
def test_steps_with_friction_are_those_of_the_compiled_solver(name, way):
    case = Case(name)
    found, expected = case.in_tensors(WAYS[way]), case.at(steps=WAYS[way])
    check_values(found, expected, case.atol)
    pressing = expected.walls.normals > 0.0
    np.testing.assert_allclose(found.wall_states.detach()[pressing], expected.walls.states[pressing], atol=1e-7)
    np.testing.assert_allclose(found.dissipated_work.detach(), expected.dissipated_work, atol=case.atol)
    assert abs(expected.dissipated_work) > 1e-6
    sizes = np.linalg.norm(expected.walls.states[pressing], axis=-1)
    assert (sizes > 0.999999).any() if way == "slipping" else (sizes < 0.999).any()


@pytest.mark.parametrize("name", slow_ones(*RATHER_SLOW))
def test_gradients_are_those_of_differences(name):
    """By every number of walls and outline, the base, the commands and a load: central differences of four solves."""
    case = Case(name, DifferentiableSpatialSurroundings.parameters)
    at = case.at()
    weights = weights_of(at, 0)
    gradients = gradients_of(case, case.in_tensors(), weights)
    assert float(gradients["base"].abs().max()) > 1e-3
    for leaf, place in case.numbers():
        tensor = case.leaves[leaf].detach()
        h = (2e-3 if case.walls.rigid else 2e-4) * min(1.0, max(1e-2, abs(float(tensor[place]))))
        low, lower, higher, high = (
            value_of(case.at(leaf, place, k * h, start=at), weights) for k in (-1.0, -0.5, 0.5, 1.0)
        )
        difference = (8.0 * (higher - lower) - (high - low)) / (6.0 * h)
        error, size = abs(float(gradients[leaf][place]) - difference), float(gradients[leaf].abs().max())
        assert error < (1e-5 if case.walls.rigid else 1e-6) * size + 1e-7, (leaf, place, difference)


@pytest.mark.parametrize("way", [pytest.param("slipping", marks=pytest.mark.slow), "sticking"])
@pytest.mark.parametrize("name", slow_ones(*RATHER_SLOW)[:3])
def test_gradients_with_friction_are_one_sided_differences_along_the_whole_way(name, way):
    """Through the memory of both steps; median 1e-5 of the largest."""
    names = ["planes", "capsules", "curvatures", "radii", "stiffnesses", "frictions", "preslidings"]
    case, steps = Case(name, names), WAYS[way]
    weights = weights_of(case.at(steps=steps), 1)
    gradients = gradients_of(case, case.in_tensors(steps), weights)
    zero, errors = value_of(case.at(steps=steps), weights), []
    for leaf, place in case.numbers():
        h, sides = 2e-5 * min(1.0, max(1e-2, abs(float(case.leaves[leaf].detach()[place])))), []
        for sign in (1.0, -1.0):  # the second order taken off: of these is one the side of this gradient
            near, far = (value_of(case.at(leaf, place, k * sign * h, steps), weights) for k in (1.0, 2.0))
            sides.append((4.0 * near - 3.0 * zero - far) / (2.0 * sign * h))
        gradient, size = float(gradients[leaf][place]), max(1e-3, float(gradients[leaf].abs().max()))
        errors.append(min(abs(gradient - difference) for difference in sides) / size)
    print(
        f"{name}, {way}: {len(errors)} numbers, median {np.median(errors):.1e}, worst {max(errors):.1e} of the largest"
    )
    assert np.median(errors) < 1e-5 and max(errors) < 1e-2, sorted(errors)[-5:]
    assert float(gradients["frictions"].abs().max()) > 1e-3


def test_rows_have_walls_and_bases_of_their_own_and_a_row_without_one_has_no_gradient():
    walls = DifferentiableSpatialSurroundings.of(scenes.around("sphere"), ARM)
    places = torch.tensor(walls.capsules.tolist() * 3).reshape(3, 1, 7).double()
    places[1, 0, :3] += 200.0
    places[2, 0, 6] = -1.0
    capsules = places.requires_grad_()
    base = torch.tensor(scenes.BASE).double().repeat(3, 1).requires_grad_()
    design, command = DifferentiableSpatialChain.from_mechanism(ARM), torch.tensor(scenes.COMMAND)
    around = walls.replace(capsules=capsules)
    found = solve_lengths(design, command, surroundings=around, base=base, tension_limits=scenes.LIMITS)
    assert found.ok.tolist() == [True, True, False]
    alone = solve_lengths(design, command, surroundings=walls, base=base[0], tension_limits=scenes.LIMITS)
    np.testing.assert_allclose(found.wall_forces[0].detach(), alone.wall_forces.detach(), atol=1e-9)
    assert float(found.wall_forces[1].detach().abs().max()) == 0.0
    found.insertion_force.sum().backward()
    assert float(base.grad[0].abs().sum()) > 0.0 and float(base.grad[1:].abs().sum()) == 0.0
    assert float(capsules.grad[0, 0, :3].abs().sum()) > 0.0 and float(capsules.grad[1:].abs().sum()) == 0.0


def test_a_base_is_a_place_or_a_pose_and_tensions_may_be_given():
    around, design = scenes.around("plane"), DifferentiableSpatialChain.from_mechanism(ARM)
    given = torch.tensor([6.0, 6.0, 1.0, 1.0], dtype=torch.float64, requires_grad=True)
    base = torch.tensor([0.4, -0.3, 0.5], dtype=torch.float64, requires_grad=True)
    found = solve_tensions(design, given, surroundings=around, base=base)
    expected = rj.solve_tensions(ARM, given.tolist(), surroundings=around, base=base.tolist())
    np.testing.assert_allclose(found.tip.detach(), expected.tip, atol=1e-9)
    by_tensions, by_base = torch.autograd.grad(found.insertion_force, (given, base))
    np.testing.assert_allclose(by_tensions, sensitivity.dinsertion_dtensions(expected), atol=1e-9)
    np.testing.assert_allclose(by_base, sensitivity.dinsertion_dbase(expected)[:3], atol=1e-9)
    assert float(by_base.abs().max()) > 1e-3


def test_wrong_walls_are_told():
    design = DifferentiableSpatialChain.from_mechanism(ARM)
    flat = rj.Surroundings([rj.Disc((500, 0), 3.0)])
    with pytest.raises(rj.InvalidInput, match="names among points, bars, planes, capsules"):
        DifferentiableSpatialSurroundings.of(scenes.around("plane"), ARM, ["discs"])
    with pytest.raises(rj.InvalidInput, match="walls around a chain in space: Plane, Sphere, Capsule, Tube"):
        solve_tensions(design, (3.0,) * 4, surroundings=flat)
    with pytest.raises(rj.InvalidInput, match=r"shape of base.*\(..., 6\)"):
        solve_tensions(design, (3.0,) * 4, surroundings=scenes.around("plane"), base=(0.0, 1.0))
