"""Arms with friction: the balance of every bead, closed forms, memory, energy, statuses, batches, long arms."""

import numpy as np
import pytest

from rollingjoint import (
    Bead,
    BeadTendon,
    CapstanFriction,
    FrictionState,
    HingeChain,
    MechanismError,
    Status,
    WorldForce,
    flexible_arm,
    sensitivity,
    set_threads,
    small_arm,
    solve_lengths,
    solve_lengths_batch,
    solve_tensions,
    solve_tensions_batch,
    trace,
)
from tests.rollingjoint.chain.bead_balance import BeadBalance

HANG, UPRIGHT, SIDEWAYS = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)
FIELDS = ("joint_angles", "poses", "tensions", "lengths", "gap_tensions", "friction_states", "dissipated_work", "slip")


def rubbed(arm, mu=0.1, **more):
    return arm.replace(friction=CapstanFriction(mu, **more))


def oblique_arm():
    """Beads of any axis, twisted ones too; every tendon with friction of its own, and one that ends earlier."""
    rng = np.random.default_rng(4)
    beads = [Bead(20.0, axis, 500.0, 7.0, 0.1, 0.05) for axis in [*rng.normal(size=(3, 3)), (0, 0, 1), "x"]]
    kinds = CapstanFriction(0.2, 0.05), CapstanFriction(0.05, constant=0.02), CapstanFriction(0.1, extra_turn=0.1)
    tendons = [
        BeadTendon(12 * np.array([np.cos(a), np.sin(a)]) + rng.normal(size=(6, 2)), friction=kind)
        for a, kind in zip((0.3, 2.0, 4.5), kinds, strict=True)
    ]
    return HingeChain(beads, [*tendons, BeadTendon(rng.normal(size=(4, 2)), 3)], friction=CapstanFriction(0.15))


def acting(arm, direction, *forces):
    """Weights and forces (link, body point, force): as loads, and as what BeadBalance takes."""
    weights = [(k, (0, 0, -0.5 * b.spacing), b.weight * np.array(direction)) for k, b in enumerate(arm.beads, 1)]
    return [arm.gravity(direction), *(WorldForce(k, f, point=p) for k, p, f in forces)], [*weights, *forces]


def assert_alike(found, step, tolerance=1e-9):
    assert found.status is Status.CONVERGED
    assert step.error < 1e-9
    assert found.tip == pytest.approx(step.tip, abs=100 * tolerance)
    for name, other in (("joint_angles", "angles"), ("lengths", "lengths"), ("tensions", "motor_tensions")):
        assert getattr(found, name) == pytest.approx(getattr(step, other), abs=tolerance), name
    assert found.gap_tensions == pytest.approx(step.gap_tensions, abs=tolerance)
    assert found.friction_states == pytest.approx(step.states, abs=1e-7)


@pytest.mark.parametrize(
    "arm",
    [rubbed(small_arm(), 0.05), rubbed(small_arm(), 0.2, compliance=0.05), oblique_arm()],
    ids=["small", "stretching", "oblique"],
)
def test_tensions_there_and_back_balance_every_bead(arm):
    loads, forces = acting(arm, HANG)
    more, stronger = acting(arm, HANG, (2, (1.0, -3.0, 2.0), (0.4, 0.2, -0.3)))
    balance, found = BeadBalance(arm), solve_tensions(arm, [3.0, 1.0, 0.5, 1.5], loads)
    step = balance.start(found.joint_angles, found.tensions)
    path = [([6.0, 2.0, 1.0, 3.0], False), ([2.0, 2.5, 1.0, 3.0], False), ([2.0, 2.5, 1.0, 3.0], True)]
    for tensions, pushed in path:
        before = found
        found = solve_tensions(arm, tensions, more if pushed else loads, history=before)
        acts = stronger if pushed else forces
        step = balance.step(lambda _, pull=tensions: np.array(pull), acts, step, before.joint_angles)
        assert_alike(found, step)
        assert np.abs(found.gap_tensions[:3] - found.tensions).max() > 0.005  # friction matters


def test_lengths_with_a_slack_and_a_yielding_tendon_balance_every_bead():
    arm = rubbed(small_arm(), 0.15)
    loads, forces = acting(arm, SIDEWAYS, (4, (0.0, 0.0, 0.0), (0.0, 0.5, 0.2)))
    command, limits = arm.neutral_lengths - 3.0 / arm.stiffnesses, (0.0, 9.0)
    balance, found = BeadBalance(arm), solve_lengths(arm, command, loads, tension_limits=limits)
    step, kinds = balance.start(found.joint_angles, found.tensions), set()
    for change in ([-3.0, 0.5, 6.0, 0.0], [1.0, -1.0, 1.0, 0.0], [0.0, -6.0, 0.0, 4.0]):
        before, wanted = found, command + change
        found = solve_lengths(arm, wanted, loads, tension_limits=limits, history=before)

        def pulled(lengths, wanted=wanted):
            return np.clip(arm.stiffnesses * (lengths - wanted), *limits)

        step = balance.step(pulled, forces, step, before.joint_angles)
        assert_alike(found, step)
        assert np.all(found.gap_tensions[:, found.tensions == 0.0] == 0.0)
        kinds |= set(np.sign(found.tensions) + (found.tensions == 9.0))
    assert kinds == {0.0, 1.0, 2.0}


@pytest.mark.slow
def test_the_flexible_arm_balances_bead_by_bead_from_any_history():
    arm, rng = rubbed(flexible_arm()), np.random.default_rng(0)
    loads, forces = acting(arm, HANG)
    tensions = np.array([6.0, 2.0, 1.0, 3.0, 1.0, 4.0, 2.0, 2.0])
    begun = solve_tensions(arm, 0.9 * tensions, loads).friction_state
    states = rng.uniform(-1, 1, begun.states.shape) * (begun.slips > 0.0)
    history = FrictionState(states, begun.slips, begun.grips, begun.angles, begun.rolling)
    found = solve_tensions(arm, tensions, loads, history=history)
    step = BeadBalance(arm).step(lambda _: tensions, forces, history, begun.angles)
    assert_alike(found, step)


def by_hand(arm, found, history, mu, presliding):
    """Residual of every hinge, and the gap tensions, from half angles: straight channels across hinges of one arm.

    gap = h cos(theta/2) - 2 r sin(theta/2), and the tendon turns by |theta|/2 at each of its two holes.
    """
    theta, holes = found.joint_angles, np.array([tendon.holes[0] for tendon in arm.tendons])
    axes, gap = np.array([bead.axis for bead in arm.beads]), np.array([bead.gap for bead in arm.beads])
    inside = np.outer(axes[:, 1], holes[:, 0]) - np.outer(axes[:, 0], holes[:, 1])  # distance towards the bend
    crossed = np.arange(arm.n_joints)[:, None] < arm.last_links
    sin, cos = np.sin(theta / 2)[:, None], np.cos(theta / 2)[:, None]
    gaps = np.where(crossed, gap[:, None] * cos - 2 * inside * sin, 0.0)
    slips = np.cumsum(gaps[::-1], axis=0)[::-1]
    states = np.clip(history.states - (slips - history.slips) / presliding, -1, 1)
    turns = 0.5 * np.abs(theta) + 0.5 * np.abs(np.append(0.0, theta[:-1]))
    tension = crossed * found.tensions * np.exp(-mu * np.cumsum(crossed * states * turns[:, None], axis=0))
    springs = np.array([bead.stiffness * (t - bead.rest_angle) for bead, t in zip(arm.beads, theta, strict=True)])
    pull = (tension * -(0.5 * gap[:, None] * sin + inside * cos)).sum(axis=1)
    loads = sum(found.point_jacobian(int(row[0]), row[1:4])[:3].T @ row[4:7] for row in found.loads if row[0])
    return springs + pull - loads, tension


@pytest.mark.parametrize("n", [4, 60, 200])
def test_short_and_long_arms_obey_the_law_of_half_angles_and_take_few_steps(n):
    arm = rubbed(small_arm(n, weight=0.4 / n**2), 0.2)
    loads, tensions = [arm.gravity(SIDEWAYS)], np.array([4.0, 2.0, 1.0, 2.0]) * min(1.0, 30 / n)
    found = solve_tensions(arm, 0.5 * tensions, loads)
    for pull in (tensions, 0.8 * tensions[::-1]):
        before = found.friction_state
        found = solve_tensions(arm, pull, loads, history=found)
        assert (found.status, found.iterations < 15) == (Status.CONVERGED, True)
        residual, inside = by_hand(arm, found, before, 0.2, 0.02)
        assert residual == pytest.approx(np.zeros(n), abs=1e-7)
        assert found.gap_tensions == pytest.approx(inside, rel=1e-7)
        assert 0.01 < np.abs(found.gap_tensions[-1] / pull - 1.0).max() < 1.0


def test_without_a_coefficient_a_history_changes_no_bit():
    arm, load = small_arm(), [small_arm().gravity(HANG)]
    before = solve_tensions(rubbed(arm, 0.0), [3, 1, 1, 1], load)
    found = solve_tensions(rubbed(arm, 0.0), [8, 1, 1, 1], load, history=before)
    plain = solve_tensions(arm, [8, 1, 1, 1], load, start=before)
    for name in FIELDS[:5]:
        assert np.array_equal(getattr(found, name), getattr(plain, name)), name
    assert found.dissipated_work == 0.0


def test_the_pose_tends_linearly_to_the_one_without_friction():
    plain, load = solve_tensions(small_arm(), [8, 1, 1, 1]), []
    shifts = []
    for mu in (1e-2, 1e-3, 1e-4):
        arm = rubbed(small_arm(), mu)
        found = solve_tensions(arm, [8, 1, 1, 1], load, history=solve_tensions(arm, [3, 1, 1, 1], load))
        shifts.append(np.linalg.norm(found.tip - plain.tip) / mu)
    assert shifts[0] > 0.5
    assert shifts == pytest.approx([shifts[-1]] * 3, rel=0.02)


def test_mirrored_paths_give_mirrored_arms():
    arm, mirror = rubbed(flexible_arm()), [0, 3, 2, 1, 7, 6, 5, 4]  # y to -y
    path = np.random.default_rng(3).uniform(0, 8, (4, 8))
    one, other = (trace(arm, p, [arm.gravity(SIDEWAYS)], given="tensions") for p in (path, path[:, mirror]))
    assert np.all(one.ok)
    assert other.tip == pytest.approx(one.tip * (1, -1, 1), abs=1e-8)
    assert other.gap_tensions == pytest.approx(one.gap_tensions[..., mirror], abs=1e-9)
    assert other.friction_states == pytest.approx(one.friction_states[..., mirror], abs=1e-7)


@pytest.mark.slow
def test_a_closed_loop_loses_what_the_motors_put_in():
    arm, steps = rubbed(small_arm()), 800
    leg = np.linspace(0.0, 3.0, steps)
    once = np.concatenate([leg, leg[-2::-1], -leg[1:], -leg[-2::-1]])
    command = arm.neutral_lengths - 4.0 / arm.stiffnesses
    path = command + np.outer(np.concatenate([once, once[1:]]), [-1.0, 0.5, 1.0, -0.5])
    found = trace(arm, path, [arm.gravity(SIDEWAYS)])
    assert np.all(found.ok)
    second = slice(len(once) - 1, None)  # from the second loop on it repeats itself
    assert found.joint_angles[-1] == pytest.approx(found.joint_angles[second][0], abs=1e-12)
    tensions, lengths = found.tensions[second], found.lengths[second]
    put_in = -np.sum(0.5 * (tensions[1:] + tensions[:-1]) * np.diff(lengths, axis=0))
    assert put_in > 0.5
    assert found.dissipated_work[second][1:].sum() == pytest.approx(put_in, rel=1e-5)


def test_a_move_in_one_direction_may_be_split_at_will():
    arm, load = rubbed(small_arm(), 0.2), [small_arm().gravity(SIDEWAYS)]
    command = arm.neutral_lengths - 4.0 / arm.stiffnesses
    begun = solve_lengths(arm, command, load)
    for move in (np.array([0.0, 3.0, 0.0, -3.0]), np.array([-3.0, 0.0, 0.0, 0.0])):
        once = solve_lengths(arm, command + move, load, history=begun)
        shares = np.linspace(0, 1, 11)[1:, None]
        split = trace(arm, command + shares * move, load, history=begun)
        assert split.tip[-1] == pytest.approx(once.tip, abs=1e-10)
        assert np.abs(once.slip).max() > 0.1


def test_where_a_tendon_turns_back_within_a_step_more_steps_converge():
    """A push on the tip that moves it by 380 mm: 0.8 mm off in one step, 0.09 in four, 0.015 in sixteen."""
    arm, tensions = rubbed(flexible_arm()), [3.0, 1.0, 1.0, 1.0] * 2
    weights = [arm.gravity(HANG)]
    begun = solve_tensions(arm, tensions, weights, history=solve_tensions(arm, 0.7 * np.array(tensions), weights))

    def tip(count):
        pushes = [[*weights, WorldForce(-1, (0.0, t, 0.0))] for t in np.linspace(0, 1, count + 1)[1:]]
        return trace(arm, [tensions] * count, pushes, "tensions", history=begun).tip[-1]

    finest = tip(256)
    errors = [np.abs(tip(count) - finest).max() for count in (1, 4, 16)]
    assert errors[0] < 1.0
    assert errors[1] < 0.2 * errors[0]
    assert errors[2] < 0.2 * errors[1]


def test_every_start_ends_in_the_same_pose():
    arm, rng = rubbed(oblique_arm()), np.random.default_rng(5)
    load = [arm.gravity(HANG), WorldForce(-1, (0.3, -0.2, 0.1))]
    before = solve_tensions(arm, [2, 1, 1, 1], load)
    starts = rng.normal(0, 0.15, (100, 5))
    found = solve_tensions_batch(arm, np.tile([5.0, 2, 1, 3], (100, 1)), load, starts, history=before)
    assert np.all(found.ok)
    assert np.ptp(found.joint_angles, axis=0) == pytest.approx(np.zeros(5), abs=1e-10)


def column(n, weight):
    bead = Bead(20.0, "y", 500.0, gap=8.0, weight=weight)
    return rubbed(HingeChain([bead] * n, [BeadTendon([(5, 0)]), BeadTendon([(-5, 0)])]))


@pytest.mark.parametrize("n, weight", [(4, 3.0), (20, 0.1)])
def test_a_column_buckles_under_friction_and_says_so(n, weight):
    arm = column(n, weight)
    straight = solve_tensions(arm, [1.0, 1.0])
    found = solve_tensions(arm, [1.0, 1.0], [arm.gravity(UPRIGHT)], history=straight)
    assert (found.status, found.escapes) == (Status.CONVERGED, 1)
    assert found.smallest_eigenvalue > 0.0
    assert by_hand(arm, found, straight.friction_state, 0.1, 0.02)[0] == pytest.approx(np.zeros(n), abs=1e-7)


def test_holes_that_meet_are_a_status():
    arm = column(1, 0.0)
    found = solve_tensions(arm, [400.0, 1.0], history=solve_tensions(arm, [1.0, 1.0]))
    assert found.status is Status.AT_LIMIT
    assert found.joint_angles == pytest.approx(arm.joint_limits[:, 1])


def test_numbers_that_mean_nothing_are_a_status_and_leave_the_history():
    arm = rubbed(small_arm())
    before = solve_tensions(arm, [5, 1, 1, 1], history=solve_tensions(arm, [1, 1, 1, 1]))
    state = before.friction_state
    wrong = FrictionState(state.states * np.nan, state.slips, state.grips, state.angles, state.rolling)
    for found in (
        solve_tensions(arm, [np.nan, 1, 1, 1], history=before),
        solve_tensions(arm, [1, 1, 1, 1], [WorldForce(-1, (0, 0, np.inf))], history=before),
        solve_tensions(arm, [1, 1, 1, 1], history=wrong),
    ):
        assert found.status is Status.INVALID_INPUT
        for name in FIELDS[:5]:
            assert np.all(np.isfinite(getattr(found, name))), name
    path = trace(arm, [[1, 1, 1, 1], [5, 1, 1, 1], [-1, 1, 1, 1], [1, 1, 1, 1]], given="tensions")
    again = trace(arm, [[1, 1, 1, 1], [5, 1, 1, 1], [1, 1, 1, 1]], given="tensions")
    assert path.status.tolist() == [0, 0, 5, 0]
    assert np.array_equal(path.friction_states[-1], again.friction_states[-1])


def test_rows_with_coefficients_and_histories_of_their_own_are_the_single_steps_to_the_last_bit():
    rng, load = np.random.default_rng(7), [small_arm().gravity(SIDEWAYS)]
    arms = [rubbed(small_arm(), mu, presliding=delta) for mu, delta in ((0.05, 0.02), (0.2, 0.02), (0.1, 0.1))]
    rows = [arms[k % 3] for k in range(12)]
    tensions = rng.uniform(0, 8, (12, 4))
    tensions[4, 1] = np.nan
    lengths = arms[0].neutral_lengths + rng.uniform(-2, 0.5, (12, 4))
    set_threads(3)
    before = solve_tensions_batch(rows * 50, np.tile(rng.uniform(0, 8, (12, 4)), (50, 1)), load)
    first = solve_lengths_batch(rows * 50, np.tile(lengths, (50, 1)), load, history=before)
    second = solve_tensions_batch(rows * 50, np.tile(tensions, (50, 1)), load, history=first)
    for lane in range(12):
        begun = solve_tensions(arms[lane % 3], before.tensions[lane], load)
        one = solve_lengths(arms[lane % 3], lengths[lane], load, history=begun)
        two = solve_tensions(arms[lane % 3], tensions[lane], load, history=one)
        for batch, single in ((first, one), (second, two)):
            for name in (*FIELDS, "status", "iterations", "stiffness", "torques_per_tension"):
                assert np.array_equal(getattr(batch, name)[588 + lane], getattr(single, name)), name


def differences(function, at, step):
    steps = step * np.eye(len(at))
    return np.stack([(function(at + e) - function(at - e)) / (2 * step) for e in steps], axis=-1)


@pytest.mark.parametrize("arm", [rubbed(small_arm(), 0.2, compliance=0.02), oblique_arm()], ids=["small", "oblique"])
def test_sensitivities_are_the_differences_of_steps(arm):
    """Holes stick in some links and slip in others; none changes over within the differences."""
    loads, tensions = [arm.gravity(SIDEWAYS)], np.array([4.0, 2.0, 1.0, 3.0])
    begun = solve_tensions(arm, 0.8 * tensions, loads)
    found = solve_tensions(arm, tensions, loads, history=begun)
    crossed = found.gap_tensions > 0.0
    assert 0 < np.sum(found.sticking) < np.sum(crossed)
    step = {"loads": loads, "history": begun}

    def lengths(tau):
        return solve_tensions(arm, tau, **step).lengths

    def tip(tau):
        return solve_tensions(arm, tau, **step).tip

    assert sensitivity.dlengths_dtensions(found) == pytest.approx(differences(lengths, tensions, 1e-5), abs=1e-6)
    assert sensitivity.dtip_dtensions(found) == pytest.approx(differences(tip, tensions, 1e-5), abs=1e-5)
    wrench = sensitivity.dposes_dload(found, 4)[-1, :3, :3]

    def pushed(force):
        return solve_tensions(arm, tensions, [*loads, WorldForce(4, force)], history=begun).tip

    assert wrench == pytest.approx(differences(pushed, np.zeros(3), 1e-5), abs=1e-5)
    command = begun.lengths - 0.8 * tensions / arm.stiffnesses
    commanded = command - np.array([0.3, -0.1, 0.05, 0.02])
    elastic = solve_lengths(arm, commanded, **step)

    def by_length(c):
        return solve_lengths(arm, c, **step)

    expected = differences(lambda c: by_length(c).tip, commanded, 1e-6)
    assert sensitivity.dposes_dlengths(elastic)[-1, :3] == pytest.approx(expected, abs=1e-5)
    expected = differences(lambda c: by_length(c).tensions, commanded, 1e-6)
    assert sensitivity.dtensions_dlengths(elastic) == pytest.approx(expected, abs=1e-5)


def test_what_hinges_cannot_have_is_refused_in_one_line():
    with pytest.raises(MechanismError, match=r"friction rolling = 0.1: expected 0: hinges do not roll"):
        rubbed(small_arm(), 0.1, rolling=0.1)
    for model in ("linear", "end_couple"):
        with pytest.raises(MechanismError, match=rf"tendon model with friction = '{model}': expected exact"):
            rubbed(small_arm(model=model))
    with pytest.raises(MechanismError, match="rolling of a tendon's friction"):
        BeadTendon([(1, 2)], friction=CapstanFriction(0.1, rolling=0.1))
    assert not rubbed(small_arm(model="linear"), 0.0).has_friction
    doubled = rubbed(small_arm()).scaled(np.full(4, 2.0), np.ones(4), np.ones(4))
    assert doubled.friction == CapstanFriction(0.1)


@pytest.mark.parametrize("constant", [0.02, 0.3])
def test_constant_forces_that_use_up_the_tension_of_slack_tendons_stop_no_walk(constant):
    arm, rng = small_arm(20).replace(friction=CapstanFriction(0.1, 0.02, constant=constant)), np.random.default_rng(0)
    begin = solve_tensions(arm, np.full(4, 3.0))
    first = begin.lengths - begin.tensions / arm.stiffnesses
    commands = np.tile(first, (2, 1))
    history = FrictionState(*(np.repeat(array[None], 2, axis=0) for array in begin.friction_state))
    for _ in range(30):
        commands = np.clip(commands + rng.uniform(-1.0, 1.0, commands.shape), first - 12.0, first + 12.0)
        found = solve_lengths_batch(arm, commands, tension_limits=(0.005, 15.0), history=history)
        assert found.ok.all() and np.all(found.residual <= 1e-8)
        history = found.friction_state
