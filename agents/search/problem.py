"""The design problem of a search file, and the optimisers for it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from typing import Any

from agents.runs.checks import prefixed
from agents.runs.consent import check_named, imported
from agents.search.config import SearchConfig
from agents.search.methods import make
from agents.search.optimiser import Optimiser, Setup
from rollingjoint import HingeChain, RollingChain, SpatialChain
from rollingjoint.checked_yaml import mapping, number
from rollingjoint.design import (
    BendingShapes,
    DesignBox,
    FrictionRequired,
    LateralStiffness,
    Limit,
    LoadCapacity,
    Objective,
    PeakTension,
    PlacementError,
    PressingMargin,
    Problem,
    TendonTravel,
    Term,
    TiltingMargin,
    TipReach,
    TipRotation,
    TipStiffness,
    TipTravel,
    ToothMargin,
    measure,
    space_of_settings,
)
from rollingjoint.errors import ConfigError, SolverError
from rollingjoint.io.mechanism_file import load_mechanism

_PLANAR = BendingShapes, TipTravel, TipRotation, LateralStiffness, LoadCapacity, TendonTravel, PeakTension
_SPATIAL = TipStiffness, TipReach, PlacementError, PressingMargin, TiltingMargin, ToothMargin, FrictionRequired
KINDS: dict[str, Any] = {kind.name: kind for kind in (*_PLANAR, *_SPATIAL)}
_OF_OBJECTIVE = "name", "unit", "maximise", "measure"
REFERENCE = "reference"


def design_problem(config: SearchConfig, held_out: bool = False) -> Problem:
    """The problem of a search, or of its held-out scores; raises ConfigError that names the key."""
    changes = config.held_out if held_out else {}
    for kind in mapping("held_out", changes, list(changes)):
        objective_class("held_out", kind)
    space = design_space(config)
    terms = tuple(_term(f"objectives[{i}]", item, config, changes) for i, item in enumerate(config.objectives))
    limits = tuple(_limit(f"limits[{i}]", item, config, changes) for i, item in enumerate(config.limits))
    with _located("objectives"):
        return Problem(space, terms, limits)


def design_space(config: SearchConfig) -> DesignBox:
    """The design space of a search; raises ConfigError that names the key."""
    with _located("space"):
        return space_of_settings(config.space)


def objective_class(where: str, kind: object) -> Any:
    """The class of an objective: of the project, by its name, or MODULE:NAME of a module that the command allows.

    Raises:
        ConfigError: no such class, or none of an objective.
    """
    module, _, name = str(kind).rpartition(":")
    if not module:
        mapping(f"{where}.kind", {kind: None}, tuple(KINDS))
        return KINDS[str(kind)]
    check_named(f"{where}.kind", str(kind), module, f"one of {', '.join(KINDS)}")
    found = getattr(imported(module), name, None)
    missing = [part for part in _OF_OBJECTIVE if not hasattr(found, part)]
    if not (isinstance(found, type) and is_dataclass(found)) or missing:
        allowed = f"a dataclass with {', '.join(_OF_OBJECTIVE)}, as rollingjoint.design.Objective"
        hint = f"It has no {missing[0]}." if missing and found is not None else f"{module} has no such class."
        raise ConfigError(f"{where}.kind", str(kind), allowed, hint)
    return found


def check(config: SearchConfig) -> None:
    """Raise ConfigError unless the problem, the held-out problem and all optimisers can be built and measured."""
    for held_out in (False, True):
        problem = design_problem(config, held_out)
        with _located("held_out" if held_out else "objectives"):
            problem.evaluate(problem.space.reference()[None])
            against(config, problem)
    for run in config.runs():
        optimiser(run, problem)


def optimiser(run: SearchConfig, problem: Problem) -> Optimiser:
    """The optimiser of a run of one method and one seed; raises ConfigError."""
    ((name, settings),) = run.methods.items()
    return make(name, Setup(problem.dimensions, names(problem), run.seeds[0]), settings)


def measured(problem: Problem) -> list[Objective]:
    """The measured values of a design: objectives, then limits."""
    return [term.objective for term in problem.objectives] + [limit.objective for limit in problem.limits]


def names(problem: Problem) -> tuple[str, ...]:
    """Names of all measured values; a second one of a kind is "kind 2"."""
    unique: list[str] = []
    for objective in measured(problem):
        name = objective.name
        count = sum(earlier.split()[0] == name for earlier in unique)
        unique.append(f"{name} {count + 1}" if count else name)
    return tuple(unique)


def reference(config: SearchConfig) -> RollingChain | SpatialChain:
    """The mechanism to compare with; raises ConfigError."""
    with _located("reference"):
        if design_space(config).dimension == 2:
            return load_mechanism(config.reference, RollingChain)
        mechanism = load_mechanism(config.reference)
        if isinstance(mechanism, HingeChain):
            return SpatialChain.from_arm(mechanism)
        return load_mechanism(config.reference, SpatialChain)


def against(config: SearchConfig, problem: Problem) -> list[float]:
    """The measured values of the reference mechanism, in the order of `names`; NaN where it has no equilibrium."""
    return [_measured(config, objective) for objective in measured(problem)]


def _measured(config: SearchConfig, objective: Objective) -> float:
    try:
        return float(measure(reference(config), [objective])[0])
    except SolverError:
        return math.nan


def _term(where: str, item: object, config: SearchConfig, changes: Mapping[str, Any]) -> Term:
    objective, settings = _objective(where, item, ("weight", "scale"), changes)
    values = _numbers(where, settings, config, objective)
    with _located(where):
        return Term(objective, **values)


def _limit(where: str, item: object, config: SearchConfig, changes: Mapping[str, Any]) -> Limit:
    objective, settings = _objective(where, item, ("low", "high"), changes)
    bounds = _numbers(where, settings, config, objective)
    with _located(where):
        return Limit(objective, **bounds)


def _numbers(where: str, settings: Mapping[str, Any], config: SearchConfig, objective: Objective) -> dict[str, float]:
    """The numbers of an entry; "reference", which no weight can be, is the value of the reference mechanism."""
    numbers = {}
    for key, value in settings.items():
        is_reference = value == REFERENCE and key != "weight"
        numbers[key] = _measured(config, objective) if is_reference else number(f"{where}.{key}", value)
        if not math.isfinite(numbers[key]):
            raise ConfigError(f"{where}.{key}", value, "a number", f"{config.reference} has no equilibrium there.")
    return numbers


def _objective(
    where: str, item: object, keys: tuple[str, ...], changes: Mapping[str, Any]
) -> tuple[Any, Mapping[str, Any]]:
    """The objective that an entry describes, with the `changes` of its kind, and the values of the other `keys`."""
    kind = mapping(where, item, list(item) if isinstance(item, Mapping) else (), ["kind"])["kind"]
    chosen = objective_class(where, kind)
    names = [field.name for field in fields(chosen)]
    entry = mapping(f"{where} ({kind})", item, ["kind", *keys, *names])
    changed = mapping(f"held_out.{kind}", changes.get(kind), names)
    values = {key: value for key, value in entry.items() if key in names} | dict(changed)
    with _located(where):
        objective = chosen(**{key: _frozen(value) for key, value in values.items()})
    return objective, {key: entry[key] for key in keys if key in entry}


def _frozen(value: Any) -> Any:
    return tuple(map(_frozen, value)) if isinstance(value, list | tuple) else value


@contextmanager
def _located(where: str) -> Iterator[None]:
    """Adds the place in the file to errors; a missing or misplaced field becomes one, too."""
    try:
        with prefixed(f"{where}: "):
            yield
    except ConfigError:
        raise
    except (TypeError, ValueError) as error:
        raise ConfigError(where, str(error), "numbers and lists as docs/design_search.md describes them") from error
