"""How the observation answers motors, tensions and tip: the derivative of a tracking environment's observation."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.learners.motion import Readings
from rj_gym.tracking.arrays import AGE, LAG_TENSION
from rj_gym.tracking.task import TrackingTask

_PAST = re.compile(r"(?P<name>.*), lag (?P<lag>\d+)")
_KINDS = {"action": "action", "command": "motor", "tension": "tension"}


@dataclass(frozen=True)
class _ObservedEntry:
    """Of which tendon or axis an entry is, how old, and in which unit; kind "": its gradient is left out."""

    kind: str = ""
    lag: int = 0
    unit: float = 1.0
    part: int = 0


class Observing:
    """The observation's derivative by readings.

    Entries of motors, tensions, past readings, the tip error and of pictures have one; rounding and noise are
    left out. The readings after a step are one row: its action, motors, measured tensions, and tip and poses in the
    picture that is seen. Observations are linear in the rows now and some steps ago.
    """

    def __init__(self, task: TrackingTask) -> None:
        names = [entry.name for entry in task.entries()]
        self.age = names.index("picture age") if "picture age" in names else None
        entries = [_entry(name, task) for name in names]
        m, starts = task.action_size, {"action": 0, "motor": task.action_size, "tension": 2 * task.action_size}
        starts |= {"tip": 3 * m, "pose": 3 * m + task.dimension}
        self.parts, self.width = np.cumsum([m, m, m, task.dimension]), starts["pose"] + len(task.pictured)
        # An action is kept with the row that it led to: a step ago is now.
        ages = [entry.lag - 1 if entry.kind == "action" else entry.lag for entry in entries]
        self.ages = sorted({0, *ages})
        rates = np.zeros((len(names), len(self.ages), self.width), np.float32)
        for column, (entry, age) in enumerate(zip(entries, ages, strict=True)):
            if entry.kind:
                place = starts[entry.kind] + entry.part
                rates[column, self.ages.index(age), place] += 1.0 / entry.unit
                if entry.lag and entry.kind != "action":  # the past value, less the present one
                    rates[column, 0, place] -= 1.0 / entry.unit
        self.rates = rates.reshape(len(names), -1)

    def tape(self, steps: int, lanes: int) -> ObservingTape:
        """A record of T = `steps` observations of B = `lanes` episodes, which begin now."""
        return ObservingTape(self, steps, lanes)


class ObservingTape:
    """Observations of T steps of B episodes, and then, last one first, the gradients by what they show."""

    def __init__(self, observing: Observing, steps: int, lanes: int) -> None:
        self._observing, self._shape = observing, (steps, lanes)
        self._taken: list[NDArray[np.int64]] = []

    def add(self, observation: NDArray[np.float32]) -> None:
        """The next observation (B, entries)."""
        if self._observing.age is not None:
            age = np.rint(AGE * observation[:, self._observing.age]).astype(np.int64)
            self._taken.append(np.maximum(len(self._taken) - age, 0))

    def begin_back(self) -> None:
        """Before the gradients by the last observation."""
        steps, lanes = self._shape
        self._now, first = steps, self._observing.parts[2]
        self._by_rows = np.zeros((steps, lanes, self._observing.width), np.float32)
        self._by_pictures = np.zeros((steps, lanes, self._observing.width - first), np.float32)

    def zeros(self) -> tuple[NDArray[np.float32], Readings]:
        """Gradients as of `back`, by the action and by the readings, all 0."""
        return self._split(np.zeros((self._shape[1], self._observing.width), np.float32))

    def back(self, by_observation: NDArray[np.float32]) -> tuple[NDArray[np.float32], Readings]:
        """Whole gradients by the action before the last observation of which there are none yet, and by its readings.

        Args:
            by_observation: gradient by its entries (B, entries).
        """
        self._now -= 1
        now, observing = self._now, self._observing
        shares = (by_observation @ observing.rates).reshape(len(by_observation), -1, observing.width)
        for place, age in enumerate(observing.ages):
            self._by_rows[max(now - age, 0)] += shares[:, place]
        row, first = self._by_rows[now], observing.parts[2]
        if observing.age is not None:
            self._by_pictures[self._taken[now], np.arange(len(row))] += row[:, first:]
            row[:, first:] = self._by_pictures[now]
        return self._split(row)

    def _split(self, row: NDArray[np.float32]) -> tuple[NDArray[np.float32], Readings]:
        action, motor, tension, tip, pose = np.split(row, self._observing.parts, axis=1)
        return action, Readings(motor, tension, tip, pose)


def _entry(name: str, task: TrackingTask) -> _ObservedEntry:
    past = _PAST.fullmatch(name)
    lag = int(past["lag"]) if past else 0
    words = (past["name"] if past else name).split()
    config = task.config
    if words[0] == "tendon" and words[-1] in _KINDS:
        units = {"action": 1.0, "command": config.command_scale_mm, "tension": config.tension_range[1]}
        if lag:
            units |= {"command": config.action_scale_mm, "tension": LAG_TENSION}
        return _ObservedEntry(_KINDS[words[-1]], lag, units[words[-1]], int(words[1]))
    if words[:2] == ["tip", "error"]:
        return _ObservedEntry("tip", lag, -config.reward.error_scale_mm, "xyz".index(words[2]))
    if name in task.pictured:
        return _ObservedEntry(
            "pose", 0, task.length if words[-1] in ("x", "y", "z") else 1.0, task.pictured.index(name)
        )
    return _ObservedEntry()
