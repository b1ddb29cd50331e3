"""Jacobian feedback, and predictive control, on the estimates of a bank of Kalman filters."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from agents.controllers.controller import Array, Controller, Mask, Reading, restarted
from agents.controllers.filters.bank import Bank
from agents.controllers.filters.estimate import Estimate
from agents.controllers.filters.hypotheses import FilterSettings
from agents.controllers.kernels import Outlook, cross_play, damped_increments, look_ahead
from agents.controllers.steps import KEEP, FeedbackSettings, TargetMotion, pulling_in, tensions_within_margin
from rj_gym.core.settings import Settings
from rj_gym.tracking.task import TrackingTask
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

    def length(self, action_scale_mm: float) -> int:
        """Steps of the sweep, there and back to either side."""
        return 4 * round(self.sweep_mm / action_scale_mm)

    def actions(self, steps: Array, action_scale_mm: float, n_tendons: int) -> Array:
        """The actions after `steps` (B,) of episodes, (B, m); NaN once the sweep is over."""
        length = self.length(action_scale_mm)
        turn = length // 4
        ways = np.where((turn <= steps) & (steps < 3 * turn), -1.0, 1.0)
        ways = np.where(steps < length, ways, np.nan)
        signs = (-1.0) ** np.arange(n_tendons) if self.pattern == "apart" else np.ones(n_tendons)
        return np.asarray(ways[:, None] * signs)


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


class FilterFeedback(Controller):
    """Damped resolved rate on the tip, tensions and play that a bank of extended Kalman filters estimates.

    The tip and its responses are means over the hypotheses. Motors go ahead of the tendons that they move by the
    estimated play.
    """

    def __init__(self, settings: FilterFeedbackSettings | None = None) -> None:
        self.settings = settings or FilterFeedbackSettings()
        self.motion, self.steps = TargetMotion(), np.empty(0)

    def bind(self, task: TrackingTask | None) -> None:
        """Take over the task: filters of its mechanism."""
        super().bind(task)
        self.limits = tensions_within_margin(self.task.config.held_tensions)
        self.bank = Bank(self.task, self.settings.filter)

    def reset(self, mask: Mask) -> None:
        """Begin episodes, (B,), without measurements."""
        self.bank.reset(mask)
        self.motion.reset(mask, self.task.dimension)
        self.steps = restarted(self.steps, mask, np.zeros(len(mask)))

    def act(self, observations: Any) -> Array:
        """Actions of the motors, (B, m)."""
        reading, task = self.read(observations), self.task
        estimate = self.estimated(reading)
        self._known = self._known_of(reading, estimate)
        sweep = self.settings.probe.actions(self.steps, task.config.action_scale_mm, task.mechanism.n_tendons)
        self.steps, probing = self.steps + 1.0, ~np.isnan(sweep[:, 0])
        if probing.all():
            return sweep
        actions = self.feedback(reading, estimate)
        self.motion.reset(probing, task.dimension)
        return np.where(probing[:, None], sweep, actions)

    def estimated(self, reading: Reading) -> Estimate:
        """The estimate after the measurements of this step."""
        return self.bank.take_in(reading)

    def estimates(self) -> Array:
        """Estimates of the bank at the last action, (B, d + 3 m), for residual policies.

        Way of the estimated tip to the target [10 mm], tensions [15 N], tendons minus motors and half widths [mm].
        """
        return self._known

    def _known_of(self, reading: Reading, estimate: Estimate) -> Array:
        config = self.task.config
        way, tensions = reading.target - estimate.tip, estimate.tensions / config.tension_range[1]
        behind = estimate.played - reading.commands
        return np.hstack([way / config.reward.error_scale_mm, tensions, behind, estimate.half_widths])

    def feedback(self, reading: Reading, estimate: Estimate) -> Array:
        """Actions towards the target, (B, m)."""
        return pulling_in(self.motor_moves(reading, estimate), self.task.config.action_scale_mm)

    def motor_moves(self, reading: Reading, estimate: Estimate) -> Array:
        """Moves of the motors towards the target, (B, m) [mm]."""
        settings, goals = self.settings.feedback, self.wanted(estimate)
        weights = settings.stiffen, settings.damping, settings.far, KEEP
        model = estimate.tip_by_command, estimate.tensions_by_command, estimate.tensions
        tendons, motors = np.empty_like(goals), np.empty_like(goals)
        low, high = (np.ascontiguousarray(np.broadcast_to(limit, goals.shape)) for limit in self.limits)
        way, reach = self.way(reading, estimate), self.task.config.action_scale_mm
        damped_increments(*model, way, goals, low, high, reach, *weights, tendons)
        play = estimate.played, reading.commands, estimate.half_widths
        cross_play(tendons, *play, settings.dead_band_mm, settings.crossing, motors)
        return motors

    def way(self, reading: Reading, estimate: Estimate) -> Array:
        """The way that the tip should go in this step, (B, d) [mm]."""
        target = reading.target
        return self.settings.feedback.gain * (target - estimate.tip) + self.motion.since_last(target)

    def wanted(self, estimate: Estimate) -> Array:
        """Wanted tensions, (B, m) [N]: all raised equally, until the highest is at its limit where that stiffens.

        Elsewhere, until their mean is the rest tension.
        """
        now = estimate.tensions
        if self.bank.model.stiffens:
            return now + self.limits[1] - now.max(axis=1, keepdims=True)
        return now + self.settings.feedback.rest_tension - now.mean(axis=1, keepdims=True)


class FilterPredictive(FilterFeedback):
    """Model-predictive control over the moves of a few steps, for all hypotheses of the bank at once.

    The moves of the motors minimise the mean square of the tip error over the hypotheses, with tendons that each follow
    through their own play: where its width is uncertain, the moves are those that are best on average. Responses
    are linear over the horizon. The search begins at the moves of FilterFeedback.
    """

    REACH = 4.0  # steps of the horizon: the farthest that a motor is planned to go
    POINTS = 12  # of a grid on either side

    def motor_moves(self, reading: Reading, estimate: Estimate) -> Array:
        """Moves of the motors towards the target, (B, m) [mm]."""
        settings, bank, at = self.settings.feedback, self.bank, self.bank.model.places
        reach = self.REACH * self.task.config.action_scale_mm
        moves = np.clip(super().motor_moves(reading, estimate), -reach, reach)
        outlook = Outlook(
            bank.weights,
            settings.gain * (reading.target[:, None] - bank.tips),
            np.ascontiguousarray(bank.linear.tip[:, :, at.offsets : at.stiffnesses]),
            bank.belief.play.played,
            np.ascontiguousarray(bank.belief.states[:, at.half_widths : at.frictions]),
            reading.commands,
            estimate.tensions,
            estimate.tensions_by_command,
        )
        weights = settings.stiffen, settings.damping, *self.limits, KEEP
        look_ahead(outlook, self.wanted(estimate), weights, reach, self.POINTS, moves)
        return moves
