"""The score that a policy file records: a regression band of fixed episodes.

The same episodes must score within the tolerances again, on any machine. A band does not cover other episodes: the
standard error of a mean of 200 episodes is several times as wide. docs/results.md has intervals.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from agents.evaluation.score import Score
from agents.runs.checks import check_fields, integer, number, seed_number
from rollingjoint.checked_yaml import mapping
from rollingjoint.errors import ConfigError

ERRORS, SHARES = ("mean_mm", "median_mm", "p95_mm"), ("within_1_mm", "held_1_mm")
LATER = ("last_10_mm",)  # an error, too; files of earlier versions lack it
RELATIVE, ABSOLUTE_MM, SHARE = 0.02, 0.002, 0.01  # half widths of the bands; reasons: docs/policies.md
WITH_MEMORY = 4.0  # times as wide: a memory carries last bits through the whole episode


@dataclass(frozen=True)
class RecordedScore:
    """The score of a policy on the episodes with the seeds first_seed, first_seed + 1, ...

    Args:
        values: by the names ERRORS and LATER [mm] and SHARES, as in
            agents.evaluation.score.Score.
        tolerances: by the same names, the largest difference of a score of the same episodes.
    Raises:
        ConfigError: a missing name, or a number out of range.
    """

    first_seed: Annotated[int, seed_number]
    episodes: Annotated[int, integer(1, 10**6)]
    values: Mapping[str, float]
    tolerances: Mapping[str, float]

    def __post_init__(self) -> None:
        check_fields(self, "score.")
        for part in ("values", "tolerances"):
            numbers = mapping(f"score.{part}", getattr(self, part), ERRORS + LATER + SHARES, ERRORS + SHARES)
            for name, value in numbers.items():
                number(0.0, 1e6)(f"score.{part}.{name}", value)
        if self.values.keys() != self.tolerances.keys():
            raise ConfigError("score.tolerances", sorted(self.tolerances), f"those of {', '.join(self.values)}")

    @classmethod
    def of(cls, score: Score, seeds: range, has_memory: bool = False) -> RecordedScore:
        """The record of a score of the episodes with these seeds, by a policy that has a memory or not."""
        factor = WITH_MEMORY if has_memory else 1.0
        values = {name: getattr(score, name) for name in ERRORS + LATER + SHARES}
        errors = {name: factor * (RELATIVE * values[name] + ABSOLUTE_MM) for name in ERRORS + LATER}
        tolerances = errors | dict.fromkeys(SHARES, factor * SHARE)
        return cls(seeds.start, len(seeds), values, tolerances)

    @property
    def described(self) -> str:
        """The kind of score, its episodes and seeds, in words."""
        last = self.first_seed + self.episodes - 1
        return f"regression band of {self.episodes} fixed episodes, seeds {self.first_seed} to {last}"

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
                lines.append(f"{name} is {now:.4g}, outside {value:.4g} ± {tolerance:.2g}, the {self.described}")
        return lines
