"""One set of results of several: campaigns of other machines or days, other training seeds, controllers entered."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from agents.results.environment import environment_of, episodes_key
from agents.results.record import (
    BenchmarkRecord,
    ControllerRecord,
    EpisodeScores,
    Results,
    ResultsError,
    RunRecord,
    World,
)

RELATIVE, ABSOLUTE_MM = 0.02, 0.002  # by how much a mean may differ on another machine


def merged(results: Sequence[Results]) -> Results:
    """All benchmarks, controllers and runs of these results.

    Benchmarks with the same episodes become one, as do controllers of the same name and runs of the same training seed.
    Values in several results are taken from the first of them.

    Raises:
        ResultsError: a world with other seeds or settings in one than in another, or a run that scored differently.
        ConfigError: an environment that this version does not have.
    """
    groups: dict[str, list[BenchmarkRecord]] = {}
    for record in (record for source in results for record in source.benchmarks):
        groups.setdefault(episodes_key(environment_of(record)), []).append(record)
    benchmarks = [_benchmark(group) for group in groups.values()]
    titles = [benchmark.title for benchmark in benchmarks]
    if len(set(titles)) < len(titles):
        raise ResultsError("titles", titles, "another title for every task", "Rename one: the key `title` in its file.")
    return Results(
        benchmarks,
        commands=_distinct(source.commands for source in results),
        scored_on=_distinct(source.scored_on for source in results),
        trained_with=_distinct(source.trained_with for source in results),
        left_out={path: why for source in results for path, why in source.left_out.items()},
        films={title: films for source in reversed(results) for title, films in _films(source, groups).items()},
    )


def _benchmark(records: Sequence[BenchmarkRecord]) -> BenchmarkRecord:
    first = records[0]
    worlds: dict[str, World] = {}
    controllers: dict[str, ControllerRecord] = {}
    for record in records:
        for world in record.worlds:
            world_before = worlds.get(world.name, world)
            _check_same(first.title, world_before, world)
            worlds[world.name] = world if world_before.floors is None else world_before
        for controller in record.controllers:
            controller_before = controllers.get(controller.name)
            controllers[controller.name] = (
                controller if controller_before is None else _controller(controller_before, controller)
            )
    levels = {name: level for record in reversed(records) for name, level in record.levels.items()}
    impossible = {name: why for record in records for name, why in record.impossible.items()}
    return replace(
        first,
        worlds=list(worlds.values()),
        controllers=list(controllers.values()),
        levels=levels,
        impossible=impossible,
    )


def _films(results: Results, groups: Mapping[str, Sequence[BenchmarkRecord]]) -> dict[str, Mapping[str, str]]:
    """The captions of its animations, by the titles that its benchmarks have among all."""
    titles = {id(record): group[0].title for group in groups.values() for record in group}
    return {
        titles[id(record)]: results.films[record.title]
        for record in results.benchmarks
        if record.title in results.films
    }


def _check_same(title: str, first: World, second: World) -> None:
    if (first.seeds, first.changes, first.role) != (second.seeds, second.changes, second.role):
        allowed = f"{first.role} episodes {first.seeds} with the changes {dict(first.changes)}, as in the other file"
        raise ResultsError(f"{title}: world {first.name!r}", f"{second.seeds}, {dict(second.changes)}", allowed)


def _controller(first: ControllerRecord, second: ControllerRecord) -> ControllerRecord:
    if (first.kind, first.privileged) != (second.kind, second.privileged):
        raise ResultsError(
            f"{first.name}: kind", second.kind, f"{first.kind}, as in the other file", "Rename one of them."
        )
    runs: dict[int | None, RunRecord] = {run.training_seed: run for run in first.runs}
    for run in second.runs:
        run_before = runs.get(run.training_seed)
        runs[run.training_seed] = run if run_before is None else _run(first.name, run_before, run)
    ordered = sorted(runs.values(), key=lambda run: -1 if run.training_seed is None else run.training_seed)
    return replace(first, runs=ordered, training=first.training or second.training)


def _run(name: str, first: RunRecord, second: RunRecord) -> RunRecord:
    driven: Mapping[str, EpisodeScores] = {**second.driven, **first.driven}
    for world in (world for world in first.driven if world in second.driven):
        means = [float(np.mean(run.driven[world].last)) for run in (first, second)]
        if not np.isclose(means[0], means[1], rtol=RELATIVE, atol=ABSOLUTE_MM):
            what = f"{name}, training seed {first.training_seed}: mean error in {world!r}"
            raise ResultsError(what, means[1], f"{means[0]:.4g} mm, as in the other file", "Rename one of them.")
    return replace(first, driven=driven, curve=second.curve if first.curve is None else first.curve)


def _distinct(parts: Iterable[Sequence[str]]) -> list[str]:
    return list(dict.fromkeys(text for part in parts for text in part))
