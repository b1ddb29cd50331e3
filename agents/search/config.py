"""The content of a search file: frozen, checked once when built, read from YAML."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any

from agents.runs.checks import check_fields, integer, integers, prefixed
from agents.search.methods import METHODS
from rollingjoint.checked_yaml import entries, mapping, read_yaml, text
from rollingjoint.errors import ConfigError

SMALLEST_CHUNK = 100  # designs


@dataclass(frozen=True)
class SearchConfig:
    """A search: one design problem, several methods with equal budgets, each with several seeds.

    Args:
        objectives: a list of {`kind`, `weight`, `scale`} and fields of the kind; weight 0: only measured; scale 1 by
            default, or `reference`: the value of the reference mechanism. Kinds of your own: MODULE:NAME.
        methods: settings by name of a method.
        space: fields of `rollingjoint.design.DesignSpace`, by default five equal, symmetric links; with `kind: space`
            those of `rollingjoint.design.SpatialDesignSpace`; with `mechanism`, a preset or the path of a file, the
            fields of `rollingjoint.design.MechanismSpace`.
        limits: a list of {`kind`, `low`, `high`} and fields of the kind; the bound `reference`: the value of the
            reference mechanism.
        held_out: by kind of objective, fields that differ when the best designs are scored again.
        reference: the mechanism to compare with, a preset or the path of a mechanism file; by default that of the
            space, or five_link.
        budget: designs that every run evaluates; one with its gradient is one.
        seeds: every method runs once with each.
        chunk: 0: every batch is scored as a whole, by the process of its run. 100 or more: batches of at least twice as
            many designs are scored in chunks of at least this size, [by many workers](scaling.md#one-slow-search).
    """

    objectives: Sequence[Mapping[str, Any]]
    methods: Mapping[str, Mapping[str, Any]]
    space: Mapping[str, Any] = field(default_factory=dict)
    limits: Sequence[Mapping[str, Any]] = ()
    held_out: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    reference: str = ""
    budget: Annotated[int, integer(1, 10_000_000)] = 1000
    seeds: Annotated[Sequence[int], integers(0, 2**31 - 1)] = (1, 2, 3)
    chunk: Annotated[int, integer(0, 10_000_000)] = 0

    def __post_init__(self) -> None:
        entries("objectives", self.objectives)
        if not isinstance(self.limits, list | tuple):
            raise ConfigError("limits", self.limits, "a list of limits")
        for name, settings in mapping("methods", self.methods, tuple(METHODS)).items():
            if not isinstance(settings, Mapping | None):
                raise ConfigError(f"methods.{name}", settings, "the settings of the method, keys and values, or none")
        if not self.methods:
            raise ConfigError("methods", self.methods, f"at least one of {', '.join(METHODS)}")
        if self.reference == "":
            given = self.space.get("mechanism") if isinstance(self.space, Mapping) else None
            object.__setattr__(self, "reference", given if given and isinstance(given, str) else "five_link")
        text("reference", self.reference)
        entries("seeds", self.seeds)
        check_fields(self)
        if 0 < self.chunk < SMALLEST_CHUNK:
            hint = "Fewer designs are scored sooner than they are handed over."
            raise ConfigError("chunk", self.chunk, f"0, or {SMALLEST_CHUNK} or more", hint)
        if len(set(self.seeds)) < len(self.seeds):
            raise ConfigError("seeds", list(self.seeds), "every seed once")
        settings = {name: dict(settings or {}) for name, settings in self.methods.items()}
        object.__setattr__(self, "methods", settings)

    def runs(self) -> Iterator[SearchConfig]:
        """The same for one method and one seed at a time, in the order of the seeds."""
        for seed in self.seeds:
            for name, settings in self.methods.items():
                yield replace(self, methods={name: settings}, seeds=(seed,))

    @property
    def run_name(self) -> str:
        """Name of a run and of its folder: the only method and the only seed."""
        (method,), (seed,) = self.methods, self.seeds
        return f"{method}/seed_{seed}"

    def to_dict(self) -> dict[str, Any]:
        """Plain values for YAML; load_search reads them."""
        return {name: _plain(value) for name, value in asdict(self).items()}


KEYS = tuple(field.name for field in fields(SearchConfig))


def load_search(path: Path) -> SearchConfig:
    """The search in a YAML file; raises ConfigError naming file and key.

    Values inside the parts are checked by agents.search.problem.check, which builds the problem and the optimisers.
    """
    with prefixed(f"{path}: "):
        return SearchConfig(**mapping("top level", read_yaml(path), KEYS, ("objectives", "methods")))


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value
