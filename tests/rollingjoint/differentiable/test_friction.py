"""Torch equilibria with tendon friction: values against two independent methods, gradients against differences."""

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint import Status
from rollingjoint.chain.random_chain import random_chain, random_loads, random_tensions
from rollingjoint.load import LOAD_COLUMNS, load_table

torch = pytest.importorskip("torch")

from rollingjoint.differentiable import (  # noqa: E402 - needs torch
    DifferentiableChain,
    DifferentiableFriction,
    FrictionStates,
    solve_lengths,
    solve_tensions,
)
from rollingjoint.differentiable import solve as solve_module  # noqa: E402

torch.set_num_threads(1)

# Source: reference cases of tendon friction, found by a Newton method in joint angles and, independently, by the force
# balance of every link with all hole forces; the two agree to 1e-11. Every case starts at 3 N per tendon.
# Mechanism, friction, tension limits; of every step: tensions, or lengths less those at the start, force along x at the
# tip, where the tip comes to rest, and the tensions in gap 0.
REFERENCE = {
    "tensions, pulled and released": (
        rj.five_link,
        {"mu": 0.1},
        None,
        [
            ((9.0, 3.0), 0.0, (-50.97204472816, 54.57640618085), (8.67208962531, 3.01666536973)),
            ((7.5, 3.0), 0.0, (-50.60871210553, 54.96498005649), (7.77702556977, 2.98459228203)),
        ],
    ),
    "lengths, differential and then both pulled, compliance": (
        rj.five_link,
        {"mu": 0.1, "compliance": 0.08},
        (0.5, 15.0),
        [
            ((-2.0, 2.0), 0.0, (-41.02852682355, 65.13296879187), (4.29551081171, 2.87140660151)),
            ((-3.0, 1.0), 0.0, (-40.12880184033, 65.77772289432), (9.43339102246, 7.36855861098)),
        ],
    ),
    "lengths, presliding": (
        rj.five_link,
        {"mu": 0.2, "presliding": 0.05},
        (0.5, 15.0),
        [((-0.1, 0.1), 0.0, (-35.41259208548, 69.3724803636), (3.0032115578, 2.84451830309))],
    ),
    "lengths, one tendon slack": (
        rj.five_link,
        {"mu": 0.1},
        (0.0, 15.0),
        [((-2.0, 8.0), 0.3, (-34.65847097054, 68.64386378365), (1.47902883245, 0.0))],
    ),
    "four tendons, two end half way": (
        rj.two_segment,
        {"mu": 0.1},
        None,
        [
            (
                (6.0, 3.0, 4.0, 3.0),
                0.0,
                (-40.551670614, 78.51588034416),
                (5.93798905372, 3.03132926604, 3.95865936915, 3.03132926604),
            )
        ],
    ),
    "extra turn and constant friction": (
        rj.five_link,
        {"mu": 0.1, "extra_turn": 0.1, "constant": 0.02},
        None,
        [
            ((6.0, 3.0), 0.0, (-44.37165934439, 62.1288186505), (5.72690714956, 3.06141508791)),
            ((5.0, 3.0), 0.0, (-44.10174352074, 62.34683847395), (5.21597998341, 2.93987178297)),
        ],
    ),
}
FIELDS = [
    "tip",
    "gap_tensions",
    "friction_states",
    "dissipated_work",
    "slip",
    "lengths",
    "tensions",
    "contact_forces",
    "stiffness",
]
NUMBERS = ["mu", "presliding", "extra_turn", "constant", "compliance"]


def started(design, friction):
    """The start of every case, and its length commands at 3 N."""
    start = solve_tensions(design, (3.0,) * design.n_tendons, friction=friction)
    return start, start.lengths.detach() - 3.0 / 5.0


@pytest.mark.parametrize("name", REFERENCE)
def test_steps_end_where_two_independent_methods_put_them(name):
    build, numbers, limits, steps = REFERENCE[name]
    design, friction = DifferentiableChain.from_mechanism(build()), DifferentiableFriction(**numbers)
    found, command = started(design, friction)
    for inputs, force, tip, first_gap in steps:
        loads = [rj.WorldForce(-1, (force, 0.0))]
        if limits is None:
            found = solve_tensions(design, inputs, loads, friction=friction, history=found)
        else:
            lengths = command + torch.tensor(inputs, dtype=torch.float64)
            found = solve_lengths(design, lengths, loads, friction=friction, history=found, tension_limits=limits)
        assert found.status == Status.CONVERGED
        assert found.tip.numpy() == pytest.approx(tip, abs=1e-10)
        assert found.gap_tensions[0].numpy() == pytest.approx(first_gap, abs=1e-10)


def test_one_joint_slides_to_the_closed_form():
    """ln(T_l / T_r) - mu |phi| = ln(sin((w - s) / R) / sin((w + s) / R)) of two circles, s = -R phi / 2."""
    mu, radius, half_width, ratio = 0.2, 20.0, 10.0, 2.0
    design, friction = DifferentiableChain.from_mechanism(rj.uniform(2)), DifferentiableFriction(mu)
    found = solve_tensions(design, (6.0, 3.0), friction=friction, history=started(design, friction)[0])
    phi = found.joint_angles.item()
    s = -0.5 * radius * phi
    sines = np.sin((half_width - s) / radius) / np.sin((half_width + s) / radius)
    assert np.log(ratio) - mu * phi == pytest.approx(np.log(sines), abs=1e-12)
    assert s == pytest.approx(-3.28916954762, abs=1e-10)


STEP_FIELDS = ["joint_angles", "poses", "gap_tensions", "friction_states", "slip", "dissipated_work"]
STEP_FIELDS += ["tensions", "lengths", "stiffness", "smallest_eigenvalue", "sticking"]


@pytest.mark.parametrize("solver", ["torch", "compiled"])
@pytest.mark.parametrize("seed", range(3))
def test_steps_are_those_of_the_compiled_solver(seed, solver):
    rng = np.random.default_rng(seed)
    friction = rj.CapstanFriction(
        *rng.uniform((0.02, 0.02), (0.2, 0.05)), *rng.uniform(0, (0.1, 0.02)), compliance=0.05
    )
    chain = random_chain(rng, 5).replace(friction=friction)
    design = DifferentiableChain.from_mechanism(chain)
    tensions = np.array([random_tensions(rng, chain.n_tendons) for _ in range(8)])
    known = rj.solve_tensions_batch(chain, tensions)
    found = solve_tensions(design, tensions)
    command = known.lengths - known.tensions / chain.stiffnesses
    for _ in range(3):
        command = command + rng.uniform(-1, 1, command.shape)
        loads = random_loads(rng, chain.n_links, 0.2)
        known = rj.solve_lengths_batch(chain, command, loads, tension_limits=(0.0, 15.0), history=known)
        found = solve_lengths(design, command, loads, tension_limits=(0.0, 15.0), history=found, solver=solver)
        assert found.status.tolist() == known.status.tolist()
        for field in STEP_FIELDS:
            expected = np.asarray(getattr(known, field), float)
            scale = 1.0 + np.abs(expected[known.ok]).max() * 1e2
            assert np.asarray(getattr(found, field), float)[known.ok] == pytest.approx(
                expected[known.ok], abs=1e-9 * scale
            ), field
        for name in ("states", "slips", "grips", "angles"):
            expected, close = getattr(known.friction_state, name), 1e-6 if name == "grips" else 2e-7
            assert getattr(found.friction_state, name).numpy() == pytest.approx(expected, abs=close), name


PATHS = {  # friction, tension limits, steps of inputs and forces at the tip; what the friction states at the end are
    "sliding": ({}, None, [((9.0, 3.0), (0.0, 0.0))], {"slide": 8, "stick": 0}),
    "mixed": ({}, None, [((9.0, 3.0), (0.0, 0.0)), ((7.5, 3.05), (0.3, 0.0))], {"slide": 6, "stick": 2}),
    "stuck": (
        {"mu": 0.2, "presliding": 0.05},
        (0.5, 15.0),
        [((-0.1, 0.1), (0.01, 0.0))],
        {"slide": 0, "stick": 8},
    ),
    "three steps with everything": (
        {"extra_turn": 0.1, "constant": 0.02, "compliance": 0.08},
        (0.5, 15.0),
        [((-2.0, 2.0), (0.0, 0.0)), ((-3.0, 1.0), (0.3, 0.0)), ((-2.2, 0.3), (0.2, 0.1))],
        {"slide": 6, "stick": 2},
    ),
}


def walk(base, leaves, limits, path):
    """The equilibrium at the end of a path, from everything that it depends on."""
    friction = DifferentiableFriction(*(leaves[name] for name in NUMBERS))
    design = base.replace(**{name: leaves[name] for name in ("coefficients", "hole_arcs", "stiffnesses")})
    found = solve_tensions(design, leaves["start"], friction=friction)
    neutral = torch.tensor(rj.five_link().neutral_lengths) - 0.6
    for inputs, force in path:
        loads = torch.as_tensor(load_table([rj.WorldForce(-1, force)], design.n_links)) + leaves["loads"]
        moved = torch.tensor(inputs, dtype=torch.float64) + leaves["inputs"]
        step = {"friction": friction, "history": found}
        if limits is None:
            found = solve_tensions(design, moved, loads, **step)
        else:
            found = solve_lengths(design, neutral + moved, loads, tension_limits=limits, **step)
    assert found.ok.all()
    return found


def path_leaves(base, numbers):
    """Everything that the end of a path depends on."""
    numbers = dict.fromkeys(NUMBERS, 0.0) | {"mu": 0.1, "presliding": 0.02} | numbers
    leaves = {name: torch.full((2,), value, dtype=torch.float64) for name, value in numbers.items()}
    leaves |= {name: getattr(base, name).clone() for name in ("coefficients", "hole_arcs", "stiffnesses")}
    leaves |= {"inputs": torch.zeros(2, dtype=torch.float64), "start": torch.full((2,), 3.0, dtype=torch.float64)}
    leaves["loads"] = torch.zeros(1, len(LOAD_COLUMNS), dtype=torch.float64)
    return {name: leaf.requires_grad_() for name, leaf in leaves.items()}


def directions(rng, leaves):
    """A direction in every leaf that leaves the step one that can be solved."""
    steps = {name: torch.as_tensor(rng.normal(size=leaf.shape)) for name, leaf in leaves.items()}
    for name in NUMBERS:
        steps[name] = 0.1 * steps[name] * (leaves[name] > 0)
    steps["coefficients"] = 0.01 * steps["coefficients"] / 15.0 ** torch.arange(leaves["coefficients"].shape[-1])
    steps["hole_arcs"][:, 1:, 0] = steps["hole_arcs"][:, :-1, 1]  # facing holes move alike, or they would cross
    moving = torch.tensor([column in ("fx", "fy") for column in LOAD_COLUMNS])
    steps["loads"] = 0.1 * torch.where(moving, steps["loads"], 0.0)
    return steps


def weighted(found, weights):
    """One number of every field, (..., fields)."""
    rows = found.status.shape
    sums = [(getattr(found, name) * weight).reshape(*rows, -1).sum(-1) for name, weight in weights.items()]
    return torch.stack(sums, -1)


def assert_gradients_match_differences(function, leaves, steps):
    """Of a function of the leaves, (..., fields), by every leaf along its step; differences of lanes, error O(h⁴)."""
    rows = [
        torch.autograd.grad(y, list(leaves.values()), retain_graph=True, allow_unused=True) for y in function(leaves)
    ]
    reaches = 1e-4 * torch.tensor([1.0, -1.0, 0.5, -0.5], dtype=torch.float64)
    lanes = {}
    for place, (name, leaf) in enumerate(leaves.items()):
        lanes[name] = leaf.detach().expand(len(leaves), 4, *leaf.shape).clone()
        lanes[name][place] += torch.tensordot(reaches, steps[name], 0)
    moved = function(lanes)
    wide, narrow = (moved[:, 0] - moved[:, 1]) / 2e-4, (moved[:, 2] - moved[:, 3]) / 1e-4
    for column, name in enumerate(leaves):
        gradient = [0.0 if row[column] is None else float((row[column] * steps[name]).sum()) for row in rows]
        numeric = ((4 * narrow - wide) / 3)[column].numpy()
        assert gradient == pytest.approx(numeric, rel=1e-6, abs=1e-8 * np.abs(numeric).max() + 1e-5), name


@pytest.mark.slow
@pytest.mark.parametrize("name", PATHS)
def test_gradients_along_a_path_match_differences(name, monkeypatch):
    monkeypatch.setattr(solve_module, "solve_compiled", lambda *_: pytest.fail("the torch solver got stuck"))
    numbers, limits, path, kinds = PATHS[name]
    rng = np.random.default_rng(2)
    base = DifferentiableChain.from_mechanism(rj.five_link())
    leaves = path_leaves(base, numbers)
    found = walk(base, leaves, limits, path)
    assert int(found.sticking.sum()) == kinds["stick"]
    assert int((found.friction_states.abs() == 1.0).sum()) == kinds["slide"]
    weights = {field: torch.as_tensor(rng.normal(size=getattr(found, field).shape)) for field in FIELDS}
    steps = directions(rng, leaves)
    assert_gradients_match_differences(
        lambda values: weighted(walk(base, values, limits, path), weights), leaves, steps
    )


def test_gradients_by_the_history_match_differences():
    rng = np.random.default_rng(3)
    design, friction = DifferentiableChain.from_mechanism(rj.five_link()), DifferentiableFriction(0.1)
    pulled = solve_tensions(design, (9.0, 3.0), friction=friction, history=started(design, friction)[0])
    before = pulled.friction_state
    leaves = {"states": 0.8 * before.states, "slips": before.slips.clone()}
    leaves = {name: leaf.requires_grad_() for name, leaf in leaves.items()}

    def step(values):
        history = FrictionStates(values["states"], values["slips"], before.grips, before.angles)
        return solve_tensions(design, (7.5, 3.05), friction=friction, history=history)

    found = step(leaves)
    assert 0 < int(found.sticking.sum()) < 8
    weights = {field: torch.as_tensor(rng.normal(size=getattr(found, field).shape)) for field in FIELDS}
    steps = {name: 0.1 * torch.as_tensor(rng.normal(size=leaf.shape)) for name, leaf in leaves.items()}
    assert_gradients_match_differences(lambda values: weighted(step(values), weights), leaves, steps)


def test_a_detached_history_stops_gradients():
    design = DifferentiableChain.from_mechanism(rj.five_link())
    mu = torch.tensor(0.1, dtype=torch.float64, requires_grad=True)
    friction = DifferentiableFriction(mu)
    pulled = solve_tensions(design, (9.0, 3.0), friction=friction, history=started(design, friction)[0])
    constant = DifferentiableFriction(0.1)
    attached = solve_tensions(design, (7.5, 3.05), friction=constant, history=pulled)
    assert torch.autograd.grad(attached.tip.sum(), mu, retain_graph=True)[0] != 0
    cut = solve_tensions(design, (7.5, 3.05), friction=constant, history=pulled.friction_state.detach())
    assert cut.tip.tolist() == attached.tip.tolist() and not cut.tip.requires_grad


def test_without_friction_there_is_none_and_at_a_start_none_acts():
    design = DifferentiableChain.from_mechanism(rj.five_link())
    mu = torch.tensor(0.1, dtype=torch.float64, requires_grad=True)
    free = solve_tensions(design, (6.0, 3.0), DEAD)
    start = solve_tensions(design, (6.0, 3.0), DEAD, friction=DifferentiableFriction(mu))
    for found in (free, start):
        assert found.gap_tensions.tolist() == [[6.0, 3.0]] * 4
        assert found.friction_states.abs().max() == 0
    assert start.tip.tolist() == free.tip.tolist()
    assert not start.tip.requires_grad
    assert free.friction_state.angles.tolist() == free.joint_angles.tolist()


def test_without_friction_a_history_is_where_to_start():
    design, push = DifferentiableChain.from_mechanism(rj.uniform(4)), [rj.WorldForce(-1, (0.0, -12.0))]
    left = solve_tensions(design, (1.0, 1.0), push, starts=torch.full((3,), 0.4))
    assert solve_tensions(design, (1.0, 1.0), push, history=left).tip.numpy() == pytest.approx(left.tip.numpy())


DEAD = [rj.WorldForce(2, (0.3, -0.4), point=(1.0, 2.0))]


def test_no_friction_at_mu_zero():
    design = DifferentiableChain.from_mechanism(rj.five_link())
    friction = DifferentiableFriction(0.0)
    found = solve_tensions(design, (6.0, 3.0), DEAD, friction=friction, history=started(design, friction)[0])
    free = solve_tensions(design, (6.0, 3.0), DEAD)
    assert found.tip.numpy() == pytest.approx(free.tip.numpy(), abs=1e-11)
    assert found.stiffness.numpy() == pytest.approx(free.stiffness.numpy(), abs=1e-9)


def test_every_lane_has_its_own_friction_and_history():
    design = DifferentiableChain.from_mechanism(rj.five_link())
    mu = torch.tensor([[0.0], [0.05], [0.1], [0.2]], dtype=torch.float64, requires_grad=True)
    tensions = torch.tensor([[9.0, 3.0], [7.5, 3.0], [6.0, 4.0], [9.0, 3.0]], dtype=torch.float64)
    friction = DifferentiableFriction(mu)
    start = solve_tensions(design, tensions.flip(0), friction=friction)
    together = solve_tensions(design, tensions, DEAD, friction=friction, history=start)
    (gradient,) = torch.autograd.grad(together.tip.sum(), mu)
    for lane in range(4):
        alone = DifferentiableFriction(mu[lane])
        start = solve_tensions(design, tensions[3 - lane], friction=alone)
        one = solve_tensions(design, tensions[lane], DEAD, friction=alone, history=start)
        assert one.tip.detach().numpy() == pytest.approx(together.tip[lane].detach().numpy(), abs=1e-10)
        (by_mu,) = torch.autograd.grad(one.tip.sum(), mu)
        assert by_mu[lane].item() == pytest.approx(gradient[lane].item(), rel=1e-8)


BAD_FRICTION = {
    "beyond the range of mu": {"mu": 0.3},
    "negative mu": {"mu": -0.1},
    "not a number": {"mu": np.nan},
    "hardly any presliding": {"presliding": 0.005},
    "negative extra turn": {"extra_turn": -0.1},
    "negative constant": {"constant": -0.1},
    "negative compliance": {"compliance": -0.1},
}


@pytest.mark.parametrize("what", BAD_FRICTION)
def test_a_lane_whose_friction_cannot_be_solved_has_no_gradient_and_leaves_the_others_alone(what):
    design = DifferentiableChain.from_mechanism(rj.five_link())
    good = {"mu": 0.1, "presliding": 0.02, "extra_turn": 0.0, "constant": 0.0, "compliance": 0.0}
    both = {name: [[value], [(good | BAD_FRICTION[what])[name]]] for name, value in good.items()}
    leaves = {name: torch.tensor(value, dtype=torch.float64, requires_grad=True) for name, value in both.items()}
    history = started(design, DifferentiableFriction(0.1))[0]
    found = solve_tensions(design, (6.0, 3.0), DEAD, friction=DifferentiableFriction(**leaves), history=history)
    assert found.status.tolist() == [Status.CONVERGED, Status.INVALID_INPUT]
    outputs = [getattr(found, field) for field in (*FIELDS, "smallest_eigenvalue")]
    assert all(torch.isfinite(output).all() for output in outputs)
    gradients = torch.autograd.grad(sum(output.sum() for output in outputs), list(leaves.values()))
    assert gradients[0][0] != 0 and all(gradient[1] == 0 for gradient in gradients)
    alone = solve_tensions(design, (6.0, 3.0), DEAD, friction=DifferentiableFriction(0.1), history=history)
    assert found.tip[0].detach().numpy() == pytest.approx(alone.tip.numpy(), abs=1e-10)


def test_what_cannot_be_understood_is_refused_by_name():
    design = DifferentiableChain.from_mechanism(rj.five_link())
    friction = DifferentiableFriction(0.1)
    other = solve_tensions(DifferentiableChain.from_mechanism(rj.uniform(3)), (3.0, 3.0), friction=friction)
    with pytest.raises(rj.InvalidInput, match="history"):
        solve_tensions(design, (3.0, 3.0), friction=friction, history=other)
    with pytest.raises(rj.InvalidInput, match="history = 3"):
        solve_tensions(design, (3.0, 3.0), friction=friction, history=3)
    with pytest.raises(
        rj.InvalidInput, match=r"friction = 0\.1: expected a DifferentiableFriction or a CapstanFriction"
    ):
        solve_tensions(design, (3.0, 3.0), friction=0.1)
    with pytest.raises(rj.InvalidInput, match="rolling resistance"):
        solve_tensions(design, (3.0, 3.0), friction=rj.CapstanFriction(0.1, rolling=0.05))
    with pytest.raises(rj.InvalidInput, match="rolling resistance"):
        DifferentiableChain.from_mechanism(rj.five_link().replace(friction=rj.CapstanFriction(0.1, rolling=0.05)))
    with pytest.raises(rj.InvalidInput, match="shape of mu"):
        solve_tensions(design, (3.0, 3.0), friction=DifferentiableFriction(torch.full((3,), 0.1)))
    with pytest.raises(rj.InvalidInput, match="leading axes"):
        wide = DifferentiableFriction(torch.full((3, 1), 0.1))
        solve_tensions(design, torch.ones(2, 2), friction=wide)


def test_the_energy_of_stiffness_is_that_of_the_nonsymmetric_jacobian():
    design, friction = DifferentiableChain.from_mechanism(rj.five_link()), DifferentiableFriction(0.1)
    found = solve_tensions(design, (9.0, 3.0), friction=friction, history=started(design, friction)[0])
    H = found.stiffness
    assert (H - H.mT).abs().max() > 1e-3 * H.abs().max()
    assert found.smallest_eigenvalue.item() == pytest.approx(np.linalg.eigvals(H.numpy()).real.min(), rel=1e-12)


def test_a_step_that_repeats_its_inputs_has_the_derivatives_of_sliding_on():
    design, friction = DifferentiableChain.from_mechanism(rj.five_link()), DifferentiableFriction(0.1)
    start, rest = started(design, friction)
    command = (rest + torch.tensor([-2.0, 2.0])).requires_grad_()
    step = {"friction": friction, "tension_limits": (0.5, 15.0)}
    there = solve_lengths(design, command.detach(), history=start, **step)
    for _ in range(3):
        there = solve_lengths(design, command.detach(), history=there.friction_state, **step)
    found = solve_lengths(design, command, history=there, **step)
    assert not found.sticking.any()
    on = torch.tensor([-1e-5, 1e-5], dtype=torch.float64)
    further = solve_lengths(design, command.detach() + on, history=there, **step)
    (gradient,) = torch.autograd.grad(found.tip[0], command)
    assert float((gradient * on).sum()) == pytest.approx(float(further.tip[0] - found.tip[0].detach()), rel=1e-4)


def test_a_design_keeps_the_friction_of_its_mechanism():
    friction = rj.CapstanFriction(0.1, 0.03, 0.05, 0.01, compliance=0.05)
    chain = rj.five_link().replace(friction=friction)
    assert [tendon.friction for tendon in DifferentiableChain.from_mechanism(chain).mechanism().tendons] == [
        friction
    ] * 2
    other = rj.five_link().replace(
        tendons=[
            rj.Tendon.on_surfaces(s, friction=rj.CapstanFriction(mu))
            for s, mu in zip((-10.0, 10.0), (0.05, 0.2), strict=True)
        ]
    )
    plain = DifferentiableChain.from_mechanism(rj.five_link())
    assert plain.friction is None and plain.mechanism().tendons[0].friction is None
    both = DifferentiableChain.from_mechanism([chain, other, rj.five_link()])
    start = solve_tensions(both, (3.0, 3.0))
    found = solve_tensions(both, (9.0, 4.0), DEAD, history=start)
    for lane, each in enumerate((chain, other)):
        known = rj.solve_tensions(each, (9.0, 4.0), DEAD, history=rj.solve_tensions(each, (3.0, 3.0)))
        for field in ("tip", "gap_tensions", "contact_forces", "slip", "stiffness"):
            assert getattr(found, field)[lane].numpy() == pytest.approx(getattr(known, field), rel=1e-9, abs=1e-8), (
                field
            )
        alone = solve_tensions(both[lane], (9.0, 4.0), DEAD, history=known.friction_state)
        assert alone.gap_tensions.numpy() == pytest.approx(known.gap_tensions, abs=1e-9)
    assert found.gap_tensions[2].tolist() == [[9.0, 4.0]] * 4
    given = solve_tensions(plain, (9.0, 4.0), DEAD, friction=friction, history=start.friction_state)
    replaced = solve_tensions(plain.replace(friction=friction), (9.0, 4.0), DEAD, history=start)
    assert given.tip[0].tolist() == replaced.tip[0].tolist() == pytest.approx(found.tip[0].tolist(), abs=1e-10)


@pytest.mark.parametrize("tensions", [(np.nan, 3.0), (0.0, 0.0)])
def test_a_lane_that_fails_remembers_what_the_compiled_solver_remembers(tensions):
    chain = rj.five_link().replace(friction=rj.CapstanFriction(0.1))
    design = DifferentiableChain.from_mechanism(chain)
    mu = torch.tensor(0.1, dtype=torch.float64, requires_grad=True)
    friction = DifferentiableFriction(mu)
    inputs = np.array([tensions, (8.0, 3.0)])
    known = rj.solve_tensions_batch(chain, [(9.0, 3.0)] * 2, history=rj.solve_tensions(chain, (3.0, 3.0)))
    found = solve_tensions(design, (9.0, 3.0), friction=friction, history=started(design, friction)[0])
    known = rj.solve_tensions_batch(chain, inputs, history=known)
    found = solve_tensions(design, inputs, friction=friction, history=found)
    assert found.status.tolist() == known.status.tolist() and not found.ok[0]
    for name in ("states", "slips", "grips", "angles"):
        remembered = getattr(found.friction_state, name)
        assert remembered.detach().numpy() == pytest.approx(getattr(known.friction_state, name), abs=1e-8)
        assert torch.autograd.grad(remembered[0].sum(), mu, retain_graph=True)[0] == 0
    assert found.dissipated_work.detach().numpy() == pytest.approx(known.dissipated_work, abs=1e-9)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="this machine has no CUDA device")
def test_the_same_on_a_cuda_device():
    results = []
    for device in ("cpu", "cuda"):
        design = DifferentiableChain.from_mechanism(rj.five_link(), device=device)
        mu = torch.full((4, 1), 0.1, dtype=torch.float64, requires_grad=True)
        friction = DifferentiableFriction(mu.to(device))
        found = solve_tensions(
            design, torch.tensor([9.0, 3.0]), friction=friction, history=started(design, friction)[0]
        )
        found = solve_tensions(design, torch.tensor([7.5, 3.05]), friction=friction, history=found)
        assert found.tip.device.type == device and found.friction_state.states.device.type == device
        results.append([found.tip.detach().cpu(), torch.autograd.grad(found.tip.sum(), mu)[0]])
    for one, other in zip(*results, strict=True):
        assert one.numpy() == pytest.approx(other.numpy(), rel=1e-8, abs=1e-8)
