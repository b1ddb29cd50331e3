"""Jacobian feedback: damped resolved rate."""

from __future__ import annotations

import numpy as np

from agents.controllers.assumed_play import AssumedPlay
from agents.controllers.feedback_settings import KEEP, FeedbackSettings, tensions_within_margin
from agents.controllers.measured import measured_by
from agents.controllers.responses import bounded_step, length_responses
from agents.evaluation.controller import Array, Seen
from rj_gym.core.tracking_task import TrackingTask
from rollingjoint.chain.solution import Solution


class JacobianFeedback:
    """Damped resolved rate: tip error to tendon increments by the model's Jacobian at the measured pose, load unknown.

    The increments d minimise |error - J d|² + stiffen² |wanted - tensions - K d|² + damping² |d|² within the action's
    range, with J = d tip / d lengths and K = d tensions / d lengths. With two tendons the tip
    moves along a curve and hardly responds across it: there the second term decides. It pulls all tendons in together,
    because a chain under tension yields less to an unknown load. An arm is held by its springs without tension: there
    the second term keeps the tensions as they are.

    Args:
        settings: the weights; those of `crossing`, `dead_band_mm` and `half_width_mm` are for motors with play: the
            tendons are then taken to follow the motors by the play operator of that half width.
    """

    def __init__(self, settings: FeedbackSettings | None = None) -> None:
        self.settings = settings or FeedbackSettings()

    def begin(self, task: TrackingTask, episodes: int) -> None:
        """Reset: the motion of the target is unknown."""
        self.task, self.tension_range = task, tensions_within_margin(task.config.tension_range)
        self.measured = measured_by(task, episodes)
        self.play = AssumedPlay(self.settings)
        self.target: Array | None = None

    def act(self, seen: Seen) -> Array:
        """Tendon increments against the error, and ahead with the target as it moved in the last step, (B, m)."""
        before = seen.target if self.target is None else self.target
        self.target = seen.target
        self.play.follow(seen.commands)
        way = self.settings.gain * self.error(seen) + (self.target - before)
        moves = self.play.motor_moves(self.increments(seen, way))
        return np.clip(-moves / self.task.config.action_scale_mm, -1.0, 1.0)

    def error(self, seen: Seen) -> Array:
        """Where the tip should go from where it is taken to be, (B, d) [mm]."""
        return seen.error

    def increments(self, seen: Seen, way: Array) -> Array:
        """Changes of the commanded lengths that move the tip by `way` (B, d), (B, m) both [mm]."""
        model = self.measured.unloaded(seen)
        return self.step(model, way, self.wanted(model), np.zeros_like(model.tensions))

    def wanted(self, model: Solution) -> Array:
        """Wanted tensions, (B, m) [N]: where that stiffens, all raised equally until the highest is at its limit."""
        if not self.measured.stiffens:
            return model.tensions
        return model.tensions + self.tension_range[1] - model.tensions.max(axis=1, keepdims=True)

    def step(self, model: Solution, way: Array, wanted: Array, done: Array) -> Array:
        """One Gauss-Newton step of the increments, beyond those done already, (B, m) [mm].

        Tensions that would leave their range get the weight KEEP and the end of the range as their goal.
        """
        tips, tensions = length_responses(model)
        some = self.settings
        damping = some.damping**2 + some.far**2 * np.sum(way**2, axis=1)
        free = np.swapaxes(tips, 1, 2) @ tips + damping[:, None, None] * np.eye(tips.shape[2])
        pull = np.einsum("bim,bi->bm", tips, way) - damping[:, None] * done
        weights, changes = np.full_like(done, some.stiffen**2), wanted - model.tensions
        most = self.task.config.action_scale_mm
        for _ in range(3):
            weighted = weights[:, :, None] * tensions
            hessian = free + np.swapaxes(tensions, 1, 2) @ weighted
            slope = -pull - np.einsum("bim,bi->bm", weighted, changes)
            step = bounded_step(hessian, slope, -most - done, most - done)
            after = model.tensions + (tensions @ step[..., None])[..., 0]
            kept = np.clip(after, *self.tension_range)
            weights = np.where(after == kept, weights, KEEP**2)
            changes = np.where(after == kept, changes, kept - model.tensions)
        return step
