"""The model inverse, without feedback."""

from __future__ import annotations

import numpy as np

from agents.baselines.measured import measured_by, unstretched
from agents.baselines.model_inverse import nearest_tensions
from agents.evaluation.controller import Array, Seen
from rj_gym.core.tracking_task import TrackingTask
from rollingjoint.statics.solve import solve_tensions_batch


class OpenLoop:
    """The model command: goes to the tendon lengths that put the unloaded tip nearest to the target.

    It knows the mechanism, the target and its own commands, and looks neither at the pose nor at the load.
    """

    def begin(self, task: TrackingTask, episodes: int) -> None:
        """Reset: nothing is planned."""
        self.task = task
        self.loads = measured_by(task, episodes).nominal_loads
        self.target = np.full((episodes, task.dimension), np.nan)
        self.rest = self.tensions = np.full((episodes, task.mechanism.n_tendons), task.config.start_tension)

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
