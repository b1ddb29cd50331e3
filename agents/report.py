"""Scores of controllers over the same episodes, as numbers, a table, JSON and Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from agents.rollout import Episode, error_table

CLOSE_MM = 1.0
HELD_STEPS = 10


@dataclass(frozen=True)
class Score:
    """How one controller did: tip error at the end of the episodes [mm], shares from 0 to 1.

    `within_1_mm` is the share of episodes that end within 1 mm of the target, `held_1_mm` the share that are within
    1 mm during all of the last 10 steps, `ended_early` the number of episodes that the environment ended.
    """

    mean_mm: float
    median_mm: float
    p95_mm: float
    within_1_mm: float
    held_1_mm: float
    mean_reward: float
    ended_early: int

    @classmethod
    def of(cls, episodes: Sequence[Episode]) -> Score:
        """The score of one controller's episodes."""
        errors = error_table(episodes)
        final = errors[:, -1]
        return cls(
            mean_mm=float(final.mean()),
            median_mm=float(np.median(final)),
            p95_mm=float(np.percentile(final, 95)),
            within_1_mm=float(np.mean(final <= CLOSE_MM)),
            held_1_mm=float(np.mean(np.all(errors[:, -HELD_STEPS:] <= CLOSE_MM, axis=1))),
            mean_reward=float(np.mean([episode.reward for episode in episodes])),
            ended_early=sum(episode.terminated for episode in episodes),
        )


@dataclass(frozen=True)
class Report:
    """Everything that an evaluation found: what was evaluated and the episodes of every controller, by name."""

    about: Mapping[str, Any]
    length_mm: float
    episodes: Mapping[str, Sequence[Episode]]

    @property
    def scores(self) -> dict[str, Score]:
        """The score of every controller."""
        return {name: Score.of(episodes) for name, episodes in self.episodes.items()}

    def table(self) -> list[list[str]]:
        """Header and rows of the table, as text: tip errors in mm and in % of the mechanism's length."""
        head = ["controller", "mean", "median", "95 % below", "within 1 mm", f"held {HELD_STEPS} steps"]
        return [head, *([name, *self._cells(score)] for name, score in self.scores.items())]

    def _cells(self, score: Score) -> list[str]:
        errors = [
            f"{value:.2f} mm ({100 * value / self.length_mm:.1f} %)"
            for value in (score.mean_mm, score.median_mm, score.p95_mm)
        ]
        return [*errors, f"{100 * score.within_1_mm:.0f} %", f"{100 * score.held_1_mm:.0f} %"]

    def text(self) -> str:
        """The table for a terminal."""
        rows = self.table()
        widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
        lines = ["  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]) for row in rows]
        return "\n".join([lines[0], "-" * len(lines[0]), *lines[1:]])

    def to_dict(self) -> dict[str, Any]:
        """Plain values for report.json."""
        return {
            "about": dict(self.about),
            "length_mm": self.length_mm,
            "scores": {name: asdict(score) for name, score in self.scores.items()},
            "seeds": [episode.seed for episode in next(iter(self.episodes.values()))],
            "final_errors_mm": {name: [float(e.errors[-1]) for e in some] for name, some in self.episodes.items()},
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
            f"Tip error at the end of the episode, in mm and in % of the mechanism's length ({self.length_mm:g} mm). "
            f"Within 1 mm: share of episodes that end so near to the target; held: share that are so near in all of "
            f"the last {HELD_STEPS} steps. Every controller drives the same episodes.",
            "\n".join([f"| {head} |", f"|{aligned}|", *(f"| {row} |" for row in rows)]),
            "\n".join(f"- **{name}**: {note}" for name, note in notes.items()),
            f"Episodes that the environment ended early: {', '.join(early) or 'none'}.",
            *(f"![{caption}]({file})\n\n{caption}" for file, caption in pictures.items()),
        ]
        return "\n\n".join(parts) + "\n"
