"""The guard, spools and pace."""

import numpy as np
import pytest

from agents.rig.guard import GuardSettings, RigGuard
from agents.rig.pace import Pace, VirtualClock, WallClock
from agents.rig.protocols import RigReading, Stopped
from agents.rig.spool import Spools
from rollingjoint.errors import ConfigError

HOME = np.array([90.0, 97.0])


def passed(goal, tensions=(5.0, 5.0), before=HOME, motors=HOME, age=0.0, **settings):
    guard = RigGuard(GuardSettings(**settings), HOME)
    readings = RigReading(np.array(motors), 1.0 - age), RigReading(np.array(tensions), 1.0)
    return guard.passed(np.array(goal), np.array(before), *readings, 1.0), guard.interventions


def test_goals_change_by_a_millimetre_at_most_and_stay_in_the_travel():
    goal, told = passed([80.0, 97.5])
    assert goal.tolist() == [89.0, 97.5] and told == ["step: motors [0]"]
    goal, told = passed([88.0, 97.0], before=[88.5, 97.0], motors=[88.5, 97.0], travel_mm=1.0)
    assert goal.tolist() == [89.0, 97.0] and told == ["travel: motors [0]"]


def test_nobody_pulls_while_one_is_high_and_a_slack_tendon_is_not_let_out():
    goal, told = passed([89.5, 97.5], tensions=(26.0, 5.0))
    assert goal.tolist() == [90.0, 97.5] and told == ["tension high: motors [0]"]
    goal, told = passed([90.5, 96.5], tensions=(0.3, 5.0))
    assert goal.tolist() == [90.0, 96.5] and told == ["tension low: motors [0]"]


def test_a_motor_far_behind_its_goal_gets_no_further_goal():
    goal, told = passed([85.0, 97.0], before=[86.0, 97.0], motors=[90.0, 97.0])
    assert goal.tolist() == [87.0, 97.0] and "motor behind its goal: motors [0]" in told


@pytest.mark.parametrize(
    ("words", "changes"),
    [
        ("finite", {"goal": [np.nan, 97.0]}),
        ("finite", {"goal": [90.0]}),
        ("tensions are not finite", {"tensions": (np.nan, 1.0)}),
        ("s old", {"age": 0.3}),
        ("at or above the limit of 40 N", {"tensions": (5.0, 41.0)}),
    ],
)
def test_what_must_not_be_sent_stops(words, changes):
    with pytest.raises(Stopped, match=words):
        passed(**({"goal": HOME} | changes))


def test_limits_out_of_order_are_refused():
    with pytest.raises(ConfigError, match="low < high < stop"):
        GuardSettings(high=50.0)


def test_spools_count_turns_signs_and_offsets():
    spools = Spools(10.0, (1, -1), (100, -300), (90.0, 97.0), (0.5, 0.0))
    assert spools.lengths([100, -300]).tolist() == [90.5, 97.0]
    far = spools.ticks([90.5 - 160.0, 97.0 + 160.0])
    assert far[0] > 100 and far[1] > -300  # pulled in by rising ticks; let out by rising ones
    np.testing.assert_allclose(spools.lengths(far), [90.5 - 160.0, 257.0], atol=0.5 * spools.mm_per_tick)
    for wrong in ({"signs": (1, 2)}, {"zero_mm": (1.0,)}, {"radius_mm": 0.0}):
        with pytest.raises(ConfigError):
            Spools(**({"radius_mm": 10.0, "signs": (1, 1), "zero_ticks": (0, 0), "zero_mm": (0.0, 0.0)} | wrong))


def test_missed_steps_are_left_out_and_not_caught_up():
    clock = VirtualClock()
    pace = Pace(clock, 20.0)
    for _ in range(3):
        assert pace.wait() == 0.0
    clock.sleep_until(clock.now() + 0.33)
    first = clock.now()
    pace.wait()
    assert clock.now() == first and pace.missed == 5
    pace.wait()
    assert clock.now() == pytest.approx(first + 0.05) and "5 missed" in pace.summary()


def test_the_wall_clock_waits():
    clock = WallClock()
    until = clock.now() + 0.02
    clock.sleep_until(until)
    assert clock.now() >= until
