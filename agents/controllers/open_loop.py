"""The model inverse, without feedback."""

from __future__ import annotations

import numpy as np

from agents.controllers.measured import measured_by, unstretched
from agents.controllers.model_inverse import nearest_tensions
from agents.evaluation.controller import Array, Seen
from rj_gym.core.tracking_task import TrackingTask
from rollingjoint.checks import as_positive
from rollingjoint.statics.solve import solve_tensions_batch


class OpenLoop:
    """The model command: goes to the tendon lengths that put the unloaded tip nearest to the target.

    It knows the mechanism, the target and its own commands, and looks neither at the pose nor at the load.

    Args:
        rest_tension: the tension [N] that the model's tensions are drawn to where the target leaves a choice; None:
            REST_TENSION where tensions stiffen the mechanism, the tension of the start elsewhere. Outside the tension
            range of the task, the nearest end of that range.
    Raises:
        InvalidInput: a tension that is not a positive number.
    """

    REST_TENSION = 13.0  # N: the best of 3 to 15 N on tuning seeds (docs/training.md); a chain yields less when taut

    def __init__(self, rest_tension: float | None = None) -> None:
        if rest_tension is not None:
            as_positive("rest_tension", rest_tension, "a tension above 0 [N], or None")
        self.rest_tension = rest_tension

    def begin(self, task: TrackingTask, episodes: int) -> None:
        """Reset: nothing is planned."""
        self.task = task
        model = measured_by(task, episodes)
        self.loads = model.nominal_loads
        self.target = np.full((episodes, task.dimension), np.nan)
        own = self.REST_TENSION if model.stiffens else task.config.start_tension
        rest = np.clip(own if self.rest_tension is None else self.rest_tension, *task.config.tension_range)
        self.rest = self.tensions = np.full((episodes, task.mechanism.n_tendons), rest)

    def act(self, seen: Seen) -> Array:
        """One step on the straight way to the commanded lengths, (B, m)."""
        target = self.aim(seen)
        if not np.array_equal(target, self.target):
            self.plan(target)
        way = (seen.commands - self.lengths) / self.task.config.action_scale_mm
        return way / np.maximum(1.0, np.abs(way).max(axis=1, keepdims=True))

    def aim(self, seen: Seen) -> Array:
        """Where the model's tip should go, (B, d) [mm]: to the target."""
        return seen.target

    def plan(self, target: Array) -> None:
        """Set the commanded lengths for these targets: unstretched lengths at the tensions that the model proposes."""
        mechanism, limits = self.task.mechanism, self.task.config.tension_range
        self.target = target
        self.tensions = nearest_tensions(mechanism, target, limits, self.rest, self.tensions, self.loads)
        self.lengths = unstretched(solve_tensions_batch(mechanism, self.tensions, self.loads))
