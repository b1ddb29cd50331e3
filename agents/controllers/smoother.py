"""Feedback on the estimate of a full-information smoother, and on that of a bank of filters where its fit fails."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from agents.controllers.arm_smoother import arm_smoother_of, check_arm
from agents.controllers.controller import Array, Mask, Reading, restarted
from agents.controllers.filter_feedback import FilterFeedback, FilterFeedbackSettings
from agents.controllers.filters.bank import Bank
from agents.controllers.filters.estimate import Estimate
from agents.controllers.steps import tensions_within_margin
from rj_gym.core.settings import Settings
from rj_gym.tracking.config import TaskConfig
from rj_gym.tracking.task import TrackingTask
from rollingjoint import RollingChain
from rollingjoint.checks import as_integer, as_number
from rollingjoint.errors import InvalidInput
from rollingjoint.estimate import ArmSmoother, Effort, HiddenPrior, HiddenRanges, MeasurementLaw, Smoothed, Smoother
from rollingjoint.transmission import pull_limit

_SHARP_RAD, _SHARP_MM = 1e-3, 0.02  # standard deviations of pictures without noise
_ROOM = 1.0  # N between the lowest tension and the lowest limit that a motor may show
_NEAR_MM = 3.0  # the longest way of a step in which a tendon is nearly slack
_READ_MM = 1e-4  # a motor this near to where it was asked to go has not given way: observations are float32


@dataclass(frozen=True)
class SmootherSettings(Settings):
    """Assumptions of a smoother; it knows all else from the settings of the task.

    Args:
        tension_sd: of a measured tension about the model's [N]. tension_share: the same in proportion to it.
        robust: standard deviations beyond which a residual counts linearly.
        start_sd_mm: of the lengths of the tendons at the start, which equal start tensions fix [mm].
        shown_sd: of the tensions that load cells show when motors are set by them at the start [N].
        picture_share: standard deviations of places and angles in pictures, over those of their noise.
        limit_sd: of the tension at which a motor gives way, where the task fixes it; 0: it is not used [N].
        every: steps after which the history is followed anew. searches: how often the fit starts anew from many places:
            after the probe, and then after twice as many steps.
        starts: of the play of every tendon, such a search tries this many.
        doubt: cost per measurement, over the cost that the noise of the sensors explains, above which the fit is
            searched for anew, with play and sheath friction beyond the ranges of the task, too.
        misfit: cost per measurement above which the fit has failed, and the bank's estimate counts.
        held_share: of the range that the motors' own limits are drawn from: the tension that feedback takes motors to
            hold until they have stopped.
    """

    _SECTION: ClassVar[str] = "smoother."
    tension_sd: float = 0.1
    tension_share: float = 0.0
    robust: float = 3.0
    start_sd_mm: float = 0.005
    shown_sd: float = 0.02
    picture_share: float = 1.0
    limit_sd: float = 0.05
    every: int = 6
    searches: int = 2
    starts: int = 3
    doubt: float = 1.6
    misfit: float = 1.5
    held_share: float = 0.5

    def __post_init__(self) -> None:
        self._check(as_number, "tension_sd", "robust", "start_sd_mm", "shown_sd", "picture_share", low=1e-4, high=1e4)
        self._check(as_number, "tension_share", "limit_sd", low=0.0, high=1e3)
        self._check(as_number, "misfit", "doubt", low=0.0)
        self._check(as_number, "held_share", low=0.0, high=1.0)
        self._check(as_integer, "every", "starts", low=1, high=1000)
        self._check(as_integer, "searches", low=0, high=100)


@dataclass(frozen=True)
class SmootherFeedbackSettings(FilterFeedbackSettings):
    """Settings of SmootherFeedback: of its smoother, and those of the bank that it falls back on."""

    _NESTED: ClassVar[dict[str, type[Settings]]] = FilterFeedbackSettings._NESTED | {"smoother": SmootherSettings}
    smoother: SmootherSettings = field(default_factory=SmootherSettings)


class SmootherFeedback(FilterFeedback):
    """Damped resolved rate on the tip, tensions and play that a full-information smoother estimates.

    The smoother fits all hidden numbers of an episode to everything that was measured in it. Where its fit fails, which
    the misfit shows, the bank of filters counts instead.
    """

    settings: SmootherFeedbackSettings

    def __init__(self, settings: SmootherFeedbackSettings | None = None) -> None:
        super().__init__(settings or SmootherFeedbackSettings())
        self._motors = self._actions = self._stops = np.empty((0, 0))
        self._banks: dict[int, Bank] = {}

    def bind(self, task: TrackingTask | None) -> None:
        """Take over the task; raises InvalidInput for one that the smoother does not know."""
        super().bind(task)
        config = check_served(self.task)
        self.smoother = smoother_of(self.task, self.settings)
        actuation, sensing = config.actuation, config.sensing
        tells = actuation.delay == 0 and actuation.rate_limit_mm is None
        self._stop_at_limits = tells and actuation.limit_at == "motor"
        self._ways = (-math.inf, (0.0 if self._stop_at_limits else math.inf)) if tells else (0.0, 0.0)
        least, most = actuation.tension_limit or (config.tension_range[1],) * 2
        share = self.settings.smoother.held_share
        self._held = config.tension_range[0], (1.0 - share) * least + share * most
        self._readable_mm = _READ_MM + 5.0 * sensing.encoder_noise_mm + sensing.encoder_resolution_mm
        self._readable_mm += 2.0 * actuation.dead_band_mm
        self._observations: deque[Any] = deque(maxlen=config.episode_steps + 1)

    def reset(self, mask: Mask) -> None:
        """Begin episodes, (B,), without measurements."""
        super().reset(mask)
        self.smoother.reset(mask)
        if mask.all():
            self._banks = {}
            self._observations.clear()
        self._banks = {episode: bank for episode, bank in self._banks.items() if not mask[episode]}
        empty = np.zeros((len(mask), self.task.mechanism.n_tendons))
        self._motors = restarted(self._motors, mask, empty)
        self._actions = restarted(self._actions, mask, empty)
        self._stops = restarted(self._stops, mask, empty + math.inf)

    def act(self, observations: Any) -> Array:
        """Actions of the motors, (B, m)."""
        self._actions = super().act(observations)
        return self._actions

    def estimated(self, reading: Reading) -> Estimate:
        """The estimate after the measurements of this step."""
        motors = reading.commands
        given_way = self._given_way(reading, motors)
        shifts = np.clip(given_way, *self._ways)
        smoothed = self.smoother.take_in(motors, shifts, reading.tensions, *_pictures(reading))
        self._motors = motors
        self._observations.append(reading.observation)
        self.smoothed, self.misfit = smoothed, smoothed.misfit
        failed = np.flatnonzero(self.failed(smoothed))
        estimate = Estimate(*smoothed[1:7])
        for episode in failed.tolist():
            self._ask_bank(episode, estimate)
        for episode in self._banks.keys() - set(failed.tolist()):
            del self._banks[episode]
        if self._stop_at_limits:
            self._stops = np.where(given_way > 0.0, reading.tensions, self._stops)
            self.limits = tensions_within_margin((self._held[0], self._ceilings(smoothed)))
        return estimate

    def way(self, reading: Reading, estimate: Estimate) -> Array:
        """The way of the tip in this step, (B, d) [mm]: a short one where a tendon is nearly slack.

        A slack chain answers to moves as it does nowhere else; over a short way the wanted tensions count more.
        """
        way = super().way(reading, estimate)
        if not self.bank.model.stiffens:
            return way
        slack = (estimate.tensions < self.limits[0]).any(axis=1, keepdims=True)
        length = np.linalg.norm(way, axis=1, keepdims=True)
        return np.where(slack, way * np.minimum(1.0, _NEAR_MM / np.maximum(length, 1e-9)), way)

    def wanted(self, estimate: Estimate) -> Array:
        """Wanted tensions, (B, m) [N]: all raised equally, until one is at its limit, where that stiffens."""
        if not self.bank.model.stiffens:
            return super().wanted(estimate)
        now = estimate.tensions
        return now + (self.limits[1] - now).min(axis=1, keepdims=True)

    def failed(self, smoothed: Smoothed) -> Mask:
        """Where the fit has failed, (B,)."""
        finite = np.isfinite(smoothed.tip).all(axis=1) & np.isfinite(smoothed.tensions).all(axis=1)
        searched = self.smoother.measured_steps >= self.smoother.trusted_from
        return ~finite | (searched & ~(smoothed.misfit <= self.settings.smoother.misfit))

    def _ceilings(self, smoothed: Smoothed) -> Array:
        """The highest tensions that pulls reach behind the sheath, (B, m) [N]: where motors have stopped last."""
        at, (gains, zeros) = self.smoother.prior.layout, self.smoother.prior.cells(smoothed.numbers)
        frictions, ceilings = smoothed.numbers[:, at.frictions : at.places], (self._stops - zeros) / gains
        if self.task.config.sensing.tension_at != "tendon":
            ceilings = pull_limit(ceilings, frictions, smoothed.half_widths)
        return np.clip(ceilings, self._held[0] + _ROOM, self._held[1])

    def _given_way(self, reading: Reading, motors: Array) -> Array:
        """How much less far than it was asked to a motor has pulled in this step, or paid out below 0, (B, m) [mm].

        At a limit of the tension in the tendon a motor takes it along; one that stops at a limit of its own does not.
        """
        actions = reading.last_actions
        asked = self._motors - self.task.config.action_scale_mm * (self._actions if actions is None else actions)
        shifts = np.where(self.steps[:, None] > 0, motors - asked, 0.0)
        return np.where(np.abs(shifts) > self._readable_mm, shifts, 0.0)

    def _ask_bank(self, episode: int, estimate: Estimate) -> None:
        """Replace the estimate in one episode by that of the bank, which takes in what it has not seen yet.

        At a limit of tension the bank's tendons do not respond, so responses stay those of the smoother's chain.
        """
        known = 1
        if episode not in self._banks:
            self._banks[episode] = Bank(self.task, self.settings.filter)
            self._banks[episode].reset(np.ones(1, bool))
            known = int(self.smoother.measured_steps[episode])
        for observation in list(self._observations)[-known:]:
            banks = self._banks[episode].take_in(Reading(_row(observation, episode), self.task))
        for values, others in zip(estimate, banks, strict=True):
            if values.ndim == 2 or not np.isfinite(values[episode]).all():
                values[episode] = others[0]


def _pictures(reading: Reading) -> tuple[Array, NDArray[np.int64]] | tuple[()]:
    """Pictures that come now, (B, n - 1, 3), NaN where none does, and their ages, (B,); empty without poses."""
    if reading.sees == "none":
        return ()
    new = reading.picture_is_new
    return np.where(new[:, None, None], reading.poses[:, 1:], np.nan), np.rint(reading.picture_age).astype(np.int64)


def _row(observation: Any, episode: int) -> Any:
    """The observation of one episode, (1, entries) each."""
    if isinstance(observation, Mapping):
        return {name: values[episode : episode + 1] for name, values in observation.items()}
    return observation[episode : episode + 1]


def check_served(task: TrackingTask) -> TaskConfig:
    """The settings of a task, one that the smoother knows; raises InvalidInput for others.

    Friction that a task draws for the holes of its chain is not in the smoother's model: sheath friction stands for it.
    """
    config, mechanism, name = task.config, task.mechanism, "what the smoother knows"
    if not isinstance(mechanism, RollingChain):
        return check_arm(task)
    if mechanism.has_friction or mechanism.springs:
        raise InvalidInput("mechanism", mechanism, "a chain without springs and friction", f"That is {name}.")
    if config.load.process == "step":
        raise InvalidInput("load.process", config.load.process, "'constant' or 'ou'", f"That is {name}.")
    if config.sensing.pose == "tip" or config.sensing.biased:
        raise InvalidInput("sensing", config.sensing, "poses of all links without biases, or none", f"That is {name}.")
    if not config.observe_tensions:
        raise InvalidInput("observe_tensions", False, "True", "The smoother needs measured tensions.")
    return config


def smoother_of(task: TrackingTask, settings: SmootherFeedbackSettings) -> Smoother | ArmSmoother:
    """A smoother for a task, which it knows by its settings and its nominal mechanism."""
    if not isinstance(task.mechanism, RollingChain):
        return arm_smoother_of(task, settings)
    config, mechanism, own = task.config, task.mechanism, settings.smoother
    random, actuation, sensing = config.randomization, config.actuation, config.sensing
    gain_error, zero = sensing.tension_gain_error, sensing.tension_offset
    wanders = config.load.process == "ou"
    ranges = HiddenRanges(
        force=config.load.magnitude,
        wanders=wanders,
        offset_mm=(-random.actuator_offset_mm, random.actuator_offset_mm),
        stiffness=(1.0 - random.stiffness_spread, 1.0 + random.stiffness_spread),
        play_mm=settings.filter.play_mm or actuation.play_mm,
        sheath_friction=settings.filter.sheath_friction or actuation.sheath_friction,
        gain=(1.0 - gain_error, 1.0 + gain_error),
        zero=(-zero, zero),
        surface_mm=random.link_tolerance_mm,
        surface_rad=random.link_tolerance_rad,
    )
    law = MeasurementLaw(
        start_tension=config.start_tension,
        start_sd=own.start_sd_mm if config.start == "equal" else math.inf,
        shown_sd=own.shown_sd if config.start == "measured" else math.inf,
        low=config.yield_tensions[0],
        high=config.yield_tensions[1],
        limit_sd=own.limit_sd or math.inf,
        cells_at_tendons=sensing.tension_at == "tendon",
        tension_sd=own.tension_sd,
        tension_share=own.tension_share,
        robust=own.robust,
        memory=math.exp(-1.0 / config.load.correlation_steps) if wanders else 1.0,
        angle_sd=own.picture_share * max(random.angle_noise_rad, _SHARP_RAD),
        position_sd=own.picture_share * max(random.position_noise_mm, _SHARP_MM),
    )
    links = range(1, mechanism.n_links) if config.load.link == "random" else [mechanism.n_links - 1]
    first = 1 + max(settings.probe.length(config.action_scale_mm), 4)
    searches = [1 + (first - 1) * 2**number for number in range(own.searches)]
    doubt = own.doubt * _explained(task, own)
    effort = Effort(every=own.every, searches=searches, starts=own.starts, doubt=doubt)
    steps, pictured = config.episode_steps + 1, sensing.pose != "none"
    prior, wears = HiddenPrior.of(mechanism, ranges), ranges.worn() != ranges
    worn = HiddenPrior.of(mechanism, ranges.worn()) if wears else None
    return Smoother(mechanism, prior, law, list(links), effort, steps, pictured, worn)


def _explained(task: TrackingTask, settings: SmootherSettings) -> float:
    """The mean cost of a measurement where all that is off is the noise of the sensors."""
    mechanism, sensing = task.mechanism, task.config.sensing
    tensions = 0.5 * min(sensing.tension_noise / settings.tension_sd, 1.0) ** 2
    pictures = 0.5 * min(1.0 / settings.picture_share, 1.0) ** 2
    shown = 0.0 if sensing.pose == "none" else 3.0 * mechanism.n_joints / sensing.period
    return (mechanism.n_tendons * tensions + shown * pictures) / (mechanism.n_tendons + shown)
