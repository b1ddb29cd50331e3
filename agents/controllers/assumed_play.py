"""Tendons behind a play of a width that is assumed, and the moves of motors that take them along."""

from __future__ import annotations

import numpy as np

from agents.controllers.feedback_settings import FeedbackSettings
from agents.controllers.kernels import cross_play
from agents.evaluation.controller import Array
from rollingjoint.transmission import play_step


class AssumedPlay:
    """Where tendons are that follow their motors by the play operator, of one half width for all; 0 is no play.

    Args:
        settings: `half_width_mm`, and how motors cross the play.
    """

    def __init__(self, settings: FeedbackSettings) -> None:
        self.settings = settings
        self.motors: Array | None = None
        self.tendons: Array = np.empty(0)

    def follow(self, motors: Array) -> Array:
        """Commands of the tendons, (B, m) [mm], when the motors are there; they begin in the middle of the play."""
        half = self.settings.half_width_mm
        self.tendons = motors if self.motors is None else play_step(self.tendons, motors, half)
        self.motors = motors
        return self.tendons

    def motor_moves(self, increments: Array) -> Array:
        """Moves of the motors that move the tendons by these increments, (B, m) both [mm]."""
        some = self.settings
        if some.half_width_mm == 0.0:
            return increments
        moves, half = np.empty_like(increments), np.full_like(increments, some.half_width_mm)
        cross_play(increments, self.tendons, self.motors, half, some.dead_band_mm, some.crossing, moves)
        return moves
