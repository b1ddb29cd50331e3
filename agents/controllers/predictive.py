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
        tensions = np.full_like(start, self.tension_range[1]) if self.measured.stiffens else start
        aim = self.task.mechanism, reading.target, self.tension_range
        return nearest_tensions(*aim, tensions, start, loads, self.PLAN)


class Predictive(LoadEstimate):
    """One-step model-predictive control under the estimated load.

    It minimises the cost of Jacobian feedback with the whole model in place of a linear one: a few Gauss-Newton
    steps, each from the equilibrium that the model predicts for the increments so far. The part of the
    measured tip that the model does not explain is taken to stay as it is.
    """

    STEPS = 3  # after which increments change by less than sensors can tell

    def increments(self, reading: Reading, way: Array) -> Array:
        """Changes of the commanded lengths that move the predicted tip by `way` (B, d), (B, m) both [mm]."""
        model, loads = self.measured.loaded(reading)
        commands, tensions = unstretched(model), self.planned(reading, loads)
        predicted, moves = model, np.zeros_like(model.tensions)
        for _ in range(self.STEPS):
            trial = moves + self.step(predicted, way - (predicted.tip - model.tip), tensions, moves)
            candidate = solve_lengths_batch(self.task.mechanism, commands + trial, loads, predicted)
            valid = np.asarray(candidate.ok)
            predicted, moves = choose(valid, candidate, predicted), np.where(valid[:, None], trial, moves)
        return moves
