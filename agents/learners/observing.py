"""How the observation answers motors, tensions and tip: the derivative of a tracking environment's observation."""

from __future__ import annotations

import re
from dataclasses import dataclass

import torch

from agents.learners.motion import Motion
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
    """Adds gradients to the observations of a tracking task.

    Entries of motors, tensions, past readings, the tip error and of pictures have them; rounding and noise do not. The
    readings after a step are one row: its action, motors, measured tensions, and tip and poses in the picture that is
    seen. Observations are linear in the rows now and some steps ago.
    """

    def __init__(self, task: TrackingTask) -> None:
        names = [entry.name for entry in task.entries()]
        self._age = names.index("picture age") if "picture age" in names else None
        entries = [_entry(name, task) for name in names]
        m, starts = task.action_size, {"action": 0, "motor": task.action_size, "tension": 2 * task.action_size}
        starts |= {"tip": 3 * m, "pose": 3 * m + task.dimension}
        width = starts["pose"] + len(task.pictured)
        # An action is kept with the row that it led to: a step ago is now.
        ages = [entry.lag - 1 if entry.kind == "action" else entry.lag for entry in entries]
        self._ages = sorted({0, *ages})
        self._linear = torch.zeros(len(self._ages), width, len(names))
        for column, (entry, age) in enumerate(zip(entries, ages, strict=True)):
            if entry.kind:
                place = starts[entry.kind] + entry.part
                self._linear[self._ages.index(age), place, column] += 1.0 / entry.unit
                if entry.lag and entry.kind != "action":  # the past value, less the present one
                    self._linear[0, place, column] -= 1.0 / entry.unit
        self._linear = self._linear.reshape(-1, len(names))

    def begin(self) -> None:
        """Episodes begin."""
        self._rows: list[torch.Tensor] = []
        self._pictures: list[torch.Tensor] = []

    def __call__(self, observation: torch.Tensor, action: torch.Tensor, motion: Motion) -> torch.Tensor:
        """The next observation (B, entries), with the gradients of this action, this motion and those before."""
        picture = torch.cat([motion.tip, motion.pose], 1)
        self._pictures.append(picture)
        shown = picture if self._age is None else self._pictured(observation[:, self._age])
        self._rows.append(torch.cat([action, motion.motor, motion.tension, shown], 1))
        now = len(self._rows) - 1
        answer = torch.cat([self._rows[max(now - age, 0)] for age in self._ages], 1) @ self._linear
        return observation + (answer - answer.detach())

    def _pictured(self, age: torch.Tensor) -> torch.Tensor:
        """The pictures that are seen now, (B, d + k)."""
        now = len(self._pictures) - 1
        taken = now - torch.round(AGE * age).long()
        return torch.stack(self._pictures)[taken.clamp(0, now), torch.arange(len(age))]


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
