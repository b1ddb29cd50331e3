"""The model of a mechanism where it was measured, with or without an estimate of the load; one class per kind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from agents.controllers.measured_arm import MeasuredArm
from agents.controllers.measured_chain import MeasuredChain
from agents.evaluation.controller import Array, Seen
from rj_gym.core.tracking_task import TrackingTask
from rollingjoint.chain.hinge import HingeChain
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.solution import Solution


class Measured(Protocol):
    """What controllers ask of a model, B episodes side by side.

    Attributes:
        nominal_loads: those that the model knows of: none, or the weight of an arm that hangs.
        stiffens: whether higher tensions stiffen the mechanism, so that they are worth going for.
    """

    nominal_loads: Any
    stiffens: bool

    def unloaded(self, seen: Seen) -> Solution:
        """The model where it was measured, the load unknown."""

    def loaded(self, seen: Seen) -> tuple[Solution, Array]:
        """The model under the loads estimated from the measurements, and these loads, (B, rows, columns)."""


MODELS: dict[type, Callable[[TrackingTask, int], Measured]] = {RollingChain: MeasuredChain, HingeChain: MeasuredArm}


def measured_by(task: TrackingTask, episodes: int) -> Measured:
    """The model of a task's mechanism, for episodes that begin."""
    return MODELS[type(task.mechanism)](task, episodes)


def unstretched(equilibria: Solution) -> Array:
    """Commanded lengths that hold these equilibria, (B, m) [mm]."""
    return equilibria.lengths - equilibria.tensions / equilibria.mechanism.stiffnesses
