"""How the observation answers motors, tensions and tip: the derivative of what a tracking environment shows."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from rj_gym.core.hardware import AGE, LAG_TENSION
from rj_gym.core.tracking_task import TrackingTask

_PAST = re.compile(r"(?P<name>.*), lag (?P<lag>\d+)")
_KINDS = {"action": "action", "command": "motor", "tension": "tension"}


@dataclass(frozen=True)
class Readings:
    """What could be read after a step, with gradients.

    Args:
        action: of the step, (B, m). motor: (B, m) [mm]. tension: measured, (B, m) [N]. tip: (B, d) [mm].
    """

    action: torch.Tensor
    motor: torch.Tensor
    tension: torch.Tensor
    tip: torch.Tensor


@dataclass(frozen=True)
class _Group:
    """Neighbouring entries of one kind: "" where their gradient is left out. `unit`: of the entries."""

    kind: str
    lag: int
    columns: tuple[int, ...]
    unit: float = 1.0


class Observing:
    """Adds gradients to the observations of a tracking task.

    Entries of motors, tensions, past readings, the tip error and the tip itself have them; those of other links do not,
    nor do rounding and noise.
    """

    def __init__(self, task: TrackingTask) -> None:
        names = [entry.name for entry in task.entries()]
        self._age = names.index("picture age") if "picture age" in names else None
        tip = "tip" if "tip x" in names else f"link {task.mechanism.n_links - 1}"
        self._groups: list[_Group] = []
        for name in names:
            kind, lag, unit, part = _kind_of(name, tip, task)
            last = self._groups[-1] if self._groups else None
            if last and (last.kind, last.lag, last.unit) == (kind, lag, unit) and part in (0, len(last.columns)):
                self._groups[-1] = _Group(kind, lag, (*last.columns, part), unit)
            else:
                self._groups.append(_Group(kind, lag, (part,), unit))

    def begin(self) -> None:
        """Episodes begin."""
        self._seen: list[torch.Tensor] = []

    def __call__(self, observation: torch.Tensor, readings: Sequence[Readings]) -> torch.Tensor:
        """The next observation (B, entries) with the gradients of the readings since the start."""
        self._seen.append(self._tips(observation, readings))
        parts = [self._part(group, readings, len(observation)) for group in self._groups]
        answer = torch.cat(parts, 1)
        return observation + (answer - answer.detach())

    def _tips(self, observation: torch.Tensor, readings: Sequence[Readings]) -> torch.Tensor:
        """The tips in the pictures that are seen now, (B, d)."""
        if self._age is None:
            return readings[-1].tip
        now = len(readings) - 1
        taken = now - torch.round(AGE * observation[:, self._age]).long()
        tips = torch.stack([each.tip for each in readings])
        return tips[taken.clamp(0, now), torch.arange(len(observation))]

    def _part(self, group: _Group, readings: Sequence[Readings], rows: int) -> torch.Tensor:
        """The entries of a group up to a constant; lagged ones are values then minus now, but for actions."""
        if not group.kind:
            return torch.zeros(rows, len(group.columns))
        if group.kind == "action":  # chosen after the readings then, and kept with those that followed
            return readings[max(len(readings) - group.lag, 0)].action
        now = self._value(group.kind, readings, len(readings) - 1)[:, group.columns]
        if group.lag:
            now = self._value(group.kind, readings, max(len(readings) - 1 - group.lag, 0))[:, group.columns] - now
        return now / group.unit

    def _value(self, kind: str, readings: Sequence[Readings], place: int) -> torch.Tensor:
        value: torch.Tensor = self._seen[place] if kind == "tip" else getattr(readings[place], kind)
        return value


def _kind_of(name: str, tip: str, task: TrackingTask) -> tuple[str, int, float, int]:
    """Kind, lag and unit of an entry, and which tendon or axis it is of."""
    past = _PAST.fullmatch(name)
    lag = int(past["lag"]) if past else 0
    words = (past["name"] if past else name).split()
    config = task.config
    if words[0] == "tendon" and words[-1] in _KINDS:
        units = {"action": 1.0, "command": config.command_scale_mm, "tension": config.tension_range[1]}
        if lag:
            units |= {"command": config.action_scale_mm, "tension": LAG_TENSION}
        return _KINDS[words[-1]], lag, units[words[-1]], int(words[1])
    if words[:2] == ["tip", "error"]:
        return "tip", lag, -config.reward.error_scale_mm, "xyz".index(words[2])
    if " ".join(words[:-1]) == tip and words[-1] in ("x", "y", "z"):
        return "tip", 0, task.length, "xyz".index(words[-1])
    return "", 0, 1.0, 0
