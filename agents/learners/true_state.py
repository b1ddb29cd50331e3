"""Feedback on the true state and on how the tip answers every tendon: the teacher of policies that see less."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rj_gym.tracking.tangent import Tangent
from rj_gym.tracking.task import TrackingTask
from rollingjoint.errors import ConfigError
from rollingjoint.transmission import play_inverse

KEEP = 3.0  # mm/N: weight of a tension outside the margin, above any error
MARGIN = 0.05  # of the tension range, kept free at both ends: there a tendon has no effect
RELEASE = 0.1  # mm: by which a tendon at a limit moves away from it

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TrueStateWeights:
    """Weights of TrueStateFeedback.

    Args:
        gain: share of the error that a step removes.
        stiffen: weight of high tensions [mm/N]: weak next to the error. Chains of hinges keep their tensions.
        damping: the smallest response of the tip to commands that is used [mm/mm].
        far: more damping far from the target, where the response will have changed on arrival [1/mm].
        dead_band_mm: moves of a tendon that are not worth crossing the play for [mm].
    """

    gain: float = 0.8
    stiffen: float = 0.1
    damping: float = 0.3
    far: float = 0.05
    dead_band_mm: float = 0.02


class TrueState(NamedTuple):
    """The state of B episodes, and their targets (B, d) [mm]."""

    tangent: Tangent
    target: Array


class TrueStateFeedback:
    """Feedback on the true tip error: damped Gauss-Newton steps with the true rates, through the true play.

    The changes d of commands minimise |way - J d|² + stiffen² |wanted - tensions - K d|² + damping² |d|², with
    J = d tip / d command, K = d tension / d command; motors go ahead of their tendons by half the width of the play.

    Args:
        task: a tracking task with motors that follow commands at once.
        weights: of the terms.
    Raises:
        ConfigError: motors with a delay or a rate limit.
    """

    privileged = True

    def __init__(self, task: TrackingTask, weights: TrueStateWeights | None = None) -> None:
        self._check_motors(task)
        self.lowest = task.config.tension_range[0]
        self.weights, self.scale = weights or TrueStateWeights(), task.config.action_scale_mm
        self.stiffens = task.mechanism.slips
        self._before: Array = np.empty((0, 1))  # targets of the last step

    @staticmethod
    def _check_motors(task: TrackingTask) -> None:
        actuation, hint = task.config.actuation, "The teacher takes motors to do at once what they are told."
        if actuation.delay:
            raise ConfigError("actuation.delay", actuation.delay, "0 with distill", hint)
        if actuation.rate_limit_mm is not None:
            raise ConfigError("actuation.rate_limit_mm", actuation.rate_limit_mm, "null with distill", hint)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Begin episodes, (B,): the motion of their targets is unknown."""
        self._before = np.where(mask[:, None], np.nan, np.nan if mask.all() else self._before)

    def act(self, observations: TrueState) -> Array:
        """Actions (B, m) in [-1, 1] towards the targets, ahead with them as they moved in the last step."""
        tangent, target = observations
        before = np.where(np.isnan(self._before), target, self._before)
        self._before = target.copy()
        way = self.weights.gain * (target - tangent.tips) + (target - before)
        tendons = self._released(self._step(tangent, way), tangent)
        motor_moves = play_inverse(tangent.commands, tendons, tangent.half_play) - tangent.motors
        moves = np.where(np.abs(tendons) > self.weights.dead_band_mm, motor_moves, tendons)
        return np.clip(-moves / self.scale, -1.0, 1.0)

    def _step(self, tangent: Tangent, way: Array) -> Array:
        """Changes of commands, (B, m) [mm], none beyond the range of actions.

        Tensions that would leave their range get the weight KEEP and the end of the range as their goal.
        """
        tips, tensions, settings = tangent.tip_rates, tangent.tension_rates, self.weights
        low, high = self._range(tangent)
        damping = settings.damping**2 + settings.far**2 * np.sum(way**2, axis=1)
        free = np.swapaxes(tips, 1, 2) @ tips + damping[:, None, None] * np.eye(tips.shape[2])
        changes = np.zeros_like(tangent.tensions)
        if self.stiffens:
            changes += np.min(high - tangent.tensions, axis=1, keepdims=True)
        weights = np.full_like(changes, settings.stiffen**2)
        for _ in range(3):
            weighted = weights[:, :, None] * tensions
            pull = np.einsum("bim,bi->bm", tips, way) + np.einsum("bim,bi->bm", weighted, changes)
            step = np.linalg.solve(free + np.swapaxes(tensions, 1, 2) @ weighted, pull[..., None])
            step *= np.minimum(1.0, self.scale / (np.abs(step).max(axis=1, keepdims=True) + 1e-12))
            after = tangent.tensions + (tensions @ step)[..., 0]
            clipped = np.clip(after, low, high)
            weights = np.where(after == clipped, weights, KEEP**2)
            changes = np.where(after == clipped, changes, clipped - tangent.tensions)
        return step[..., 0]

    def _released(self, step: Array, tangent: Tangent) -> Array:
        """The step where tendons at a tension limit, which have no effect, move away from it."""
        release = np.where(tangent.tensions > self._range(tangent)[1], RELEASE, -RELEASE)
        return np.where(tangent.held, release, step)

    def _range(self, tangent: Tangent) -> tuple[Array, Array]:
        """The tensions that it uses, (B, m) each [N]: a margin within those at which tendons are at a limit."""
        margin = MARGIN * (tangent.limits - self.lowest)
        return self.lowest + margin, tangent.limits - margin
