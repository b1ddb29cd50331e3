"""Scores of controllers over the same episodes, as numbers, a table, JSON and Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import cloudpickle  # type: ignore[import-untyped]
import numpy as np

from agents.controllers.controller import Array, Controller
from agents.evaluation.floor import episode_floor, why_no_floor
from agents.evaluation.rollout import BLOCK, LAST_STEPS, Episodes, joined, run_episodes
from agents.evaluation.score import CLOSE_MM, FLOOR, HELD_STEPS, Score
from agents.executors.driver import Unit, values_of
from agents.executors.progress import Progress
from agents.executors.protocol import Executor
from agents.runs.command_line import signals_seen
from agents.runs.environment import EnvConfig
from rj_gym.registry import task_of
from rollingjoint.checks import as_integer
from rollingjoint.tables import markdown_table, text_table

RETURNS = (
    "Return and terms of the reward: sums over an episode, means over the episodes. The best policy of a training is "
    "the one with the smallest tip error in its evaluations, not the one with the largest return."
)
POLICY, OPEN_LOOP = "policy", "open loop"  # names of controllers


@dataclass(frozen=True)
class EvaluationReport:
    """Everything that an evaluation found.

    Args:
        episodes: of every controller, by name, with the same seeds.
        length_mm: of the mechanism; None where the environment is not one of rj_gym.
        floors: the smallest error that any command reaches at the end of every episode, (E,) [mm].
        about: the evaluated environment and episodes.
        no_floor: why there are no floors where one would look for them, one line.
        floors_at: the floors after other steps than the last, too, (E,) each, by step.
    """

    episodes: Mapping[str, Episodes]
    length_mm: float | None = None
    floors: Array | None = None
    about: Mapping[str, Any] = field(default_factory=dict)
    no_floor: str = ""
    floors_at: Mapping[int, Array] = field(default_factory=dict)

    @property
    def scores(self) -> dict[str, Score]:
        """The score of every controller."""
        return {name: Score.of(episodes, self.floors) for name, episodes in self.episodes.items()}

    @property
    def known_floors(self) -> Array | None:
        """The floors that are finite, if there are any."""
        finite = self.floors[np.isfinite(self.floors)] if self.floors is not None else np.empty(0)
        return finite if len(finite) else None

    @property
    def seeds(self) -> list[int]:
        """The seeds of the episodes."""
        return [int(seed) for seed in next(iter(self.episodes.values())).seeds]

    def table(self) -> list[list[str]]:
        """Head and rows of the table, as text."""
        last = f"last {LAST_STEPS} steps"
        head = ["controller", "mean", "median", "95 % below", last, "within 1 mm", f"held {HELD_STEPS} steps", "regret"]
        rows = [
            [
                name,
                *_errors(score.mean_mm, score.median_mm, score.p95_mm, score.last_10_mm),
                *_shares(score.within_1_mm, score.held_1_mm),
                "" if score.regret_mm is None else _error(score.regret_mm),
            ]
            for name, score in self.scores.items()
        ]
        return [head, *rows, *([] if self.known_floors is None else [_floor_row(self.known_floors)])]

    @property
    def reward_terms(self) -> dict[str, dict[str, float]]:
        """Means of the terms of the reward, summed over an episode, by controller; none where they are not known."""
        known = {name: episodes.reward_terms for name, episodes in self.episodes.items() if episodes.reward_terms}
        return {name: {term: float(sums.mean()) for term, sums in terms.items()} for name, terms in known.items()}

    def reward_table(self) -> list[list[str]]:
        """Head and rows of the table of returns and terms of the reward; empty where no terms are known."""
        terms = self.reward_terms
        rows = [
            [name, *(f"{value:.3f}" for value in (float(self.episodes[name].rewards.mean()), *values.values()))]
            for name, values in terms.items()
        ]
        return [["controller", "return", *next(iter(terms.values()))], *rows] if terms else []

    def text(self) -> str:
        """The tables for a terminal."""
        (head, *rows), rewards = self.table(), self.reward_table()
        parts = [text_table(head, rows, ruled=True), *([self.no_floor] if self.no_floor else [])]
        return "\n".join(
            [*parts, *(["", text_table(rewards[0], rewards[1:], ruled=True), "", RETURNS] if rewards else [])]
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain values for report.json."""
        floors: dict[str, Any] = {} if self.floors is None else {"floors_mm": _plain(self.floors)}
        if self.no_floor:
            floors["no_floor"] = self.no_floor
        return {
            "about": dict(self.about),
            "length_mm": self.length_mm,
            "scores": {name: asdict(score) for name, score in self.scores.items()},
            "seeds": self.seeds,
            **({"reward_terms": terms} if (terms := self.reward_terms) else {}),
            "final_errors_mm": {name: _plain(episodes.final_errors) for name, episodes in self.episodes.items()},
            **floors,
        }

    def markdown(self, notes: Mapping[str, str], pictures: Mapping[str, str]) -> str:
        """The text of report.md.

        Args:
            notes: descriptions of the controllers, by name.
            pictures: caption by file name.
        """
        (head, *rows), rewards = self.table(), self.reward_table()
        early = [f"{name}: {score.ended_early}" for name, score in self.scores.items() if score.ended_early]
        parts = [
            "# Evaluation",
            "\n".join(f"- {key}: {value}" for key, value in self.about.items()),
            self._explanation(),
            markdown_table(head, rows),
            *([markdown_table(rewards[0], rewards[1:]), RETURNS] if rewards else []),
            "\n".join(f"- **{name}**: {note}" for name, note in notes.items()),
            f"Episodes that the environment ended early: {', '.join(early) or 'none'}.",
            *(f"![{caption}]({file})\n\n{caption}" for file, caption in pictures.items()),
        ]
        return "\n\n".join(parts) + "\n"

    def _explanation(self) -> str:
        length = "" if self.length_mm is None else f"; the mechanism is {self.length_mm:g} mm long"
        text = (
            f"Tip error at the end of the episode{length}; last {LAST_STEPS} steps: its mean over these. Within 1 mm: "
            f"share of episodes that end so near to the target; held: share that are so near in all of the last "
            f"{HELD_STEPS} steps. Every controller drives the same episodes."
        )
        if self.floors is None:
            return f"{text} {self.no_floor}".rstrip()
        return (
            f"{text} The floor is the smallest error that any command reaches against the load of the episode; regret "
            "is the mean of what a controller leaves above it."
        )


def evaluate_controllers(
    env: EnvConfig,
    controllers: Mapping[str, Controller],
    seeds: Sequence[int],
    with_floor: bool = True,
    executor: Executor | None = None,
    moments: int = 1,
) -> EvaluationReport:
    """Results of the controllers in the same episodes, one per seed, and the floors of these; no files are written.

    Environments with another task than tracking have no floor, and none is known with friction.

    Args:
        moments: after how many steps of every episode floors are searched for: after the last one, and where there are
            more, after others that are spread evenly from the start on.
        executor: where the episodes run, a unit per controller and block of seeds (agents.executors.options); None:
            in this process.
    Raises:
        RollingJointError: a controller that cannot act in this environment.
    """
    episodes = driven(env, controllers, seeds, executor)
    if not env.is_tracking:
        return EvaluationReport(episodes)
    why = why_no_floor(env) if with_floor else ""
    config = env.arguments()["config"]
    floors_at: dict[int, Array] = {}
    if with_floor and not why:
        as_integer("moments", moments, 1)
        steps = sorted({round(step) for step in np.linspace(config.episode_steps, 0, moments)})
        floors_at = dict(zip(steps, episode_floor(env, seeds, steps).errors.T, strict=True))
    floors = floors_at.get(config.episode_steps)
    return EvaluationReport(episodes, task_of(config).length, floors, no_floor=why, floors_at=floors_at)


def driven(
    env: EnvConfig, controllers: Mapping[str, Controller], seeds: Sequence[int], executor: Executor | None
) -> dict[str, Episodes]:
    """The episodes of every controller, one per seed; None as executor: in this process."""
    if executor is None:
        return {name: run_episodes(env, controller, seeds) for name, controller in controllers.items()}
    blocks = [seeds[first : first + BLOCK] for first in range(0, len(seeds), BLOCK)]
    pickled = {name: cloudpickle.dumps(controller) for name, controller in controllers.items()}
    units = [Unit(name, _episodes, (env, pickled[name], block)) for name in controllers for block in blocks]
    with signals_seen() as signals, Progress(len(units), "block") as progress:
        values = iter(values_of(executor, units, progress, signals))
    return {name: joined([next(values) for _ in blocks]) for name in controllers}


def _episodes(env: EnvConfig, controller: bytes, seeds: Sequence[int]) -> Episodes:
    return run_episodes(env, cloudpickle.loads(controller), seeds)


def _floor_row(floors: Array) -> list[str]:
    errors = _errors(floors.mean(), np.median(floors), np.percentile(floors, 95))
    return [FLOOR, *errors, "", *_shares(float(np.mean(floors <= CLOSE_MM))), "", ""]


def _error(value: float) -> str:
    return f"{value:.3f} mm" if abs(value) < 1 else f"{value:.2f} mm"


def _errors(*values: float) -> list[str]:
    return [_error(float(value)) for value in values]


def _shares(*values: float) -> list[str]:
    return [f"{100 * value:.1f} %" for value in values]


def _plain(errors: Array) -> list[float | None]:
    """The errors as JSON has them: None where one is not finite."""
    return [float(error) if np.isfinite(error) else None for error in errors]
