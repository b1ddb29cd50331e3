"""What the filters of a bank differ in: the loaded link, and play and sheath friction of every tendon."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.controllers.filters.settings import FilterSettings
from agents.evaluation.controller import Array

NO_RANGE = (0.0, 0.0)


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
