"""Clocks, and a fixed rate: by the wall, or by a clock that moves when the loop waits."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Protocol

import numpy as np

from agents.rig.protocols import RigError
from rollingjoint.checks import as_positive

_SPUN = 3e-4  # s: the end of a wait, which sleeping would miss
_PATIENCE = 5.0  # s of the wall, for a simulated bus to read what was sent


class LoopClock(Protocol):
    """Seconds, and a wait."""

    def now(self) -> float:
        """The time [s]."""

    def sleep_until(self, t: float) -> None:
        """Wait until a time [s]."""


class WallClock:
    """Time that no change of the system's clock moves."""

    def now(self) -> float:
        """The time [s]."""
        return time.monotonic()

    def sleep_until(self, t: float) -> None:
        """Wait until a time [s]; the last third of a millisecond is spun away."""
        while (remaining := t - time.monotonic()) > 0.0:
            if remaining > _SPUN:
                time.sleep(remaining - _SPUN)


class VirtualClock:
    """Time that passes only while the loop waits: the same loop, as fast as it computes.

    Attributes:
        quiet: functions that say whether everything sent has arrived; time does not pass before.
    """

    def __init__(self) -> None:
        self._t, self._lock = 0.0, threading.Lock()
        self.quiet: list[Callable[[], bool]] = []

    def now(self) -> float:
        """The time [s]."""
        with self._lock:
            return self._t

    def sleep_until(self, t: float) -> None:
        """Let time pass up to t [s]."""
        last = time.monotonic() + _PATIENCE
        while not all(is_quiet() for is_quiet in self.quiet):
            if time.monotonic() > last:
                raise RigError("the simulated bus does not keep up")
            time.sleep(0.0)
        with self._lock:
            self._t = max(self._t, t)


class Pace:
    """Steps at a fixed rate, and how late each began; a missed step is left out, never caught up in a burst.

    Attributes:
        late: by which steps began late [s]. work: from the beginning of a step to its wait [s]. missed: steps left out.
    """

    def __init__(self, clock: LoopClock, rate: float) -> None:
        self.clock, self.period = clock, 1.0 / as_positive("rate", rate, "a positive number [Hz]")
        self.late: list[float] = []
        self.work: list[float] = []
        self.missed = 0
        self.start()

    def start(self) -> None:
        """Begin now."""
        self._begun = self.clock.now()
        self._next = self._begun + self.period

    def wait(self) -> float:
        """Wait for the next step; returns how late it begins [s]."""
        now = self.clock.now()
        self.work.append(now - self._begun)
        if now > self._next + self.period:
            self.missed += int((now - self._next) / self.period)
            self._next = now
        self.clock.sleep_until(self._next)
        self._begun = self.clock.now()
        self.late.append(self._begun - self._next)
        self._next += self.period
        return self.late[-1]

    def summary(self) -> str:
        """Jitter and work as a line."""
        if not self.late:
            return "no steps"
        late, work = (1e3 * np.array(values) for values in (self.late, self.work))
        (l50, l99), (w50, w99) = (np.percentile(values, (50, 99)) for values in (late, work))
        lateness = f"late by p50 {l50:.2f}, p99 {l99:.2f}, max {late.max():.2f} ms"
        effort = f"work p50 {w50:.2f}, p99 {w99:.2f} ms; {self.missed} missed"
        return f"{len(late)} waits of {1e3 * self.period:.3g} ms: {lateness}; {effort}"
