"""Hidden numbers of arms and rolling joints in space with friction in their holes, from what motors measure."""

from dataclasses import replace

import numpy as np
import pytest

from rollingjoint.chain.presets import pitch_yaw, small_arm
from rollingjoint.errors import InvalidInput
from rollingjoint.estimate import ArmEffort, ArmLaw, ArmPrior, ArmRanges, ArmSmoother, FollowedArm, MotorHistory
from rollingjoint.friction import CapstanFriction

ARMS = {"arm": small_arm(4), "rolling joints": pitch_yaw(4, weight=0.2)}
STEPS = 12
RANGES = ArmRanges(
    offset_mm=(-0.5, 0.5), stiffness=(0.8, 1.2), hinge=(0.9, 1.1), weight=(0.9, 1.1), play_mm=(0.2, 1.0),
    sheath_friction=(0.0, 0.3), hole_friction=(0.0, 0.1), shared=True,
)  # fmt: skip
LAW = ArmLaw(3.0, 0.005, 0.0, 1e4, 0.05, 0.1, 0.0, 3.0, 0.02)
RIG = LAW._replace(high=np.inf, measured=True)
ERRORS = {"gain": (0.98, 1.02), "zero": (-0.1, 0.1)}  # of load cells
CASES = {  # the mechanism, changes of the ranges, and the law
    "one coefficient": ("arm", {}, LAW),
    "one per tendon": ("arm", {"shared": False}, LAW),
    "cells that err at the motors": ("arm", ERRORS, RIG),
    "cells that err at the tendons": ("arm", ERRORS, RIG._replace(cells_at_tendons=True)),
    "rolling": ("rolling joints", {}, LAW),
    "rolling, cells that err": ("rolling joints", ERRORS, RIG),
}


def history_of(arm, numbers, prior, law, seed):
    """An episode of an arm with these hidden numbers that begins at the start tension, with exact tensions."""
    at, m, rng = prior.layout, arm.n_tendons, np.random.default_rng(seed)
    empty = np.zeros((1, STEPS, m))
    history = MotorHistory(np.ones(1, np.int64), empty, empty.copy(), empty.copy(), np.zeros((1, STEPS, 0, 3)))
    followed = FollowedArm(arm, prior, law)
    rows = followed.begun(np.zeros(1, np.int64), numbers[None])
    away, _ = followed._begin(rows, history.motors[:, 0])
    ways = np.vstack([np.zeros(m), rng.uniform(-1.0, 1.0, (STEPS - 1, m)) - 0.3])
    history.motors[0] = away[0] + np.cumsum(ways, axis=0)
    rows = followed.begun(np.zeros(1, np.int64), numbers[None])
    for step in range(STEPS):
        history.counts[0] = step + 1
        followed.follow(rows, history)
        half, friction = numbers[at.half_widths : at.frictions], numbers[at.frictions : at.places]
        place = np.clip((rows.played[0] - history.motors[0, step]) / half, -1.0, 1.0)
        gain, zero = prior.cells(numbers[None])
        sheath = 1.0 if law.cells_at_tendons else np.exp(friction * place)
        history.tensions[0, step] = np.reshape(gain * (rows.tensions * sheath) + zero, -1)
    return history, rows


@pytest.fixture(params=CASES)
def case(request):
    """An arm, a prior, a law, hidden numbers, and an episode with them."""
    name, changes, law = CASES[request.param]
    arm = ARMS[name]
    prior = ArmPrior.of(arm, replace(RANGES, **changes))
    draws = np.random.default_rng(0).standard_normal(prior.layout.total)
    numbers = prior.within(prior.means + prior.sds * np.clip(draws, -1.0, 1.0))
    return arm, prior, law, numbers, *history_of(arm, numbers, prior, law, 1)


def test_derivatives_are_the_differences(case):
    arm, prior, law, numbers, history, _ = case
    K, reach = prior.layout.total, 1e-5
    followed = FollowedArm(arm, prior, law)
    alone = followed.followed(history, np.zeros(1, np.int64), numbers[None])
    changes = reach * np.diag(prior.sds)
    near = followed.followed(history, np.zeros(2 * K, np.int64), np.concatenate([numbers + changes, numbers - changes]))
    for name in ("tip", "tensions"):
        values = getattr(near, name)
        differences = (values[:K] - values[K:]).T / (2 * reach)
        np.testing.assert_allclose(getattr(alone, f"{name}_by")[0] * prior.sds, differences, atol=1e-6)
    np.testing.assert_allclose(-alone.slope[0], (near.cost[:K] - near.cost[K:]) / (2 * reach), rtol=1e-5, atol=1e-4)


@pytest.mark.slow
def test_the_smoother_finds_the_tip_as_well_as_it_can_be_known(case):
    arm, prior, law, _, history, truth = case
    smoother = ArmSmoother(arm, prior, law, ArmEffort(every=1, passes=10, moved=1e-3), STEPS)
    smoother.reset(np.ones(1, bool))
    for step in range(STEPS):
        smoothed = smoother.take_in(*(values[:, step] for values in history[1:4]))
    away = (smoothed.tip - truth.tip)[0]
    assert away @ np.linalg.solve(truth.tip_covariance(prior.sds)[0], away) < 16.0
    rows = FollowedArm(arm, prior, law).followed(history, np.zeros(1, np.int64), smoothed.numbers)
    assert rows.cost[0] < truth.cost[0]
    np.testing.assert_allclose(smoothed.tensions, truth.tensions, atol=0.3)
    assert smoothed.misfit[0] < 0.3


def test_more_measurements_leave_less_of_the_tip_unknown(case):
    arm, prior, law, numbers, history, _ = case
    followed, variances = FollowedArm(arm, prior, law), []
    last = followed.followed(history, np.zeros(1, np.int64), numbers[None])
    reached = last.tip_by[0] * prior.sds
    for count in (1, 4, STEPS):
        history.counts[0] = count
        rows = followed.followed(history, np.zeros(1, np.int64), numbers[None])
        rows.tip_by[:] = last.tip_by
        variances.append(np.trace(rows.tip_covariance(prior.sds)[0]) / np.trace(reached @ reached.T))
    assert 1.0 > variances[0] > variances[1] > variances[2]


def test_episodes_side_by_side_are_those_alone(case):
    arm, prior, law, _, history, _ = case
    both = ArmSmoother(arm, prior, law, steps=STEPS)
    both.reset(np.ones(2, bool))
    alone = ArmSmoother(arm, prior, law, steps=STEPS)
    alone.reset(np.ones(1, bool))
    for step in range(5):
        values = [np.repeat(each[:, step], 2, axis=0) for each in history[1:4]]
        both.take_in(*values)
    both.reset(np.array([False, True]))
    for step in range(5):
        now = [np.stack([each[0, 5 + step], each[0, step]]) for each in history[1:4]]
        second = both.take_in(*now)
        first = alone.take_in(*(each[:, step] for each in history[1:4]))
    np.testing.assert_allclose(second.tip[1], first.tip[0], rtol=1e-9)
    np.testing.assert_allclose(second.numbers[1], first.numbers[0], rtol=1e-9)


def test_tilts_beyond_the_horizon_are_refused():
    with pytest.raises(InvalidInput, match="tilt"):
        ArmRanges(tilt=(0.0, 2.0))


RESISTED = replace(pitch_yaw(4), friction=CapstanFriction(0.0, rolling=0.1))


@pytest.mark.parametrize("arm", [small_arm(4, "linear"), RESISTED], ids=["linear", "rolling resistance"])
def test_other_mechanisms_are_refused(arm):
    with pytest.raises(InvalidInput, match="exact"):
        ArmSmoother(arm, ArmPrior.of(arm, RANGES), LAW)
