"""Feedback under an estimated load: by the Jacobian there, and by model-predictive control over one step."""

from __future__ import annotations

import numpy as np

from agents.controllers.controller import Array, Reading
from agents.controllers.jacobian_feedback import JacobianFeedback
from agents.controllers.measured import unstretched
from agents.controllers.steps import choose, nearest_tensions
from rollingjoint import solve_lengths_batch


class LoadEstimate(JacobianFeedback):
    """Jacobian feedback with the load estimated from pose and tensions: Jacobian and tensions are those under it.

    The tensions to go for are those that put the model's tip, under that load, nearest to the target; where there is a
    choice the higher ones of a chain, which stiffen it, and those nearest to the measured ones of an arm.
    """

    PLAN = 3  # steps of the search for them, which goes on from the measured tensions in every step

    def increments(self, reading: Reading, way: Array) -> Array:
        """Changes of the commanded lengths that move the tip by `way` (B, d), (B, m) both [mm]."""
        model, loads = self.measured.loaded(reading)
        return self.step(model, way, self.planned(reading, loads), np.zeros_like(model.tensions))

    def planned(self, reading: Reading, loads: Array) -> Array:
        """Wanted tensions, (B, m) [N]."""
        start = np.clip(reading.tensions, *self.tension_range)
        rest = np.full_like(start, self.tension_range[1]) if self.measured.stiffens else start
        return nearest_tensions(self.task.mechanism, reading.target, self.tension_range, rest, start, loads, self.PLAN)


class Predictive(LoadEstimate):
    """One-step model-predictive control under the estimated load.

    What Jacobian feedback minimises with a linear model, this one minimises with the whole one: a few Gauss-Newton
    steps, each from the equilibrium that the model predicts for the increments so far. What the model does not explain
    of the measured tip is taken to stay as it is.
    """

    STEPS = 3  # after which increments change by less than sensors can tell

    def increments(self, reading: Reading, way: Array) -> Array:
        """Changes of the commanded lengths that move the predicted tip by `way` (B, d), (B, m) both [mm]."""
        now, loads = self.measured.loaded(reading)
        commands, wanted = unstretched(now), self.planned(reading, loads)
        found, moves = now, np.zeros_like(now.tensions)
        for _ in range(self.STEPS):
            trial = moves + self.step(found, way - (found.tip - now.tip), wanted, moves)
            tried = solve_lengths_batch(self.task.mechanism, commands + trial, loads, found)
            usable = np.asarray(tried.ok)
            found, moves = choose(usable, tried, found), np.where(usable[:, None], trial, moves)
        return moves
