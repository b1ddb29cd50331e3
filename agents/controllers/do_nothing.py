"""A controller that does nothing: the minimum for every other one to beat."""

from __future__ import annotations

import numpy as np

from agents.evaluation.controller import Array, Seen
from rj_gym.core.tracking_task import TrackingTask


class DoNothing:
    """Leaves the tendons as they are."""

    def begin(self, task: TrackingTask, episodes: int) -> None:
        """Remember how many episodes and tendons there are."""
        self.shape = episodes, task.mechanism.n_tendons

    def act(self, seen: Seen) -> Array:
        """No increments, (B, m)."""
        return np.zeros(self.shape)
