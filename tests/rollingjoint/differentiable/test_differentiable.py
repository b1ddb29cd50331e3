"""Differentiable equilibria: values, gradients and failures against the compiled solver, which knows no torch."""

import sys
from pathlib import Path

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint import Link, Profile, RollingChain, Status, Surface, Tendon
from rollingjoint.chain.random_chain import random_chain, random_lengths, random_loads, random_tensions
from rollingjoint.load import LOAD_COLUMNS, load_table
from rollingjoint.statics import sensitivity

torch = pytest.importorskip("torch")

from rollingjoint.differentiable import (  # noqa: E402 - needs torch
    DifferentiableChain,
    linear_pieces,
    solve_lengths,
    solve_tensions,
    spline_pieces,
)
from rollingjoint.differentiable import newton as newton_module  # noqa: E402
from rollingjoint.differentiable import solve as solve_module  # noqa: E402
from rollingjoint.differentiable.design import PARAMETERS  # noqa: E402

torch.set_num_threads(1)

FIELDS = [
    "joint_angles",
    "arc_lengths",
    "poses",
    "contact_points",
    "contact_tangents",
    "tensions",
    "lengths",
    "tendon_rates",
    "contact_forces",
    "stiffness",
    "smallest_eigenvalue",
]
DEAD = [rj.WorldForce(2, (0.3, -0.4), point=(1.0, 2.0))]
EVERY = [*DEAD, rj.Spring(1, 0.02, (30.0, 50.0), (0.5, 1.0)), rj.BodyWrench(-1, (0.1, 0.2), moment=1.0)]
EVERY += [rj.TorsionSpring(2, 4.0, 0.1, 1), rj.TorsionSpring(-1, 3.0, -0.2)]


def mixed():
    """Three links with every form of curvature, holes on surfaces and in links, a tendon that ends early."""
    limits = (-12.0, 12.0)
    forms = [
        Profile.spline(np.linspace(*limits, 5), [0.01, 0.02, 0.03, 0.01, 0.02]),
        Profile.piecewise_constant([-12.0, -3.0, 7.0, 12.0], [-0.04, -0.03, -0.05]),
        Profile.polynomial([0.02, 1e-4, -2e-5, 1e-6], limits),
        Profile.samples(np.linspace(-12.0, 13.0, 6), [-0.05, -0.03, -0.04, -0.05, -0.04, -0.03]),
        Profile.constant(0.03, (-11.0, 14.0)),
        Profile.constant(-0.03, limits),
    ]
    surfaces = [Surface(form, (0.3 * i, 8.0 * (-1) ** (i + 1)), 0.05 * i) for i, form in enumerate(forms)]
    links = [Link(*surfaces[i : i + 2]) for i in (0, 2, 4)]
    tendons = [Tendon.on_surfaces(-8.0, stiffness=3.0), Tendon.on_surfaces(8.5), Tendon([((5.0, -2.0), (4.0, 1.0))], 1)]
    return RollingChain(links, tendons, "mixed")


CASES = {  # mechanism, tensions or lengths less the neutral ones, loads
    "five_link, tensions": (rj.five_link, solve_tensions, (6.0, 3.0), DEAD),
    "five_link, lengths": (rj.five_link, solve_lengths, (-2.0, -1.5), EVERY),
    "two_segment, lengths": (rj.two_segment, solve_lengths, (-2.0, -1.0, -1.5, -2.5), [rj.WorldForce(-1, (0.3, -0.4))]),
    "mixed, tensions": (mixed, solve_tensions, (4.0, 3.0, 2.0), EVERY),
    "at a surface limit": (rj.five_link, solve_tensions, (0.4, 0.5), [rj.WorldForce(-1, (-1.0, -0.1))]),
}


def case(name):
    build, solve, inputs, loads = CASES[name]
    chain = build()
    inputs = np.array(inputs) + (0.0 if solve is solve_tensions else chain.neutral_lengths)
    return chain, solve, inputs, load_table(loads, chain.n_links)


def compiled(solve, chain, inputs, table):
    """The same lane by the solver that knows no torch."""
    batch = rj.solve_tensions_batch if solve is solve_tensions else rj.solve_lengths_batch
    return batch(chain, inputs[None], table[None])


def flat(equilibrium):
    """All fields one behind the other."""
    return np.concatenate([np.ravel(np.asarray(getattr(equilibrium, field), float)) for field in FIELDS])


def blocks(equilibrium):
    """Where each field lies in `flat`."""
    sizes = np.cumsum([0] + [np.size(np.asarray(getattr(equilibrium, field).detach())) for field in FIELDS])
    return {field: slice(*sizes[i : i + 2]) for i, field in enumerate(FIELDS)}


def wiggle(rng, name, design):
    """A direction in one parameter that leaves the mechanism one that can be built."""
    tensor = getattr(design, name)
    step = torch.as_tensor(rng.normal(size=tensor.shape))
    if name == "coefficients":
        return 0.1 * step / 15.0 ** torch.arange(tensor.shape[-1])
    if name == "hole_arcs":
        step[:, 1:, 0] = step[:, :-1, 1]  # facing holes move alike, or they would cross
    if name == "breaks":
        step[tensor == 0.0] = 0.0  # where s = 0 lies on a break, the start of the surface would jump
        step[..., 0], step[..., -1] = step[0, 0, 0], step[0, 0, -1]  # where both surfaces end, they end together
        step = torch.where(tensor == tensor[..., -1:], step[..., -1:], step)  # pieces that stand for none stay none
    return step


def richardson(function, h):
    """Derivative at 0 by two central differences, error O(h⁴)."""
    wide, narrow = ((function(x) - function(-x)) / (2 * x) for x in (h, 0.5 * h))
    return (4 * narrow - wide) / 3


@pytest.mark.parametrize("solver", ["torch", "compiled"])
@pytest.mark.parametrize("name", CASES)
def test_equilibria_are_those_of_the_compiled_solver(name, solver):
    chain, solve, inputs, table = case(name)
    reference = compiled(solve, chain, inputs, table)
    found = solve(DifferentiableChain.from_mechanism(chain), inputs, torch.as_tensor(table), solver=solver)
    assert int(found.status) == reference.status[0]
    for field in FIELDS:
        expected = getattr(reference, field)[0]
        assert getattr(found, field).numpy() == pytest.approx(expected, rel=1e-10, abs=2e-9), field


def test_random_mechanisms_have_the_statuses_and_poses_of_the_compiled_solver(monkeypatch):
    left = []
    whole = solve_module.solve_compiled
    monkeypatch.setattr(solve_module, "solve_compiled", lambda *a: left.append(int(a[-1].sum())) or whole(*a))
    for seed in range(8):
        rng = np.random.default_rng(100 + seed)
        chain = random_chain(rng, 6)
        loads = random_loads(rng, chain.n_links, 1.5)
        if seed % 2:
            batch, solve = rj.solve_tensions_batch, solve_tensions
            inputs = np.array([random_tensions(rng, chain.n_tendons) for _ in range(16)])
        else:
            batch, solve = rj.solve_lengths_batch, solve_lengths
            inputs = np.array([random_lengths(rng, chain) for _ in range(16)])
        reference, found = batch(chain, inputs, loads), solve(DifferentiableChain.from_mechanism(chain), inputs, loads)
        assert found.status.numpy() == pytest.approx(reference.status)
        assert found.joint_angles.numpy() == pytest.approx(reference.joint_angles, abs=1e-9)
    assert sum(left) <= 2  # of 128: the others are found without a table


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_gradients_of_everything_by_everything_match_differences_of_the_compiled_solver(name):
    rng = np.random.default_rng(1)
    chain, solve, inputs, table = case(name)
    design = DifferentiableChain.from_mechanism(chain, PARAMETERS)
    leaves = {parameter: getattr(design, parameter) for parameter in PARAMETERS}
    leaves["inputs"] = torch.tensor(inputs, requires_grad=True)
    leaves["loads"] = torch.tensor(table, requires_grad=True)
    found = solve(design, leaves["inputs"], leaves["loads"])
    outputs = torch.cat([getattr(found, field).flatten() for field in FIELDS])
    rows = [torch.autograd.grad(y, list(leaves.values()), retain_graph=True, allow_unused=True) for y in outputs]

    steps = {parameter: wiggle(rng, parameter, design) for parameter in PARAMETERS}
    steps["inputs"] = torch.as_tensor(rng.normal(size=inputs.shape))
    moving = [column not in ("link", "other") for column in LOAD_COLUMNS]
    steps["loads"] = torch.as_tensor(0.1 * rng.normal(size=table.shape) * moving)
    for column in map(LOAD_COLUMNS.index, ("k", "torsion")):
        steps["loads"][:, column] *= torch.as_tensor(table[:, column] > 0)  # springs stay springs
    if name == "at a surface limit":
        del steps["hole_arcs"]  # the contact is beyond the hole: the facing holes cannot move alike

    for column, (parameter, step) in ((list(leaves).index(key), (key, step)) for key, step in steps.items()):
        gradient = np.array([0.0 if row[column] is None else float((row[column] * step).sum()) for row in rows])

        def moved(x, parameter=parameter, step=step):
            changed = parameter in PARAMETERS
            mechanism = design.replace(**{parameter: leaves[parameter] + x * step}).mechanism() if changed else chain
            values = inputs + (x * step.numpy() if parameter == "inputs" else 0.0)
            loads = table + (x * step.numpy() if parameter == "loads" else 0.0)
            return flat(compiled(solve, mechanism, values, loads))

        numeric = richardson(moved, 1e-3)
        for field, block in blocks(found).items():
            scale = np.abs(numeric[block]).max()
            assert gradient[block] == pytest.approx(numeric[block], abs=1e-6 * scale + 1e-8), (parameter, field)


def jacobian(outputs, leaf):
    rows = [torch.autograd.grad(y, leaf, retain_graph=True)[0] for y in outputs.flatten()]
    return torch.stack(rows).reshape(*outputs.shape, *leaf.shape).numpy()


@pytest.mark.parametrize("name", ["five_link, tensions", "at a surface limit"])
def test_gradients_by_tensions_are_the_sensitivities(name):
    chain, _, inputs, table = case(name)
    reference = rj.solve_tensions(chain, inputs, CASES[name][3])
    tensions = torch.tensor(inputs, requires_grad=True)
    found = solve_tensions(DifferentiableChain.from_mechanism(chain), tensions, torch.as_tensor(table))
    close = {"rel": 1e-9, "abs": 1e-9}
    assert jacobian(found.poses, tensions) == pytest.approx(sensitivity.dposes_dtensions(reference), **close)
    assert jacobian(found.lengths, tensions) == pytest.approx(sensitivity.dlengths_dtensions(reference), **close)


def test_gradients_by_lengths_and_loads_are_the_sensitivities():
    chain, _, inputs, _ = case("five_link, lengths")
    acting = [rj.WorldForce(2, (0.3, -0.4), moment=2.0, point=(3.0, -1.0))]
    reference = rj.solve_lengths(chain, inputs, acting)
    lengths = torch.tensor(inputs, requires_grad=True)
    table = torch.tensor(load_table(acting, chain.n_links), requires_grad=True)
    found = solve_lengths(DifferentiableChain.from_mechanism(chain), lengths, table)
    close = {"rel": 1e-9, "abs": 1e-9}
    assert jacobian(found.poses, lengths) == pytest.approx(sensitivity.dposes_dlengths(reference), **close)
    assert jacobian(found.tensions, lengths) == pytest.approx(sensitivity.dtensions_dlengths(reference), **close)
    by_load = jacobian(found.poses, table)[:, :, 0, [3, 4, 7]]
    assert by_load == pytest.approx(sensitivity.dposes_dload(reference, 2, (3.0, -1.0)), **close)


def test_gradcheck_of_a_small_mechanism():
    chain = rj.uniform(3)
    design = DifferentiableChain.from_mechanism(chain)
    loads = [rj.WorldForce(-1, (0.2, 0.1))]

    def function(coefficients, starts, stiffnesses, lengths):
        changed = design.replace(coefficients=coefficients, starts=starts, stiffnesses=stiffnesses)
        found = solve_lengths(changed, lengths, loads)
        return found.tip, found.tensions, found.contact_forces, found.stiffness / 100.0

    leaves = [design.coefficients, design.starts, design.stiffnesses, torch.as_tensor(chain.neutral_lengths - (2, 1))]
    leaves = [leaf.clone().requires_grad_() for leaf in leaves]
    assert torch.autograd.gradcheck(function, leaves, eps=1e-5, atol=1e-4, rtol=1e-5)


def test_second_derivatives_are_refused():
    design = DifferentiableChain.from_mechanism(rj.uniform(3), ["coefficients"])
    y = solve_tensions(design, (3.0, 1.0)).tip[0]
    (first,) = torch.autograd.grad(y, design.coefficients, create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        first.square().sum().backward()


def test_a_held_joint_moves_with_its_surface_and_with_nothing_else():
    chain, _, inputs, table = case("at a surface limit")
    tensions = torch.tensor(inputs, requires_grad=True)
    design = DifferentiableChain.from_mechanism(chain, ["angles"])
    found = solve_tensions(design, tensions, torch.as_tensor(table))
    assert int(found.status) == Status.AT_LIMIT
    held = int((~found.free_joints).nonzero()[0])
    by_tension, by_angle = torch.autograd.grad(found.joint_angles[held], (tensions, design.angles))
    assert by_tension.abs().max() == 0
    assert by_angle[held, 1] == 1 and by_angle[held + 1, 0] == -1  # child below less parent above
    assert by_angle.abs().sum() == 2


def test_slack_and_yielding_tendons_have_no_influence():
    chain = rj.five_link()
    lengths = torch.as_tensor(chain.neutral_lengths - (6.0, -30.0)).requires_grad_()
    design = DifferentiableChain.from_mechanism(chain, ["stiffnesses"])
    slack = solve_lengths(design, lengths, [rj.WorldForce(-1, (0.2, 0.1))])
    assert slack.ok and slack.tensions[1] == 0 and slack.tendon_stiffness[1] == 0
    for gradient in torch.autograd.grad(slack.tip.sum(), (lengths, design.stiffnesses)):
        assert gradient[0] != 0 and gradient[1] == 0
    highest = torch.tensor([4.0, 4.0], requires_grad=True, dtype=torch.float64)
    pulled = torch.as_tensor(chain.neutral_lengths - (6.0, -6.5)).requires_grad_()
    yielding = solve_lengths(DifferentiableChain.from_mechanism(chain), pulled, tension_limits=(0.0, highest))
    assert yielding.tensions[0] == 4 and yielding.tensions[1] < 4
    by_length, by_limit = torch.autograd.grad(yielding.tip.sum(), (pulled, highest))
    assert by_length[0] == 0 and by_limit[0] != 0 and by_limit[1] == 0
    start, step = pulled.detach().numpy(), np.array([0.0, 1e-4])
    there, back = (
        rj.solve_lengths(chain, start + sign * step, tension_limits=(0.0, 4.0)).tip.sum() for sign in (1, -1)
    )
    assert float(by_length[1]) == pytest.approx((there - back) / 2e-4, rel=1e-6)


def test_where_both_holes_of_a_link_coincide_the_gradient_is_the_mean_of_both_sides():
    through = Tendon([((5.0, 0.0), (5.0, 0.0))] * 5, 4)
    chain = RollingChain(rj.five_link().links, [Tendon.on_surfaces(-10.0), through], "a point")
    design = DifferentiableChain.from_mechanism(chain, requires_grad=["holes"])
    lengths, reach, moved = torch.tensor(chain.neutral_lengths - 1.0), 1e-5, (1, 2, 0, 1)
    here = solve_lengths(design, lengths).tip[0]
    (gradient,) = torch.autograd.grad(here, design.holes)
    step = torch.zeros_like(design.holes)
    step[moved] = reach
    behind, ahead = (solve_lengths(design.replace(holes=design.holes + way * step), lengths).tip[0] for way in (-1, 1))
    left, right = ((way / reach).item() for way in (here - behind, ahead - here))
    assert abs(right - left) > 0.1
    assert 0.5 * (left + right) == pytest.approx(gradient[moved].item(), rel=0, abs=1e-4)


def designs_and_cases():
    factors = torch.tensor([0.9, 1.0, 1.1], dtype=torch.float64)
    base = DifferentiableChain.from_mechanism(rj.five_link())
    coefficients = (base.coefficients * factors[:, None, None, None, None]).requires_grad_()
    tensions = torch.tensor([[3.0, 1.0], [1.0, 4.0]], dtype=torch.float64, requires_grad=True)
    tables = torch.zeros(2, 1, 11, dtype=torch.float64)
    tables[:, 0, [0, 3]] = torch.tensor([[4.0, 0.3], [2.0, -0.5]], dtype=torch.float64)
    return base, coefficients, tensions, tables


@pytest.mark.parametrize("solver", ["torch", "compiled"])
def test_a_table_of_designs_and_load_cases_is_its_single_lanes(solver):
    base, coefficients, tensions, tables = designs_and_cases()
    weights = torch.arange(6.0, dtype=torch.float64).reshape(3, 2, 1)
    table = solve_tensions(base.replace(coefficients=coefficients)[:, None], tensions, tables, solver=solver)
    assert table.tip.shape == (3, 2, 2) and table.stiffness.shape == (3, 2, 4, 4)
    together = torch.autograd.grad((weights * table.tip).sum(), (coefficients, tensions))
    apart = [torch.zeros_like(coefficients), torch.zeros_like(tensions)]
    for d in range(3):
        for c in range(2):
            lane = solve_tensions(base.replace(coefficients=coefficients[d]), tensions[c], tables[c], solver=solver)
            assert lane.tip.detach().numpy() == pytest.approx(table.tip[d, c].detach().numpy(), abs=1e-10)
            gradients = torch.autograd.grad((weights[d, c] * lane.tip).sum(), (coefficients, tensions))
            apart = [total + gradient for total, gradient in zip(apart, gradients, strict=True)]
    for one, other in zip(together, apart, strict=True):
        assert one.numpy() == pytest.approx(other.numpy(), rel=1e-9, abs=1e-9 * float(other.abs().max()))


def broken(base):
    """Designs that cannot be solved, with what is wrong with them."""
    c = base.coefficients
    hollow, nan, wild = c.clone(), c.clone(), c.clone()
    hollow[1, 1, :, 0] = 0.2
    nan[2, 0, 0, 0] = torch.nan
    wild[0, 1, 0, 0] = -1e13
    limits = base.breaks.clone()
    limits[0, 1] += 20.0
    return {
        "surfaces that cut into each other": {"coefficients": hollow},
        "not a number": {"coefficients": nan},
        "a huge number": {"coefficients": wild},
        "a surface without s = 0": {"breaks": limits},
        "a hole beyond its surface": {"hole_arcs": base.hole_arcs + 10.0},
        "a negative stiffness": {"stiffnesses": -base.stiffnesses},
    }


@pytest.mark.parametrize("solver", ["torch", "compiled"])
@pytest.mark.parametrize("what", broken(DifferentiableChain.from_mechanism(rj.five_link())))
def test_a_design_that_cannot_be_built_has_no_gradient_and_leaves_the_others_alone(what, solver):
    base = DifferentiableChain.from_mechanism(rj.five_link())
    both = {name: torch.stack([getattr(base, name)] * 2) for name in PARAMETERS}
    for name, bad in broken(base)[what].items():
        both[name][0] = bad
    leaves = {name: tensor.requires_grad_() for name, tensor in both.items()}
    found = solve_lengths(base.replace(**leaves), rj.five_link().neutral_lengths - 1.0, DEAD, solver=solver)
    assert found.status.tolist() == [Status.INVALID_INPUT, Status.CONVERGED]
    assert_dead_and_finite(found, 0, list(leaves.values()))
    alone = solve_lengths(base, rj.five_link().neutral_lengths - 1.0, DEAD)
    assert found.tip[1].detach().numpy() == pytest.approx(alone.tip.numpy(), abs=1e-9)


def assert_dead_and_finite(found, lane, leaves):
    """Every field is finite, and the lane has a gradient of zero while the others have one."""
    outputs = [getattr(found, field) for field in FIELDS]
    assert all(torch.isfinite(output).all() for output in outputs)
    total = sum(output.sum() for output in outputs)
    for gradient in torch.autograd.grad(total, leaves, allow_unused=True, retain_graph=True):
        if gradient is not None:
            assert torch.isfinite(gradient).all()
            assert gradient[lane].abs().max() == 0


@pytest.mark.parametrize("solver", ["torch", "compiled"])
def test_holes_that_have_changed_places_are_no_equilibrium(solver):
    def pulled(y):
        return [Tendon([((x, -y), (x, y))]) for x in (-8.0, 8.0)]  # the gaps close at about y = 10 mm

    chain = rj.uniform(3, radius=100.0).replace(tendons=pulled(9.0))
    with pytest.raises(rj.MechanismError, match="holes cross"):
        chain.replace(tendons=pulled(11.0))
    upright = [rj.Spring(i, 5.0, (0.0, 20.0 * i)) for i in (1, 2)]
    higher = torch.tensor([1.0, 11.0 / 9.0], dtype=torch.float64)
    design = DifferentiableChain.from_mechanism(chain)
    assert solve_tensions(design, (0.1, 0.1), upright, solver=solver).ok
    crossed = solve_tensions(design.replace(holes=design.holes * higher), (0.1, 0.1), upright, solver=solver)
    assert crossed.status == Status.INVALID_INPUT


BAD_TENSIONS = {"nan": [np.nan, 1.0], "negative": [-1.0, 1.0], "infinite": [np.inf, 1.0], "slack": [0.0, 0.0]}


@pytest.mark.parametrize("what", BAD_TENSIONS)
def test_a_lane_that_fails_has_no_gradient_and_leaves_the_others_alone(what):
    tensions = torch.tensor([BAD_TENSIONS[what], [3.0, 1.0]], dtype=torch.float64, requires_grad=True)
    design = DifferentiableChain.from_mechanism(rj.five_link(), ["starts"])
    found = solve_tensions(design, tensions)
    expected = Status.INDETERMINATE if what == "slack" else Status.INVALID_INPUT
    assert found.status.tolist() == [expected, Status.CONVERGED]
    assert_dead_and_finite(found, 0, [tensions])
    alone = solve_tensions(design, tensions.detach()[1])
    for one, other in ((found.tip[1], alone.tip), (found.smallest_eigenvalue[1], alone.smallest_eigenvalue)):
        assert one.detach().numpy() == pytest.approx(other.detach().numpy(), rel=1e-12)
    both = [
        torch.autograd.grad(y.tip.sum() if y is alone else y.tip[1].sum(), design.starts)[0] for y in (found, alone)
    ]
    assert both[0].numpy() == pytest.approx(both[1].numpy(), rel=1e-9, abs=1e-12)


def test_lanes_with_follower_forces_are_left_to_the_compiled_solver(monkeypatch):
    asked = []
    whole = solve_module.solve_compiled
    monkeypatch.setattr(solve_module, "solve_compiled", lambda *a: asked.append(a[-1].tolist()) or whole(*a))
    tables = torch.zeros(2, 1, 11, dtype=torch.float64)
    tables[:, 0, 0], tables[1, 0, 5] = 4, 0.2
    found = solve_tensions(DifferentiableChain.from_mechanism(rj.five_link()), (6.0, 3.0), tables)
    assert asked == [[False, True]] and found.ok.all()
    reference = rj.solve_tensions(rj.five_link(), (6.0, 3.0), [rj.BodyWrench(4, (0.2, 0.0))])
    assert found.tip[1].numpy() == pytest.approx(reference.tip, abs=1e-9)


def test_lanes_that_go_on_alone_end_where_they_would_have_ended_together(monkeypatch):
    base, coefficients, tensions, tables = designs_and_cases()
    design = base.replace(coefficients=coefficients.detach())[:, None]
    starts = solve_tensions(design, tensions.detach(), tables).joint_angles
    starts[2] = 0.0  # the others are at rest
    put, left = newton_module.LineSearches.put, []
    monkeypatch.setattr(newton_module.LineSearches, "put", lambda *a: left.append(int(a[1].sum())) or put(*a))
    found = []
    for worth in (0, 64):
        monkeypatch.setattr(newton_module, "_WORTH", worth)
        found.append(solve_tensions(design, tensions.detach(), tables, starts=starts))
    assert left[-1] == 2 and found[0].ok.all()
    for name in ("joint_angles", "tensions", "stiffness"):
        one, other = (getattr(part, name).numpy() for part in found)
        assert one == pytest.approx(other, rel=1e-12, abs=1e-12)


def test_starts_choose_the_branch():
    chain = rj.uniform(4)
    design, push = DifferentiableChain.from_mechanism(chain), [rj.WorldForce(-1, (0.0, -12.0))]
    tips = {}
    for side in (-0.4, 0.4):
        reference = rj.solve_tensions(chain, (1.0, 1.0), push, start=[side] * 3)
        found = solve_tensions(design, (1.0, 1.0), push, starts=torch.full((3,), side))
        assert found.tip.numpy() == pytest.approx(reference.tip, abs=1e-8)
        tips[side] = float(found.tip[0])
    assert tips[-0.4] * tips[0.4] < 0


@pytest.mark.parametrize(("pieces", "profile"), [(linear_pieces, Profile.samples), (spline_pieces, Profile.spline)])
def test_knot_values_become_the_coefficients_of_the_profile(pieces, profile):
    knots, values = np.array([-15.0, -7.0, 1.0, 4.0, 15.0]), np.array([[-0.05, -0.03, -0.04, -0.06, -0.02], [0.1] * 5])
    found = pieces(torch.as_tensor(knots), torch.as_tensor(values))
    for row, expected in zip(found, values, strict=True):
        assert row.numpy() == pytest.approx(profile(knots, expected).coefficients, abs=1e-15)
    leaves = [torch.tensor(array, requires_grad=True) for array in (knots, values)]
    assert torch.autograd.gradcheck(pieces, leaves)


def test_a_design_becomes_the_mechanisms_it_came_from():
    chains = [mixed(), mixed().replace(tendons=[*mixed().tendons[:2], Tendon([((5.0, -2.5), (4.0, 1.5))], 1)])]
    design = DifferentiableChain.from_mechanism(chains)
    assert design.batch == (2,)
    for chain, made in zip(chains, design.mechanisms(), strict=True):
        assert made.neutral_lengths == pytest.approx(chain.neutral_lengths, abs=1e-12)
        for link, copy in zip(chain.links, made.links, strict=True):
            for surface, same in ((link.parent, copy.parent), (link.child, copy.child)):
                assert same.profile.breaks == pytest.approx(surface.profile.breaks, abs=0)
                assert (same.start, same.angle) == (surface.start, surface.angle)
    assert design[1].mechanism() is design.mechanism(1)


def test_what_cannot_be_understood_is_refused_by_name():
    design = DifferentiableChain.from_mechanism(rj.five_link())
    with pytest.raises(rj.InvalidInput, match="tensions"):
        solve_tensions(design, (1.0, 1.0, 1.0))
    with pytest.raises(rj.InvalidInput, match="solver"):
        solve_tensions(design, (1.0, 1.0), solver="mujoco")
    with pytest.raises(rj.InvalidInput, match="leading axes"):
        solve_tensions(design.replace(starts=design.starts.expand(3, 5, 2, 2)), torch.ones(2, 2))
    with pytest.raises(rj.InvalidInput, match="load table"):
        solve_tensions(design, (1.0, 1.0), torch.zeros(1, 10))
    with pytest.raises(rj.InvalidInput, match="links"):
        solve_tensions(design, (1.0, 1.0), torch.full((1, len(LOAD_COLUMNS)), 7.0))
    with pytest.raises(rj.InvalidInput, match="curvature"):
        design.replace(curvature=1.0)
    with pytest.raises(rj.InvalidInput, match="starts"):
        design.replace(starts=torch.zeros(4, 2, 2))
    with pytest.raises(rj.InvalidInput, match="mechanism"):
        DifferentiableChain.from_mechanism([rj.five_link(), rj.uniform(4)])


@pytest.mark.skipif(not torch.cuda.is_available(), reason="this machine has no CUDA device")
def test_the_same_on_a_cuda_device():
    _, coefficients, tensions, tables = designs_and_cases()
    results = []
    for device in ("cpu", "cuda"):
        design = DifferentiableChain.from_mechanism(rj.five_link(), device=device)
        design = design.replace(coefficients=coefficients.to(device))[:, None]
        found = solve_tensions(design, tensions.to(device), tables.to(device))
        assert found.tip.device.type == device
        gradients = torch.autograd.grad(found.tip.sum(), (coefficients, tensions))
        results.append([found.tip.detach().cpu(), *gradients])
    for one, other in zip(*results, strict=True):
        assert one.numpy() == pytest.approx(other.numpy(), rel=1e-8, abs=1e-8)


def test_a_network_learns_length_commands_through_the_equilibria(monkeypatch, capsys):
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[3] / "examples")
    monkeypatch.delitem(sys.modules, "equilibrium_layer", raising=False)
    import equilibrium_layer

    torch.manual_seed(0)
    errors, targets, tips = equilibrium_layer.learn(rj.two_segment(), 40)
    assert np.mean(errors[-5:]) < 0.3 * errors[0]
    assert (tips - targets).norm(dim=-1).mean() < 0.3 * errors[0]
    assert capsys.readouterr().out.count("the tip misses by") == 2
