"""Contact with a wall as an estimated cause: exact derivatives, calibrated intervals, one protocol."""

import numpy as np
import pytest

import rollingjoint as rj
from benchmarks.calibration import BESIDE_WALL, FORCE, OUTLINE, PLACE, SENSORS, WALL, measured, swing
from rollingjoint.errors import InvalidInput
from rollingjoint.estimate import ContactSmoother, HiddenRanges, RigSensors, RigSmoother, WallRanges, simulated_rigs

CHAIN = rj.five_link()
STEPS = 29


def rigs(count, seed, ranges=BESIDE_WALL):
    return simulated_rigs(CHAIN, swing(STEPS), ranges, SENSORS, rigs=count, seed=seed, wall=WALL, outline=OUTLINE)


def smoother(count, ranges=BESIDE_WALL, samples=100, steps=STEPS, wall=WALL):
    return ContactSmoother(CHAIN, wall, ranges, SENSORS, rigs=count, steps=steps, samples=samples, outline=OUTLINE)


def fed(estimator, simulated):
    for positions, tensions in zip(simulated.positions, simulated.tensions, strict=True):
        estimator.update(positions, tensions)
    return estimator


def test_costs_are_differentiated_exactly_by_all_hidden_numbers():
    """Also while several links press; the slope of the normal equations is that of the cost."""
    ranges = HiddenRanges(**vars(BESIDE_WALL) | {"force": (0.0, 1.0)})
    simulated = rigs(1, 3, ranges)
    estimator = fed(smoother(1, ranges, wall=WallRanges((-0.5, 0.5), (-20.0, 0.0), (0.5, 3.0))), simulated)
    estimator.smoother.history.tensions[:, 1:] += 0.5  # residuals of many sizes
    numbers = estimator.prior.means.copy()
    numbers[:2], numbers[-3:] = (0.2, -0.1), (0.1, -6.0, 1.2)
    sds, steps = estimator.prior.sds, 1e-5 * np.maximum(estimator.prior.sds, 1e-3)
    rows = np.vstack([numbers, numbers + np.diag(steps), numbers - np.diag(steps)])
    track = estimator._followed_at(np.zeros(len(rows), int), rows)
    K = len(numbers)
    by_difference = (track.cost[1 : K + 1] - track.cost[K + 1 :]) / (2.0 * steps) * sds
    # tensions are linearised by their means: Gauss-Newton has the same first derivatives
    free = sds > 0.0
    assert np.allclose(-track.slope[0][free], by_difference[free], rtol=2e-4, atol=2e-3 * np.abs(by_difference).max())


@pytest.mark.slow
def test_a_wall_is_found():
    simulated = rigs(4, 11)
    estimator = fed(smoother(4), simulated)
    assert np.all(estimator.misfit < 1.0)
    pressing = simulated.touching.link > 0
    assert pressing.sum() >= 3
    assert np.all(estimator.touches[pressing] > 0.5)
    force, contact, wall = estimator.wall_force, estimator.contact, estimator.wall
    assert np.mean(force.contains(simulated.touching.force)[pressing]) > 0.7
    assert np.mean(contact.contains(simulated.touching.place)[pressing]) > 0.7
    assert np.mean(wall.contains(simulated.walls)) > 0.7
    widths = wall.high - wall.low
    assert np.median(widths[:, 1]) < 0.3 * 15.0 and np.median((force.high - force.low)[pressing]) < 1.0
    assert np.all(estimator.touched[pressing].argmax(axis=1) == simulated.touching.link[pressing])
    without = fed(RigSmoother(CHAIN, HiddenRanges(**vars(BESIDE_WALL)), SENSORS, rigs=4, steps=STEPS), simulated)
    assert np.all(without.misfit[pressing] > 2.0 * estimator.misfit[pressing])


@pytest.mark.slow(minutes=2)
def test_intervals_beside_a_wall_are_calibrated():
    depths, _, _ = measured(ContactSmoother, 250, STEPS, seed=20, ranges=BESIDE_WALL, links=[-1])
    assert {FORCE, PLACE} < set(depths)
    for what, values in depths.items():
        assert 0.91 <= np.mean(values <= 0.95) <= 0.99, what  # three standard deviations
        assert 0.40 <= np.mean(values <= 0.5) <= 0.60, what


def test_before_any_measurement_estimates_are_the_ranges():
    estimator = smoother(None, samples=4000)
    assert np.allclose(estimator.wall.low, [-0.475, -19.6, 0.56], atol=[0.03, 0.4, 0.08])
    assert np.allclose(estimator.wall.high, [0.475, -5.4, 2.94], atol=[0.03, 0.4, 0.08])
    assert 0.0 < estimator.touches < 1.0


@pytest.mark.slow
def test_a_single_rig_is_the_first_of_many_and_reset_forgets():
    simulated = rigs(2, 5)
    many, one = fed(smoother(2, samples=400), simulated), smoother(None, samples=400)
    for positions, tensions in zip(simulated.positions[:, 0], simulated.tensions[:, 0], strict=True):
        one.update(positions, tensions)
    assert one.wall.mean.shape == (3,) and one.contact.mean.shape == (2,) and one.touched.shape == (5,)
    width = many.tip.high[0] - many.tip.low[0]
    assert np.all(np.abs(one.tip.mean - many.tip.mean[0]) < 0.25 * width)  # other samples
    one.reset()
    assert np.array_equal(one.wall.mean, smoother(None, samples=400).wall.mean)


def test_the_force_at_other_positions_is_that_where_motors_have_gone_there():
    wall = WallRanges((0.2, 0.2), (-11.0, -11.0), (1.0, 1.0))
    estimator = ContactSmoother(CHAIN, wall, outline=OUTLINE, samples=20)
    places = CHAIN.neutral_lengths - [[0.5, -0.5], [2.0, -2.0], [2.5, -2.5]]
    estimator.update(places[0], [3.0, 3.0])
    assert np.array_equal(estimator.touching_at(places[:1]).force[0], estimator.touching.force[0])
    ahead = estimator.touching_at(places)
    assert ahead.force.shape == (3, 20, 2) and ahead.link.shape == (3, 20)
    estimator.update(places[2], [3.0, 3.0])
    force = estimator.touching.force[0, 0]
    assert np.allclose(ahead.force[2], force, atol=1e-6) and np.linalg.norm(force) > 0.1
    assert np.linalg.norm(ahead.force[1, 0]) < np.linalg.norm(force)
    with pytest.raises(InvalidInput, match="positions"):
        estimator.touching_at([[0.0, 0.0, 0.0]])


def test_a_known_wall_stays_known():
    simulated = rigs(1, 7)
    direction, offset, compliance = simulated.walls[0]
    wall = WallRanges((direction, direction), (offset - 3.0, offset + 3.0), (compliance, compliance))
    estimator = fed(smoother(1, wall=wall), simulated)
    assert np.allclose(estimator.wall.mean[0, [0, 2]], [direction, compliance], atol=1e-6)
    assert estimator.wall.contains(simulated.walls)[0, 1] or abs(estimator.wall.mean[0, 1] - offset) < 1.0


def test_bad_input_gets_one_line():
    with pytest.raises(InvalidInput, match="compliance = 0"):
        WallRanges(compliance=(0.0, 1.0))
    with pytest.raises(InvalidInput, match="displaced surfaces"):
        ContactSmoother(CHAIN, WALL, HiddenRanges(surface_mm=0.05), RigSensors())
    with pytest.raises(InvalidInput, match="starts"):
        ContactSmoother(CHAIN, starts=(0, 1))
    with pytest.raises(InvalidInput, match="RollingChain"):
        ContactSmoother(rj.small_arm())
