"""Scores of controllers over the same episodes, as numbers, a table, JSON and Markdown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from agents.evaluation.controller import Array
from agents.evaluation.rollout import Episodes

CLOSE_MM = 1.0
HELD_STEPS = 10
FLOOR = "floor"


@dataclass(frozen=True)
class Score:
    """How one controller did: tip error at the end of the episodes [mm], shares from 0 to 1.

    `within_1_mm` is the share of episodes that end within 1 mm of the target, `held_1_mm` the share that are within
    1 mm during all of the last 10 steps, `ended_early` the number of episodes that the environment ended. `regret_mm`
    is the mean of final error minus floor of the same episode, None where there are no floors.
    """

    mean_mm: float
    median_mm: float
    p95_mm: float
    within_1_mm: float
    held_1_mm: float
    mean_reward: float
    ended_early: int
    regret_mm: float | None = None

    @classmethod
    def of(cls, episodes: Episodes, floors: Array | None = None) -> Score:
        """The score of one controller's episodes; floors (E,) [mm], one that is not finite does not count."""
        final = episodes.final_errors
        return cls(
            mean_mm=float(final.mean()),
            median_mm=float(np.median(final)),
            p95_mm=float(np.percentile(final, 95)),
            within_1_mm=float(np.mean(final <= CLOSE_MM)),
            held_1_mm=float(np.mean(np.all(episodes.errors[:, -HELD_STEPS:] <= CLOSE_MM, axis=1))),
            mean_reward=float(episodes.rewards.mean()),
            ended_early=int(episodes.terminated.sum()),
            regret_mm=None if floors is None else _mean_of_finite(final - floors),
        )


@dataclass(frozen=True)
class Report:
    """Everything that an evaluation found.

    Args:
        episodes: of every controller, by name, with the same seeds.
        length_mm: of the mechanism; None where the environment is not one of rj_gym.
        floors: the smallest error that any command reaches at the end of every episode, (E,) [mm].
        about: what was evaluated.
    """

    episodes: Mapping[str, Episodes]
    length_mm: float | None = None
    floors: Array | None = None
    about: Mapping[str, Any] = field(default_factory=dict)

    @property
    def scores(self) -> dict[str, Score]:
        """The score of every controller."""
        return {name: Score.of(episodes, self.floors) for name, episodes in self.episodes.items()}

    @property
    def known_floors(self) -> Array | None:
        """The floors that are finite, if there are any."""
        known = self.floors[np.isfinite(self.floors)] if self.floors is not None else np.empty(0)
        return known if len(known) else None

    @property
    def seeds(self) -> list[int]:
        """The seeds of the episodes."""
        return [int(seed) for seed in next(iter(self.episodes.values())).seeds]

    def table(self) -> list[list[str]]:
        """Header and rows of the table, as text."""
        head = ["controller", "mean", "median", "95 % below", "within 1 mm", f"held {HELD_STEPS} steps", "regret"]
        rows = [
            [
                name,
                *_errors(score.mean_mm, score.median_mm, score.p95_mm),
                *_shares(score.within_1_mm, score.held_1_mm),
                "" if score.regret_mm is None else _error(score.regret_mm),
            ]
            for name, score in self.scores.items()
        ]
        return [head, *rows, *([] if self.known_floors is None else [_floor_row(self.known_floors)])]

    def text(self) -> str:
        """The table for a terminal."""
        rows = self.table()
        widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
        lines = ["  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]) for row in rows]
        return "\n".join([lines[0], "-" * len(lines[0]), *lines[1:]])

    def to_dict(self) -> dict[str, Any]:
        """Plain values for report.json."""
        floors = {} if self.floors is None else {"floors_mm": _plain(self.floors)}
        return {
            "about": dict(self.about),
            "length_mm": self.length_mm,
            "scores": {name: asdict(score) for name, score in self.scores.items()},
            "seeds": self.seeds,
            "final_errors_mm": {name: _plain(some.final_errors) for name, some in self.episodes.items()},
            **floors,
        }

    def markdown(self, notes: Mapping[str, str], pictures: Mapping[str, str]) -> str:
        """The text of report.md.

        Args:
            notes: what each controller is, by name.
            pictures: caption by file name.
        """
        head, *rows = (" | ".join(row) for row in self.table())
        aligned = "|".join([":--", *["--:"] * (len(self.table()[0]) - 1)])
        early = [f"{name}: {score.ended_early}" for name, score in self.scores.items() if score.ended_early]
        parts = [
            "# Evaluation",
            "\n".join(f"- {key}: {value}" for key, value in self.about.items()),
            self._explanation(),
            "\n".join([f"| {head} |", f"|{aligned}|", *(f"| {row} |" for row in rows)]),
            "\n".join(f"- **{name}**: {note}" for name, note in notes.items()),
            f"Episodes that the environment ended early: {', '.join(early) or 'none'}.",
            *(f"![{caption}]({file})\n\n{caption}" for file, caption in pictures.items()),
        ]
        return "\n\n".join(parts) + "\n"

    def _explanation(self) -> str:
        length = "" if self.length_mm is None else f"; the mechanism is {self.length_mm:g} mm long"
        text = (
            f"Tip error at the end of the episode{length}. Within 1 mm: share of episodes that end so near to the "
            f"target; held: share that are so near in all of the last {HELD_STEPS} steps. Every controller drives the "
            "same episodes."
        )
        if self.floors is None:
            return text
        return (
            f"{text} The floor is the smallest error that any command reaches against the load of the episode; regret "
            "is the mean of what a controller leaves above it."
        )


def _mean_of_finite(values: Array) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else None


def _floor_row(floors: Array) -> list[str]:
    errors = _errors(floors.mean(), np.median(floors), np.percentile(floors, 95))
    return [FLOOR, *errors, *_shares(float(np.mean(floors <= CLOSE_MM))), "", ""]


def _error(value: float) -> str:
    return f"{value:.3f} mm" if abs(value) < 1 else f"{value:.2f} mm"


def _errors(*values: float) -> list[str]:
    return [_error(float(value)) for value in values]


def _shares(*values: float) -> list[str]:
    return [f"{100 * value:.1f} %" for value in values]


def _plain(errors: Array) -> list[float | None]:
    """The errors as JSON has them: None where one is not finite."""
    return [float(error) if np.isfinite(error) else None for error in errors]
