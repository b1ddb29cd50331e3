"""Settings of a bank of Kalman filters, and the hypotheses in which its filters differ."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from agents.controllers.controller import Array
from rj_gym.core.settings import Range, Settings
from rollingjoint.checks import as_integer, as_number, as_range


@dataclass(frozen=True)
class FilterSettings(Settings):
    """What a bank of extended Kalman filters assumes; it knows all else from the settings of the task.

    Standard deviations are those of a normal distribution around the nominal mechanism.

    Args:
        hypotheses: how many widths of play, places in it and sheath frictions are tried side by side, for every link
            that may be loaded; 1 is the middle of each.
        play_mm, sheath_friction: ranges in which they lie [mm, 1]; None: those of the task.
        width_share, friction_share: standard deviations of width and sheath friction within a hypothesis, as a share of
            their ranges. place_share: that of where a tendon begins, as a share of half the width.
        start_sd_mm: of the lengths of the tendons at the start, which the start tension fixes but for tolerances [mm].
        offset_sd_mm: of the offsets of the motors [mm]. offset_walk_mm: how far they drift in a step [mm].
        stiffness_sd: of the logarithm of tendon stiffnesses.
        bias_sd_mm: of the true tip about the model's [mm]. bias_walk_mm: how far it drifts in a step [mm].
        force_walk: how far a constant load is taken to drift in a step, as a share of its standard deviation.
        tension_sd: of a measured tension about the model's [N]. tension_share: the same in proportion to it.
        angle_sd, position_sd_mm: of measured link angles and tips about the model's [rad, mm].
        tempering: power to which the probability of a measurement is taken where hypotheses are weighed, 0 to 1.
    """

    _SECTION: ClassVar[str] = "filter."
    hypotheses: int = 16
    play_mm: Range | None = None
    sheath_friction: Range | None = None
    width_share: float = 0.2
    friction_share: float = 0.2
    place_share: float = 0.4
    start_sd_mm: float = 0.3
    offset_sd_mm: float = 0.3
    offset_walk_mm: float = 0.02
    stiffness_sd: float = 0.12
    bias_sd_mm: float = 0.5
    bias_walk_mm: float = 0.05
    force_walk: float = 0.01
    tension_sd: float = 0.5
    tension_share: float = 0.08
    angle_sd: float = 0.01
    position_sd_mm: float = 0.5
    tempering: float = 0.3

    def __post_init__(self) -> None:
        self._check(as_integer, "hypotheses", low=1, high=4096)
        for name in ("play_mm", "sheath_friction"):
            if getattr(self, name) is not None:
                self._check(as_range, name, low=0.0)
        self._check(as_number, "width_share", "friction_share", "place_share", "tempering", low=0.0, high=1.0)
        self._check(as_number, "offset_sd_mm", "stiffness_sd", "bias_sd_mm", low=0.0, high=100.0)
        self._check(as_number, "offset_walk_mm", "bias_walk_mm", "force_walk", "tension_share", low=0.0, high=100.0)
        self._check(as_number, "start_sd_mm", "tension_sd", "angle_sd", "position_sd_mm", low=1e-4, high=1e4)


@dataclass(frozen=True)
class Hypotheses:
    """H hypotheses, the same for every episode.

    Args:
        links: the loaded link, (H,).
        half_widths: of the play of every tendon, (H, m) [mm].
        places: where tendons begin within the play, (H, m) in [-1, 1] of the half width.
        frictions: exponent of the sheath friction of every tendon, (H, m).
    """

    links: NDArray[np.int64]
    half_widths: Array
    places: Array
    frictions: Array

    def __len__(self) -> int:
        return len(self.links)

    @classmethod
    def of(cls, config: Any, settings: FilterSettings, n_links: int, n_tendons: int) -> Hypotheses:
        """Those of a task's settings: every link that may be loaded with every point of an even spread over play."""
        play, friction = assumed_ranges(config, settings)
        count = settings.hypotheses if max(*play, *friction) > 0.0 else 1
        points = evenly_spread(count, 3 * n_tendons).reshape(count, 3, n_tendons)
        anywhere = getattr(config.load, "link", "tip") == "random"  # an arm's payload is at its tip
        links = np.arange(1, n_links) if anywhere else np.array([n_links - 1])
        points = np.tile(points, (len(links), 1, 1))
        return cls(
            np.repeat(links, count),
            0.5 * _within(play, points[:, 0]),
            _within((-1.0, 1.0), points[:, 1]),
            _within(friction, points[:, 2]),
        )


def assumed_ranges(config: Any, settings: FilterSettings) -> tuple[tuple[float, float], tuple[float, float]]:
    """Ranges of the play's width [mm] and of the sheath friction: those of the settings, else those of the task."""
    actuation = config.actuation
    return settings.play_mm or actuation.play_mm, settings.sheath_friction or actuation.sheath_friction


def evenly_spread(count: int, dimensions: int) -> Array:
    """Points of the unit cube, (count, dimensions), evenly spread and always the same; the first is its centre.

    Additive recurrence with the powers of the root of x^(d + 1) = x + 1: Roberts, "The unreasonable effectiveness of
    quasirandom sequences", 2018.
    """
    root = 2.0
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (dimensions + 1))
    steps = root ** -np.arange(1.0, dimensions + 1)
    return np.asarray((0.5 + np.arange(count)[:, None] * steps) % 1.0)


def _within(limits: tuple[float, float], points: Array) -> Array:
    low, high = limits
    return low + (high - low) * points
