"""Steps with friction against two other methods, a closed form, and what any law of dry friction must keep."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rollingjoint import (
    CapstanFriction,
    FrictionState,
    RollingChain,
    Status,
    WorldForce,
    five_link,
    solve_lengths,
    solve_lengths_batch,
    solve_tensions,
    trace,
    two_segment,
    uniform,
)
from rollingjoint.chain import batch
from rollingjoint.chain.friction_step import friction_laws
from rollingjoint.kernels.arrays import TendonLaw
from rollingjoint.kernels.friction import History, new_friction_arrays
from rollingjoint.kernels.rolling import BatchArrays, new_results
from rollingjoint.load import load_table

CASES = json.loads((Path(__file__).parent / "friction_reference.json").read_text("utf-8"))["cases"]
CHAINS = {"five_link": five_link, "two_segment": two_segment, "uniform2": partial(uniform, 2)}
LIMITS = (0.5, 15.0)


def at_rest(chain, tension=3.0):
    """The equilibrium under equal tensions in which nothing has ever slipped, and the command that holds it."""
    begin = solve_tensions(chain, np.full(chain.n_tendons, tension))
    return begin, begin.lengths - begin.tensions / chain.stiffnesses


def with_friction(build, *arguments, **coefficients):
    return build().replace(friction=CapstanFriction(*arguments, **coefficients))


@pytest.mark.parametrize("case", CASES, ids=[case["name"] for case in CASES])
def test_two_independent_methods_agree(case):
    chain = with_friction(CHAINS[case["mechanism"]], **case["friction"])
    history, _ = at_rest(chain)
    for step in case["steps"]:
        loads = [WorldForce(-1, step["force"])] if any(step["force"]) else []
        if step["given"] == "tensions":
            history = solve_tensions(chain, step["inputs"], loads, history=history)
        else:
            limits = case["tension_limits"]
            history = solve_lengths(chain, step["inputs"], loads, tension_limits=limits, history=history)
        assert history.status is Status.CONVERGED and history.residual < 1e-8
        for name in ("joint_angles", "tip", "lengths", "tensions", "gap_tensions", "friction_states"):
            assert getattr(history, name) == pytest.approx(np.array(step[name]), rel=0, abs=1e-8), name
        assert history.friction_state.rolling == pytest.approx(step["rolling"], abs=1e-8)


@pytest.mark.parametrize("mu", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("pull", [(6.0, 3.0), (3.0, 6.0), (5.0, 4.0)])
def test_one_joint_has_a_closed_form(mu, pull):
    """ln(T_l / T_r) = 2 mu |s| / R + ln(sin((w - s)/R) / sin((w + s)/R)), s < 0 where the left tendon is pulled."""
    chain = with_friction(partial(uniform, 2), mu)
    begin, _ = at_rest(chain)
    step = solve_tensions(chain, pull, history=begin)
    left, right = pull
    R, w, s = 20.0, 10.0, step.arc_lengths[0]
    loss = np.sign(left - right) * 2.0 * mu * abs(s) / R
    assert np.log(left / right) - loss == pytest.approx(np.log(np.sin((w - s) / R) / np.sin((w + s) / R)), abs=1e-11)
    assert step.joint_angles[0] == pytest.approx(-2.0 * s / R, abs=1e-12)
    assert np.array_equal(step.friction_states[0], np.sign([left - right, right - left]))


def one_way(chain, given):
    """Inputs along which every slip goes one way, from the equilibrium at rest; the last ones lead back."""
    begin, command = at_rest(chain)
    first, way = (begin.tensions, np.array([4.0, -1.0])) if given == "tensions" else (command, np.array([-3.0, 3.0]))
    return begin, first, way


@pytest.mark.parametrize("mu", [0.1, 0.2])
@pytest.mark.parametrize("given", ["tensions", "lengths"])
def test_splitting_a_step_changes_nothing_where_the_slip_goes_one_way(given, mu):
    chain = with_friction(five_link, mu)
    begin, first, way = one_way(chain, given)
    shares = np.linspace(0.0, 1.0, 11)[1:, None]
    there, back = first + way, first - 0.2 * way
    path = np.concatenate([first + shares * way, there + shares * (back - there)])
    whole = trace(chain, [there, back], given=given, history=begin)
    split = trace(chain, path, given=given, history=begin)
    assert split.ok.all() and np.abs(whole.tip[0] - whole.tip[1]).max() > 1.0
    assert split.tip[[9, 19]] == pytest.approx(whole.tip, rel=0, abs=1e-10)
    assert split.gap_tensions[[9, 19]] == pytest.approx(whole.gap_tensions, rel=0, abs=1e-10)


def test_one_step_differs_from_many_where_a_slip_turns_back():
    """Measured: 0.07 mm of 19 mm where 0.5 N is put on the tip in one step, and less the more steps it takes."""
    chain = with_friction(five_link, 0.2)
    begin, _ = at_rest(chain, 2.0)
    force, ends = -np.sqrt(0.125), []
    for count in (1, 16, 128):
        loads = [[WorldForce(-1, (share * force, share * force))] for share in np.linspace(0.0, 1.0, count + 1)[1:]]
        inputs = np.tile(begin.tensions, (count, 1))
        ends.append(trace(chain, inputs, loads, given="tensions", history=begin).tip[-1])
    assert 0.05 < np.linalg.norm(ends[0] - ends[2]) < 0.1
    assert 0.005 < np.linalg.norm(ends[1] - ends[2]) < 0.02


@pytest.mark.parametrize("build", [partial(uniform, 5), two_segment], ids=["uniform", "two_segment"])
def test_the_mirrored_path_of_a_symmetric_chain_is_the_mirrored_result(build):
    chain = with_friction(build, 0.15)
    begin, command = at_rest(chain)
    rng = np.random.default_rng(0)
    path = command + np.cumsum(rng.uniform(-1.0, 1.0, (6, chain.n_tendons)), axis=0)
    forces = rng.normal(0.0, 0.3, (6, 2))
    swapped = np.arange(chain.n_tendons).reshape(-1, 2)[:, ::-1].ravel()
    right = trace(chain, path, [[WorldForce(-1, f)] for f in forces], history=begin, tension_limits=LIMITS)
    loads = [[WorldForce(-1, f * (-1.0, 1.0))] for f in forces]
    left = trace(chain, path[:, swapped], loads, history=begin, tension_limits=LIMITS)
    assert left.joint_angles == pytest.approx(-right.joint_angles, rel=0, abs=1e-9)
    assert left.gap_tensions == pytest.approx(right.gap_tensions[..., swapped], rel=0, abs=1e-8)
    assert left.dissipated_work == pytest.approx(right.dissipated_work, rel=0, abs=1e-9)


def motor_work(begin, path, loads=0.0):
    """What motors, and a dead force on the tip, have put in along a path [N·mm]; trapezoids."""
    tensions = np.concatenate([[begin.tensions], path.tensions])
    lengths = np.concatenate([[begin.lengths], path.lengths])
    tips = np.concatenate([[begin.tip], path.tip])
    pulled = -0.5 * (tensions[1:] + tensions[:-1]) * np.diff(lengths, axis=0)
    return pulled.sum(axis=1) + np.diff(tips, axis=0) @ np.broadcast_to(loads, 2)


@pytest.mark.parametrize("mu", [0.05, 0.1, 0.2])
def test_a_closed_loop_takes_up_what_the_motors_put_in(mu):
    chain = with_friction(five_link, mu)
    begin, command = at_rest(chain)
    side = np.linspace(-4.0, 4.0, 1001)
    loop = np.concatenate([[4.0], side[::-1][1:], side[1:]])
    path = trace(chain, command + loop[:, None] * (-1.0, 1.0), tension_limits=LIMITS, history=begin)
    assert path.tip[-1] == pytest.approx(path.tip[0], rel=0, abs=1e-9)
    work, taken = motor_work(begin, path)[1:].sum(), path.dissipated_work[1:].sum()
    assert taken == pytest.approx(work, rel=1e-5) and taken > 3.0
    assert path.dissipated_work.min() > -3e-3  # a stuck hole gives back what it has stored


def test_the_power_balance_closes_with_the_square_of_the_steps():
    chain = with_friction(five_link, 0.1)
    begin, command = at_rest(chain)
    force, missing = (0.3, -0.2), []
    loads = [WorldForce(-1, force)]
    begin = trace(chain, command + np.array([[2.0, -1.0], [0.0, 0.0]]), loads, tension_limits=LIMITS, history=begin)
    begin = solve_lengths(chain, command, loads, tension_limits=LIMITS, history=begin.friction_state.row(1))
    for count in (50, 200):
        shares = np.linspace(0.0, 1.0, count + 1)[1:, None]
        path = trace(chain, command + shares * (-2.0, 1.5), loads, tension_limits=LIMITS, history=begin)
        work = motor_work(begin, path, force)
        assert path.dissipated_work == pytest.approx(work, abs=2.0 / count**2)
        missing.append(abs(path.dissipated_work.sum() - work.sum()))
    assert missing[1] < 0.2 * missing[0]


@settings(max_examples=15, deadline=None)
@given(st.floats(0.02, 0.2), st.floats(0.01, 0.1), st.integers(0, 2**32 - 1))
def test_random_loops_take_up_work(mu, presliding, seed):
    chain = with_friction(five_link, mu, presliding)
    begin, command = at_rest(chain)
    rng = np.random.default_rng(seed)
    corners = command + rng.uniform(-4.0, 4.0, (3, 2))
    loop = np.concatenate([corners, corners, corners[:1]])
    path = trace(chain, loop, [WorldForce(-1, rng.normal(0.0, 0.2, 2))], tension_limits=LIMITS, history=begin)
    assert path.ok.all()
    assert path.dissipated_work.sum() > -1e-3
    assert np.all(np.abs(path.friction_states) <= 1.0) and np.all(path.gap_tensions >= 0.0)


@pytest.mark.parametrize("mu", [0.1, 0.2])
def test_random_starts_end_alike(mu):
    chain = with_friction(five_link, mu)
    begin, command = at_rest(chain)
    rng = np.random.default_rng(1)
    loads = [WorldForce(-1, (0.2, -0.1))]
    begin = solve_lengths(chain, command - (1.0, 0.0), loads, history=begin, tension_limits=LIMITS)
    starts = begin.joint_angles + rng.normal(0.0, 0.3, (200, 4))
    inputs = np.tile(command - (2.0, -1.0), (200, 1))
    ends = solve_lengths_batch(chain, inputs, loads, starts, LIMITS, begin.friction_state)
    assert ends.ok.all()
    assert np.ptp(ends.joint_angles, axis=0).max() < 1e-9
    assert np.ptp(ends.friction_states, axis=0).max() < 1e-8


def test_the_effect_vanishes_with_the_coefficient():
    begin, _ = at_rest(five_link())
    free = solve_tensions(five_link(), (6.0, 3.0), start=begin)
    moved = [
        np.linalg.norm(solve_tensions(with_friction(five_link, mu), (6.0, 3.0), history=begin).tip - free.tip)
        for mu in (1e-4, 1e-3, 1e-2)
    ]
    assert np.array(moved) / (1e-4, 1e-3, 1e-2) == pytest.approx(30.0, rel=0.2)
    assert moved[1] == pytest.approx(10.0 * moved[0], rel=0.01)


@pytest.mark.parametrize("factor", [0.3, 4.0])
def test_forces_that_are_scaled_alike_change_no_pose(factor):
    chain = with_friction(two_segment, 0.15)
    ends = []
    for scale in (1.0, factor):
        begin, _ = at_rest(chain, 3.0 * scale)
        inputs = scale * np.array([[6.0, 3.0, 4.0, 3.0], [3.0, 3.5, 3.0, 5.0]])
        ends.append(trace(chain, inputs, [WorldForce(-1, (0.2 * scale, 0.1 * scale))], "tensions", history=begin))
    assert ends[1].tip == pytest.approx(ends[0].tip, rel=0, abs=1e-7)
    assert ends[1].gap_tensions == pytest.approx(factor * ends[0].gap_tensions, rel=1e-7)
    assert ends[1].dissipated_work == pytest.approx(factor * ends[0].dissipated_work, rel=1e-5, abs=1e-7)


def test_a_slack_tendon_slips_along_and_pulls_on_nothing():
    chain = with_friction(five_link, 0.1)
    begin, command = at_rest(chain)
    step = solve_lengths(chain, command - (2.0, -8.0), [WorldForce(-1, (0.3, 0.0))], history=begin)
    assert step.ok and step.tensions[1] == 0.0
    assert np.all(step.gap_tensions[:, 1] == 0.0) and np.any(step.friction_states[:, 1] != 0.0)
    both = solve_lengths(chain, command - (-20.0, -20.0), history=step)
    assert both.status is Status.INDETERMINATE
    assert np.array_equal(both.friction_states, step.friction_states)  # nothing tells which way they would slip
    assert both.dissipated_work == 0.0 and np.all(both.gap_tensions == 0.0)


def test_a_joint_stops_at_the_end_of_its_surface():
    chain = with_friction(five_link, 0.1)
    begin, _ = at_rest(chain)
    step = solve_tensions(chain, (0.4, 0.5), [WorldForce(-1, (-1.0, -0.1))], history=begin)
    assert step.status is Status.AT_LIMIT and not step.free_joints.all()
    assert step.residual < 1e-8 and step.smallest_eigenvalue > 0.0
    again = solve_tensions(chain, (9.0, 3.0), history=step)
    assert again.status is Status.CONVERGED


def test_tendons_rub_by_their_own_coefficients_up_to_their_ends():
    plain = two_segment()
    own = [CapstanFriction(0.2), CapstanFriction(0.0), None, CapstanFriction(0.05, 0.05)]
    tendons = [type(t)(t.holes, t.end, t.stiffness, friction) for t, friction in zip(plain.tendons, own, strict=True)]
    chain = plain.replace(tendons=tendons, friction=CapstanFriction(0.1))
    begin, command = at_rest(chain)
    step = solve_lengths(chain, command - (4.0, -2.0, 1.0, -1.0), tension_limits=LIMITS, history=begin)
    assert step.ok
    assert np.all(step.gap_tensions[:3, 1] == step.tensions[1])  # no friction of its own
    assert np.all(step.gap_tensions[3:, :2] == 0.0) and np.all(step.friction_states[3:, :2] == 0.0)
    directions = step.gap_tensions[0] / step.tensions
    assert np.all((directions < 1.0) == (step.friction_states[0] > 0.0) * (np.arange(4) != 1))
    # each tendon alone: the ratio of the tensions in its gaps is exp(-mu z turn), whatever the other tendons have
    uniform_mu = solve_tensions(plain.replace(friction=CapstanFriction(0.1)), (6.0, 3.0, 4.0, 3.0), history=begin)
    shared = [type(t)(t.holes, t.end, t.stiffness, CapstanFriction(0.1)) for t in plain.tendons]
    by_tendon = solve_tensions(plain.replace(tendons=shared), (6.0, 3.0, 4.0, 3.0), history=begin)
    assert np.array_equal(by_tendon.gap_tensions, uniform_mu.gap_tensions)


def test_what_friction_remembers_is_only_what_it_says():
    chain = with_friction(five_link, 0.1)
    begin, command = at_rest(chain)
    first = solve_lengths(chain, command - (2.0, -2.0), tension_limits=LIMITS, history=begin)
    copied = FrictionState(*(array.copy() for array in first.friction_state))
    by_state = solve_lengths(chain, command, tension_limits=LIMITS, history=copied)
    by_result = solve_lengths(chain, command, tension_limits=LIMITS, history=first)
    assert np.array_equal(by_state.poses, by_result.poses)
    assert np.linalg.norm(by_result.tip - begin.tip) > 0.5  # it does not come back


def test_ordinary_steps_take_few_iterations_in_the_lanes_and_none_is_left_to_the_solver_for_all_cases(monkeypatch):
    left = []
    monkeypatch.setattr(batch, "_left", lambda arrays, first, last, everything: left.append(first))
    chain, rng = with_friction(five_link, 0.1), np.random.default_rng(0)
    commands = chain.neutral_lengths - rng.uniform(0.5, 3.0, (64, 2))
    loads = [WorldForce(-1, (0.2, 0.1))]
    history = solve_lengths_batch(chain, commands, loads)
    for _ in range(4):
        commands = commands + rng.uniform(-0.5, 0.5, commands.shape)
        history = solve_lengths_batch(chain, commands, loads, history=history)
        assert left == [] and np.all(history.status == Status.CONVERGED)
        assert history.residual.max() < 1e-8 and history.iterations.mean() < 5.0


def test_lanes_and_the_solver_for_all_cases_end_a_step_alike(monkeypatch):
    chain, rng = with_friction(five_link, 0.1), np.random.default_rng(1)
    commands, loads = chain.neutral_lengths - rng.uniform(0.5, 3.0, (24, 2)), [WorldForce(-1, (0.2, 0.1))]
    history = solve_lengths_batch(chain, commands, loads)
    commands = commands + rng.uniform(-0.5, 0.5, commands.shape)
    side_by_side = solve_lengths_batch(chain, commands, loads, history=history)
    monkeypatch.setattr(RollingChain, "kernels", replace(RollingChain.kernels, most_with_friction=0))
    row_by_row = solve_lengths_batch(chain, commands, loads, history=history)
    assert np.all(row_by_row.status == Status.CONVERGED)
    for name in ("joint_angles", "poses", "tensions", "gap_tensions", "contact_forces", "contact_tangents", "slip"):
        assert getattr(side_by_side, name) == pytest.approx(getattr(row_by_row, name), rel=0, abs=1e-7), name


def test_rolling_resistance_is_the_normal_force_off_the_contact():
    chain, force, arm = with_friction(five_link, 0.1, rolling=0.5), np.array([0.4, -0.3]), 0.5
    history, command = at_rest(chain)
    found = solve_lengths(chain, command - (1.5, -1.0), [WorldForce(-1, force)], history=history)
    assert found.status is Status.CONVERGED
    levers = found.tip - found.contact_points
    moments = levers[:, 0] * force[1] - levers[:, 1] * force[0]
    rolling = arm * found.contact_forces[:, 1] * found.friction_state.rolling
    assert np.abs(rolling).min() > 0.1
    pulls = (found.gap_tensions * found.tendon_rates).sum(axis=1)
    assert pulls + rolling == pytest.approx(moments, abs=1e-7)


def test_one_joint_whose_tendons_hardly_stretch_in_their_channels_ends_as_without():
    begin, _ = at_rest(uniform(2))
    rigid, soft = (
        solve_tensions(with_friction(partial(uniform, 2), 0.1, compliance=compliance), (5.0, 3.0), history=begin)
        for compliance in (0.0, 1e-9)
    )
    assert soft.status is Status.CONVERGED
    assert soft.joint_angles == pytest.approx(rigid.joint_angles, abs=1e-7)


@pytest.mark.parametrize("force", [20.0, 55.0], ids=["between the limits", "a joint at its limit"])
def test_responses_of_a_step_are_how_its_angles_answer_commands(force):
    chain, h = with_friction(five_link, 0.1), 1e-4
    fresh = np.zeros((1, 4, 2))

    def stepped(command):
        laws = TendonLaw(command[None], chain.stiffnesses[None], np.zeros((1, 2)), np.full((1, 2), np.inf))
        loads, start = load_table([WorldForce(4, (force, 0.0))], 5)[None], np.array(chain.neutral_angles[None])
        results = new_results(1, 4, 2, responses=True)
        problem = BatchArrays(chain.arrays, np.zeros(1, np.int64), laws, loads, start, results)
        friction = new_friction_arrays(friction_laws(chain, 1), History(fresh, fresh, fresh, start, np.zeros((1, 4))))
        batch.step_range(chain.kernels, problem, friction, 0, 1)
        return results

    command = chain.neutral_lengths - 2.0
    step, changes = stepped(command), h * np.eye(2)
    assert step.status == (Status.AT_LIMIT if force > 50.0 else Status.CONVERGED)
    differences = [(stepped(command + d).joint_angles - stepped(command - d).joint_angles)[0] for d in changes]
    answers = np.stack(differences, axis=1) / (2.0 * h)
    assert np.abs(answers).max() > 0.01
    np.testing.assert_allclose(step.responses[0], answers, rtol=0, atol=1e-9)


def test_a_tendon_at_its_limit_answers_nothing_where_it_ends_half_way():
    chain = with_friction(two_segment, 0.1)
    joints, m = chain.n_joints, chain.n_tendons
    assert min(chain.last_links) < chain.n_links - 1
    command = chain.neutral_lengths - np.array([2.0 if end == chain.n_links - 1 else -50.0 for end in chain.last_links])
    zero = np.zeros((1, m))
    laws = TendonLaw(command[None], chain.stiffnesses[None], zero + 0.5, zero + 15.0)
    fresh, start = np.zeros((1, joints, m)), np.array(chain.neutral_angles[None])
    results = new_results(1, joints, m, responses=True)
    problem = BatchArrays(
        chain.arrays, np.zeros(1, np.int64), laws, load_table((), chain.n_links)[None], start, results
    )
    friction = new_friction_arrays(friction_laws(chain, 1), History(fresh, fresh, fresh, start, np.zeros((1, joints))))
    batch.step_range(chain.kernels, problem, friction, 0, 1)
    at_limit = results.tensions[0] == 0.5
    assert results.status == Status.CONVERGED and at_limit.any() and not at_limit.all()
    assert np.all(results.responses[0][:, at_limit] == 0.0)
    assert np.abs(results.responses[0][:, ~at_limit]).max() > 1e-3
