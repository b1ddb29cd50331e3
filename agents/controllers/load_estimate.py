"""Jacobian feedback under an estimated load."""

from __future__ import annotations

import numpy as np

from agents.controllers.jacobian_feedback import JacobianFeedback
from agents.controllers.model_inverse import nearest_tensions
from agents.evaluation.controller import Array, Seen


class LoadEstimate(JacobianFeedback):
    """Jacobian feedback with the load estimated from pose and tensions: Jacobian and tensions are those under it.

    The tensions to go for are those that put the model's tip, under that load, nearest to the target; where there is a
    choice the higher ones of a chain, which stiffen it, and those nearest to the measured ones of an arm.
    """

    PLAN = 3  # steps of the search for them, which goes on from the measured tensions in every step

    def increments(self, seen: Seen, way: Array) -> Array:
        """Changes of the commanded lengths that move the tip by `way` (B, d), (B, m) both [mm]."""
        model, loads = self.measured.loaded(seen)
        return self.step(model, way, self.planned(seen, loads), np.zeros_like(model.tensions))

    def planned(self, seen: Seen, loads: Array) -> Array:
        """Wanted tensions, (B, m) [N]."""
        start = np.clip(seen.tensions, *self.tension_range)
        rest = np.full_like(start, self.tension_range[1]) if self.measured.stiffens else start
        return nearest_tensions(self.task.mechanism, seen.target, self.tension_range, rest, start, loads, self.PLAN)
