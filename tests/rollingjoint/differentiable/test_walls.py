"""Gradients among walls: values are those of the compiled solver, gradients those of differences of it."""

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint import (
    Bare,
    Capsule,
    Disc,
    HalfPlane,
    InvalidInput,
    Lumen,
    Polygon,
    Sleeve,
    Surroundings,
    WallFriction,
)
from rollingjoint.load import load_table
from tests.rollingjoint.walls.scenes import CHAIN, LIMITS, REST

torch = pytest.importorskip("torch")

from rollingjoint.differentiable import (  # noqa: E402 - needs torch
    DifferentiableChain,
    DifferentiableFriction,
    DifferentiableSpatialChain,
    DifferentiableSurroundings,
    solve_lengths,
    solve_tensions,
)
from rollingjoint.differentiable.surroundings import numeric  # noqa: E402

torch.set_num_threads(1)

PARAMETERS = DifferentiableSurroundings.parameters
LENGTHS = REST + np.array([0.4, -0.3, 0.2, 0.1])
LUMEN = Lumen([30, 40, 40, 30], [0, 0.02, -0.02, 0], [8, 8, 7.5, 7, 7], stiffness=2, toe=0.3)
SCENES = {
    "a lumen that tapers, a disc in it, a plane": (
        Surroundings([LUMEN, Disc((-9, 66), 4.0), HalfPlane((1, 0.1), -33, stiffness=3)], Sleeve(5.0)),
        (0.1, 30.0, 0.05),
    ),
    "naked links at a capsule, a polygon and two planes": (
        Surroundings(
            [
                Capsule((-9, 45), (-9, 66), 2.0, stiffness=3),
                Polygon([(9, 40), (16, 40), (9, 60)], stiffness=4, toe=0.2),
                HalfPlane((-1, 0.1), -3.4, stiffness_per_length=0.3),
                HalfPlane((0, -1), -79, stiffness=0.5),
            ],
            Bare(1.0),
        ),
        (0.3, 1.0, -0.02),
    ),
    "a lumen by length of outline": (
        Surroundings([Lumen.through([(0, 0), (0, 55), (-30, 90), (-30, 150)], 8.0, 35.0, stiffness_per_length=0.2)],
            Sleeve(5.0, points=6)),
        (0.0, 25.0, 0.0),
    ),
    "a straight lumen that tapers": (
        Surroundings([Lumen([40, 80], [0, 0], [8, 7, 4.6], stiffness=2), HalfPlane((1, 0), -4.9)], Sleeve(4.5)),
        (0.6, 25.0, 0.03),
    ),
    "rigid walls": (
        Surroundings([Lumen([40, 50, 60], [0, 0.012, 0], 7.0), Disc((8, 55), 4.0)], Sleeve(5.0), rigid=True),
        (0.0, 25.0, 0.0),
    ),
}  # fmt: skip
FIELDS = ("tip", "poses", "tensions", "wall_forces", "insertion_force", "contact_forces", "lengths")


def fields_of(equilibrium):
    return [getattr(equilibrium, name) for name in FIELDS]


def weights(equilibrium, seed):
    """Weights of the sum of all fields, each of about the same size."""
    rng = np.random.default_rng(seed)
    return [
        rng.normal(size=np.shape(values)) / max(1.0, np.abs(np.asarray(values)).max())
        for values in fields_of(equilibrium)
    ]


def differentiable(scene, requires_grad=PARAMETERS):
    around, base = SCENES[scene]
    walls = DifferentiableSurroundings.of(around, CHAIN, requires_grad)
    leaves = {name: getattr(walls, name) for name in requires_grad if getattr(walls, name).numel()}
    leaves["base"] = torch.tensor(base, requires_grad=True, dtype=torch.float64)
    leaves["commands"] = torch.tensor(LENGTHS, requires_grad=True)
    leaves["loads"] = torch.tensor(load_table([rj.WorldForce(-1, (0.1, -0.05))], CHAIN.n_links), requires_grad=True)
    return walls, leaves


def solved(walls, leaves, start=None):
    """The equilibrium of the compiled solver at the values of tensors."""
    arrays = numeric(walls.tables(), walls.rigid)
    numbers = {name: leaves[name].detach().numpy() for name in ("base", "commands", "loads")}
    force = [rj.WorldForce(-1, tuple(numbers["loads"][0, 3:5]))]
    return rj.solve_lengths(
        CHAIN, numbers["commands"], force, start, tension_limits=LIMITS, surroundings=arrays, base=numbers["base"]
    )


def changed(leaves, walls, name, at, by):
    """The walls and leaves after a change of one number."""
    tensor = leaves[name].detach().clone()
    tensor[at] += by
    if name in PARAMETERS:
        return walls.replace(**{name: tensor}), leaves
    return walls, leaves | {name: tensor}


def numbers_of(leaves):
    """Names and places of all numbers that solves depend on smoothly."""
    for name, tensor in leaves.items():
        for at in np.ndindex(*tensor.shape):
            outline = name in ("points", "bars") and at[1] == 0  # the link
            length = name == "points" and at[1] == 4
            begins = name == "toes" and tensor[at] == 0.0  # to one side only
            if not (outline or length or begins) and (name != "loads" or at == (0, 3)):
                yield name, at


@pytest.mark.parametrize("scene", SCENES)
def test_values_are_those_of_the_compiled_solver(scene):
    walls, leaves = differentiable(scene, ())
    expected = solved(walls, leaves)
    assert len(expected.wall_contacts) >= 2 and expected.ok
    found = solve_lengths(
        DifferentiableChain.from_mechanism(CHAIN), leaves["commands"], leaves["loads"], surroundings=walls,
        base=leaves["base"], tension_limits=LIMITS,
    )  # fmt: skip
    rigid = SCENES[scene][0].rigid
    for name, values in zip(FIELDS, fields_of(expected), strict=True):
        np.testing.assert_allclose(getattr(found, name).detach(), values, atol=1e-5 if rigid else 1e-9, err_msg=name)
    H = expected.stiffness
    np.testing.assert_allclose(found.stiffness.detach(), H, atol=1e-9 * np.abs(H).max())
    pressing = found.wall_normals.detach().numpy() > 0.0
    np.testing.assert_array_equal(pressing, expected.walls.normals > 0.0)
    np.testing.assert_allclose(found.wall_gaps.detach().numpy()[pressing], expected.walls.gaps[pressing], atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES)
def test_gradients_are_those_of_differences(scene):
    """By every number of walls and outline, the base, the commands and a load: central differences of four solves."""
    walls, leaves = differentiable(scene)
    found = solve_lengths(
        DifferentiableChain.from_mechanism(CHAIN), leaves["commands"], leaves["loads"], surroundings=walls,
        base=leaves["base"], tension_limits=LIMITS,
    )  # fmt: skip
    at = solved(walls, leaves)
    every = weights(at, 0)
    total = sum((values * torch.as_tensor(w)).sum() for values, w in zip(fields_of(found), every, strict=True))
    gradients = dict(
        zip(leaves, torch.autograd.grad(total, list(leaves.values()), materialize_grads=True), strict=True)
    )

    def value(name, place, by):
        moved = solved(*changed(leaves, walls, name, place, by), start=at)
        return sum(float((np.asarray(v) * w).sum()) for v, w in zip(fields_of(moved), every, strict=True))

    for name, size in ((name, float(gradients[name].abs().max())) for name in leaves):
        for leaf, place in numbers_of({name: leaves[name]}):
            h = (2e-3 if walls.rigid else 2e-4) * min(1.0, max(1e-2, abs(float(leaves[leaf].detach()[place]))))
            wide, narrow = ((value(leaf, place, k) - value(leaf, place, -k)) / (2.0 * k) for k in (h, 0.5 * h))
            difference = (4.0 * narrow - wide) / 3.0
            error = abs(float(gradients[leaf][place]) - difference)
            assert error < (1e-5 if walls.rigid else 1e-6) * size + 1e-7, (
                leaf,
                place,
                float(gradients[leaf][place]),
                difference,
            )


RUBBING = Surroundings([LUMEN, Disc((-9, 66), 4.0)], Sleeve(5.0), WallFriction(0.25, 0.08))
WAY = {"slipping in": (0.6, 1.0), "turning back": (0.6, -0.015), "turning back beyond the presliding": (0.6, -0.4)}


def walked(walls, base, steps, mu=None):
    """The equilibria of the compiled solver on a way of the base."""
    around = numeric(walls.tables(), walls.rigid)
    chain = CHAIN if mu is None else CHAIN.replace(friction=rj.CapstanFriction(mu))
    path = [rj.solve_lengths(chain, LENGTHS, tension_limits=LIMITS, surroundings=around, base=base)]
    for k in range(1, len(steps) + 1):
        at = base + np.array([0.0, sum(steps[:k]), 0.0])
        path.append(
            rj.solve_lengths(chain, LENGTHS, tension_limits=LIMITS, surroundings=around, base=at, history=path[-1])
        )
    return path


def walked_in_tensors(walls, base, steps, friction=None):
    design, history = DifferentiableChain.from_mechanism(CHAIN), None
    for k in range(len(steps) + 1):
        at = base + torch.tensor([0.0, sum(steps[:k]), 0.0], dtype=torch.float64)
        starts = None if history is None else history.joint_angles
        history = solve_lengths(
            design, LENGTHS, surroundings=walls, base=at, tension_limits=LIMITS, history=history, starts=starts,
            friction=friction,
        )  # fmt: skip
    return history


@pytest.mark.slow
@pytest.mark.parametrize("mu", [None, 0.08])
@pytest.mark.parametrize("way", WAY)
def test_steps_with_friction_are_those_of_the_compiled_solver(way, mu):
    walls, base = DifferentiableSurroundings.of(RUBBING, CHAIN), np.array([0.1, 30.0, 0.05])
    expected = walked(walls, base, WAY[way], mu)[-1]
    friction = None if mu is None else DifferentiableFriction(mu)
    found = walked_in_tensors(walls, torch.as_tensor(base), WAY[way], friction)
    for name, values in zip(FIELDS, fields_of(expected), strict=True):
        np.testing.assert_allclose(getattr(found, name).detach(), values, atol=1e-8, err_msg=name)
    pressing = expected.walls.normals > 0.0
    states = found.wall_states.detach().numpy()
    np.testing.assert_allclose(states[pressing], expected.walls.states[pressing], atol=1e-7)
    assert (np.abs(states[pressing]) < 1.0).all() or way != "turning back"
    np.testing.assert_allclose(found.dissipated_work.detach(), expected.dissipated_work, atol=1e-8)
    np.testing.assert_allclose(
        found.stiffness.detach(), expected.stiffness, atol=1e-8 * np.abs(expected.stiffness).max()
    )


@pytest.mark.slow
@pytest.mark.parametrize("way", WAY)
def test_gradients_with_friction_are_one_sided_differences_along_the_whole_way(way):
    """By walls, their friction and the first base: through the memory of both steps; median 1e-5 of the largest."""
    names = ["discs", "curvatures", "radii", "stiffnesses", "frictions", "preslidings"]
    walls = DifferentiableSurroundings.of(RUBBING, CHAIN, names)
    base = torch.tensor([0.1, 30.0, 0.05], requires_grad=True, dtype=torch.float64)
    leaves = {name: getattr(walls, name) for name in names} | {"base": base}
    found = walked_in_tensors(walls, base, WAY[way])
    at = walked(walls, base.detach().numpy(), WAY[way])[-1]
    every = weights(at, 1)
    total = sum((values * torch.as_tensor(w)).sum() for values, w in zip(fields_of(found), every, strict=True))
    gradients = dict(
        zip(leaves, torch.autograd.grad(total, list(leaves.values()), materialize_grads=True), strict=True)
    )

    def value(name, place, by):
        others, moved = changed(leaves, walls, name, place, by)
        last = walked(others, moved["base"].detach().numpy(), WAY[way])[-1]
        return sum(float((np.asarray(v) * w).sum()) for v, w in zip(fields_of(last), every, strict=True))

    errors = []
    for name, place in numbers_of(leaves):
        h, one = 2e-5 * min(1.0, max(1e-2, abs(float(leaves[name].detach()[place])))), []
        zero = value(name, place, 0.0)
        for sign in (1.0, -1.0):  # the second order taken off: of these is one the side of this gradient
            near, far = value(name, place, sign * h), value(name, place, 2.0 * sign * h)
            one.append((4.0 * near - 3.0 * zero - far) / (2.0 * sign * h))
        gradient, size = float(gradients[name][place]), max(1e-3, float(gradients[name].abs().max()))
        errors.append(min(abs(gradient - difference) for difference in one) / size)
    assert np.median(errors) < 1e-5 and max(errors) < 1e-2, sorted(errors)[-5:]
    assert float(gradients["frictions"].abs().max()) > 1e-3


def test_rows_have_walls_and_bases_of_their_own_and_a_row_without_one_has_no_gradient():
    walls = DifferentiableSurroundings.of(SCENES["a lumen that tapers, a disc in it, a plane"][0], CHAIN)
    design = DifferentiableChain.from_mechanism(CHAIN)
    places = torch.tensor([[-9.0, 66.0, 4.0], [-40.0, 66.0, 4.0], [-9.0, 66.0, -1.0]], dtype=torch.float64)
    discs = places[:, None].clone().requires_grad_()
    base = torch.tensor(
        [[0.1, 30.0, 0.05], [0.0, 20.0, 0.0], [0.1, 30.0, 0.05]], requires_grad=True, dtype=torch.float64
    )
    found = solve_lengths(design, LENGTHS, surroundings=walls.replace(discs=discs), base=base, tension_limits=LIMITS)
    assert found.ok.tolist() == [True, True, False]
    for row in range(2):
        alone = solve_lengths(
            design, LENGTHS, surroundings=walls.replace(discs=places[row][None]), base=base[row], tension_limits=LIMITS
        )
        np.testing.assert_allclose(found.wall_forces[row].detach(), alone.wall_forces.detach(), atol=1e-9)
    found.insertion_force.sum().backward()
    assert (base.grad[:2].abs().sum(-1) > 0).all() and float(base.grad[2].abs().sum()) == 0.0
    assert float(discs.grad[0].abs().sum()) > 0.0 and float(discs.grad[1:].abs().sum()) == 0.0


def test_surroundings_are_taken_as_they_are_and_tensions_may_be_given():
    around, base = SCENES["a lumen that tapers, a disc in it, a plane"]
    given = torch.full((4,), 3.0, dtype=torch.float64, requires_grad=True)
    found = solve_tensions(DifferentiableChain.from_mechanism(CHAIN), given, surroundings=around, base=base)
    expected = rj.solve_tensions(CHAIN, (3.0,) * 4, surroundings=around, base=base)
    np.testing.assert_allclose(found.tip.detach(), expected.tip, atol=1e-9)
    (gradient,) = torch.autograd.grad(found.insertion_force, given)
    from rollingjoint.statics.sensitivity import dinsertion_dtensions

    np.testing.assert_allclose(gradient, dinsertion_dtensions(expected), atol=1e-9)


def test_a_chain_far_from_its_walls_is_one_without():
    walls = DifferentiableSurroundings.of(Surroundings([Disc((500, 0), 3.0)]), CHAIN, ["discs"])
    design = DifferentiableChain.from_mechanism(CHAIN)
    found, free = solve_lengths(design, LENGTHS, surroundings=walls), solve_lengths(design, LENGTHS)
    np.testing.assert_allclose(found.tip, free.tip, atol=1e-9)
    assert float(found.wall_forces.abs().max()) == 0.0


def test_wrong_walls_are_told():
    around = Surroundings([Disc((500, 0), 3.0)])
    design = DifferentiableChain.from_mechanism(CHAIN)
    with pytest.raises(InvalidInput, match="names among points, bars, planes"):
        DifferentiableSurroundings.of(around, CHAIN, ["disks"])
    with pytest.raises(InvalidInput, match="Surroundings, or DifferentiableSurroundings"):
        solve_lengths(design, LENGTHS, surroundings=[Disc((0, 0), 1.0)])
    with pytest.raises(InvalidInput, match="walls around a chain in space: Plane, Sphere"):
        space = DifferentiableSpatialChain.from_mechanism(rj.pitch_yaw())
        solve_tensions(space, (3.0,) * 4, surroundings=around)
    with pytest.raises(InvalidInput, match="beside steps"):
        solve_lengths(design, LENGTHS, surroundings=around, steps=5)
    with pytest.raises(InvalidInput, match="equilibria among walls"):
        solve_lengths(design, LENGTHS, surroundings=RUBBING, history=solve_lengths(design, LENGTHS))
    one = solve_lengths(design, LENGTHS, surroundings=RUBBING, base=(0, 20, 0), tension_limits=LIMITS)
    with pytest.raises(InvalidInput, match="rows of the history"):
        solve_lengths(design, np.tile(LENGTHS, (3, 1)), surroundings=RUBBING, history=one)


def test_friction_in_the_holes_has_its_gradient_among_walls_too():
    base, steps, h = np.array([0.1, 30.0, 0.05]), (0.6, 0.3), 1e-5
    walls = DifferentiableSurroundings.of(RUBBING, CHAIN)
    mu = torch.tensor(0.08, requires_grad=True, dtype=torch.float64)
    found = walked_in_tensors(walls, torch.as_tensor(base), steps, DifferentiableFriction(mu))
    (gradient,) = torch.autograd.grad(found.insertion_force, mu)
    values = [walked(walls, base, steps, 0.08 + k * h)[-1].insertion_force for k in (-1.0, 1.0)]
    assert float(gradient) == pytest.approx((values[1] - values[0]) / (2.0 * h), rel=1e-5)
