"""The guard: what every goal passes before it is sent to motors. It lowers risk and makes nothing safe.

An emergency stop is a switch in the supply of the motors.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from agents.rig.protocols import Array, RigReading, Stopped
from rollingjoint.checks import as_number, as_positive
from rollingjoint.errors import ConfigError

_ROUNDING = 1e-9  # mm


@dataclass(frozen=True)
class GuardSettings:
    """Limits of a rig.

    Args:
        step_mm: the largest change of a goal in a step; the loop gives every look its share.
        travel_mm: how far goals may be from the lengths at the zero, either way.
        low: at or below it a tendon is not let out further [N].
        high: at or above it on any tendon no motor pulls in [N].
        stop: at or above it on any tendon the motion ends [N].
        largest_age: of readings [s].
        lag_mm: how far a motor may be from its goal before it counts as stuck, and its goal stays there.
    """

    step_mm: float = 1.0
    travel_mm: float = 40.0
    low: float = 0.5
    high: float = 25.0
    stop: float = 40.0
    largest_age: float = 0.2
    lag_mm: float = 3.0

    def __post_init__(self) -> None:
        for name, unit in (("step_mm", "mm"), ("travel_mm", "mm"), ("largest_age", "s"), ("lag_mm", "mm")):
            as_positive(f"guard.{name}", getattr(self, name), f"a positive number [{unit}]", ConfigError)
        as_number("guard.low", self.low, 0.0, error=ConfigError)
        if not self.low < self.high < self.stop < np.inf:
            raise ConfigError("guard", (self.low, self.high, self.stop), "low < high < stop [N]")


@dataclass
class RigGuard:
    """Checks goals against the last readings.

    Attributes:
        home: lengths at the zero, (m,) [mm]. interventions: of the last goal, in words.
    """

    settings: GuardSettings
    home: Array
    interventions: list[str] = field(default_factory=list)

    def passed(self, goals: Array, before: Array, motors: RigReading, tensions: RigReading, now: float) -> Array:
        """The goals that may be sent, (m,) [mm].

        Args:
            goals: as wanted. before: the last ones that were sent. motors, tensions: the last readings.
            now: the time [s].
        Raises:
            Stopped: nothing may be sent; motors have to hold.
        """
        limits, T = self.settings, tensions.values
        self.interventions = []
        if np.shape(goals) != np.shape(self.home) or not np.isfinite(goals).all():
            raise Stopped(f"goals {np.asarray(goals).tolist()} are not {len(self.home)} finite numbers")
        for name, reading in (("motors", motors), ("tensions", tensions)):
            if not np.isfinite(reading.values).all():
                raise Stopped(f"readings of {name} are not finite")
            if now - reading.t > limits.largest_age:
                raise Stopped(f"readings of {name} are {now - reading.t:.3f} s old, over {limits.largest_age:g} s")
        if (limits.stop <= T).any():
            raise Stopped(f"tensions {np.round(T, 2).tolist()} N, at or above the limit of {limits.stop:g} N")
        safe = self._told("travel", goals, np.clip(goals, self.home - limits.travel_mm, self.home + limits.travel_mm))
        stuck = np.abs(before - motors.values) > limits.lag_mm
        safe = self._told("motor behind its goal", safe, np.where(stuck, motors.values, safe))
        safe = self._told("step", safe, np.clip(safe, before - limits.step_mm, before + limits.step_mm))
        if (limits.high <= T).any():
            safe = self._told("tension high", safe, np.maximum(safe, before))
        return self._told("tension low", safe, np.where(limits.low >= T, np.minimum(safe, before), safe))

    def _told(self, why: str, wanted: Array, safe: Array) -> Array:
        """The safe goals, with a word where they are others."""
        changed = np.flatnonzero(np.abs(wanted - safe) > _ROUNDING)
        if changed.size:
            self.interventions.append(f"{why}: motors {changed.tolist()}")
        return safe
