"""The score that a policy file records, and the tolerances within which the same episodes must reproduce it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from agents.evaluation.score import Score
from agents.runs.checks import check_fields, integer, number
from rollingjoint.checked_yaml import mapping

ERRORS, SHARES = ("mean_mm", "median_mm", "p95_mm"), ("within_1_mm", "held_1_mm")
RELATIVE, ABSOLUTE_MM, SHARE = 0.02, 0.002, 0.01  # half widths of the bands: docs/policies.md says why


@dataclass(frozen=True)
class RecordedScore:
    """What a policy scored on the episodes with the seeds first_seed, first_seed + 1, ...

    Args:
        values: by the names ERRORS [mm] and SHARES, which mean what they mean in agents.evaluation.score.Score.
        tolerances: by the same names, how far a score of the same episodes may lie from the value.
    Raises:
        ConfigError: a missing name, or a number out of range.
    """

    first_seed: int
    episodes: int
    values: Mapping[str, float]
    tolerances: Mapping[str, float]

    def __post_init__(self) -> None:
        check_fields(self, "score.", first_seed=integer(0, 2**31), episodes=integer(1, 10**6))
        for part in ("values", "tolerances"):
            numbers = mapping(f"score.{part}", getattr(self, part), ERRORS + SHARES, ERRORS + SHARES)
            for name, value in numbers.items():
                number(0.0, 1e6)(f"score.{part}.{name}", value)

    @classmethod
    def of(cls, score: Score, seeds: range) -> RecordedScore:
        """The record of a score of the episodes with these seeds."""
        values = {name: getattr(score, name) for name in ERRORS + SHARES}
        tolerances = {name: RELATIVE * values[name] + ABSOLUTE_MM for name in ERRORS} | dict.fromkeys(SHARES, SHARE)
        return cls(seeds.start, len(seeds), values, tolerances)

    @property
    def seeds(self) -> range:
        """The seeds of the episodes."""
        return range(self.first_seed, self.first_seed + self.episodes)

    def complaints(self, score: Score) -> list[str]:
        """One line for every value of `score` that lies outside its band."""
        lines = []
        for name, value in self.values.items():
            now, tolerance = getattr(score, name), self.tolerances[name]
            if not abs(now - value) <= tolerance:
                lines.append(f"{name} is {now:.4g}, recorded were {value:.4g} ± {tolerance:.2g}")
        return lines
