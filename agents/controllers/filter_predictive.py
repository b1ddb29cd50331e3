"""Predictive control on what a bank of Kalman filters estimates."""

from __future__ import annotations

import numpy as np

from agents.controllers.feedback_settings import KEEP
from agents.controllers.filter_feedback import FilterFeedback
from agents.controllers.filters.estimate import Estimate
from agents.controllers.kernels import Outlook, look_ahead
from agents.evaluation.controller import Array, Seen


class FilterPredictive(FilterFeedback):
    """Model-predictive control over the moves of a few steps, for all hypotheses of the bank at once.

    The moves of the motors minimise the mean square of the tip error over the hypotheses, whose tendons each follow
    through the play of their own: where its width is uncertain, the moves are those that are best on average. Responses
    are linear over the horizon. What FilterFeedback would do is where the search begins.
    """

    REACH = 4.0  # steps of the horizon: the farthest that a motor is planned to go
    POINTS = 12  # of a grid on either side

    def motor_moves(self, seen: Seen, estimate: Estimate) -> Array:
        """Moves of the motors towards the target, (B, m) [mm]."""
        some, bank, at = self.settings.feedback, self.bank, self.bank.model.places
        reach = self.REACH * self.task.config.action_scale_mm
        moves = np.clip(super().motor_moves(seen, estimate), -reach, reach)
        outlook = Outlook(
            bank.weights,
            some.gain * (seen.target[:, None] - bank.tips),
            np.ascontiguousarray(bank.linear.tip[:, :, at.offsets : at.stiffnesses]),
            bank.belief.play.played,
            np.ascontiguousarray(bank.belief.states[:, at.half_widths : at.frictions]),
            seen.commands,
            estimate.tensions,
            estimate.tensions_by_command,
        )
        weights = some.stiffen, some.damping, *self.limits, KEEP
        look_ahead(outlook, self.wanted(estimate), weights, reach, self.POINTS, moves)
        return moves
