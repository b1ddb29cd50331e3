"""The units of a co-design: pairs, rivals, random designs; each one a file, so that a command goes on where it stopped.

config.yaml        the co-design
mechanism.yaml     the mechanism of the space, where that is a file
command.txt        the typed command; one more line whenever it is continued
versions.json      Python, packages, platform
units/NAME.json    a finished unit: design, policy, validation, scores of the test episodes
lock               held by the process that works
"""

from __future__ import annotations

import shlex
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from agents.codesign.config import GENERALIST, LONGEST, TEST, TRAIN, VALIDATION, PairConfig, load_codesign
from agents.codesign.generalist import trained_generalist
from agents.codesign.pair import Pair, Splits, trained
from agents.codesign.rivals import best_design, random_designs
from agents.codesign.task import Array, PairTask
from agents.runs.checked_json import read_json
from agents.runs.files import RunFolderError, write_json, write_text
from agents.runs.folder import versions
from agents.runs.locks import alone_in
from agents.search.methods import make
from agents.search.optimiser import Evaluated, Setup
from agents.search.problem import design_problem
from rollingjoint import PRESETS
from rollingjoint.checked_yaml import dump_yaml
from rollingjoint.design import Problem, Term
from rollingjoint.differentiable import DifferentiableChain
from rollingjoint.errors import ConfigError
from rollingjoint.io.mechanism_file import dump_mechanism, load_mechanism

REFERENCE, JOINT = "reference", "joint"
MECHANISM = "mechanism.yaml"
_EARLY = 2  # seeds that come before the random designs
_NO_DESIGN = 100.0  # cost of a design that a search around policies cannot use


@dataclass(frozen=True)
class Opposite:
    """An objective of which the opposite is better."""

    objective: Any

    @property
    def name(self) -> str:
        """Its name."""
        return f"{self.objective.name}, opposite"

    @property
    def unit(self) -> str:
        """Unit of its values."""
        return str(self.objective.unit)

    @property
    def maximise(self) -> bool:
        """Whether more is better."""
        return not self.objective.maximise

    @property
    def tensors(self) -> Any:
        """The class of chains that it measures."""
        return getattr(self.objective, "tensors", DifferentiableChain)

    def measure(self, chain: Any) -> Any:
        """The values of the objective."""
        return self.objective.measure(chain)


class Study:
    """A co-design: its task, its problems, and its units in a folder.

    Raises:
        ConfigError: a part of the configuration that cannot be built.
    """

    def __init__(self, path: Path, config: PairConfig) -> None:
        self.path, self.config = path, config
        self.problem: Problem = design_problem(config.search_of(None))
        self.space = self.problem.space
        self.task: PairTask = config.task_settings().on(self.space)
        self.rivals: dict[str, Problem] = {}
        for item in config.objectives:
            problem = design_problem(config.search_of(item))
            if item.get("opposite"):
                (term,) = problem.objectives
                problem = replace(problem, objectives=(replace(term, objective=_opposite(term)),))
            name = problem.objectives[0].objective.name
            if name in self.rivals:
                raise ConfigError("objectives", name, "every objective once")
            self.rivals[name] = problem

    @classmethod
    def begin(cls, path: Path, config: PairConfig, command: Sequence[str], force: bool = False) -> Study:
        """The study at `path`, new or existing; `force` restarts it.

        Raises:
            RunFolderError: the folder holds something else, or another co-design.
        """
        file = path / "config.yaml"
        if path.exists() and any(path.iterdir()):
            if not file.is_file():
                raise RunFolderError("run", str(path), "a new folder, or one with a co-design", "It stays as it is.")
            if force:
                shutil.rmtree(path)
            elif load_codesign(file).described() != config.described():
                hint = "Another --out begins a new one, --force replaces the one that is there."
                raise RunFolderError("run", str(path), "the co-design that the file describes now", hint)
        study = cls(path, config)
        if not file.is_file():
            write_json(path / "versions.json", versions("cma", "ribs", "optuna"))
            values, mechanism = config.to_dict(), config.space.get("mechanism")
            if isinstance(mechanism, str) and mechanism not in PRESETS:
                write_text(path / MECHANISM, dump_mechanism(load_mechanism(mechanism)))
                values["space"]["mechanism"] = MECHANISM
            write_text(file, dump_yaml(values))
        commands = path / "command.txt"
        before = commands.read_text("utf-8") if commands.is_file() else ""
        write_text(commands, before + shlex.join(command) + "\n")
        return study

    def locked(self) -> AbstractContextManager[None]:
        """Hold the folder alone; raises RunFolderError where another process holds it."""
        return alone_in(self.path, "run", "one in which no other process works")

    @cached_property
    def splits(self) -> Splits:
        """The episodes."""
        counts = self.config.episodes
        train, validation, test = (
            self.task.episodes(range(first, first + count))
            for first, count in zip((TRAIN, VALIDATION, TEST), counts, strict=True)
        )
        return Splits(train, counts[0], validation, test)

    def units(self) -> Iterator[str]:
        """Names of all units, in an order in which they can be worked on.

        Two seeds come before the random designs and the others after them, so that the report of a command that is
        stopped early has something in every table.
        """
        seeds, names = self.config.seeds, (JOINT, REFERENCE, *self.rivals)
        yield from (f"first/seed_{seed}" for seed in seeds)
        yield from (f"design/{name}" for name in self.rivals)
        yield from (f"{name}/seed_{seed}" for seed in seeds[:_EARLY] for name in names)
        yield from (f"random/{number}" for number in range(self.config.random))
        yield from (f"{name}/seed_{seed}" for seed in seeds[_EARLY:] for name in names)
        for inner, around in self.config.search_settings().items():
            for method in around.methods:
                yield from (f"search {method}, {inner}/seed_{seed}" for seed in seeds[: around.seeds])

    def file(self, unit: str) -> Path:
        """The file of a unit."""
        return self.path / "units" / f"{unit}.json"

    def is_finished(self, unit: str) -> bool:
        """Whether the unit is there."""
        return self.file(unit).is_file()

    def result(self, unit: str) -> dict[str, Any]:
        """A finished unit; raises RunFolderError for one that is not, or is damaged."""
        if not self.is_finished(unit):
            raise RunFolderError("unit", unit, "a finished one", "The command in command.txt goes on with it.")
        found = read_json(self.file(unit))
        if not isinstance(found, dict) or "x" not in found:
            raise RunFolderError("unit", str(self.file(unit)), "a file that rj codesign wrote", "Remove it.")
        return found

    def work(self, unit: str, shown: Callable[[], object] = lambda: None) -> dict[str, Any]:
        """Work on a unit and write its file; the ones that it needs are finished. shown: called now and then."""
        kind, _, last = unit.rpartition("/")
        if kind == "design":
            found = self._design(last)
        elif kind == "random":
            found = self._random(int(last), shown)
        else:
            found = self._pair(kind, int(last.removeprefix("seed_")), shown)
        write_json(self.file(unit), found)
        return found

    def _design(self, name: str) -> dict[str, Any]:
        begin, problem = time.process_time(), self.rivals[name]
        setup = Setup(problem.dimensions, (), self.config.seeds[0])
        optimiser = make("gradient", setup, {"starts": self.config.rival_starts})
        x, cost = best_design(problem, optimiser, self.config.rival_budget)
        value = float(problem.evaluate(x[None]).values[0, 0])
        found = {"x": x.tolist(), "value": value, "found": bool(np.isfinite(cost))}
        return found | {"seconds": time.process_time() - begin}

    def _pair(self, kind: str, seed: int, shown: Callable[[], object]) -> dict[str, Any]:
        reference = np.asarray(self.space.reference())
        settings = self.config.pair_settings()
        if kind == "first":
            start, half = (
                (reference, self.task.policy.initial(seed)),
                replace(settings, updates=-(-settings.updates // 2)),
            )
            return self._scored(trained(self.task, self.problem, start, half, self.splits, seed, False, shown))
        policy = np.array(self.result(f"first/seed_{seed}")["parameters"])
        x, begin = reference, time.process_time()
        if kind in self.rivals:
            x = np.array(self.result(f"design/{kind}")["x"])
        elif kind.startswith("search "):
            method, inner = kind.removeprefix("search ").split(", ")
            x = self._searched(method, inner, seed, policy, shown)
        pair = trained(self.task, self.problem, (x, policy), settings, self.splits, seed, kind == JOINT, shown)
        return self._scored(replace(pair, seconds=time.process_time() - begin))

    def _searched(self, method: str, inner: str, seed: int, policy: Array, shown: Callable[[], object]) -> Array:
        """The design that is best with the policy of the inner controller; the reference where none is feasible.

        Args:
            policy: of the reference.
        """
        around = self.config.search_settings()[inner]
        setup, sign = Setup(self.problem.dimensions, (), seed), -1.0 if self.task.settings.maximise else 1.0
        optimiser = make(method, setup, around.methods[method])
        if optimiser.wants:
            raise ConfigError("search.methods", method, "a method without derivatives: the cost is that of training")
        settings = self.config.pair_settings(around.updates)
        generalist = None
        if inner == GENERALIST:
            designs = random_designs(self.problem, around.updates, LONGEST + seed)
            generalist = trained_generalist(self.task, designs, policy, settings, self.splits, seed, shown)
            settings = replace(settings, updates=0)
        x, least_cost, count = np.asarray(self.space.reference()), np.inf, 0
        while count < around.budget:
            designs = optimiser.ask(around.budget - count)
            judged = self.problem.evaluate(designs)
            cost = judged.cost + _NO_DESIGN
            for row in np.flatnonzero(judged.feasible):
                start = designs[row], policy if generalist is None else generalist(designs[row])
                pair = trained(self.task, self.problem, start, settings, self.splits, seed, False, shown)
                if np.isfinite(pair.validation):
                    cost[row] = sign * pair.validation
                    if cost[row] < least_cost:
                        x, least_cost = pair.x, cost[row]
            optimiser.tell(Evaluated(designs, cost, judged.values, judged.ok, judged.feasible))
            count += len(designs)
        return x

    def _random(self, number: int, shown: Callable[[], object]) -> dict[str, Any]:
        x, seed = self._random_designs[number], self.config.seeds[0]
        policy = np.array(self.result(f"first/seed_{seed}")["parameters"])
        settings = self.config.pair_settings(self.config.random_updates)
        pair = trained(self.task, self.problem, (x, policy), settings, self.splits, seed, False, shown)
        values = {name: float(problem.evaluate(x[None]).values[0, 0]) for name, problem in self.rivals.items()}
        return self._scored(pair) | {"objectives": values}

    @cached_property
    def _random_designs(self) -> Array:
        return random_designs(self.problem, self.config.random, LONGEST)

    def _scored(self, pair: Pair) -> dict[str, Any]:
        """The file of a pair, with its scores of the test episodes."""
        scores = self.task.scores(pair.x, pair.parameters, self.splits.test)
        judged = self.problem.evaluate(pair.x[None])
        return {
            "x": pair.x.tolist(),
            "parameters": pair.parameters.tolist(),
            "validation": None if np.isnan(pair.validation) else pair.validation,
            "seconds": pair.seconds,
            "test": scores.values.tolist(),
            "ok": float(scores.ok.mean()),
            "extra": {name: float(np.mean(values)) for name, values in scores.extra.items()},
            "limited": judged.limited[0].tolist(),
            "feasible": bool(judged.feasible[0]),
            "history": [[update, value, x.tolist()] for update, value, x in pair.history],
        }


def _opposite(term: Term) -> Any:
    return Opposite(term.objective)


def read_study(path: Path) -> Study:
    """The co-design in a folder; raises RunFolderError where there is none."""
    if not (path / "config.yaml").is_file():
        raise RunFolderError("run", str(path), "a folder that rj codesign wrote")
    return Study(path, load_codesign(path / "config.yaml"))


Results = Mapping[str, Sequence[dict[str, Any]]]


def results_of(study: Study) -> Results:
    """The finished units by kind, those of a kind in the order of their seeds."""
    found: dict[str, list[dict[str, Any]]] = {}
    for unit in study.units():
        if study.is_finished(unit):
            found.setdefault(unit.rpartition("/")[0], []).append(study.result(unit))
    return found
