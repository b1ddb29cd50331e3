"""The content of a results file: benchmarks, their worlds, controllers, the controllers' runs, every episode's error.

A benchmark is one task; its worlds are sets of episodes of it, unchanged or under other settings. Everything that the
results page says is computed from these records.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.controllers.controller import Array
from agents.evaluation.rollout import Episodes
from agents.evaluation.score import CLOSE_MM
from rollingjoint.checks import as_choice, as_floats, as_integer
from rollingjoint.errors import InvalidInput

TEST, VALIDATION, SHIFT, SWEEP = ROLES = ("test", "validation", "shift", "sweep")
POLICY, BASELINE, ENTRY = KINDS = ("policy", "baseline", "entry")


class ResultsError(InvalidInput):
    """Results that cannot be read, do not fit together, or cannot be merged."""


@dataclass(frozen=True)
class World:
    """A set of episodes of a benchmark.

    Args:
        name: unique in its benchmark. role: one of ROLES: the table, the choice of the best, a table under settings
            that training did not have, or one point of a curve.
        first_seed, episodes: its seeds are first_seed, first_seed + 1, ...
        changes: settings on top of the benchmark's. heading: the difference in words.
        axis, value: of a curve: the varied setting with its unit, and its value. trained: its range in training.
        floors: the smallest error that any command reaches at the end, (E,) [mm], NaN where unknown; None: no floors.
    Raises:
        ResultsError: a number out of range, or floors of another number of episodes.
    """

    name: str
    role: str
    first_seed: int
    episodes: int
    changes: Mapping[str, Any] = field(default_factory=dict)
    heading: str = ""
    axis: str = ""
    value: float = 0.0
    trained: tuple[float, float] = (0.0, 0.0)
    floors: Array | None = None

    def __post_init__(self) -> None:
        as_choice(f"world {self.name!r}: role", self.role, ROLES, error=ResultsError)
        as_integer(f"world {self.name!r}: first_seed", self.first_seed, 0, error=ResultsError)
        as_integer(f"world {self.name!r}: episodes", self.episodes, 1, error=ResultsError)
        if self.floors is not None and self.floors.shape != (self.episodes,):
            raise ResultsError(f"world {self.name!r}: floors", self.floors.shape, f"({self.episodes},)")

    @property
    def seeds(self) -> range:
        """The seeds of its episodes."""
        return range(self.first_seed, self.first_seed + self.episodes)

    @property
    def known_floors(self) -> Array:
        """The floors that are known, (K,) [mm]."""
        return np.empty(0) if self.floors is None else self.floors[np.isfinite(self.floors)]


@dataclass(frozen=True)
class EpisodeScores:
    """The E episodes of a world, driven by one run of a controller.

    Args:
        last: mean tip error over the last 10 steps, (E,) [mm].
        final: tip error at the end, (E,) [mm]. held: whether all of the last 10 steps were within 1 mm, (E,). Both None
            where only the first was kept.
        ended_early: number of episodes that the environment ended.
        action_us: processor time per action, the episodes side by side [µs]; 0 where it was not measured.
    Raises:
        ResultsError: different numbers of episodes, or errors that are not finite.
    """

    last: Array
    final: Array | None = None
    held: NDArray[np.bool_] | None = None
    ended_early: int = 0
    action_us: float = 0.0

    def __post_init__(self) -> None:
        allowed = "finite errors of 0 or more, one per episode [mm]"
        for name in ("last", "final", "held"):
            value = getattr(self, name)
            if value is None and name != "last":
                continue
            values = as_floats(name, value, allowed, ResultsError)
            fits = values.ndim == 1 and values.shape == np.shape(self.last)
            if not fits or not np.all(values >= 0) or np.isinf(values).any():
                raise ResultsError(name, value, allowed)
        as_integer("ended_early", self.ended_early, 0, error=ResultsError)

    @classmethod
    def of(cls, episodes: Episodes, complete: bool) -> EpisodeScores:
        """The record of these episodes; without `complete` only the errors over the last steps."""
        last, early = episodes.last_errors.mean(axis=1), int(episodes.terminated.sum())
        if not complete:
            return cls(last, ended_early=early)
        held = np.all(episodes.last_errors <= CLOSE_MM, axis=1)
        return cls(last, episodes.final_errors, held, early, episodes.action_us)


@dataclass(frozen=True)
class RunRecord:
    """One run of a controller: of a learned one, one training seed.

    Args:
        driven: by name of the world. training_seed: None for a controller without training.
        seconds: processor time of the training. seeds: of environments that training used, first and last, by use.
        curve: steps done, mean tip error [mm] and processor time [s] at every evaluation during training, (3, T).
    """

    driven: Mapping[str, EpisodeScores]
    training_seed: int | None = None
    seconds: float = 0.0
    seeds: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    curve: Array | None = None


@dataclass(frozen=True)
class ControllerRecord:
    """A controller of a benchmark.

    Args:
        name: unique in its benchmark. kind: one of KINDS: trained here, to compare with, or entered.
        runs: at least one, with different training seeds.
        privileged: whether it sees the true state, which no robot shows: never the best of its kind.
        training: plain values: `algorithm`, `steps`, `config`; empty without a known training.
    Raises:
        ResultsError: another kind, or two runs of one training seed.
    """

    name: str
    kind: str
    runs: Sequence[RunRecord]
    privileged: bool = False
    training: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        as_choice(f"{self.name}: kind", self.kind, KINDS, error=ResultsError)
        seeds = self.training_seeds
        if not seeds or len(set(seeds)) < len(seeds):
            raise ResultsError(f"{self.name}: training seeds", seeds, "at least one run, each with another seed")

    @property
    def training_seeds(self) -> list[int | None]:
        """The training seeds of its runs."""
        return [run.training_seed for run in self.runs]

    def has(self, world: str) -> bool:
        """Whether all of its runs drove in a world."""
        return all(world in run.driven for run in self.runs)

    def errors(self, world: str, what: str = "last") -> Array:
        """`last`, `final` or `held` of every run in a world, (S, E)."""
        return np.stack([np.asarray(getattr(run.driven[world], what), float) for run in self.runs])


@dataclass(frozen=True)
class BenchmarkRecord:
    """One task and the episodes of all controllers.

    Args:
        title: for headings and file names. description: of the task, in sentences.
        env_id, settings: of the environment; the settings complete and plain, the mechanism as its numbers.
        worlds, controllers: by their names.
        levels: mean errors in the evaluations during training [mm], by name of a controller or floor.
        impossible: why, by name of a controller that cannot drive here.
    Raises:
        ResultsError: two of a name, or errors of a world that does not exist or has another number of episodes.
    """

    title: str
    description: str
    env_id: str
    settings: Mapping[str, Any]
    worlds: Sequence[World]
    controllers: Sequence[ControllerRecord]
    levels: Mapping[str, float] = field(default_factory=dict)
    impossible: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for what, names in (("worlds", [world.name for world in self.worlds]), ("controllers", self.names())):
            if len(set(names)) < len(names):
                raise ResultsError(f"{self.title}: {what}", names, "different names")
        sizes = {world.name: world.episodes for world in self.worlds}
        for controller in self.controllers:
            for name, driven in ((name, episodes) for run in controller.runs for name, episodes in run.driven.items()):
                if sizes.get(name) != len(driven.last):
                    allowed = f"the {sizes.get(name, 0)} episodes of the world {name!r}"
                    raise ResultsError(f"{self.title}: {controller.name}: episodes", len(driven.last), allowed)

    def names(self, kind: str = "", world: str = "") -> list[str]:
        """The names of its controllers: all, or only of a kind, or that drove in a world."""
        controllers = [
            controller
            for controller in self.controllers
            if kind in ("", controller.kind) and (not world or controller.has(world))
        ]
        return [controller.name for controller in controllers]

    def controller(self, name: str) -> ControllerRecord:
        """The controller with this name."""
        return next(controller for controller in self.controllers if controller.name == name)

    def world(self, name: str) -> World:
        """The world with this name."""
        return next(world for world in self.worlds if world.name == name)

    def of_role(self, role: str) -> list[World]:
        """The worlds of a role."""
        return [world for world in self.worlds if world.role == role]

    def best(self, kind: str, but: Sequence[str] = (), worlds: Sequence[World] = ()) -> str | None:
        """The controller of a kind with the smallest mean error in the validation episodes; None where there is none.

        Privileged controllers, those named in `but`, and those that did not drive in all these worlds are left out.
        """
        (world, *_) = [world.name for world in self.of_role(VALIDATION)] or [""]
        names = [name for name in self.names(kind, world) if world and not self.controller(name).privileged]
        names = [name for name in names if name not in but and all(self.controller(name).has(w.name) for w in worlds)]
        return min(names, key=lambda name: float(self.controller(name).errors(world).mean()), default=None)


@dataclass(frozen=True)
class Results:
    """All of a results file.

    Args:
        benchmarks: with different titles.
        commands: that made the file. scored_on, trained_with: machines and versions, in words.
        left_out: why, by run folder. films: caption by file name, by title of a benchmark.
    """

    benchmarks: Sequence[BenchmarkRecord]
    commands: Sequence[str] = ()
    scored_on: Sequence[str] = ()
    trained_with: Sequence[str] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)
    films: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        titles = [record.title for record in self.benchmarks]
        if len(set(titles)) < len(titles):
            raise ResultsError("benchmarks", titles, "different titles")
