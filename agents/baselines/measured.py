"""What a model makes of what is seen: an equilibrium there, and the load that it tells of; one way per family."""

from __future__ import annotations

from typing import Any, Protocol

from agents.baselines.measured_arm import MeasuredArm
from agents.baselines.measured_chain import MeasuredChain
from agents.controller import Array, Seen
from rj_gym.core.tracking_task import TrackingTask as Task
from rollingjoint.solution import Solution
from rollingjoint.spatial.chain import HingeChain


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
        """The model under the loads that the measurements tell of, and these, (B, rows, columns)."""


def measured_by(task: Task, lanes: int) -> Measured:
    """The model of a task's mechanism, for episodes that begin."""
    return MeasuredArm(task, lanes) if isinstance(task.mechanism, HingeChain) else MeasuredChain(task.mechanism)


def unstretched(equilibria: Solution) -> Array:
    """Commanded lengths that hold these equilibria, (B, m) [mm]."""
    return equilibria.lengths - equilibria.tensions / equilibria.mechanism.stiffnesses
