"""The full-information smoother: derivatives, minima against SciPy's, and findings in synthetic histories."""

import math
import pickle

import numpy as np
import pytest
from scipy.optimize import least_squares

from rollingjoint import CapstanFriction, WorldForce, five_link, solve_lengths_batch, solve_tensions_batch, two_segment
from rollingjoint.chain.variations import varied_chain
from rollingjoint.errors import InvalidInput
from rollingjoint.estimate import Effort, HiddenPrior, HiddenRanges, MeasurementLaw, Smoother
from rollingjoint.estimate.arrays import MotorHistory
from rollingjoint.estimate.smoother import FollowedChain
from rollingjoint.estimate.surfaces import surface_tables
from rollingjoint.load import load_table
from rollingjoint.transmission import play_step, sheath_direction, sheath_ratio

CHAIN = five_link()
RANGES = {
    "force": (0.0, 1.0),
    "offset_mm": (-0.5, 0.5),
    "stiffness": (0.8, 1.2),
    "play_mm": (0.5, 3.0),
    "sheath_friction": (0.0, 0.6),
}
SURFACES = {"surface_mm": 0.1, "surface_rad": 0.01}
START = 3.0  # N
LAW = MeasurementLaw(
    start_tension=START,
    start_sd=5e-3,
    shown_sd=math.inf,
    low=0.5,
    high=15.0,
    limit_sd=math.inf,
    cells_at_tendons=False,
    tension_sd=0.1,
    tension_share=0.0,
    robust=1e6,
)
STEPS = 30


def drawn(prior, rng, count, spread=0.8):
    """Hidden numbers (count, K), uniform within a share of their ranges."""
    share = rng.uniform(-0.5, 0.5, (count, prior.layout.total)) * spread
    return prior.within(prior.means + share * (prior.high - prior.low))


def moves(rng, steps, m):
    """Motors' moves that pull in, pay out and pull in again, (steps, m) [mm]."""
    return np.where(np.arange(steps)[:, None] % 12 < 8, -1.0, 1.0) * rng.uniform(0.3, 1.0, (steps, m))


def measured(chain, numbers, at, way, tip_link=4, shown=False, at_tendons=False):
    """Motors, tensions and tips of one chain with these hidden numbers, and motors that move `way`: plain NumPy.

    shown: whether motors start where load cells show START, with their offsets; at_tendons: place of the cells.
    """
    m = chain.n_tendons

    def part(first):
        return numbers[first : first + m]

    offsets, half, friction, places = (part(k) for k in (at.offsets, at.half_widths, at.frictions, at.places))
    if at.total > at.surfaces:
        displaced = np.zeros((chain.n_links, 2, 3))
        values = numbers[at.surfaces :].reshape(-1, 2, 3)
        displaced[:-1, 1], displaced[1:, 0] = values[:, 0], values[:, 1]
        chain = varied_chain(chain, displaced, np.ones(m))
    chain = varied_chain(chain, np.zeros((chain.n_links, 2, 3)), part(at.stiffnesses))
    friction = np.zeros(m) if at_tendons else friction
    begin = (
        (START - part(at.zeros)) / (part(at.gains) * np.exp(-2.0 * places * friction)) if shown else np.full(m, START)
    )
    start = solve_tensions_batch(chain, begin[None])
    played = start.lengths[0] - begin / chain.stiffnesses - (offsets if shown else 0.0)
    motor, angles = played + 2.0 * places * half, start.joint_angles
    loads = load_table([WorldForce(tip_link, tuple(numbers[:2]))], chain.n_links)[None]
    rows = []
    for step in range(len(way)):
        motor = motor + (way[step] if step else 0.0)
        played = play_step(played, motor, half)
        found = solve_lengths_batch(chain, (played + offsets)[None], loads, angles, tension_limits=(0.0, 1e4))
        angles = found.joint_angles
        ratio = part(at.gains) * sheath_ratio(friction, sheath_direction(played, motor, half))
        rows.append((motor, ratio * found.tensions[0] + part(at.zeros), found.tip[0]))
    return tuple(map(np.array, zip(*rows, strict=True)))


def history_of(motors, tensions, pictures=None):
    pictures = np.empty((len(motors), 0, 3)) if pictures is None else pictures
    return MotorHistory(
        np.array([len(motors)]), motors[None], np.zeros_like(motors)[None], tensions[None], pictures[None]
    )


def smoothed(smoother, motors, tensions, noise=0.0):
    """The last estimate of episodes (N, T, m)."""
    smoother.reset(np.ones(len(motors), bool))
    for step in range(motors.shape[1]):
        estimate = smoother.take_in(motors[:, step], np.zeros_like(motors[:, step]), tensions[:, step] + noise)
    return estimate


@pytest.mark.parametrize("chain", [CHAIN, two_segment()], ids=lambda chain: chain.name)
def test_derivatives_by_all_hidden_numbers_are_central_differences(chain):
    rng, ranges = np.random.default_rng(1), HiddenRanges(**RANGES, **SURFACES, gain=(0.9, 1.1), zero=(-0.3, 0.3))
    prior = HiddenPrior.of(chain, ranges)
    followed = FollowedChain(
        chain, [prior], LAW._replace(tension_share=0.0), surface_tables(chain, prior.layout, START), STEPS
    )
    numbers = drawn(prior, rng, 1)[0]
    motors, tensions, _ = measured(chain, numbers, prior.layout, moves(rng, 12, chain.n_tendons), chain.n_links - 1)
    numbers[prior.layout.surfaces :] = 0.0  # elsewhere they are those at the nominal surfaces
    K, step = prior.layout.total, 1e-4
    rows = np.concatenate([numbers[None], *(numbers + way * step * np.diag(prior.sds) for way in (1.0, -1.0))])
    episodes, pictures = np.zeros(len(rows), np.int64), np.full((12, chain.n_joints, 3), np.nan)
    pictures[::5] = chain.poses(chain.neutral_angles)[1:]
    track = followed.followed(
        history_of(motors, tensions, pictures), episodes, episodes + chain.n_links - 1, episodes, rows
    )
    assert track.steps.tolist() == [12] * len(rows)
    for values, rates in ((track.tip, track.tip_by[0]), (track.tensions, track.tensions_by[0])):
        expected = (values[1 : K + 1] - values[K + 1 :]).T / (2 * step)
        np.testing.assert_allclose(rates * prior.sds, expected, atol=1e-6)
    slope = (track.cost[K + 1 :] - track.cost[1 : K + 1]) / (2 * step)
    np.testing.assert_allclose(track.slope[0], slope, rtol=1e-5, atol=1e-3)


def test_tables_of_surfaces_have_at_their_points_the_rates_of_lengths():
    """Both points are a few table steps from an end of the joint's range."""
    prior, joint, step = HiddenPrior.of(CHAIN, HiddenRanges(**RANGES, **SURFACES)), 1, 1e-3
    tables = surface_tables(CHAIN, prior.layout, START)
    points = np.array([3, len(tables.values[joint]) - 4])
    angles = np.tile(CHAIN.neutral_angles, (2, 1))
    angles[:, joint] = tables.lowest[joint] + points / tables.per_radian[joint]
    for number in (0, 1, 3, 4):  # x and y of the surface below and of the one above
        displaced = np.zeros((CHAIN.n_links, 2, 3))
        displaced[joint + number // 3, 1 - number // 3, number % 3] = step
        longer, shorter = (varied_chain(CHAIN, way * displaced, np.ones(2)).tendon_lengths(angles) for way in (1, -1))
        values = tables.values[joint, points, 4 * number : 4 * number + 2]
        np.testing.assert_allclose(values, (longer - shorter) / (2.0 * step), rtol=0, atol=1e-9)


def test_a_worn_mechanism_is_found_where_the_fit_is_in_doubt():
    rng, told = (
        np.random.default_rng(11),
        HiddenRanges(**RANGES | {"play_mm": (0.5, 2.0), "sheath_friction": (0.0, 0.3)}),
    )
    prior, worn = HiddenPrior.of(CHAIN, told), HiddenPrior.of(CHAIN, told.worn())
    numbers, way = drawn(prior, rng, 4), moves(rng, STEPS, 2)
    at = prior.layout
    numbers[:2, at.half_widths : at.frictions], numbers[2:, at.frictions : at.places] = 1.4, 0.5
    motors, tensions, tips = map(np.stack, zip(*(measured(CHAIN, row, at, way) for row in numbers), strict=True))
    law, effort = LAW._replace(tension_sd=0.02), Effort(coarse_sd=0.1, doubt=0.6)
    smoother = Smoother(CHAIN, prior, law, [4], effort, STEPS, worn=worn)
    estimate = smoothed(smoother, motors, tensions)
    assert smoother.priors.tolist() == [1] * 4 and np.all(estimate.misfit < 0.1)
    np.testing.assert_allclose(estimate.tip, tips[:, -1], atol=0.05)
    alone = smoothed(Smoother(CHAIN, prior, law, [4], effort, STEPS), motors, tensions)
    assert np.all(alone.misfit > 0.6)


def test_displaced_surfaces_act_as_those_of_a_chain_with_them():
    """But for what is not linear in them, and for kinks of the profiles."""
    rng, prior = np.random.default_rng(2), HiddenPrior.of(CHAIN, HiddenRanges(**RANGES, **SURFACES))
    followed = FollowedChain(CHAIN, [prior], LAW, surface_tables(CHAIN, prior.layout, START), STEPS)
    whole, way = drawn(prior, rng, 1)[0], moves(rng, STEPS, 2)
    for share in (1.0, 0.2):
        numbers = whole.copy()
        numbers[prior.layout.surfaces :] *= share
        plain = numbers.copy()
        plain[prior.layout.surfaces :] = 0.0
        motors, tensions, tips = measured(CHAIN, numbers, prior.layout, way)
        rows, episodes = np.array([numbers, plain]), np.zeros(2, np.int64)
        track = followed.followed(history_of(motors, tensions), episodes, episodes + 4, episodes, rows)
        near, far = np.linalg.norm(track.tip - tips[-1], axis=1)
        assert far > 0.3 * share and near < 0.1 * far
        assert track.misfit[0] < 0.01 * track.misfit[1]


def test_it_finds_the_hidden_numbers_of_exact_measurements():
    rng, prior = np.random.default_rng(3), HiddenPrior.of(CHAIN, HiddenRanges(**RANGES))
    numbers = drawn(prior, rng, 6)
    way = moves(rng, STEPS, 2)
    motors, tensions, tips = map(
        np.stack, zip(*(measured(CHAIN, row, prior.layout, way) for row in numbers), strict=True)
    )
    smoother = Smoother(CHAIN, prior, LAW._replace(tension_sd=1e-3, start_sd=1e-4), [4], Effort(coarse_sd=0.1), STEPS)
    estimate = smoothed(smoother, motors, tensions)
    known = prior.sds > 0.0
    np.testing.assert_allclose(estimate.numbers[:, known], numbers[:, known], atol=0.03)
    np.testing.assert_allclose(estimate.tip, tips[:, -1], atol=0.01)
    assert np.all(estimate.misfit < 1e-2)


@pytest.mark.parametrize("at_tendons", [False, True])
def test_it_finds_the_tip_where_motors_start_by_load_cells_that_err(at_tendons):
    rng, errors = np.random.default_rng(8), {"gain": (0.98, 1.02), "zero": (-0.1, 0.1)}
    prior = HiddenPrior.of(CHAIN, HiddenRanges(**RANGES, **errors))
    numbers, way = drawn(prior, rng, 6), moves(rng, STEPS, 2)
    cases = [measured(CHAIN, row, prior.layout, way, 4, True, at_tendons) for row in numbers]
    motors, tensions, tips = map(np.stack, zip(*cases, strict=True))
    law = LAW._replace(tension_sd=0.01, start_sd=math.inf, shown_sd=0.01, cells_at_tendons=at_tendons)
    smoother = Smoother(CHAIN, prior, law, [4], Effort(coarse_sd=0.1), STEPS)
    estimate = smoothed(smoother, motors, tensions)
    assert smoother.measured_steps.tolist() == [STEPS] * 6
    np.testing.assert_allclose(estimate.tip, tips[:, -1], atol=0.1)
    assert np.all(estimate.misfit < 0.05)


def test_the_loaded_link_is_found_where_any_may_be_loaded():
    """The load is at its largest."""
    rng, prior = np.random.default_rng(4), HiddenPrior.of(CHAIN, HiddenRanges(**RANGES | {"force": (0.8, 1.0)}))
    numbers, way = drawn(prior, rng, 4, 1.0), moves(rng, STEPS, 2)
    numbers[:, :2] = prior.within(10.0 * numbers)[:, :2]
    cases = [measured(CHAIN, row, prior.layout, way, link) for link, row in enumerate(numbers, start=1)]
    motors, tensions, tips = map(np.stack, zip(*cases, strict=True))
    smoother = Smoother(CHAIN, prior, LAW._replace(tension_sd=1e-3, start_sd=1e-4), range(1, 5), steps=STEPS)
    estimate = smoothed(smoother, motors, tensions)
    assert smoother.links.tolist() == [1, 2, 3, 4]
    np.testing.assert_allclose(estimate.tip, tips[:, -1], atol=0.01)


def test_its_minimum_is_that_of_a_general_least_squares_solver():
    rng, prior = np.random.default_rng(5), HiddenPrior.of(CHAIN, HiddenRanges(**RANGES))
    truth, way = drawn(prior, rng, 1)[0], moves(rng, 14, 2)
    motors, tensions, _ = measured(CHAIN, truth, prior.layout, way)
    tensions = tensions + 0.1 * rng.standard_normal(tensions.shape)
    followed = FollowedChain(CHAIN, [prior], LAW, surface_tables(CHAIN, prior.layout, START), STEPS)
    smoother = Smoother(CHAIN, prior, LAW, [4], Effort(every=1, passes=20, moved=1e-9), 14)
    estimate = smoothed(smoother, motors[None], tensions[None])
    varied = np.flatnonzero(prior.sds)
    one, tip = np.zeros(1, np.int64), np.array([4])

    def cost(numbers):
        return followed.followed(history_of(motors, tensions), one, tip, one, numbers[None]).cost[0]

    def residuals(units):
        numbers = prior.means.copy()
        numbers[varied] += units * prior.sds[varied]
        at, m = prior.layout, 2
        played = motors[0] - 2.0 * numbers[at.places : at.places + m] * numbers[at.half_widths : at.half_widths + m]
        stiffnesses = CHAIN.stiffnesses * numbers[at.stiffnesses : at.stiffnesses + m]
        begin = solve_tensions_batch(CHAIN, np.full((1, m), START)).lengths[0] - START / stiffnesses
        half, angles, rows = numbers[at.half_widths : at.half_widths + m], CHAIN.neutral_angles, []
        loads = load_table([WorldForce(4, tuple(numbers[:2]))], CHAIN.n_links)[None]
        chain = varied_chain(CHAIN, np.zeros((5, 2, 3)), stiffnesses / CHAIN.stiffnesses)
        start = played
        for motor in motors:
            played = play_step(played, motor, half)
            commands = (played + numbers[at.offsets : at.offsets + m])[None]
            found = solve_lengths_batch(chain, commands, loads, angles, tension_limits=(0.0, 1e4))
            angles = found.joint_angles
            friction = numbers[at.frictions : at.frictions + m]
            rows.append(found.tensions[0] * sheath_ratio(friction, sheath_direction(played, motor, half)))
        off = (tensions - np.array(rows)) / LAW.tension_sd
        return np.concatenate([off.ravel(), (start - begin) / LAW.start_sd, units])

    units = (estimate.numbers[0] - prior.means)[varied] / prior.sds[varied]
    assert cost(estimate.numbers[0]) == pytest.approx(0.5 * np.sum(residuals(units) ** 2), rel=1e-6)
    reference = least_squares(residuals, units, x_scale=1.0, xtol=1e-12, ftol=1e-12)
    assert cost(estimate.numbers[0]) == pytest.approx(reference.cost, rel=1e-4)
    np.testing.assert_allclose(units, reference.x, atol=0.02)


def wandering(rng, prior, memory, steps, link):
    """Motors, tensions and poses of the moving links under a force that wanders; no play."""
    numbers, force, rows = drawn(prior, rng, 1)[0], 0.5 * rng.standard_normal(2), []
    at, way = prior.layout, moves(rng, steps, 2)
    chain = varied_chain(CHAIN, np.zeros((5, 2, 3)), numbers[at.stiffnesses : at.stiffnesses + 2])
    motor = solve_tensions_batch(chain, np.full((1, 2), START)).lengths[0] - START / chain.stiffnesses
    angles = CHAIN.neutral_angles
    for step in range(steps):
        motor = motor + (0.5 * way[step] if step else 0.0)
        loads = load_table([WorldForce(link, tuple(force))], 5)[None]
        command = (motor + numbers[at.offsets : at.offsets + 2])[None]
        found = solve_lengths_batch(chain, command, loads, angles, tension_limits=(0.0, 1e4))
        angles = found.joint_angles
        rows.append((motor, found.tensions[0], found.poses[0, 1:]))
        force = memory * force + 0.5 * math.sqrt(1.0 - memory**2) * rng.standard_normal(2)
    return tuple(map(np.array, zip(*rows, strict=True)))


def test_a_force_that_wanders_is_where_the_cost_is_least():
    rng, memory = np.random.default_rng(9), 0.9
    prior = HiddenPrior.of(CHAIN, HiddenRanges(**RANGES | {"play_mm": (0.0, 0.0), "wanders": True}))
    motors, tensions, poses = wandering(rng, prior, memory, 12, 4)
    law = LAW._replace(memory=memory, angle_sd=0.01, position_sd=0.5)
    poses[::2] = np.nan
    smoother = Smoother(CHAIN, prior, law, [4], Effort(every=1, passes=15, moved=1e-9, searches=()), 12, True)
    smoother.reset(np.ones(1, bool))
    for step in range(12):  # pictures are two steps late
        shown = poses[max(step - 2, 0), None] if step > 1 else np.full((1, 4, 3), np.nan)
        now = motors[step, None], np.zeros((1, 2)), tensions[step, None]
        estimate = smoother.take_in(*now, shown, np.array([2]))
    followed, track = smoother.fine, smoother.track
    numbers, forces = followed.proposals(track, np.zeros(1), 2.0)
    np.testing.assert_allclose(numbers, estimate.numbers, atol=1e-9)
    one, link = np.zeros(1, np.int64), np.array([4])

    def cost(numbers, forces):
        return followed.followed(smoother.history, one, link, one, numbers, forces).cost[0]

    least, varied = cost(numbers, forces), [k for k in np.flatnonzero(prior.sds) if k > 1]
    np.testing.assert_allclose(track.cost, least, rtol=1e-6)
    for way in (-0.01, 0.01):
        for k in varied:
            assert cost(numbers + way * prior.sds * (np.arange(len(prior.sds)) == k), forces) > least - 1e-6
        for step in range(12):
            for axis in range(2):
                moved = forces.copy()
                moved[0, step, axis] += way
                assert cost(numbers, moved) > least - 1e-6


def test_pictures_tell_which_link_a_wandering_force_pulls():
    rng, memory = np.random.default_rng(10), 0.93
    prior = HiddenPrior.of(CHAIN, HiddenRanges(**RANGES | {"play_mm": (0.0, 0.0), "wanders": True}))
    cases = [wandering(rng, prior, memory, 40, link) for link in (1, 2, 3, 4)]
    motors, tensions, poses = map(np.stack, zip(*cases, strict=True))
    law, effort = LAW._replace(memory=memory, angle_sd=2e-3, position_sd=0.1), Effort(searches=(9, 39))
    smoother = Smoother(CHAIN, prior, law, range(1, 5), effort, 40, True)
    smoother.reset(np.ones(4, bool))
    for step in range(40):
        now = motors[:, step], np.zeros((4, 2)), tensions[:, step], poses[:, step], np.zeros(4, np.int64)
        estimate = smoother.take_in(*now)
    assert smoother.links.tolist() == [1, 2, 3, 4]
    np.testing.assert_allclose(estimate.tip, poses[:, -1, -1, :2], atol=0.2)


def test_episodes_side_by_side_are_those_of_episodes_alone_and_begin_apart():
    rng, prior = np.random.default_rng(6), HiddenPrior.of(CHAIN, HiddenRanges(**RANGES, **SURFACES))
    way = moves(rng, 20, 2)
    cases = [measured(CHAIN, row, prior.layout, way) for row in drawn(prior, rng, 3)]
    motors, tensions, _ = map(np.stack, zip(*cases, strict=True))
    tensions = tensions + 0.1 * rng.standard_normal(tensions.shape)
    law = LAW._replace(robust=3.0)
    together = smoothed(Smoother(CHAIN, prior, law, [4], steps=20), motors, tensions)
    for episode in range(3):
        alone = smoothed(Smoother(CHAIN, prior, law, [4], steps=20), motors[episode, None], tensions[episode, None])
        for values, expected in zip(together, alone, strict=True):
            np.testing.assert_allclose(values[episode], expected[0], rtol=1e-9, atol=1e-9)
    smoother, still = Smoother(CHAIN, prior, law, [4], steps=20), np.zeros((2, 2))
    smoother.reset(np.ones(2, bool))
    for step in range(5):
        smoother.take_in(motors[:2, step], still, tensions[:2, step])
    smoother = pickle.loads(pickle.dumps(smoother))
    smoother.reset(np.array([False, True]))
    for step in range(20):
        first = min(5 + step, 19)
        places = [0, 1], [first, step]
        late = smoother.take_in(motors[places], still, tensions[places])
        assert step < 14 or smoother.history.counts[0] == 20  # its steps are over: it stays as it is
    for values, expected in zip(late, together, strict=True):
        np.testing.assert_allclose(values[:2], expected[:2], rtol=1e-9, atol=1e-9)


def test_a_motor_that_gives_way_takes_its_tendon_along_and_is_at_its_limit():
    """Both motors pull 4 mm in, and are moved back by 0.7 mm."""
    prior, nothing = HiddenPrior.of(CHAIN, HiddenRanges(**RANGES)), np.full((2, 2), np.nan)
    smoother = Smoother(CHAIN, prior, LAW._replace(limit_sd=0.05), [4], Effort(searches=(), passes=9, every=1), 3)
    smoother.reset(np.ones(2, bool))
    begin = np.tile(solve_tensions_batch(CHAIN, np.full((1, 2), START)).lengths - START / CHAIN.stiffnesses, (2, 1))
    smoother.take_in(begin, np.zeros((2, 2)), nothing)
    shift = np.array([[0.0, 0.0], [0.7, 0.7]])
    after = smoother.take_in(begin - 4.0 + shift, shift, nothing)
    assert np.all(np.abs(after.tensions[0] - 15.0) > 0.5)
    np.testing.assert_allclose(after.tensions[1], 15.0, atol=0.1)
    at_end = begin[1] - 4.0 + 0.7 + after.half_widths[1]
    np.testing.assert_allclose(after.played[1], at_end, atol=1e-9)


def test_absurd_and_missing_measurements_leave_finite_estimates():
    rng, prior = np.random.default_rng(7), HiddenPrior.of(CHAIN, HiddenRanges(**RANGES, **SURFACES))
    smoother = Smoother(CHAIN, prior, LAW._replace(robust=3.0), [4], steps=30)
    smoother.reset(np.ones(4, bool))
    for step in range(33):
        motors = CHAIN.neutral_lengths + rng.uniform(-100.0, 100.0, (4, 2))
        tensions = np.where(rng.uniform(size=(4, 2)) < 0.3, np.nan, rng.uniform(0.0, 45.0, (4, 2)))
        motors[3] = np.nan if step > 20 else motors[3]
        estimate = smoother.take_in(motors, rng.uniform(-1.0, 1.0, (4, 2)), tensions)
        assert np.isfinite(estimate.numbers).all()
    assert np.all(estimate.misfit[:3] > 5.0)


def test_mechanisms_with_friction_or_springs_and_ranges_that_are_none_are_refused():
    rubbing = CHAIN.replace(friction=CapstanFriction(0.1))
    with pytest.raises(InvalidInput, match="without springs and friction"):
        Smoother(rubbing, HiddenPrior.of(rubbing, HiddenRanges()), LAW, [4])
    with pytest.raises(InvalidInput, match="play_mm"):
        HiddenRanges(play_mm=(2.0, 1.0))
