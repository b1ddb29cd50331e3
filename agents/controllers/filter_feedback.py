"""Jacobian feedback on what a bank of Kalman filters estimates."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from agents.controllers.feedback_settings import KEEP, FeedbackSettings, tensions_within_margin
from agents.controllers.filters.bank import Bank
from agents.controllers.filters.estimate import Estimate
from agents.controllers.filters.settings import FilterSettings
from agents.controllers.kernels import cross_play, damped_increments
from agents.evaluation.controller import Array, Seen
from rj_gym.core.settings import Settings
from rj_gym.core.tracking_task import TrackingTask
from rollingjoint.checks import as_choice, as_number

PATTERNS = ("apart", "together")


@dataclass(frozen=True)
class ProbeSettings(Settings):
    """Moves at the start of an episode that show play and friction, before the target counts.

    Args:
        sweep_mm: motors pull in by as much, pay out by twice as much, and pull in again; 0: not at all [mm].
        pattern: "together", or "apart": every other tendon the other way round.
    """

    _SECTION: ClassVar[str] = "probe."
    sweep_mm: float = 0.0
    pattern: str = "apart"

    def __post_init__(self) -> None:
        self._check(as_number, "sweep_mm", low=0.0, high=100.0)
        self._check(as_choice, "pattern", choices=PATTERNS)

    def action(self, step: int, action_scale_mm: float, n_tendons: int) -> Array | None:
        """The action of a step, (m,), None once the sweep is over."""
        turn = round(self.sweep_mm / action_scale_mm)
        if step >= 4 * turn:
            return None
        way = -1.0 if turn <= step < 3 * turn else 1.0
        signs = (-1.0) ** np.arange(n_tendons) if self.pattern == "apart" else np.ones(n_tendons)
        return np.asarray(way * signs)


@dataclass(frozen=True)
class FilterFeedbackSettings(Settings):
    """Settings of FilterFeedback: of its filters, of the feedback on them, and of its first moves."""

    _NESTED: ClassVar[dict[str, type[Settings]]] = {
        "filter": FilterSettings,
        "feedback": FeedbackSettings,
        "probe": ProbeSettings,
    }
    filter: FilterSettings = field(default_factory=FilterSettings)
    feedback: FeedbackSettings = field(default_factory=FeedbackSettings)
    probe: ProbeSettings = field(default_factory=ProbeSettings)

    def __post_init__(self) -> None:
        self._check_nested(self._NESTED)


class FilterFeedback:
    """Damped resolved rate on the tip, tensions and play that a bank of extended Kalman filters estimates.

    The tip and its responses are means over the hypotheses. Motors go ahead of the tendons that they move by what is
    estimated of the play.
    """

    def __init__(self, settings: FilterFeedbackSettings | None = None) -> None:
        self.settings = settings or FilterFeedbackSettings()

    def begin(self, task: TrackingTask, episodes: int) -> None:
        """Forget what was measured."""
        self.task, self.limits = task, tensions_within_margin(task.config.tension_range)
        self.bank = Bank(task, self.settings.filter, episodes)
        self.target: Array | None = None
        self.step = -1

    def act(self, seen: Seen) -> Array:
        """Actions of the motors, (B, m)."""
        self.step += 1
        estimate, task = self.bank.take_in(seen), self.task
        self._known = self._known_of(seen, estimate)
        probe = self.settings.probe.action(self.step, task.config.action_scale_mm, task.mechanism.n_tendons)
        if probe is not None:
            return np.repeat(probe[None], len(estimate.tip), axis=0)
        return self.feedback(seen, estimate)

    def estimates(self) -> Array:
        """What the bank knew at the last action, (B, d + 3 m), for residual policies.

        Way of the estimated tip to the target [10 mm], tensions [15 N], tendons minus motors and half widths [mm].
        """
        return self._known

    def _known_of(self, seen: Seen, estimate: Estimate) -> Array:
        some = self.task.config
        way, tensions = seen.target - estimate.tip, estimate.tensions / some.tension_range[1]
        behind = estimate.played - seen.commands
        return np.hstack([way / some.reward.error_scale_mm, tensions, behind, estimate.half_widths])

    def feedback(self, seen: Seen, estimate: Estimate) -> Array:
        """Actions towards the target, (B, m)."""
        most = self.task.config.action_scale_mm
        return np.clip(-self.motor_moves(seen, estimate) / most, -1.0, 1.0)

    def motor_moves(self, seen: Seen, estimate: Estimate) -> Array:
        """Moves of the motors towards the target, (B, m) [mm]."""
        some, target = self.settings.feedback, seen.target
        ahead = target - (target if self.target is None else self.target)
        self.target = target
        way, wanted = some.gain * (target - estimate.tip) + ahead, self.wanted(estimate)
        weights = some.stiffen, some.damping, some.far, KEEP
        model = estimate.tip_by_command, estimate.tensions_by_command, estimate.tensions
        tendons, motors = np.empty_like(wanted), np.empty_like(wanted)
        damped_increments(*model, way, wanted, *self.limits, self.task.config.action_scale_mm, *weights, tendons)
        play = estimate.played, seen.commands, estimate.half_widths
        cross_play(tendons, *play, some.dead_band_mm, some.crossing, motors)
        return motors

    def wanted(self, estimate: Estimate) -> Array:
        """Wanted tensions, (B, m) [N]: all raised equally, until the highest is at its limit where that stiffens.

        Elsewhere, until their mean is the rest tension.
        """
        now = estimate.tensions
        if self.bank.model.stiffens:
            return now + self.limits[1] - now.max(axis=1, keepdims=True)
        return now + self.settings.feedback.rest_tension - now.mean(axis=1, keepdims=True)
