"""The content of a co-design file: frozen, checked once when built, read from YAML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, asdict, dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any

from agents.codesign.hold import TipHold
from agents.codesign.lumen import LumenPush
from agents.codesign.pair import PairSettings
from agents.runs.checks import check_fields, integer, integers, prefixed
from agents.search.config import SearchConfig
from agents.search.methods import METHODS
from rollingjoint.checked_yaml import entries, mapping, read_yaml
from rollingjoint.errors import ConfigError
from rollingjoint.io.mechanism_file import load_mechanism, mechanism_to_dict

TASKS: dict[str, Any] = {"lumen": LumenPush, "hold": TipHold}
RETRAINED, GENERALIST = INNER = ("retrained", "generalist")
"""Inner controllers of a search: a policy that is retrained for every design, and one that knows the design."""
TRAIN, VALIDATION, TEST, LONGEST = 1_000_000, 2_000_000, 3_000_000, 1_000_000
"""First seeds of the episodes of training, of validation and of tests, and the most episodes of each."""


@dataclass(frozen=True)
class SearchAround:
    """A search of designs whose cost is that of an inner controller in the validation episodes.

    Args:
        methods: settings by name of a method of `rj search`.
        budget: designs of each method.
        updates: of `retrained`, the policy of every design, from that of the reference; of `generalist`, before the
            search, each with a new random design that keeps the limits.
        seeds: number of the seeds, the first ones, with which every method searches.
    """

    methods: Mapping[str, Any] = field(default_factory=dict)
    budget: Annotated[int, integer(1, 100_000)] = 40
    updates: Annotated[int, integer(1, 100_000)] = 10
    seeds: Annotated[int, integer(1, 1000)] = 1

    def __post_init__(self) -> None:
        names = mapping("methods", self.methods, tuple(METHODS))
        object.__setattr__(self, "methods", {name: dict(settings or {}) for name, settings in names.items()})
        check_fields(self)


@dataclass(frozen=True)
class PairConfig:
    """Co-design of a mechanism and its policy, and what it is compared with.

    Args:
        task: `kind`, `lumen` or `hold`, and its fields.
        space: as of a search file; the designs.
        limits: as of a search file; every pair's design keeps them, rivals, too.
        objectives: as of a search file, without weights: the best design of each is a rival with a policy of its own.
            With `opposite: true` the least of what more is better of, or the other way round.
        pairs: how pairs are trained: fields of PairSettings.
        episodes: number of episodes for training, validation and test, in this order.
        rival_budget: designs that the search for the best of an objective evaluates.
        rival_starts: descents of that search.
        random: random designs, over which the ranks of objectives and of control are compared; 0: none.
        random_updates: of the policy for each of them.
        search: searches around a policy, by name of the inner controller, `retrained` or `generalist`: fields of
            SearchAround.
        seeds: every pair is trained once with each.
    """

    task: Mapping[str, Any]
    space: Mapping[str, Any]
    limits: Sequence[Mapping[str, Any]] = ()
    objectives: Sequence[Mapping[str, Any]] = ()
    pairs: Mapping[str, Any] = field(default_factory=dict)
    episodes: Annotated[Sequence[int], integers(1, LONGEST)] = (48, 24, 100)
    rival_budget: Annotated[int, integer(1, 1_000_000)] = 120
    rival_starts: Annotated[int, integer(1, 1000)] = 6
    random: Annotated[int, integer(0, 100_000)] = 0
    random_updates: Annotated[int, integer(1, 100_000)] = 15
    search: Mapping[str, Any] = field(default_factory=dict)
    seeds: Annotated[Sequence[int], integers(0, 2**31 - 1)] = (1, 2, 3)

    def __post_init__(self) -> None:
        check_fields(self)
        entries("seeds", self.seeds)
        if len(set(self.seeds)) < len(self.seeds):
            raise ConfigError("seeds", list(self.seeds), "every seed once")
        if len(self.episodes) != 3:
            raise ConfigError("episodes", list(self.episodes), "three numbers: training, validation, test")
        mapping("space", self.space, list(self.space) if isinstance(self.space, Mapping) else ())
        for i, item in enumerate(self.objectives):
            mapping(f"objectives[{i}]", item, list(item) if isinstance(item, Mapping) else (), ["kind"])
        self.task_settings()
        self.pair_settings()
        self.search_settings()

    def task_settings(self) -> Any:
        """The settings of the task; raises ConfigError."""
        given = mapping("task", self.task, list(self.task) if isinstance(self.task, Mapping) else (), ["kind"])
        kind = mapping("task.kind", {given["kind"]: None}, tuple(TASKS))
        return _built("task", TASKS[next(iter(kind))], {k: v for k, v in given.items() if k != "kind"})

    def pair_settings(self, updates: int | None = None) -> PairSettings:
        """How pairs are trained, with another number of updates where one is given; raises ConfigError."""
        changed = {} if updates is None else {"updates": updates}
        return _built("pairs", PairSettings, {**_mapped("pairs", self.pairs), **changed})

    def search_settings(self) -> dict[str, SearchAround]:
        """The searches by name of the inner controller; raises ConfigError."""
        given = self.search
        if isinstance(given, Mapping) and "methods" in given:  # of files from when there was one inner controller
            given = {RETRAINED: given}
        searches = mapping("search", given, INNER)
        with prefixed("search."):
            return {inner: _built(inner, SearchAround, values) for inner, values in searches.items()}

    def search_of(self, objective: Mapping[str, Any] | None) -> SearchConfig:
        """The search file of an objective alone, with the limits; None: of the limits alone."""
        apart = ("opposite", "low", "high")
        any_kind = next(iter((*self.limits, *self.objectives)), {"kind": "tip_travel"})
        kept = {key: value for key, value in (objective or any_kind).items() if key not in apart}
        measured = {**kept, "weight": 0.0} if objective is None else {**kept, "scale": "reference"}
        return SearchConfig([measured], {"gradient": {"starts": self.rival_starts}}, self.space, self.limits)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for YAML; load_codesign reads them."""
        return {name: _plain(value) for name, value in asdict(self).items()}

    def described(self) -> dict[str, Any]:
        """Plain values in which a mechanism file has its content in place of its path; raises ConfigError."""
        values = self.to_dict()
        if isinstance(values["space"].get("mechanism"), str):
            values["space"]["mechanism"] = mechanism_to_dict(load_mechanism(values["space"]["mechanism"]))
        return values


KEYS = tuple(entry.name for entry in fields(PairConfig))


def load_codesign(path: Path) -> PairConfig:
    """The co-design in a YAML file; raises ConfigError naming file and key.

    The path of a mechanism may be relative to the folder of the file.
    """
    with prefixed(f"{path}: "):
        values = dict(mapping("top level", read_yaml(path), KEYS, ("task", "space")))
        space = values["space"]
        given = space.get("mechanism") if isinstance(space, Mapping) else None
        if isinstance(given, str) and (path.parent / given).is_file():
            values["space"] = {**space, "mechanism": str(path.parent / given)}
        return PairConfig(**values)


def _mapped(where: str, given: Any) -> dict[str, Any]:
    return dict(mapping(where, given, list(given) if isinstance(given, Mapping) else ()))


def _built(where: str, kind: Any, given: Mapping[str, Any]) -> Any:
    names = [entry.name for entry in fields(kind)]
    needed = [entry.name for entry in fields(kind) if entry.default is MISSING and entry.default_factory is MISSING]
    values = mapping(where, given, names, needed)
    return kind(**values)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value
