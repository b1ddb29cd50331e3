"""Jacobian feedback: damped resolved rate."""

from __future__ import annotations

from typing import Any

import numpy as np

from agents.controllers.controller import Array, Controller, Mask, Reading, restarted
from agents.controllers.kernels import cross_play
from agents.controllers.measured import measured_by
from agents.controllers.steps import (
    KEEP,
    FeedbackSettings,
    TargetMotion,
    bounded_step,
    length_responses,
    pulling_in,
    tensions_within_margin,
)
from rj_gym.tracking.task import TrackingTask
from rollingjoint.chain.solution import Solution
from rollingjoint.transmission import play_step


class AssumedPlay:
    """Where tendons are that follow their motors by the play operator, of one half width for all; 0 is no play.

    Args:
        settings: `half_width_mm`, and how motors cross the play.
    """

    def __init__(self, settings: FeedbackSettings) -> None:
        self.settings = settings
        self.motors = self.tendons = np.empty(0)

    def reset(self, mask: Mask, n_tendons: int) -> None:
        """Forget the motors of the episodes of the mask, (B,)."""
        unknown = np.full((len(mask), n_tendons), np.nan)
        self.motors, self.tendons = (restarted(values, mask, unknown) for values in (self.motors, self.tendons))

    def follow(self, motors: Array) -> Array:
        """Commands of the tendons, (B, m) [mm], when the motors are there; they begin in the middle of the play."""
        half = self.settings.half_width_mm
        self.tendons = np.where(np.isnan(self.motors), motors, play_step(self.tendons, motors, half))
        self.motors = motors
        return self.tendons

    def motor_moves(self, increments: Array) -> Array:
        """Moves of the motors that move the tendons by these increments, (B, m) both [mm]."""
        settings = self.settings
        if settings.half_width_mm == 0.0:
            return increments
        moves, half = np.empty_like(increments), np.full_like(increments, settings.half_width_mm)
        cross_play(increments, self.tendons, self.motors, half, settings.dead_band_mm, settings.crossing, moves)
        return moves


class JacobianFeedback(Controller):
    """Damped resolved rate: tip error to tendon increments by the model's Jacobian at the measured pose, load unknown.

    The increments d minimise |error - J d|² + stiffen² |wanted - tensions - K d|² + damping² |d|² within the action's
    range, with J = d tip / d lengths and K = d tensions / d lengths. With two tendons the tip
    moves along a curve and hardly responds across it: there the second term decides. It pulls all tendons in together,
    because a chain under tension yields less to an unknown load. An arm is held by its springs without tension: there
    the second term keeps the tensions as they are.

    Args:
        settings: the weights; `crossing`, `dead_band_mm` and `half_width_mm` are for motors with play: the
            tendons are then taken to follow the motors by the play operator of that half width.
    """

    def __init__(self, settings: FeedbackSettings | None = None) -> None:
        self.settings = settings or FeedbackSettings()
        self.play, self.motion = AssumedPlay(self.settings), TargetMotion()

    def bind(self, task: TrackingTask | None) -> None:
        """Take over the task, and its model."""
        super().bind(task)
        self.tension_range = tensions_within_margin(self.task.config.held_tensions)
        self.measured = measured_by(self.task)

    def reset(self, mask: Mask) -> None:
        """Begin episodes, (B,): the motion of the target is unknown."""
        self.measured.reset(mask)
        self.play.reset(mask, self.task.mechanism.n_tendons)
        self.motion.reset(mask, self.task.dimension)

    def act(self, observations: Any) -> Array:
        """Tendon increments against the error, and ahead with the target as it moved in the last step, (B, m)."""
        reading = self.read(observations)
        self.play.follow(reading.commands)
        way = self.settings.gain * self.error(reading) + self.motion.since_last(reading.target)
        moves = self.play.motor_moves(self.increments(reading, way))
        return pulling_in(moves, self.task.config.action_scale_mm)

    def error(self, reading: Reading) -> Array:
        """Where the tip should go from where it is taken to be, (B, d) [mm]."""
        return reading.error

    def increments(self, reading: Reading, way: Array) -> Array:
        """Changes of the commanded lengths that move the tip by `way` (B, d), (B, m) both [mm]."""
        model = self.measured.unloaded(reading)
        return self.step(model, way, self.wanted(model), np.zeros_like(model.tensions))

    def wanted(self, model: Solution) -> Array:
        """Wanted tensions, (B, m) [N]: where that stiffens, all raised equally until the highest is at its limit."""
        if not self.measured.stiffens:
            return model.tensions
        high = self.tension_range[1]
        if np.ndim(high) > 0:  # tendons that differ
            return model.tensions + np.min(high - model.tensions, axis=1, keepdims=True)
        return model.tensions + high - model.tensions.max(axis=1, keepdims=True)

    def step(self, model: Solution, way: Array, goals: Array, done: Array) -> Array:
        """One Gauss-Newton step of the increments, beyond those done already, (B, m) [mm].

        Tensions that would leave their range get the weight KEEP and the end of the range as their goal.
        """
        tips, tensions = length_responses(model)
        settings = self.settings
        damping = settings.damping**2 + settings.far**2 * np.sum(way**2, axis=1)
        free = np.swapaxes(tips, 1, 2) @ tips + damping[:, None, None] * np.eye(tips.shape[2])
        pull = np.einsum("bim,bi->bm", tips, way) - damping[:, None] * done
        weights, changes = np.full_like(done, settings.stiffen**2), goals - model.tensions
        limit = self.task.config.action_scale_mm
        for _ in range(3):
            weighted = weights[:, :, None] * tensions
            hessian = free + np.swapaxes(tensions, 1, 2) @ weighted
            slope = -pull - np.einsum("bim,bi->bm", weighted, changes)
            step = bounded_step(hessian, slope, -limit - done, limit - done)
            after = model.tensions + (tensions @ step[..., None])[..., 0]
            bounded = np.clip(after, *self.tension_range)
            weights = np.where(after == bounded, weights, KEEP**2)
            changes = np.where(after == bounded, changes, bounded - model.tensions)
        return step
