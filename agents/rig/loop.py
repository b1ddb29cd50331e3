"""A rig: motors, load cells and perhaps a tracker, under a guard, at a fixed rate, with a recording."""

from __future__ import annotations

import gc
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Any, Self

import numpy as np

from agents.rig.guard import GuardSettings, RigGuard
from agents.rig.pace import LoopClock, Pace
from agents.rig.protocols import Array, RigError, RigMotors, RigPoses, RigReading, RigTensions
from rollingjoint.checks import as_integer
from rollingjoint.identify import RecordingWriter


@dataclass(frozen=True)
class RigState:
    """Readings after a step; tip: (d,) [mm], None where it was not seen; late: the largest of the step's looks [s]."""

    t: float
    motors: Array
    tensions: Array
    tip: Array | None
    late: float
    retries: int


class Rig:
    """The loop of a rig. On leaving a `with` block, also by an error or Ctrl-C, motors hold, and torque stays on.

    Args:
        motors, tensions, poses: devices. clock: of the loop and of the devices' times.
        rate: of steps [Hz]. looks: in every step; goals are ramps over them, each checked by the guard.
        guard: its settings. home: lengths at the zero, (m,) [mm].
        writer: of the recording.
    """

    def __init__(
        self,
        motors: RigMotors,
        tensions: RigTensions,
        clock: LoopClock,
        home: Array,
        guard: GuardSettings | None = None,
        rate: float = 20.0,
        looks: int = 4,
        poses: RigPoses | None = None,
        writer: RecordingWriter | None = None,
    ) -> None:
        self.motors, self.tensions, self.poses, self.clock, self.writer = motors, tensions, poses, clock, writer
        self.looks, self._late = as_integer("looks", looks, 1, 100), 0.0
        whole = guard or GuardSettings()
        self.step_mm, self.rate = whole.step_mm, rate
        self.guard = RigGuard(replace(whole, step_mm=whole.step_mm / self.looks), np.asarray(home, float))
        self.pace = Pace(clock, rate * self.looks)
        self._read()
        self.goal: Array = self._motor_reading.values.copy()
        self.run = "1"

    def __enter__(self) -> Self:
        gc.collect()
        gc.freeze()  # else a collection looks at all modules and policies, some 80 ms in the middle of the loop
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None:
            self._log_event(f"{type(error).__name__}: {error}")
        self.close()

    @property
    def state(self) -> RigState:
        """The last readings."""
        motors, tensions = self._motor_reading, self._tension_reading
        tip = None if self._tip is None else self._tip.values
        retries = motors.retries + tensions.retries
        return RigState(motors.t, motors.values, tensions.values, tip, self._late, retries)

    def begin(self, run: str) -> RigState:
        """Begin a run of the recording: goals where motors are, and a first line."""
        self.run = run
        self._read()
        self.goal, self._late = self._motor_reading.values.copy(), 0.0
        self.pace.start()
        self._log()
        return self.state

    def step(self, goal: Array, **others: Any) -> RigState:
        """Go to a goal, (m,) [mm], in one step, as far as the guard lets; others go into the recording.

        Raises:
            Stopped, RigError: after motors were told to hold.
        """
        wanted, begin = np.asarray(goal, float), self.goal
        told: list[str] = []
        late = 0.0
        for look in range(1, self.looks + 1):
            late = max(late, self._look(begin + (wanted - begin) * look / self.looks, told))
        self._late = late
        event = "guard: " + "; ".join(dict.fromkeys(told)) if told else None
        self._log(event=event, goal=self.goal, **others)
        return self.state

    def _look(self, goal: Array, told: list[str]) -> float:
        """Send a part of a goal, and read; returns how late the next look begins [s]."""
        try:
            now = self.clock.now()
            self.goal = self.guard.passed(goal, self.goal, self._motor_reading, self._tension_reading, now)
            told += self.guard.interventions
            self.motors.write(self.goal)
            late = self.pace.wait()
            self._read()
        except (RigError, KeyboardInterrupt) as error:
            held = self.motors.hold()
            self._log_event(f"{type(error).__name__}: {error}; " + ("motors hold" if held else "hold not confirmed"))
            raise
        return late

    def _read(self) -> None:
        self._motor_reading, self._tension_reading = self.motors.read(), self.tensions.read()
        self._tip: RigReading | None = None if self.poses is None else self.poses.read()

    def _log(self, **others: Any) -> None:
        if self.writer is not None:
            state = self.state
            self.writer.step(
                state.t, state.motors, state.tensions, tip=state.tip, run=self.run, late=state.late,
                retries=state.retries or None, **others,
            )  # fmt: skip

    def _log_event(self, event: str) -> None:
        if self.writer is not None:
            self.writer.event(self.clock.now(), event)

    def close(self) -> None:
        """Hold, and leave the ports."""
        self.motors.hold()
        self.motors.close()
        self.tensions.close()
        if self.writer is not None:
            self.writer.close()
