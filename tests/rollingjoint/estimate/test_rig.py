"""Estimates of rigs: intervals that are calibrated, one protocol, and samples of boxes against a second opinion."""

import numpy as np
import pytest

import rollingjoint as rj
from benchmarks.calibration import RANGES, SENSORS, measured, path
from rollingjoint.errors import InvalidInput
from rollingjoint.estimate import HiddenRanges, RigFilter, RigSensors, RigSmoother, simulated_rigs
from rollingjoint.estimate.sampling import sample_in_boxes

CHAIN = rj.five_link()
KINDS = pytest.mark.parametrize("kind", [RigSmoother, RigFilter])


def estimated(kind, rigs, simulated, **arguments):
    estimator = kind(CHAIN, RANGES, SENSORS, rigs=rigs, steps=len(simulated.positions), **arguments)
    for positions, tensions in zip(simulated.positions, simulated.tensions, strict=True):
        estimator.update(positions, tensions)
    return estimator


@pytest.mark.slow
@KINDS
def test_intervals_contain_the_truth_as_often_as_they_say(kind):
    depths, _, _ = measured(kind, 100, 30, seed=7, ranges=RANGES, links=[-1])
    for what, values in depths.items():
        assert 0.88 <= np.mean(values <= 0.95) <= 1.0, what  # three standard deviations
        assert 0.38 <= np.mean(values <= 0.5) <= 0.62, what


@pytest.mark.slow
@KINDS
def test_intervals_are_calibrated_over_a_thousand_rigs(kind):
    depths, _, _ = measured(kind, 1000, 40, seed=0, ranges=RANGES, links=[-1])
    for what, values in depths.items():
        assert 0.93 <= np.mean(values <= 0.95) <= 0.97, what


@KINDS
def test_a_single_rig_is_the_first_of_many(kind):
    simulated = simulated_rigs(CHAIN, path(26), RANGES, SENSORS, rigs=3, seed=1)
    many, one = estimated(kind, 3, simulated), kind(CHAIN, RANGES, SENSORS, steps=26)
    for positions, tensions in zip(simulated.positions[:, 0], simulated.tensions[:, 0], strict=True):
        one.update(positions, tensions)
    assert one.load.mean.shape == (2,) and many.load.mean.shape == (3, 2)
    assert one.shape.low.shape == (5, 3) and one.place.shape == (5,)
    width = one.load.high - one.load.low
    assert np.all(np.abs(one.load.mean - many.load.mean[0]) < 0.25 * width)  # other samples
    assert np.array_equal(one.load.interval, (one.load.low, one.load.high))


def test_before_any_measurement_estimates_are_the_ranges():
    estimator = RigSmoother(CHAIN, RANGES, SENSORS, samples=4000)
    assert np.allclose(estimator.play.low, 0.5 + 0.025 * 1.5, atol=0.05)
    assert np.allclose(estimator.play.high, 2.0 - 0.025 * 1.5, atol=0.05)
    assert np.allclose(estimator.friction.mean, 0.15, atol=0.02)


@pytest.mark.slow
def test_the_loaded_link_is_found():
    simulated = simulated_rigs(CHAIN, path(30), RANGES, SENSORS, [1, 2, 3, 4], rigs=40, seed=3)
    estimator = RigSmoother(CHAIN, RANGES, SENSORS, [1, 2, 3, 4], rigs=40, steps=30)
    for positions, tensions in zip(simulated.positions, simulated.tensions, strict=True):
        estimator.update(positions, tensions)
    assert np.allclose(estimator.place.sum(axis=1), 1.0)
    assert np.mean(estimator.place[np.arange(40), simulated.links]) > 0.4  # 0.25 by chance
    heavy = np.hypot(*simulated.forces.T) > 0.5
    assert np.mean(estimator.place.argmax(axis=1)[heavy] == simulated.links[heavy]) > 0.6


def test_pictures_narrow_intervals():
    simulated = simulated_rigs(CHAIN, path(26), RANGES, SENSORS, rigs=4, seed=2)
    without, seeing = estimated(RigSmoother, 4, simulated), RigSmoother(CHAIN, RANGES, SENSORS, rigs=4, steps=26)
    for step in zip(simulated.positions, simulated.tensions, simulated.pictures, strict=True):
        seeing.update(*step)
    widths = [np.mean(each.load.high - each.load.low) for each in (seeing, without)]
    assert widths[0] < 0.9 * widths[1]
    assert np.mean(seeing.tip.contains(simulated.poses[-1, :, -1, :2])) > 0.7


def test_the_recursive_estimator_agrees_with_the_whole_history():
    simulated = simulated_rigs(CHAIN, path(40), RANGES, SENSORS, rigs=20, seed=4)
    smoother, recursive = (estimated(kind, 20, simulated) for kind in (RigSmoother, RigFilter))
    width = smoother.load.high - smoother.load.low
    assert np.median(np.abs(smoother.load.mean - recursive.load.mean) / width) < 0.1
    assert np.median(smoother.misfit) < 0.6


def test_loads_that_wander_are_followed():
    ranges = HiddenRanges(force=(0.0, 1.0), wanders=True, offset_mm=(-0.3, 0.3))
    sensors = RigSensors(tension_sd=0.05, start_tension=5.0, memory=0.95)
    simulated = simulated_rigs(CHAIN, path(40), ranges, sensors, rigs=30, seed=5)
    for kind in (RigSmoother, RigFilter):
        estimator = kind(CHAIN, ranges, sensors, rigs=30, steps=40)
        for positions, tensions in zip(simulated.positions, simulated.tensions, strict=True):
            estimator.update(positions, tensions)
        assert np.mean(estimator.load.contains(simulated.forces)) > 0.85
        assert np.mean(estimator.load.high - estimator.load.low) < 1.0  # 1.6 before any measurement


def test_reset_forgets():
    simulated = simulated_rigs(CHAIN, path(5), RANGES, SENSORS, seed=0)
    estimator = RigFilter(CHAIN, RANGES, SENSORS)
    before = estimator.load.mean
    estimator.update(simulated.positions[0, 0], simulated.tensions[0, 0])
    estimator.reset()
    assert np.array_equal(estimator.load.mean, before)


def test_missing_tensions_are_left_out():
    simulated = simulated_rigs(CHAIN, path(5), RANGES, SENSORS, seed=0)
    estimator = RigSmoother(CHAIN, RANGES, SENSORS)
    estimator.update(simulated.positions[0, 0], [np.nan, simulated.tensions[0, 0, 1]])
    assert np.all(np.isfinite(estimator.load.mean))


def test_bad_input_gets_one_line():
    with pytest.raises(InvalidInput, match="RollingChain"):
        RigSmoother(rj.small_arm())
    estimator = RigSmoother(CHAIN, steps=1)
    with pytest.raises(InvalidInput, match="shape of positions"):
        estimator.update([1.0], [1.0, 1.0])
    with pytest.raises(InvalidInput, match="finite numbers"):
        estimator.update([np.nan, 90.0], [1.0, 1.0])
    estimator.update([90.0, 90.0], [1.0, 1.0])
    with pytest.raises(InvalidInput, match="steps = 2"):
        estimator.update([90.0, 90.0], [1.0, 1.0])
    with pytest.raises(InvalidInput, match="tension_sd"):
        RigSensors(tension_sd=0.0)
    with pytest.raises(InvalidInput, match="shape of the path"):
        simulated_rigs(CHAIN, [[0.0]], RANGES, SENSORS)
    with pytest.raises(InvalidInput, match=r"path\[0\]"):
        simulated_rigs(CHAIN, [[-1.0, 0.0]], RANGES, SENSORS)


def test_samples_within_a_box_are_those_of_rejection():
    rng = np.random.default_rng(0)
    A = rng.standard_normal((3, 3))
    precision, mean = A @ A.T + 0.3 * np.eye(3), np.array([0.5, -0.2, 0.1])
    low, high = np.array([-1.0, -0.5, -0.8]), np.array([0.7, 0.9, 0.4])
    ours = sample_in_boxes(precision[None], mean[None], low, high, mean[None], 20_000, rng)[0]
    drawn = rng.multivariate_normal(mean, np.linalg.inv(precision), 400_000)
    theirs = drawn[np.all((drawn > low) & (drawn < high), axis=1)]
    assert np.all((ours >= low) & (ours <= high))
    assert np.allclose(ours.mean(axis=0), theirs.mean(axis=0), atol=0.02)
    tails = [np.quantile(drawn, [0.025, 0.975], axis=0) for drawn in (ours, theirs)]
    assert np.allclose(*tails, atol=0.03)
