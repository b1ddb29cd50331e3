"""Differentiable equilibria in space: values, gradients and failures against the compiled solver."""

import dataclasses

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint import Status
from rollingjoint.load import SPATIAL_LOAD_COLUMNS
from tests.rollingjoint.chain.spatial_chains import alternating, random_chain, random_loads, rolling_contact

torch = pytest.importorskip("torch")

from rollingjoint.differentiable import (  # noqa: E402 - needs torch
    DifferentiableChain,
    DifferentiableFriction,
    DifferentiableSpatialChain,
    SpatialEquilibria,
    as_on_a_device,
    solve_lengths,
    solve_tensions,
)
from rollingjoint.differentiable import solve as solve_module  # noqa: E402
from rollingjoint.differentiable.spatial_design import SPATIAL_PARAMETERS  # noqa: E402

torch.set_num_threads(1)

FIELDS = [
    "joint_angles",
    "poses",
    "contact_points",
    "tensions",
    "lengths",
    "tendon_rates",
    "reactions",
    "stiffness",
    "smallest_eigenvalue",
    "finite_friction_required",
    "finite_tilting_margins",
]
UNMOVED = "link", "other"


def hinge(rng):
    axis = rng.normal(size=3)
    points = np.array([[0.0, 0.0, 3.5], [0.0, 0.0, -3.5]]) + 0.2 * rng.normal(size=(2, 3))
    return rj.PointHinge(axis, *points, rng.uniform(5, 30), 0.1 * rng.normal(), (-0.6, 0.6))


def one_or_the_other(rng):
    return (rolling_contact, hinge)[int(rng.integers(2))](rng)


def upright(rng):
    """A hinge about z."""
    return rj.PointHinge((0.0, 0.0, 1.0), (0.0, 0.0, 3.5), (0.0, 0.0, -3.5), 20.0, 0.05, (-0.3, 0.3))


def twisted():
    """Two rolling contacts around a hinge about z."""
    chain = random_chain(np.random.default_rng(5), 3)
    return chain.replace(joints=[chain.joints[0], upright(None), chain.joints[2]])


BUILDS = {
    "rolling": lambda: random_chain(np.random.default_rng(3)),
    "mixed": lambda: random_chain(np.random.default_rng(4), 5, 4, one_or_the_other),
    "hinges": lambda: random_chain(np.random.default_rng(6), 4, 4, hinge),
    "about z": twisted,
    "pitch and yaw": lambda: alternating(6, joint_stiffness=5.0),
}


def loads_of(chain, potential, seed=0):
    loads = random_loads(np.random.default_rng(seed), chain, potential)
    return chain.load_table([*loads, rj.TorsionSpring(2, 4.0, 0.1, 1)])


def finite(values):
    """Values at hinges, infinite or without meaning for gradients, as zeros."""
    return np.where(np.isfinite(values), values, 0.0)


def fields(equilibrium):
    """All fields one behind the other: tensors as they are, arrays as tensors."""
    parts = []
    for field in FIELDS:
        values = getattr(equilibrium, field.removeprefix("finite_"))
        values = values if isinstance(values, torch.Tensor) else torch.tensor(values, dtype=torch.float64)
        parts.append(torch.where(torch.isfinite(values), values, 0.0).flatten())
    return torch.cat(parts)


def blocks(equilibrium):
    sizes = [0] + [getattr(equilibrium, field.removeprefix("finite_")).numel() for field in FIELDS]
    ends = np.cumsum(sizes)
    return {field: slice(*ends[i : i + 2]) for i, field in enumerate(FIELDS)}


def inputs_of(chain, solve):
    tensions = 2.0 + 0.7 * np.arange(chain.n_tendons)
    return tensions if solve is solve_tensions else chain.neutral_lengths - 0.1 * tensions


def compiled(chain, solve, inputs, table):
    """The same row by the solver that knows no torch."""
    batch = rj.solve_tensions_batch if solve is solve_tensions else rj.solve_lengths_batch
    return batch(chain, inputs[None], table[None]).row(0)


@pytest.mark.parametrize("potential", [True, False])
@pytest.mark.parametrize("solve", [solve_tensions, solve_lengths])
@pytest.mark.parametrize("name", BUILDS)
def test_equilibria_are_those_of_the_compiled_solver(name, solve, potential):
    chain = BUILDS[name]()
    table, inputs = loads_of(chain, potential), inputs_of(chain, solve)
    reference = compiled(chain, solve, inputs, table)
    design = DifferentiableSpatialChain.from_mechanism(chain)
    for solver in ("torch", "compiled"):
        found = solve(design, inputs, torch.as_tensor(table), solver=solver)
        assert isinstance(found, SpatialEquilibria)
        assert int(found.status) == int(reference.status)
        for field in (*FIELDS[:-2], "tip", "contact_forces", "arc_lengths", "gap_tensions", "pressing_margins"):
            if field != "contact_forces":
                expected = getattr(reference, field)
                assert getattr(found, field).numpy() == pytest.approx(expected, rel=1e-10, abs=2e-9, nan_ok=True), field
        assert found.tilting_margins.numpy() == pytest.approx(reference.tilting_margins, rel=1e-9)
        assert found.friction_required.numpy() == pytest.approx(reference.friction_required, rel=1e-9, abs=1e-12)
        assert found.tooth_margins().numpy() == pytest.approx(reference.tooth_margins(), rel=1e-9)
        assert found.strap_forces.numpy() == pytest.approx(reference.strap_forces, abs=1e-8)
        assert found.slip_margins(0.2).numpy() == pytest.approx(reference.slip_margins(0.2), rel=1e-9)


def test_impossible_coefficients_and_angles_of_margins_are_refused():
    chain = next(iter(BUILDS.values()))()
    design = DifferentiableSpatialChain.from_mechanism(chain)
    equilibria = solve_tensions(design, inputs_of(chain, solve_tensions))
    for friction in (-0.1, np.nan):
        with pytest.raises(rj.InvalidInput, match="friction"):
            equilibria.slip_margins(friction)
    for angle in (-0.1, 0.5 * np.pi, np.nan):
        with pytest.raises(rj.InvalidInput, match="pressure_angle"):
            equilibria.tooth_margins(angle)


@pytest.mark.parametrize("name", BUILDS)
def test_stiffness_and_poses_at_the_same_angles_are_those_of_the_kernels_to_1e_10(name):
    chain = BUILDS[name]()
    table, inputs = loads_of(chain, False), inputs_of(chain, solve_lengths)
    reference = compiled(chain, solve_lengths, inputs, table)
    design = DifferentiableSpatialChain.from_mechanism(chain)
    geometry = design.geometry()
    law = solve_module.Law(
        torch.as_tensor(inputs),
        design.stiffnesses,
        torch.zeros(chain.n_tendons),
        torch.full((chain.n_tendons,), torch.inf),
    )
    angles = torch.tensor(reference.joint_angles)
    contact = geometry.contact(geometry.contacts(angles, torch.zeros_like(angles)))
    state = solve_module.state_at(geometry, law, design.loads(torch.as_tensor(table), chain.n_joints), angles, contact)
    assert state.stiffness.numpy() == pytest.approx(
        reference.stiffness, rel=1e-10, abs=1e-10 * abs(reference.stiffness).max()
    )
    assert state.rotations.numpy() == pytest.approx(reference.rotations, abs=1e-10)
    assert state.positions.numpy() == pytest.approx(reference.positions, abs=1e-10)
    assert state.lengths.numpy() == pytest.approx(reference.lengths, abs=1e-10)
    assert state.reactions.numpy() == pytest.approx(reference.reactions, abs=1e-10 * 100)


def wiggle(rng, name, design):
    """A direction in one parameter that leaves the chain one that can be built."""
    tensor = getattr(design, name)
    step = torch.as_tensor(rng.normal(size=tensor.shape))
    if name == "coefficients":
        return 0.05 * step / 2.0 ** torch.arange(tensor.shape[-1])
    if name == "breaks":
        step[tensor == 0.0] = 0.0
        step[..., 0], step[..., -1] = step[0, 0, 0], step[0, 0, -1]  # where both surfaces end, they end together
        step = torch.where(tensor == tensor[..., -1:], step[..., -1:], step)  # pieces that stand for none stay none
        return 0.1 * step
    return step if name in ("joint_stiffnesses", "stiffnesses") else 0.1 * step


def richardson(function, h):
    """Derivative at 0 by two central differences, error O(h⁴)."""
    wide, narrow = ((function(x) - function(-x)) / (2 * x) for x in (h, 0.5 * h))
    return (4 * narrow - wide) / 3


CASES = {
    "rolling, lengths": ("rolling", solve_lengths, False),
    "rolling, tensions": ("rolling", solve_tensions, True),
    "mixed, lengths": ("mixed", solve_lengths, False),
    "hinges, lengths": ("hinges", solve_lengths, False),
    "about z, tensions": ("about z", solve_tensions, False),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_gradients_of_everything_by_everything_match_differences_of_the_compiled_solver(case):
    name, solve, potential = CASES[case]
    rng, chain = np.random.default_rng(1), BUILDS[name]()
    table, inputs = loads_of(chain, potential), inputs_of(chain, solve)
    design = DifferentiableSpatialChain.from_mechanism(chain, SPATIAL_PARAMETERS)
    leaves = {parameter: getattr(design, parameter) for parameter in SPATIAL_PARAMETERS}
    leaves["inputs"] = torch.tensor(inputs, requires_grad=True)
    leaves["loads"] = torch.tensor(table, requires_grad=True)
    found = solve(design, leaves["inputs"], leaves["loads"])
    outputs = fields(found)
    rows = [torch.autograd.grad(y, list(leaves.values()), retain_graph=True, allow_unused=True) for y in outputs]

    steps = {parameter: wiggle(rng, parameter, design) for parameter in SPATIAL_PARAMETERS}
    steps["inputs"] = torch.as_tensor(rng.normal(size=inputs.shape))
    moving = [column not in UNMOVED for column in SPATIAL_LOAD_COLUMNS]
    steps["loads"] = torch.as_tensor(0.1 * rng.normal(size=table.shape) * moving)
    for column in map(SPATIAL_LOAD_COLUMNS.index, ("k", "torsion")):
        steps["loads"][:, column] *= torch.as_tensor(table[:, column] > 0)  # springs stay springs

    for column, (parameter, step) in ((list(leaves).index(key), (key, step)) for key, step in steps.items()):
        gradient = np.array([0.0 if row[column] is None else float((row[column] * step).sum()) for row in rows])

        def moved(x, parameter=parameter, step=step):
            changed = parameter in SPATIAL_PARAMETERS
            mechanism = design.replace(**{parameter: leaves[parameter] + x * step}).mechanism() if changed else chain
            values = inputs + (x * step.numpy() if parameter == "inputs" else 0.0)
            loads = table + (x * step.numpy() if parameter == "loads" else 0.0)
            return fields(compiled(mechanism, solve, values, loads)).numpy()

        numeric = richardson(moved, 1e-3)
        for field, block in blocks(found).items():
            if (name, parameter, field) == ("about z", "hinge_axes", "reactions"):
                continue  # beside z, the plane in which they are given jumps
            scale = np.abs(numeric[block]).max()
            assert gradient[block] == pytest.approx(numeric[block], abs=1e-6 * scale + 1e-8), (parameter, field)


STEPS = [(3.0, 2.0, 2.0, 2.5), (4.0, 2.0, 2.5, 2.0), (3.0, 2.2, 2.0, 2.0)]
NUMBERS = {"mu": 0.12, "presliding": 0.02, "extra_turn": 0.05, "constant": 0.01, "compliance": 0.01}


def walked(design, friction, leaf):
    """Equilibria along a path of tensions, the last one under a load."""
    begin = solve_tensions(design, STEPS[0], friction=friction)
    before = solve_tensions(design, STEPS[1], friction=friction, history=begin)
    return solve_tensions(design, leaf, [rj.WorldForce(-1, (0.05, 0.0, -0.1))], friction=friction, history=before)


@pytest.mark.parametrize("name", ["rolling", "mixed", "hinges"])
def test_steps_with_friction_are_those_of_the_compiled_solver(name, monkeypatch):
    asked = []
    whole = solve_module.solve_compiled
    monkeypatch.setattr(solve_module, "solve_compiled", lambda *a: asked.append(a[-1]) or whole(*a))
    chain = BUILDS[name]().replace(friction=rj.CapstanFriction(**NUMBERS))
    design = DifferentiableSpatialChain.from_mechanism(chain)
    found = walked(design, None, STEPS[2])
    assert not asked
    reference = None
    for tensions, loads in zip(STEPS, ([], [], [rj.WorldForce(-1, (0.05, 0.0, -0.1))]), strict=True):
        reference = rj.solve_tensions(chain, tensions, loads, history=reference)
    assert int(found.status) == int(reference.status)
    assert int(found.sticking.sum()) > 0 or int((found.friction_states.abs() == 1.0).sum()) > 0
    for field in (
        "joint_angles",
        "gap_tensions",
        "friction_states",
        "slip",
        "dissipated_work",
        "stiffness",
        "reactions",
    ):
        assert getattr(found, field).numpy() == pytest.approx(getattr(reference, field), rel=1e-7, abs=1e-7), field


@pytest.mark.slow
def test_gradients_through_a_path_with_friction_match_differences(monkeypatch):
    monkeypatch.setattr(solve_module, "solve_compiled", lambda *_: pytest.fail("the torch solver got stuck"))
    rng, chain = np.random.default_rng(2), BUILDS["mixed"]()
    design = DifferentiableSpatialChain.from_mechanism(chain, SPATIAL_PARAMETERS)
    leaves = {
        name: getattr(design, name) for name in ("holes", "coefficients", "azimuths", "hinge_axes", "hinge_points")
    }
    leaves |= {name: torch.tensor(value, dtype=torch.float64, requires_grad=True) for name, value in NUMBERS.items()}
    leaves["inputs"] = torch.tensor(STEPS[2], dtype=torch.float64, requires_grad=True)
    weight = torch.as_tensor(rng.normal(size=64))

    def weighted(values):
        moved = design.replace(**{name: value for name, value in values.items() if name in SPATIAL_PARAMETERS})
        friction = DifferentiableFriction(**{name: values[name] for name in NUMBERS})
        found = walked(moved, friction, values["inputs"])
        parts = [found.tip, found.gap_tensions, found.slip, found.reactions, found.dissipated_work[None]]
        outputs = torch.cat([part.flatten() for part in parts])
        return (outputs * weight.repeat(2)[: len(outputs)]).sum()

    gradients = torch.autograd.grad(weighted(leaves), list(leaves.values()))
    for (name, leaf), gradient in zip(leaves.items(), gradients, strict=True):
        step = wiggle(rng, name, design) if name in SPATIAL_PARAMETERS else 0.1 * leaf.detach()
        numeric = richardson(lambda x, n=name, s=step, v=leaf: weighted(leaves | {n: v.detach() + x * s}).item(), 1e-3)
        assert float((gradient * step).sum()) == pytest.approx(numeric, rel=2e-6, abs=1e-7), name


def planar_in_space(chain):
    """A planar chain as one in space, in the plane x-z."""
    pairs = zip(chain.links[:-1], chain.links[1:], strict=True)
    joints = [rj.RollingContact(0.0, above.parent, below.child, 5.0) for below, above in pairs]
    tendons = [
        rj.SpaceTendon(np.insert(points, 1, 0.0, axis=-1), tendon.end, tendon.stiffness)
        for points, tendon in zip(chain.hole_points, chain.tendons, strict=True)
    ]
    return rj.SpatialChain(joints, tendons)


@pytest.mark.parametrize("build", [rj.five_link, rj.two_segment])
def test_joints_of_one_plane_have_the_equilibria_and_gradients_of_the_planar_chain(build):
    chain = build()
    loads = torch.tensor([[float(chain.n_joints), 0.2, -0.1]])
    results = []
    for kind, mechanism, columns, at in (
        (DifferentiableChain, chain, rj.load.LOAD_COLUMNS, ("fx", "fy")),
        (DifferentiableSpatialChain, planar_in_space(chain), SPATIAL_LOAD_COLUMNS, ("fx", "fz")),
    ):
        tensions = torch.tensor(2.0 + np.arange(chain.n_tendons), requires_grad=True)
        table = torch.zeros(1, len(columns), dtype=torch.float64)
        table[:, [columns.index(name) for name in ("link", *at)]] = loads.double()
        found = solve_tensions(kind.from_mechanism(mechanism), tensions, table)
        assert int(found.status) == Status.CONVERGED
        angles = found.joint_angles
        slopes = [torch.autograd.grad(angle, tensions, retain_graph=True)[0] for angle in angles]
        results.append(torch.cat([angles, found.smallest_eigenvalue[None], *slopes]).detach().numpy())
    assert results[0] == pytest.approx(results[1], rel=1e-9, abs=1e-10)


def test_an_arm_has_gradients_as_a_chain_of_hinges():
    arm = rj.small_arm(weight=0.1).replace(springs=[rj.Spring(2, 0.05, (10.0, 0.0, 40.0))])
    chain = rj.SpatialChain.from_arm(arm)
    lengths = arm.neutral_lengths - [3.0, 0.5, 0.0, 1.0]
    reference = rj.solve_lengths(arm, lengths, [arm.gravity()])
    assert chain.gravity() == arm.gravity() and rj.solve_lengths(chain, lengths, [arm.gravity()]).ok
    leaf = torch.tensor(lengths, requires_grad=True)
    found = solve_lengths(DifferentiableSpatialChain.from_mechanism(chain), leaf, [chain.gravity()])
    assert found.poses.detach().numpy() == pytest.approx(reference.poses, abs=1e-8)
    assert found.tensions.detach().numpy() == pytest.approx(reference.tensions, abs=1e-8)
    slopes = torch.stack([torch.autograd.grad(x, leaf, retain_graph=True)[0] for x in found.tip]).numpy()
    assert slopes == pytest.approx(rj.sensitivity.dposes_dlengths(reference)[-1, :3], abs=1e-7)
    with pytest.raises(rj.MechanismError, match="exact"):
        rj.SpatialChain.from_arm(rj.small_arm(model="linear"))


def test_designs_and_load_cases_broadcast_and_become_the_chains_they_came_from():
    chains = [BUILDS["mixed"]()]
    stiffer = [dataclasses.replace(tendon, stiffness=9.0) for tendon in chains[0].tendons]
    chains.append(chains[0].replace(tendons=stiffer))
    design = DifferentiableSpatialChain.from_mechanism(chains)
    tensions = torch.tensor([[3.0, 2.0, 2.5, 2.0], [2.0, 4.0, 2.0, 3.0], [2.0, 2.0, 5.0, 2.0]], dtype=torch.float64)
    found = solve_tensions(design[:, None], tensions, [rj.WorldForce(-1, (0.1, 0.0, 0.05))])
    assert found.poses.shape == (2, 3, 6, 4, 4) and found.ok.all()
    for i, chain in enumerate(chains):
        again = design.mechanism(i)
        assert again.neutral_lengths == pytest.approx(chain.neutral_lengths, rel=1e-13)
        assert again.joint_limits == pytest.approx(chain.joint_limits, rel=1e-13)
        reference = rj.solve_tensions_batch(again, tensions.numpy(), [rj.WorldForce(-1, (0.1, 0.0, 0.05))])
        assert found.tip[i].numpy() == pytest.approx(reference.tip, abs=1e-9)


BROKEN = {
    "numbers that are not finite": ("holes", torch.nan),
    "surfaces that cannot roll": ("coefficients", 0.0),
    "a stiffness below zero": ("joint_stiffnesses", -1.0),
    "an axis without direction": ("hinge_axes", 0.0),
    "a contact line without width": ("half_widths", 0.0),
}


@pytest.mark.parametrize("solver", ["torch", "compiled"])
@pytest.mark.parametrize("fault", BROKEN)
def test_a_design_that_cannot_be_built_has_no_gradient_and_leaves_the_others_alone(fault, solver):
    base = DifferentiableSpatialChain.from_mechanism(BUILDS["mixed"]())
    name, value = BROKEN[fault]
    leaf = getattr(base, name).expand(2, *getattr(base, name).shape).clone()
    leaf[1] = value
    leaf.requires_grad_()
    tensions = torch.tensor([3.0, 2.0, 2.5, 2.0], dtype=torch.float64)
    found = solve_tensions(base.replace(**{name: leaf}), tensions, solver=solver)
    assert found.status.tolist() == [Status.CONVERGED, Status.INVALID_INPUT]
    assert found.tip[0].tolist() == pytest.approx(solve_tensions(base, tensions, solver=solver).tip.tolist(), abs=1e-9)
    margins = found.tilting_margins[torch.isfinite(found.tilting_margins)]
    gradient = torch.autograd.grad(found.tip.sum() + margins.sum() + found.stiffness.sum(), leaf)[0]
    assert torch.isfinite(found.poses).all() and gradient[1].eq(0.0).all() and torch.isfinite(gradient[0]).all()


def test_holes_that_have_changed_places_are_no_equilibrium():
    base = DifferentiableSpatialChain.from_mechanism(alternating(4, joint_stiffness=5.0))
    holes = base.holes.clone()
    holes[..., 2] *= 1.8  # beyond the apex of the surfaces
    crossed = solve_tensions(base.replace(holes=torch.stack([base.holes, holes])), [2.0, 2.0, 2.0, 2.0])
    assert crossed.status.tolist() == [Status.CONVERGED, Status.INVALID_INPUT]


def test_a_fixed_number_of_steps_has_the_equilibria_of_the_search():
    chain = BUILDS["mixed"]()
    design, inputs = DifferentiableSpatialChain.from_mechanism(chain), inputs_of(chain, solve_lengths)
    found, fixed = solve_lengths(design, inputs), solve_lengths(design, inputs, steps=12)
    assert fixed.poses.numpy() == pytest.approx(found.poses.numpy(), abs=1e-10)
    with as_on_a_device():
        without_looks = solve_lengths(design, inputs)
    assert without_looks.poses.numpy() == pytest.approx(found.poses.numpy(), abs=1e-12)


def test_wrong_inputs_are_refused_in_one_line():
    chain = BUILDS["rolling"]()
    with pytest.raises(rj.InvalidInput, match="DifferentiableSpatialChain"):
        DifferentiableChain.from_mechanism(chain)
    with pytest.raises(rj.InvalidInput, match="DifferentiableChain"):
        DifferentiableSpatialChain.from_mechanism(rj.five_link())
    with pytest.raises(rj.InvalidInput, match="rolling resistance"):
        DifferentiableSpatialChain.from_mechanism(chain.replace(friction=rj.CapstanFriction(0.1, rolling=0.1)))
    with pytest.raises(rj.InvalidInput, match="requires_grad"):
        DifferentiableSpatialChain.from_mechanism(chain, ["hole_arcs"])
    design = DifferentiableSpatialChain.from_mechanism(chain)
    with pytest.raises(rj.InvalidInput, match="shape of the load table"):
        solve_tensions(design, [2.0] * 4, torch.zeros(1, 8))
