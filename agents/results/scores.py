"""What all controllers of a benchmark do in the same episodes, and comparisons of them episode by episode."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from agents.baselines import baselines
from agents.evaluation.controller import Array
from agents.evaluation.floor import episode_floor, why_no_floor
from agents.evaluation.policy import Policy
from agents.evaluation.rollout import Episodes, run_episodes
from agents.evaluation.score import FLOOR, Score
from agents.results.runs import POLICY, Benchmark, heavier
from agents.runs.environment import EnvConfig
from agents.runs.folder import RunFolder
from rollingjoint import set_threads

FEEDBACK = "jacobian feedback"
Drive = Callable[[Sequence["_Part"]], Iterator[Any]]
Change = Callable[[EnvConfig], EnvConfig]


@dataclass(frozen=True)
class Comparison:
    """By how much one controller's error is smaller than another's in the same E episodes [mm].

    Args:
        gain_mm: mean of the differences. standard_error_mm: of that mean, over the episodes.
        share: of the other's mean error that is gained.
        seeds_better, seeds: of the first one's runs, how many have a smaller mean error; all of them.
    """

    gain_mm: float
    standard_error_mm: float
    share: float
    seeds_better: int
    seeds: int

    @classmethod
    def of(cls, own: Array, other: Array) -> Comparison:
        """Errors of the runs of one, (S, E), against those of another, (E,)."""
        gains = other - own.mean(axis=0)
        error = float(gains.std(ddof=1) / np.sqrt(len(gains))) if len(gains) > 1 else np.inf
        better = int(np.sum(own.mean(axis=1) < other.mean()))
        return cls(float(gains.mean()), error, float(gains.mean() / other.mean()), better, len(own))

    @property
    def standard_errors(self) -> float:
        """The gain in units of its standard error."""
        if self.standard_error_mm > 0:
            return self.gain_mm / self.standard_error_mm
        return float(np.sign(self.gain_mm) * np.inf) if self.gain_mm else 0.0


@dataclass(frozen=True)
class Scores:
    """What all controllers of a benchmark did in the same E episodes.

    Args:
        policies: by name of the configuration, the episodes of each of its runs.
        baselines: by name. floors: (E,) [mm], NaN where none is known.
    """

    policies: Mapping[str, Sequence[Episodes]]
    baselines: Mapping[str, Episodes]
    floors: Array

    def of_policy(self, name: str) -> list[Score]:
        """The score of every run of a configuration."""
        return [Score.of(episodes, self.floors) for episodes in self.policies[name]]

    def of_baseline(self, name: str) -> Score:
        """The score of a baseline."""
        return Score.of(self.baselines[name], self.floors)

    def errors(self, name: str) -> Array:
        """Tip error at the end: of every run of a configuration, or of a baseline, (runs, E) [mm]."""
        found = self.policies[name] if name in self.policies else [self.baselines[name]]
        return np.stack([episodes.final_errors for episodes in found])

    @property
    def loads(self) -> Array:
        """Magnitude of the load at the end, (E,) [N]."""
        forces = next(iter(self.baselines.values())).loads
        assert forces is not None
        return np.linalg.norm(forces[:, -1], axis=-1)

    @property
    def best_policy(self) -> str:
        """The configuration with the smallest mean error."""
        return min(self.policies, key=lambda name: float(self.errors(name).mean()))

    @property
    def best_baseline(self) -> str:
        """The baseline with the smallest mean error."""
        return min(self.baselines, key=lambda name: float(self.errors(name).mean()))

    def compare(self, policy: str, baseline: str) -> Comparison:
        """How the runs of a configuration do against a baseline."""
        return Comparison.of(self.errors(policy), self.errors(baseline)[0])


@dataclass(frozen=True)
class Scored:
    """A benchmark with what was found.

    Args:
        scores: in the episodes of the tables. beyond: in those with heavier loads; None where there are none.
        levels: mean errors of Jacobian feedback and, where it is known, floor in the evaluations during training [mm],
            by name.
    """

    benchmark: Benchmark
    scores: Scores
    beyond: Scores | None
    levels: Mapping[str, float]


@dataclass(frozen=True)
class _Part:
    """One piece of work: the episodes of a run's policy or of a baseline, or (driver None) the floors."""

    env: EnvConfig
    driver: RunFolder | str | None
    seeds: Sequence[int]

    def __call__(self) -> Episodes | Array:
        if self.driver is None:
            known = not why_no_floor(self.env)
            return episode_floor(self.env, self.seeds).errors if known else np.full(len(self.seeds), np.nan)
        if isinstance(self.driver, str):
            return run_episodes(self.env, baselines()[self.driver], self.seeds)
        episodes = run_episodes(self.env, Policy.load(self.driver, POLICY), self.seeds)
        return replace(episodes, loads=None, link=None, targets=None)  # the same as those of the baselines


def score_benchmark(benchmark: Benchmark, seeds: Sequence[int], drive: Drive) -> Scored:
    """All that the page says of a benchmark, in the episodes with these seeds."""
    beyond = score(benchmark, seeds, drive, heavier) if benchmark.has_heavier else None
    during = benchmark.recipes[0].config.evaluation.seeds
    feedback, floors = drive([_Part(benchmark.env, driver, during) for driver in (FEEDBACK, None)])
    levels = {FEEDBACK: float(feedback.final_errors.mean())}
    if np.isfinite(floors).any():
        levels[FLOOR] = float(floors[np.isfinite(floors)].mean())
    return Scored(benchmark, score(benchmark, seeds, drive), beyond, levels)


def score(benchmark: Benchmark, seeds: Sequence[int], drive: Drive, change: Change = lambda env: env) -> Scores:
    """The scores of all controllers of a benchmark in the episodes with these seeds, its environments changed so."""
    driven: list[tuple[EnvConfig, RunFolder | str | None]] = []
    driven += [(run.config.env, run.folder) for recipe in benchmark.recipes for run in recipe.runs]
    driven += [(benchmark.env, driver) for driver in (*baselines(), None)]
    found = drive([_Part(change(env), driver, seeds) for env, driver in driven])
    policies = {recipe.name: [next(found) for _ in recipe.runs] for recipe in benchmark.recipes}
    return Scores(policies, {name: next(found) for name in baselines()}, next(found))


@contextmanager
def driving(jobs: int) -> Iterator[Drive]:
    """Works through parts in order, `jobs` at a time, in processes of their own if more than one."""
    if jobs == 1:
        yield lambda parts: iter([part() for part in parts])
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, context, initializer=set_threads, initargs=(1,)) as pool:
        yield lambda parts: pool.map(_Part.__call__, parts)
