"""One set of results of several: campaigns of other machines or days, other training seeds, controllers entered."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from agents.results.environment import environment_of, episodes_key
from agents.results.record import BenchmarkRecord, ControllerRecord, Driven, Results, ResultsError, RunRecord, World

RELATIVE, ABSOLUTE_MM = 0.02, 0.002  # by how much a mean may differ on another machine


def merged(results: Sequence[Results]) -> Results:
    """All benchmarks, controllers and runs of these results.

    Benchmarks with the same episodes become one, as do controllers of the same name and runs of the same training seed.
    What is in several results is taken from the first of them.

    Raises:
        ResultsError: a world with other seeds or settings in one than in another, or a run that scored differently.
        ConfigError: an environment that this version does not have.
    """
    groups: dict[str, list[BenchmarkRecord]] = {}
    for record in (one for some in results for one in some.benchmarks):
        groups.setdefault(episodes_key(environment_of(record)), []).append(record)
    benchmarks = [_benchmark(group) for group in groups.values()]
    titles = [one.title for one in benchmarks]
    if len(set(titles)) < len(titles):
        raise ResultsError("titles", titles, "another title for every task", "Rename one: the key `title` in its file.")
    return Results(
        benchmarks,
        commands=_distinct(one.commands for one in results),
        scored_on=_distinct(one.scored_on for one in results),
        trained_with=_distinct(one.trained_with for one in results),
        left_out={path: why for one in results for path, why in one.left_out.items()},
        films={title: films for one in reversed(results) for title, films in _films(one, groups).items()},
    )


def _benchmark(records: Sequence[BenchmarkRecord]) -> BenchmarkRecord:
    first = records[0]
    worlds: dict[str, World] = {}
    controllers: dict[str, ControllerRecord] = {}
    for record in records:
        for world in record.worlds:
            known = worlds.get(world.name, world)
            _check_same(first.title, known, world)
            worlds[world.name] = world if known.floors is None else known
        for controller in record.controllers:
            known_one = controllers.get(controller.name)
            controllers[controller.name] = controller if known_one is None else _controller(known_one, controller)
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
    return {titles[id(one)]: results.films[one.title] for one in results.benchmarks if one.title in results.films}


def _check_same(title: str, one: World, other: World) -> None:
    if (one.seeds, one.changes, one.role) != (other.seeds, other.changes, other.role):
        allowed = f"{one.role} episodes {one.seeds} with the changes {dict(one.changes)}, as in the other file"
        raise ResultsError(f"{title}: world {one.name!r}", f"{other.seeds}, {dict(other.changes)}", allowed)


def _controller(one: ControllerRecord, other: ControllerRecord) -> ControllerRecord:
    if (one.kind, one.privileged) != (other.kind, other.privileged):
        raise ResultsError(f"{one.name}: kind", other.kind, f"{one.kind}, as in the other file", "Rename one of them.")
    runs: dict[int | None, RunRecord] = {run.training_seed: run for run in one.runs}
    for run in other.runs:
        known = runs.get(run.training_seed)
        runs[run.training_seed] = run if known is None else _run(one.name, known, run)
    ordered = sorted(runs.values(), key=lambda run: -1 if run.training_seed is None else run.training_seed)
    return replace(one, runs=ordered, training=one.training or other.training)


def _run(name: str, one: RunRecord, other: RunRecord) -> RunRecord:
    both: Mapping[str, Driven] = {**other.driven, **one.driven}
    for world in (world for world in one.driven if world in other.driven):
        means = [float(np.mean(run.driven[world].last)) for run in (one, other)]
        if not np.isclose(means[0], means[1], rtol=RELATIVE, atol=ABSOLUTE_MM):
            what = f"{name}, training seed {one.training_seed}: mean error in {world!r}"
            raise ResultsError(what, means[1], f"{means[0]:.4g} mm, as in the other file", "Rename one of them.")
    return replace(one, driven=both, curve=other.curve if one.curve is None else one.curve)


def _distinct(parts: Iterable[Sequence[str]]) -> list[str]:
    return list(dict.fromkeys(text for part in parts for text in part))
