"""Controllers that know the identified parameters of the robot that they drive."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any

from agents.adaptation.identify import Identified
from agents.controllers.controller import Array, Controller, Mask, as_controller, plain
from agents.controllers.filter_feedback import FilterFeedback
from rj_gym.core.settings import Range
from rj_gym.tracking.task import TrackingTask
from rollingjoint.errors import ConfigError

_SURE = 2.0  # standard deviations on either side: the error of identified parameters
_LEAST = {"play_mm": 0.1, "sheath_friction": 0.02}  # on either side, however sure


class Informed(Controller):
    """A controller that is told of the identified mechanism and of its motors' offsets.

    Args:
        controller: any; where it has filters, they assume the identified play and sheath friction, too.
        identified: the result of the bench.
    """

    def __init__(self, controller: Controller, identified: Identified) -> None:
        self.controller = _narrowed(as_controller(controller), identified)
        self.twin = identified.twin

    def bind(self, task: TrackingTask | None) -> None:
        """Take over a task, with the twin's mechanism and offsets as its nominal ones."""
        if task is None:
            raise ConfigError("environment", "not one of rj_gym", "rj_gym/Instrument-v0", "Robots are instruments.")
        self.told = _told(task, self.twin)
        self.controller.bind(self.told)

    def reset(self, mask: Mask) -> None:
        """Begin episodes, (B,)."""
        self.controller.reset(mask)

    def act(self, observations: Any) -> Any:
        """The actions, (B, m)."""
        return self.controller.act(plain(observations))


def _told(task: TrackingTask, twin: Any) -> TrackingTask:
    """The task with the twin's mechanism; positions keep the units and zeros in which they are observed."""
    informed = type(task)(replace(task.config, mechanism=twin.chain))
    informed.length, informed.neutral_lengths = task.length, task.neutral_lengths + twin.motor_offsets
    return informed


def _narrowed(controller: Controller, identified: Identified) -> Controller:
    """The controller, its filters assuming the identified ranges."""
    if not isinstance(controller, FilterFeedback):
        return copy.copy(controller)
    ranges: dict[str, Any] = {name: _around(identified, name) for name in _LEAST}
    settings = controller.settings
    return type(controller)(replace(settings, filter=replace(settings.filter, **ranges)))


def _around(identified: Identified, name: str) -> Range:
    """The range of a number of all tendons, as far as it is known."""
    values: Array = getattr(identified.twin, name)
    margin = (_SURE * identified.sd[name]).clip(min=_LEAST[name])
    return max(float((values - margin).min()), 0.0), float((values + margin).max())
