"""All controllers of a benchmark in the same episodes: from run folders to a record."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from agents.controllers.controller import Array, Controller, env_for
from agents.controllers.tuned import world_of
from agents.evaluation.floor import episode_floor, why_no_floor
from agents.evaluation.rollout import run_episodes
from agents.evaluation.score import FLOOR
from agents.executors.driver import values_of
from agents.executors.options import LOCAL, executor_of
from agents.executors.policies import PolicyUnit
from agents.executors.progress import Progress
from agents.policies.loading import list_policies, load_policy, shipped_policies
from agents.policies.shipped import ShippedPolicy
from agents.policies.trained import load_driving
from agents.results.description import description
from agents.results.environment import changed, common, episodes_key, plain
from agents.results.record import (
    BASELINE,
    POLICY,
    SHIFT,
    TEST,
    BenchmarkRecord,
    ControllerRecord,
    EpisodeScores,
    RunRecord,
    World,
)
from agents.results.roster import can_drive, candidates, is_privileged, opponents
from agents.results.runs import CHECKPOINT, Benchmark, FinishedRun, Recipe, recipe_name, stages
from agents.results.standings import FEEDBACK
from agents.results.worlds import ScoringPlan, worlds_of
from agents.runs.command_line import signals_seen
from agents.runs.environment import EnvConfig
from agents.runs.folder import RunFolder
from rj_gym.registry import version_of

Drive = Callable[[Sequence["_WorldUnit"]], Iterator[Any]]


@dataclass(frozen=True)
class _WorldUnit:
    """One piece of work: the episodes of a run's policy or of a baseline, or (driver None) the floors."""

    env: EnvConfig
    driver: RunFolder | str | None
    seeds: Sequence[int]
    complete: bool = True

    @property
    def run(self) -> RunFolder | None:
        """The run of the driving policy; None for a baseline and for floors."""
        return self.driver if isinstance(self.driver, RunFolder) else None

    def __call__(self) -> EpisodeScores | Array:
        if self.driver is None:
            has_floor = not why_no_floor(self.env)
            return episode_floor(self.env, self.seeds).errors if has_floor else np.full(len(self.seeds), np.nan)
        return EpisodeScores.of(
            run_episodes(self.env, _controller(self.env.id, world_of(self.env), self.driver), self.seeds), self.complete
        )


@lru_cache(maxsize=1)  # one controller after another drives in many worlds
def _controller(env_id: str, world: str, driver: RunFolder | str) -> Controller:
    if isinstance(driver, RunFolder):
        return load_driving(driver, CHECKPOINT)
    if driver in list_policies():
        return load_policy(driver, version=version_of(env_id))
    return candidates(world)[driver]


@dataclass(frozen=True)
class Learner:
    """A learned controller that is to be scored.

    Args:
        name, training: of its record. runs: the environment and the driver of every run, a run folder or the name of a
            shipped policy, and the function from its episodes in all worlds to its record.
    """

    name: str
    training: Mapping[str, Any]
    runs: Sequence[tuple[EnvConfig, RunFolder | str, Callable[[Mapping[str, EpisodeScores]], RunRecord]]]


def score_benchmark(benchmark: Benchmark, plan: ScoringPlan, drive: Drive, runs_only: bool = False) -> BenchmarkRecord:
    """The record of a benchmark, or of its runs only, in the episodes of the plan."""
    env, learners = common(benchmark.env), [_trained(recipe) for recipe in benchmark.recipes]
    record = _score(benchmark.title, env, learners, plan, drive, runs_only)
    if runs_only:
        return record
    names = [FEEDBACK] if FEEDBACK in record.names() else []
    return replace(record, levels=_levels(benchmark, env, dict.fromkeys([*names, record.best(BASELINE)]), drive))


def score_shipped(policy: ShippedPolicy, title: str, plan: ScoringPlan, drive: Drive) -> BenchmarkRecord:
    """The record of a shipped policy and its task, without curves: one training seed, trained earlier."""
    details = policy.training
    training = {name: details[name] for name in ("steps", "config")} | {"algorithm": policy.algorithm, "shipped": True}
    run = (policy.environment, policy.name, lambda driven: RunRecord(driven, details["seed"]))
    learner = Learner(f"{policy.algorithm}_{policy.name}", training, [run])
    return _score(title, common(policy.environment), [learner], replace(plan, per_point=0), drive)


def shipped_for_others(benchmarks: Sequence[Benchmark]) -> dict[str, ShippedPolicy]:
    """The shipped policies of other tasks than these benchmarks, by a title for their task."""
    keys, titles = (
        {episodes_key(benchmark.env) for benchmark in benchmarks},
        {benchmark.title for benchmark in benchmarks},
    )
    policies = {}
    for policy in shipped_policies():
        if episodes_key(policy.environment) not in keys:
            version = version_of(policy.env_id)
            title = policy.name.replace("_", " ") + (f" v{version}" if version else "")
            policies[f"{title} (shipped)" if title in titles else title] = policy
    return policies


def _score(
    title: str,
    env: EnvConfig,
    learners: Sequence[Learner],
    plan: ScoringPlan,
    drive: Drive,
    learners_only: bool = False,
) -> BenchmarkRecord:
    able, impossible = ({}, {}) if learners_only else opponents(env)
    worlds = worlds_of(env, plan)
    on_floors = [] if learners_only else [world for world in worlds if _has_floors(world)]
    driven: list[tuple[EnvConfig, RunFolder | str, list[World]]] = [
        (own_env, driver, worlds) for learner in learners for own_env, driver, _ in learner.runs
    ]
    for name, controller in able.items():
        own_env = env_for(env, controller)
        driven.append((own_env, name, [world for world in worlds if can_drive(own_env, world, controller)]))
    parts = [
        _WorldUnit(changed(own_env, world.changes), driver, world.seeds, world.role in (TEST, SHIFT))
        for own_env, driver, own_worlds in driven
        for world in own_worlds
    ]
    values = drive([*parts, *(_WorldUnit(changed(env, world.changes), None, world.seeds) for world in on_floors)])
    done = iter([{world.name: next(values) for world in own_worlds} for *_, own_worlds in driven])
    learned = [
        ControllerRecord(
            learner.name, POLICY, [record(next(done)) for *_, record in learner.runs], training=learner.training
        )
        for learner in learners
    ]
    compared = [
        ControllerRecord(name, BASELINE, [RunRecord(next(done))], is_privileged(controller))
        for name, controller in able.items()
    ]
    return BenchmarkRecord(
        title=title,
        description=description(env.arguments()["config"]),
        env_id=env.id,
        settings=plain(env),
        worlds=[_with_floors(world, next(values)) if world in on_floors else world for world in worlds],
        controllers=[*learned, *compared],
        impossible=impossible,
    )


def _has_floors(world: World) -> bool:
    """Whether floors are looked for: in tables, and where loads vary, which moves them."""
    return world.role in (TEST, SHIFT) or "load" in world.changes


def _with_floors(world: World, floors: Array) -> World:
    return replace(world, floors=floors if np.isfinite(floors).any() else None)


def _trained(recipe: Recipe) -> Learner:
    config = recipe.config.to_dict()
    shown = {name: config[name] for name in ("parameters", "policy", "normalise", "her")}
    training = {"algorithm": config["algorithm"], "steps": config["total_timesteps"], "config": shown}
    if earlier := [recipe_name(stage.path) for stage in stages(recipe.runs[0].folder)[1:]]:
        training["began_as"] = earlier
    runs = [(run.config.env, run.folder, partial(_run_record, run)) for run in recipe.runs]
    return Learner(recipe.name, training, runs)


def _run_record(run: FinishedRun, driven: Mapping[str, EpisodeScores]) -> RunRecord:
    used = {use: (seeds[0], seeds[-1]) for use, seeds in run.config.seeds.items()}
    return RunRecord(driven, run.config.seed, run.seconds, used, run.curve)


def _levels(benchmark: Benchmark, env: EnvConfig, names: Iterable[str | None], drive: Drive) -> dict[str, float]:
    """Mean errors at the end of these controllers and of the floor, in the evaluations during training [mm]."""
    during, drivers = benchmark.recipes[0].config.evaluation.seeds, list(filter(None, names))
    *driven, floors = drive([_WorldUnit(env, name, during) for name in (*drivers, None)])
    levels = {name: float(episodes.final.mean()) for name, episodes in zip(drivers, driven, strict=True)}
    finite = floors[np.isfinite(floors)]
    return levels | ({FLOOR: float(finite.mean())} if len(finite) else {})


@contextmanager
def driving(jobs: int, cluster: str = LOCAL) -> Iterator[Drive]:
    """Works through parts, `jobs` at a time here or on a Ray cluster; their values come in the order of the parts."""
    with executor_of(cluster, jobs, inline=True) as executor:

        def drive(parts: Sequence[_WorldUnit]) -> Iterator[Any]:
            units = [PolicyUnit(str(place), _driven, (part,), part.run) for place, part in enumerate(parts)]
            with signals_seen() as signals, Progress(len(parts), "part") as progress:
                values = values_of(executor, units, progress, signals)
            return iter(values)

        yield drive


def _driven(part: _WorldUnit, run: RunFolder | None) -> EpisodeScores | Array:
    """In a worker: the episodes of a part; its policy is in the folder of `run` on this machine."""
    return (part if run is None else replace(part, driver=run))()
