"""Settings of feedback on a pose, measured or estimated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rj_gym.core.settings import Range, Settings
from rollingjoint.checks import as_number

KEEP = 3.0  # mm/N: what a tension beyond the margin weighs, more than any error
_MARGIN = 0.05  # of the tension range, kept free at both ends: a slack or yielding tendon controls nothing


def tensions_within_margin(limits: Range) -> Range:
    """The tensions that feedback uses, of those that the motors can hold [N]."""
    low, high = limits
    margin = _MARGIN * (high - low)
    return low + margin, high - margin


@dataclass(frozen=True)
class FeedbackSettings(Settings):
    """Weights of the increments of JacobianFeedback, and how motors cross the play of their tendons.

    Args:
        gain: share of the error that a step removes: less than 1 averages noise.
        stiffen: weight of tensions [mm/N]: weak beside the error, strong enough to end at high tensions in an episode.
        damping: the smallest response of the tip to lengths that is used [mm/mm].
        far: more damping far from the target, where the response will have changed on arrival [1/mm].
        crossing: share of the play's half width by which a motor goes ahead of a tendon that it moves.
        dead_band_mm: moves of a tendon that are not worth crossing the play for [mm].
        half_width_mm: of the play, where nothing estimates it [mm].
        rest_tension: mean tension for which feedback on filters goes where high ones do not stiffen, as in an arm [N].
    """

    _SECTION: ClassVar[str] = "feedback."
    gain: float = 0.8
    stiffen: float = 0.1
    damping: float = 0.3
    far: float = 0.05
    crossing: float = 1.0
    dead_band_mm: float = 0.1
    half_width_mm: float = 0.0
    rest_tension: float = 3.0

    def __post_init__(self) -> None:
        self._check(as_number, "gain", low=0.0, high=2.0)
        self._check(as_number, "stiffen", "far", "dead_band_mm", "half_width_mm", low=0.0, high=100.0)
        self._check(as_number, "damping", "rest_tension", low=1e-3, high=100.0)
        self._check(as_number, "crossing", low=0.0, high=2.0)
