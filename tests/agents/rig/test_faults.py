"""Faults of buses, motors and load cells, through the real SDK and a simulated bus."""

import gc
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from agents.rig.dynamixel import DynamixelSettings
from agents.rig.protocols import BusLost, HardwareAlert, RigError, Stopped
from agents.rig.simulated.servo import TICKS, At
from rollingjoint.errors import ConfigError

from .rigs import GUARD, Watched, built

pytestmark = pytest.mark.posix


def wander(rig, steps, rng=None):
    """Goals to and fro by up to half a millimetre a step."""
    for step in range(steps):
        rig.step(rig.goal + 0.4 * np.array([1.0, -1.0]) * (1 if step // 5 % 2 else -1))


def test_garbage_collections_in_the_loop_leave_out_what_was_there_before():
    with built() as one:
        rig, before, kept = one.rig(), gc.get_freeze_count(), [[] for _ in range(5000)]
        with rig:
            assert gc.get_freeze_count() >= before + len(kept)


def test_readings_are_right_while_answers_are_lost_damaged_reversed_or_behind_garbage():
    with built() as one, one.rig() as rig:
        faults = one.bus.faults
        faults.lost, faults.damaged, faults.garbage, faults.reversed_ids = 0.03, 0.03, 0.2, True
        for _ in range(15):
            state = rig.step(rig.goal + 0.3 * np.array([-1.0, 1.0]))
            np.testing.assert_allclose(state.motors, one.positions, atol=one.bus.mm_per_tick)
        assert faults.counts["garbage"] > 10 and one.motors.counts["retries"] > 0


def test_late_answers_are_known_by_the_counter_of_the_motor():
    with built() as one, one.rig() as rig:
        one.bus.faults.late, one.bus.faults.late_s = 0.1, 0.08
        for step in range(25):
            state = rig.step(rig.goal + 0.3 * np.array([-1.0, 1.0]) * (-1) ** (step // 6))
            np.testing.assert_allclose(state.motors, one.positions, atol=one.bus.mm_per_tick)
        assert one.motors.counts["old"] > 0


def test_answers_to_the_question_before_are_known_by_their_size():
    with built() as one, one.rig() as rig:
        watched = Watched(one)
        one.bus.faults.echoed = True
        for _ in range(5):
            state = rig.step(rig.goal + 0.3 * np.array([-1.0, 1.0]))
            np.testing.assert_allclose(state.motors, one.positions, atol=one.bus.mm_per_tick)
        assert one.motors.hold() and watched.unsafe == []
        one.motors.connect()
        np.testing.assert_allclose(one.motors.read().values, one.positions, atol=one.bus.mm_per_tick)
        assert watched.unsafe == []


def test_an_overloaded_motor_is_told_of_at_the_next_look_and_the_other_holds():
    with built() as one:
        rig = one.rig()
        one.bus.servos[2].fail()
        with pytest.raises(HardwareAlert, match="motor 2 has the hardware error 0x20"):
            rig.step(rig.goal + 0.2)
        before = one.positions[0]
        one.wait(1.0)
        assert abs(one.positions[0] - before) < 0.05 and one.bus.servos[1].is_on
        with pytest.raises(HardwareAlert, match="reboot"):
            one.motors.connect()
        one.motors.reboot(2)
        one.motors.connect()
        rig.close()


def test_lost_turns_are_refused():
    with built() as one:
        rig = one.rig()
        for servo in one.bus.servos.values():
            servo.position += 3 * TICKS
        with pytest.raises(RigError, match="home again"):
            rig.step(rig.goal)
        rig.close()


def test_a_pulled_cable_and_a_silent_motor_are_errors_and_no_hangs():
    with built() as one:
        rig = one.rig()
        one.bus.faults.mute.add(2)
        with pytest.raises(BusLost, match=r"motors \[2\] did not answer 3 times"):
            rig.step(rig.goal)
        one.bus.faults.mute.clear()
        one.bus.unplug()
        with pytest.raises(BusLost):
            rig.step(rig.goal)
        assert one.motors.hold() is False


@pytest.mark.parametrize("kind", ["nan", "silent", "frozen", "damaged"])
def test_load_cells_may_fail_three_times_in_a_row(kind):
    with built() as one, one.rig(looks=1) as rig:
        for _ in range(2):
            rig.step(rig.goal)
        one.bus.faults.cells = kind
        rig.step(rig.goal)
        one.bus.faults.cells = ""
        rig.step(rig.goal)
        one.bus.faults.cells = kind
        with pytest.raises(RigError, match=r"for the 4th time|s old"):
            wander(rig, 10)
        before = one.positions
        one.wait(1.0)
        np.testing.assert_allclose(one.positions, before, atol=0.05)


def test_a_goal_that_is_not_finite_stops_and_motors_hold():
    with built() as one, one.rig() as rig:
        watched = Watched(one)
        with pytest.raises(Stopped, match="finite"):
            rig.step(np.array([np.nan, 90.0]))
        with pytest.raises(RigError, match="finite"):
            one.motors.write(np.array([np.inf, 90.0]))
        with pytest.raises(RigError, match="31 turns"):
            one.motors.write(one.home - 2100.0)
        assert watched.unsafe == []


def test_ctrl_c_anywhere_leaves_motors_holding():
    class Interrupts:
        """Raises KeyboardInterrupt in the n-th call of the port."""

        def __init__(self, port, number):
            self.port, self.left, self.read = port, number, port.readPort
            port.readPort = self

        def __call__(self, length):
            self.left -= 1
            if self.left == 0:
                raise KeyboardInterrupt
            return self.read(length)

    for number in range(1, 12):
        with built(seed=number) as one:
            rig = one.rig()
            Interrupts(one.motors.port, number)
            with pytest.raises(KeyboardInterrupt):
                wander(rig, 20)
            before = one.positions
            one.wait(2.0)
            np.testing.assert_allclose(one.positions, before, atol=0.05)
            rig.close()


def test_a_killed_process_is_stopped_by_the_watchdog_and_goals_are_refused_until_it_is_released():
    with built(watchdog_s=0.2) as one:
        rig = one.rig()
        rig.step(rig.goal - 0.9)
        one.motors.write(rig.goal - 0.9)
        one.wait(1.0)
        assert all(servo.table[At.WATCHDOG] == 0xFF for servo in one.bus.servos.values())
        with pytest.raises(HardwareAlert, match="watchdog has stopped motor 1"):
            rig.begin("on")
        before = one.positions
        one.motors.write(rig.goal + 5.0)
        one.wait(0.1)
        np.testing.assert_array_equal(one.positions, before)
        one.motors.release_watchdogs()
        rig.begin("again")
        rig.step(rig.goal + 0.5)
        np.testing.assert_allclose(one.positions, before + 0.5, atol=0.05)
        rig.close()


def test_a_watchdog_shorter_than_three_steps_is_refused():
    with pytest.raises(ConfigError, match=r"0, or 0\.16 and more: three steps"), built(watchdog_s=0.12):
        pass
    with pytest.raises(ConfigError, match="watchdog_s"):
        DynamixelSettings("port", (1,), watchdog_s=3.0)


def test_torque_goes_off_at_connect_only_where_the_mode_differs():
    with built() as one:
        off = []
        write = one.bus.servos[1].write
        one.bus.servos[1].write = lambda at, content: (
            off.append(at == At.TORQUE and content == b"\0"),
            write(at, content),
        )[1]
        one.motors.connect()
        assert not any(off) and one.bus.servos[1].is_on
    with built(configured=False) as one:
        one.motors.connect()
        assert all(servo.is_on and servo.table[At.MODE] == 5 for servo in one.bus.servos.values())


def test_the_limit_of_current_ends_a_pull():
    with built(current_limit=8.0) as one:
        rig = one.rig()
        for _ in range(12):
            rig.step(rig.goal - 0.5)
        assert 6.5 < one.plant.motor_tensions.max() < 8.6
        assert np.abs(rig.goal - one.positions).max() < 4.5
        rig.close()


def test_tension_at_the_stop_ends_the_motion():
    with built() as one:
        rig = one.rig()
        rig.guard.settings = type(rig.guard.settings)(high=6.0, stop=8.0)
        for _ in range(20):
            rig.step(rig.goal - 0.5)
        assert one.plant.motor_tensions.max() < 8.0 and rig.guard.interventions
        one.plant.offsets = one.plant.offsets - 3.0  # somebody pulls at the mechanism
        one.plant._solved = None
        with pytest.raises(Stopped, match="at or above the limit of 8 N"):
            for _ in range(3):
                rig.step(rig.goal)
        rig.close()


def sequence(seed):
    """One random sequence of faults: what was unsafe, how it ended, and the number of goals."""
    rng = np.random.default_rng(seed)
    ended = ""
    with built(seed=seed, patience_ms=20.0) as one:
        watched = Watched(one)
        held = []
        hold = one.motors.hold
        one.motors.hold = lambda: held.append(hold()) or held[-1]
        try:
            rig = one.rig(looks=int(rng.integers(1, 5)))
            for _ in range(int(rng.integers(5, 20))):
                if rng.random() < 0.3:
                    disturb(one, rng)
                goal = rig.goal + rng.uniform(-1.5, 1.5, 2)
                if rng.random() < 0.05:
                    goal = goal * rng.choice([np.nan, np.inf, 100.0])
                rig.step(goal)
        except RigError as error:
            ended = type(error).__name__
        before = {ident: servo.position for ident, servo in one.bus.servos.items() if servo.is_on}
        one.bus.faults.mute.clear()
        for _ in range(4):
            one.wait(0.25)
        moved = [abs(one.bus.servos[ident].position - at) * one.bus.mm_per_tick for ident, at in before.items()]
        still = 0.1 if held and held[-1] else GUARD.lag_mm + GUARD.step_mm  # mm: at rest, or on to the last goals
        if max(moved, default=0.0) > still:
            watched.unsafe.append(f"motors go on by {moved} mm after {ended}")
        return watched.unsafe, ended, watched.seen


def disturb(one, rng):
    """One fault, or the end of all."""
    faults, kind = one.bus.faults, int(rng.integers(0, 12))
    faults.late_s = 1.3e-3 * one.patience_ms
    if kind < 4:
        setattr(faults, ("lost", "damaged", "late", "garbage")[kind], float(rng.uniform(0.0, 0.3)))
    elif kind == 4:
        faults.reversed_ids = not faults.reversed_ids
    elif kind == 5:
        faults.mute.add(int(rng.integers(1, 3)))
    elif kind == 6:
        faults.cells = str(rng.choice(["nan", "silent", "frozen", "damaged"]))
    elif kind == 7:
        with one.bus.lock:
            one.bus.servos[int(rng.integers(1, 3))].fail(int(rng.choice([0x01, 0x04, 0x20])))
    elif kind == 8:
        with one.bus.lock:
            one.bus.servos[int(rng.integers(1, 3))].reboot()
    elif kind == 9 and one.bus.alive:
        one.bus.unplug()
    elif kind == 10:
        one.clock.sleep_until(one.clock.now() + 0.6)  # the loop was stopped: watchdogs bite
    else:
        faults.lost = faults.damaged = faults.late = faults.garbage = 0.0
        faults.cells = ""
        faults.mute.clear()


def assert_safe(seeds):
    ends, commands = set(), 0
    with ThreadPoolExecutor(4) as pool:  # they wait for answers that do not come
        every = list(pool.map(sequence, seeds))
    for seed, (unsafe, ended, seen) in zip(seeds, every, strict=True):
        assert unsafe == [], (seed, ended)
        ends.add(ended)
        commands += seen
    return ends, commands


def test_random_faults_lead_to_no_unsafe_command():
    ends, commands = assert_safe(range(25))
    assert {"BusLost", "HardwareAlert"} <= ends and commands > 500


@pytest.mark.slow
def test_a_thousand_random_sequences_of_faults_lead_to_no_unsafe_command():
    assert_safe(range(100, 1100))
