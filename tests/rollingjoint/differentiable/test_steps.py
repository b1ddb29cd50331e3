"""A fixed number of Newton steps: the same equilibria and gradients, and the host never waits for the device."""

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint import InvalidInput, Status
from rollingjoint.load import LOAD_COLUMNS, load_table

torch = pytest.importorskip("torch")

from rollingjoint.differentiable import (  # noqa: E402 - needs torch
    DifferentiableChain,
    DifferentiableFriction,
    as_on_a_device,
    solve_lengths,
    solve_tensions,
)
from tests.host_reads import no_host_reads  # noqa: E402

pytestmark = pytest.mark.usefixtures("one_torch_thread")

ENOUGH = 25
DEAD = [rj.WorldForce(2, (0.3, -0.4), point=(1.0, 2.0))]
EVERY = [*DEAD, rj.Spring(1, 0.02, (30.0, 50.0), (0.5, 1.0)), rj.TorsionSpring(2, 4.0, 0.1, 1)]
CASES = {  # solver, tensions or lengths less the neutral ones, loads
    "tensions": (solve_tensions, [[6.0, 3.0], [3.0, 3.0], [1.0, 5.0]], DEAD),
    "lengths": (solve_lengths, [[-2.0, -1.5], [-1.0, 3.0], [-3.0, -2.0]], EVERY),
    "a surface limit": (solve_tensions, [[0.4, 0.5], [0.5, 0.4]], [rj.WorldForce(-1, (-1.0, -0.1))]),
}


def problem(name):
    """Solver, inputs (rows, m) and load table of a case."""
    solve, rows, loads = CASES[name]
    neutral = 0.0 if solve is solve_tensions else rj.five_link().neutral_lengths
    return solve, torch.tensor(np.array(rows) + neutral), torch.tensor(load_table(loads, 5))


def tips_and_gradients(solve, inputs, table, **how):
    """Tips and statuses, gradients of the sum of all tips by curvature and inputs."""
    design = DifferentiableChain.from_mechanism(rj.five_link(), requires_grad=["coefficients"])
    inputs = inputs.clone().requires_grad_()
    found = solve(design, inputs, table, **how)
    found.tip.sum().backward()
    return found.tip.detach(), found.status, design.coefficients.grad, inputs.grad


@pytest.mark.parametrize("name", CASES)
def test_enough_steps_find_the_equilibria_and_gradients_of_the_solver_that_looks(name):
    expected = tips_and_gradients(*problem(name))
    found = tips_and_gradients(*problem(name), steps=ENOUGH)
    for ours, theirs in zip(found, expected, strict=True):
        np.testing.assert_allclose(ours.numpy(), theirs.numpy(), rtol=1e-8, atol=1e-9)
    if name == "a surface limit":
        assert Status.AT_LIMIT in found[1].tolist()


@pytest.mark.parametrize("name", CASES)
def test_with_steps_nothing_is_read_back_forwards_or_backwards(name):
    solve, inputs, table = problem(name)
    design = DifferentiableChain.from_mechanism(rj.five_link(), requires_grad=["coefficients"])
    solve(design, inputs, table, steps=1)  # nodes of the quadrature are kept
    with no_host_reads():
        found = solve(design, inputs, table, steps=3)
    with as_on_a_device(), no_host_reads():
        (found.tip.sum() + found.tensions.sum() + found.poses.sum()).backward()


def test_without_steps_something_is_read_back():
    solve, inputs, table = problem("tensions")
    with pytest.raises(AssertionError, match="wait for the device"), no_host_reads():
        solve(DifferentiableChain.from_mechanism(rj.five_link()), inputs, table)


@pytest.mark.parametrize("name", CASES)
def test_looks_that_only_save_work_change_no_result(name):
    expected = tips_and_gradients(*problem(name))
    with as_on_a_device():
        found = tips_and_gradients(*problem(name))
    for ours, theirs in zip(found, expected, strict=True):
        np.testing.assert_allclose(ours.numpy(), theirs.numpy(), rtol=1e-9, atol=1e-11)


def test_a_row_that_has_not_arrived_is_not_converged_and_has_no_gradient():
    solve, inputs, table = problem("tensions")
    tip, status, _, gradient = tips_and_gradients(solve, inputs, table, steps=1)
    assert status.tolist() == [Status.NOT_CONVERGED] * 3
    assert torch.isfinite(tip).all() and (gradient == 0.0).all()


def test_rows_that_cannot_be_solved_leave_the_others_as_they_are():
    design = DifferentiableChain.from_mechanism(rj.five_link())
    table = torch.zeros(5, 1, len(LOAD_COLUMNS), dtype=torch.float64)
    table[3, 0, 0] = 9.0  # a link that does not exist
    tensions = torch.tensor([[6.0, 3.0], [float("nan"), 3.0], [0.0, 0.0], [6.0, 3.0], [6.0, -1.0]])
    found = solve_tensions(design, tensions.double(), table, steps=ENOUGH)
    bad = Status.INVALID_INPUT
    assert found.status.tolist() == [Status.CONVERGED, bad, Status.NOT_CONVERGED, bad, bad]
    expected = solve_tensions(design, tensions[0].double())
    np.testing.assert_allclose(found.tip[0].numpy(), expected.tip.numpy(), rtol=0, atol=1e-10)


def test_a_start_at_which_the_stiffness_is_indefinite_goes_down_the_gradient():
    design = DifferentiableChain.from_mechanism(rj.five_link())
    pushed = torch.tensor(load_table([rj.WorldForce(-1, (0.2, -4.0))], 5))
    tensions = torch.tensor([[0.5, 0.5]], dtype=torch.float64)
    found = solve_tensions(design, tensions, pushed, steps=400)
    expected = solve_tensions(design, tensions, pushed)
    assert bool(expected.ok.all()) and found.status.tolist() == expected.status.tolist()
    np.testing.assert_allclose(found.tip.numpy(), expected.tip.numpy(), rtol=0, atol=1e-6)


def test_steps_with_friction_are_those_of_the_solver_that_looks():
    design = DifferentiableChain.from_mechanism(rj.five_link())
    friction, commands = DifferentiableFriction(0.08), torch.tensor(rj.five_link().neutral_lengths - 0.6)
    limits = {"friction": friction, "tension_limits": (0.5, 15.0)}
    paths = []
    for how in ({}, {"steps": ENOUGH}):
        state = solve_tensions(design, torch.full((2,), 3.0, dtype=torch.float64), friction=friction)
        for pull in (2.0, 3.0, 1.0):
            lengths = commands + pull * torch.tensor([-1.0, 1.0])
            state = solve_lengths(design, lengths, history=state, **limits, **how)
        paths.append(state)
    assert bool(paths[1].ok) and bool((paths[1].gap_tensions.diff(dim=0).abs() > 1e-3).any())
    np.testing.assert_allclose(paths[1].tip.numpy(), paths[0].tip.numpy(), rtol=0, atol=1e-8)


def test_a_surface_that_winds_too_far_is_refused_where_nobody_looks():
    design = DifferentiableChain.from_mechanism(rj.five_link())
    curvature = design.coefficients.clone()
    curvature[:, 0, :, 0] = 0.9  # of every parent surface: 13 rad and more in a piece
    wound, tensions = design.replace(coefficients=curvature), torch.tensor([3.0, 3.0]).double()
    assert solve_tensions(wound, tensions).status.item() != Status.INVALID_INPUT
    assert solve_tensions(wound, tensions, steps=3).status.item() == Status.INVALID_INPUT


@pytest.mark.parametrize("how", [{"steps": 0}, {"steps": 1.5}, {"steps": 3, "solver": "compiled"}])
def test_steps_that_cannot_be_used_are_refused(how):
    design = DifferentiableChain.from_mechanism(rj.five_link())
    with pytest.raises(InvalidInput, match="steps"):
        solve_tensions(design, torch.tensor([3.0, 3.0]).double(), **how)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="this machine has no CUDA device")
def test_a_solve_with_steps_does_not_synchronise_a_cuda_device():
    solve, inputs, table = problem("lengths")
    design = DifferentiableChain.from_mechanism(rj.five_link(), device="cuda")
    inputs, table = inputs.cuda(), table.cuda()
    solve(design, inputs, table, steps=3)
    torch.cuda.set_sync_debug_mode("error")
    try:
        solve(design, inputs, table, steps=3)
    finally:
        torch.cuda.set_sync_debug_mode("default")
