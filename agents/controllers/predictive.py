"""Model-predictive control over one step."""

from __future__ import annotations

import numpy as np

from agents.controllers.load_estimate import LoadEstimate
from agents.controllers.measured import unstretched
from agents.controllers.responses import choose
from agents.evaluation.controller import Array, Seen
from rollingjoint.statics.solve import solve_lengths_batch


class Predictive(LoadEstimate):
    """One-step model-predictive control under the estimated load.

    What Jacobian feedback minimises with a linear model, this one minimises with the whole one: a few Gauss-Newton
    steps, each from the equilibrium that the model predicts for the increments so far. What the model does not explain
    of the measured tip is taken to stay as it is.
    """

    STEPS = 3  # after which increments change by less than sensors can tell

    def increments(self, seen: Seen, way: Array) -> Array:
        """Changes of the commanded lengths that move the predicted tip by `way` (B, d), (B, m) both [mm]."""
        now, loads = self.measured.loaded(seen)
        commands, wanted = unstretched(now), self.planned(seen, loads)
        found, moves = now, np.zeros_like(now.tensions)
        for _ in range(self.STEPS):
            trial = moves + self.step(found, way - (found.tip - now.tip), wanted, moves)
            tried = solve_lengths_batch(self.task.mechanism, commands + trial, loads, found)
            usable = np.asarray(tried.ok)
            found, moves = choose(usable, tried, found), np.where(usable[:, None], trial, moves)
        return moves
