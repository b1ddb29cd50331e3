"""Feedback that knows the load."""

from __future__ import annotations

import numpy as np

from agents.baselines.jacobian_feedback import JacobianFeedback
from agents.baselines.measured import estimated_loads, measured_equilibrium, unstretched
from agents.baselines.model_inverse import nearest_tensions
from agents.controller import Array, Seen
from rollingjoint.equilibrium import Equilibrium
from rollingjoint.solve import solve_lengths_batch


class LoadEstimate(JacobianFeedback):
    """Jacobian feedback with the load estimated from pose and tensions: Jacobian and tensions are those under it.

    The tensions to go for are those that put the model's tip, under that load, nearest to the target; the higher ones
    where there is a choice.
    """

    PLAN = 3  # steps of the search for them, which goes on from the measured tensions in every step

    def increments(self, seen: Seen, way: Array) -> Array:
        """Changes of the commanded lengths that move the tip by `way` (B, 2), (B, m) both [mm]."""
        model, loads = self.loaded(seen)
        return self.step(model, way, self.planned(seen, loads), np.zeros_like(model.tensions))

    def loaded(self, seen: Seen) -> tuple[Equilibrium, Array]:
        """The model under the estimated loads, and these, (B, 1, 11)."""
        measured = measured_equilibrium(self.task.mechanism, seen)
        loads = estimated_loads(measured)
        return solve_lengths_batch(self.task.mechanism, unstretched(measured), loads, measured), loads

    def planned(self, seen: Seen, loads: Array) -> Array:
        """Tensions to go for, (B, m) [N]."""
        high = np.full_like(seen.tensions, self.tension_range[1])
        start = np.clip(seen.tensions, *self.tension_range)
        return nearest_tensions(self.task.mechanism, seen.target, self.tension_range, high, start, loads, self.PLAN)
