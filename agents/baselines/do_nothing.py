"""The controller that every other one should beat."""

from __future__ import annotations

import numpy as np

from agents.controller import Array, Seen
from rj_gym.core.tracking_task import TrackingTask as Task


class DoNothing:
    """Leaves the tendons as they are."""

    def begin(self, task: Task, lanes: int) -> None:
        """Remember how many episodes and tendons there are."""
        self.shape = lanes, task.mechanism.n_tendons

    def act(self, seen: Seen) -> Array:
        """No increments, (B, m)."""
        return np.zeros(self.shape)
