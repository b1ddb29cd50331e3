"""Results files: JSON with a schema version, written and read.

Errors are written with four digits. docs/enter.md lists the keys.
"""

from __future__ import annotations

import gzip
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.controllers.controller import Array
from agents.results.record import (
    BenchmarkRecord,
    ControllerRecord,
    EpisodeScores,
    Results,
    ResultsError,
    RunRecord,
    World,
)
from agents.runs.checked_json import PACKED, read_json
from agents.runs.files import write_bytes
from rollingjoint.errors import ConfigError, RollingJointError

FORMAT, SCHEMA = "rollingjoint results", 1
FILE = "results.json" + PACKED  # in the folder of a page
_DIGITS = 4


def read_results(path: str | Path) -> Results:
    """The results in a file, JSON or gzipped JSON.

    Raises:
        ResultsError: a file that cannot be read, one of another schema, or one with parts that do not fit together.
    """
    allowed = "a file that rj results wrote"
    try:
        values = read_json(Path(path))
        version = (values["format"], values["schema"])
    except ConfigError as error:
        raise ResultsError("results file", str(path), allowed, str(error)) from error
    except (LookupError, TypeError) as error:
        raise ResultsError("results file", str(path), allowed, repr(error)) from error
    if version != (FORMAT, SCHEMA):
        hint = "Another version of this package may read it."
        raise ResultsError(f"{path}: format and schema", version, f"{FORMAT!r}, {SCHEMA}", hint)
    return from_dict(values, str(path))


def write_results(path: Path, results: Results) -> None:
    """Write a results file, gzipped where the name ends with .gz."""
    content = (_text(to_dict(results)) + "\n").encode()
    write_bytes(path, gzip.compress(content, mtime=0) if path.suffix == PACKED else content)


def to_dict(results: Results) -> dict[str, Any]:
    """Plain values, ready for JSON."""
    return {
        "format": FORMAT,
        "schema": SCHEMA,
        "commands": list(results.commands),
        "scored_on": list(results.scored_on),
        "trained_with": list(results.trained_with),
        "left_out": dict(results.left_out),
        "films": {title: dict(films) for title, films in results.films.items()},
        "benchmarks": [_benchmark(record) for record in results.benchmarks],
    }


def from_dict(values: Mapping[str, Any], source: str) -> Results:
    """The results in plain values; raises ResultsError, which names the source, where they do not fit together."""
    try:
        benchmarks = [_read_benchmark(record) for record in values["benchmarks"]]
        about = {name: values[name] for name in ("commands", "scored_on", "trained_with", "left_out", "films")}
        return Results(benchmarks, **about)
    except RollingJointError as error:
        raise ResultsError(source, "not consistent", "a file that rj results wrote", str(error)) from error
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        raise ResultsError(source, "not complete", "a file that rj results wrote", repr(error)) from error


def _benchmark(record: BenchmarkRecord) -> dict[str, Any]:
    return {
        "title": record.title,
        "description": record.description,
        "environment": {"id": record.env_id, "settings": record.settings},
        "levels_mm": dict(record.levels),
        "impossible": dict(record.impossible),
        "worlds": [_world(world) for world in record.worlds],
        "controllers": [_controller(controller) for controller in record.controllers],
    }


def _read_benchmark(values: Mapping[str, Any]) -> BenchmarkRecord:
    environment = values["environment"]
    return BenchmarkRecord(
        title=values["title"],
        description=values["description"],
        env_id=environment["id"],
        settings=environment["settings"],
        worlds=[_read_world(world) for world in values["worlds"]],
        controllers=[_read_controller(controller) for controller in values["controllers"]],
        levels=values["levels_mm"],
        impossible=values["impossible"],
    )


def _world(world: World) -> dict[str, Any]:
    plain: dict[str, Any] = {name: getattr(world, name) for name in ("name", "role", "first_seed", "episodes")}
    plain |= {"changes": world.changes, "heading": world.heading}
    if world.axis:
        plain |= {"axis": world.axis, "value": world.value, "trained": list(world.trained)}
    return plain if world.floors is None else plain | {"floors_mm": _numbers(world.floors)}


def _read_world(values: Mapping[str, Any]) -> World:
    plain = {name: value for name, value in values.items() if name not in ("floors_mm", "trained")}
    floors = np.array(values["floors_mm"], float) if "floors_mm" in values else None
    low, high = values.get("trained", (0.0, 0.0))
    return World(**plain, trained=(low, high), floors=floors)


def _controller(record: ControllerRecord) -> dict[str, Any]:
    plain = {"name": record.name, "kind": record.kind, "privileged": record.privileged, "training": record.training}
    return plain | {"runs": [_run(run) for run in record.runs]}


def _read_controller(values: Mapping[str, Any]) -> ControllerRecord:
    runs = [_read_run(run) for run in values["runs"]]
    return ControllerRecord(values["name"], values["kind"], runs, values["privileged"], values["training"])


def _run(run: RunRecord) -> dict[str, Any]:
    plain: dict[str, Any] = {"training_seed": run.training_seed, "seconds": round(run.seconds, 1)}
    plain["seeds"] = {use: list(ends) for use, ends in run.seeds.items()}
    if run.curve is not None:
        plain["curve"] = dict(zip(_CURVE, map(_numbers, run.curve), strict=True))
    return plain | {"driven": {name: _driven(driven) for name, driven in run.driven.items()}}


def _read_run(values: Mapping[str, Any]) -> RunRecord:
    curve = np.array([values["curve"][name] for name in _CURVE], float) if "curve" in values else None
    seeds = {use: (first, last) for use, (first, last) in values["seeds"].items()}
    driven = {name: _read_driven(episodes) for name, episodes in values["driven"].items()}
    return RunRecord(driven, values["training_seed"], values["seconds"], seeds, curve)


_CURVE = ("steps", "errors_mm", "processor_seconds")


def _driven(driven: EpisodeScores) -> dict[str, Any]:
    plain: dict[str, Any] = {"last_10_mm": _numbers(driven.last), "ended_early": driven.ended_early}
    if driven.final is not None and driven.held is not None:
        plain |= {"final_mm": _numbers(driven.final), "held": "".join("01"[int(held)] for held in driven.held)}
        plain |= {"action_us": _number(driven.action_us)} if driven.action_us else {}
    return plain


def _read_driven(values: Mapping[str, Any]) -> EpisodeScores:
    last, early = np.array(values["last_10_mm"], float), values["ended_early"]
    if "final_mm" not in values:
        return EpisodeScores(last, ended_early=early)
    held = np.array([bool("01".index(letter)) for letter in values["held"]])
    return EpisodeScores(last, np.array(values["final_mm"], float), held, early, values.get("action_us", 0.0))


def _numbers(values: Array) -> list[float | int | None]:
    """The values with _DIGITS digits, whole numbers as they are; None where one is not finite."""
    return [_number(float(value)) for value in values]


def _number(value: float) -> float | int | None:
    if not np.isfinite(value):
        return None
    if value == int(value) and value > 10**_DIGITS:  # such as steps
        return int(value)
    rounded = float(f"{value:.{_DIGITS}g}")
    return int(rounded) if rounded == int(rounded) else rounded


def _text(values: Any, indent: str = "") -> str:
    """JSON, one entry per line, lists of plain values in one line."""
    inner = indent + " "
    if isinstance(values, Mapping) and values:
        lines = [f"{inner}{json.dumps(str(key))}: {_text(value, inner)}" for key, value in values.items()]
        return "{\n" + ",\n".join(lines) + f"\n{indent}}}"
    if isinstance(values, Sequence) and any(isinstance(value, Mapping) for value in values):
        return "[\n" + ",\n".join(f"{inner}{_text(value, inner)}" for value in values) + f"\n{indent}]"
    return json.dumps(values, separators=(",", ":"), allow_nan=False)
