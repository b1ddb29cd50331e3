"""Results of the runs below a folder: curves, comparisons, the best designs scored again."""

from __future__ import annotations

import itertools
import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from agents.runs.files import RunFolderError
from agents.search.config import SearchConfig
from agents.search.folder import SearchRun
from agents.search.methods import METHODS
from agents.search.optimiser import Array, Evaluated, Mask
from agents.search.problem import against, design_problem, measured, names
from rollingjoint.design import Problem, nondominated

N = TypeVar("N", int, float)
YARDSTICK = "cma_es"  # the other methods have to reach its final cost
BASELINE = "random"
MAP_ELITES, CELLS = "map_elites", (20, 20)
TITLES = {
    "random": "random search",
    "latin_hypercube": "Latin hypercube",
    "cma_es": "CMA-ES",
    "sqp": "SQP",
    "bayesian": "Bayesian",
    "map_elites": "MAP-Elites",
}


@dataclass(frozen=True, eq=False)
class SearchOutcome:
    """A finished run.

    Args:
        evaluated: all its designs, (n,).
        seconds: of processor time that had been used when each had been evaluated, (n,); resuming left out.
    """

    method: str
    seed: int
    evaluated: Evaluated
    seconds: Array

    @classmethod
    def read(cls, run: SearchRun) -> SearchOutcome:
        """The outcome of a run; raises RunFolderError unless it is finished."""
        if not run.is_finished:
            allowed = f"a run of {run.config.budget} evaluations, not {run.evaluations}"
            raise RunFolderError("run", str(run.path), allowed, "The command in its command.txt goes on with it.")
        batches = run.batches()
        seconds = np.concatenate([np.full(len(batch), at) for batch, at in batches])
        method, seed = next(iter(run.config.methods)), run.config.seeds[0]
        return cls(method, seed, Evaluated.joined([batch for batch, _ in batches]), seconds)

    @cached_property
    def best_so_far(self) -> Array:
        """Least cost of a feasible design after every evaluation, (n,); infinite before the first one."""
        costs = np.where(self.evaluated.feasible, self.evaluated.cost, np.inf)
        return np.minimum.accumulate(costs)

    @property
    def best(self) -> float:
        """Least cost of a feasible design; infinite where there is none."""
        return float(self.best_so_far[-1])

    @property
    def best_x(self) -> Array:
        """The feasible design of least cost, (d,); where there is none, the one of least cost."""
        feasible = self.evaluated.feasible
        costs = np.where(feasible, self.evaluated.cost, np.inf) if feasible.any() else self.evaluated.cost
        return self.evaluated.x[costs.argmin()]

    def reached(self, cost: float) -> int | None:
        """Evaluations until a feasible design costs no more; None where none does."""
        below = self.best_so_far <= cost
        return int(below.argmax()) + 1 if below.any() else None

    def seconds_at(self, evaluations: float) -> float:
        """Processor time after this number of evaluated designs [s]; infinite for an infinite number."""
        return float(self.seconds[int(evaluations) - 1]) if math.isfinite(evaluations) else math.inf


@dataclass(frozen=True)
class Search:
    """All finished runs of one search.

    Args:
        name: of the folder.
        config: with all methods and seeds of the runs.
        outcomes: by method, in the order of the seeds.
        left_out: why, by folder of a run.
        command: that was typed last, for all methods.
    """

    name: str
    config: SearchConfig
    outcomes: Mapping[str, Sequence[SearchOutcome]]
    left_out: Mapping[Path, str]
    command: str

    @classmethod
    def read(cls, out: Path) -> Search:
        """The runs below a folder; raises RunFolderError where none is finished, or where they differ in the search."""
        runs = sorted((SearchRun(path.parent) for path in out.glob("*/seed_*/config.yaml")), key=_order)
        outcomes: dict[str, list[SearchOutcome]] = {}
        left_out: dict[Path, str] = {}
        commons: list[SearchConfig] = []
        methods: dict[str, Mapping[str, object]] = {}
        seeds, command = set[int](), ""
        for run in runs:
            try:
                outcome = SearchOutcome.read(run)
            except RunFolderError as error:
                left_out[run.path] = str(error)
                continue
            outcomes.setdefault(outcome.method, []).append(outcome)
            methods |= run.config.methods
            seeds.add(outcome.seed)
            commons.append(replace(run.config, methods={BASELINE: {}}, seeds=(0,)))
            command = _for_all_methods((run.path / "command.txt").read_text("utf-8").splitlines()[-1])
        if not outcomes:
            raise RunFolderError("search", str(out), "a folder with at least one finished run")
        if any(common != commons[0] for common in commons):
            raise RunFolderError("search", str(out), "runs of one search", "They differ in more than method and seed.")
        config = replace(commons[0], methods=methods, seeds=sorted(seeds))
        return cls(out.resolve().name, config, outcomes, left_out, command)

    @cached_property
    def problem(self) -> Problem:
        """The design problem of the search."""
        return design_problem(self.config)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The names of all measured values."""
        return names(self.problem)

    @property
    def units(self) -> tuple[str, ...]:
        """The units of all measured values."""
        return tuple(objective.unit for objective in measured(self.problem))

    @property
    def single(self) -> int | None:
        """Place of the only objective in the cost; None where there are several."""
        counted = [place for place, term in enumerate(self.problem.objectives) if term.weight]
        return counted[0] if len(counted) == 1 else None

    def shown(self, cost: float | Array) -> Array:
        """Costs of feasible designs as tables and pictures show them: values of the only objective, if there is one."""
        return np.asarray(cost) / (1.0 if self.single is None else self.problem.objectives[self.single].factor)

    @property
    def shown_name(self) -> str:
        """Name and unit of `shown`."""
        return "cost" if self.single is None else f"{words(self.names[self.single])} [{self.units[self.single]}]"

    @property
    def all(self) -> list[SearchOutcome]:
        """All outcomes."""
        return [outcome for outcomes in self.outcomes.values() for outcome in outcomes]

    @property
    def winner(self) -> SearchOutcome:
        """The run with the best design."""
        return min(self.all, key=lambda outcome: outcome.best)

    @cached_property
    def goal(self) -> float | None:
        """The cost that methods have to reach: the median of CMA-ES's final costs; None where it was not run."""
        if YARDSTICK not in self.outcomes:
            return None
        cost = median([outcome.best for outcome in self.outcomes[YARDSTICK]])
        return cost if math.isfinite(cost) else None

    def reached(self, method: str) -> list[int | None]:
        """Evaluations until each run of a method costs no more than the goal; None where one never does."""
        return [None if self.goal is None else outcome.reached(self.goal) for outcome in self.outcomes[method]]

    def scored(self, held_out: bool) -> tuple[Evaluated, list[float]]:
        """The best designs of all runs, in the order of `all`, evaluated again, and the reference's measured values."""
        problem = design_problem(self.config, held_out)
        x = np.array([outcome.best_x for outcome in self.all])
        return Evaluated.of(problem.evaluate(x)), against(self.config, problem)

    @cached_property
    def everything(self) -> Evaluated:
        """The designs of all runs."""
        return Evaluated.joined([outcome.evaluated for outcome in self.all])

    @cached_property
    def front(self) -> Mask:
        """Which feasible designs of `everything` are Pareto-optimal."""
        values = self.everything.measured[:, : len(self.problem.objectives)]
        optimal = np.zeros(len(values), bool)
        feasible = np.flatnonzero(self.everything.feasible)
        if len(feasible):
            maximise = [term.objective.maximise for term in self.problem.objectives]
            optimal[feasible[nondominated(values[feasible], maximise)]] = True
        return optimal

    @cached_property
    def archive(self) -> Archive | None:
        """The best feasible designs of all runs of MAP-Elites, cell by cell; None where it was not run."""
        if MAP_ELITES not in self.outcomes:
            return None
        settings = self.config.methods[MAP_ELITES]
        cells, ranges = settings.get("cells", CELLS), np.array(settings["ranges"], float)
        columns = [self.names.index(name) for name in settings["measures"]]
        share = (self.everything.measured[:, columns] - ranges[:, 0]) / (ranges[:, 1] - ranges[:, 0])
        places = np.clip(np.floor(share * cells).astype(int), 0, np.array(cells) - 1)
        counts = [len(outcome.evaluated) for outcome in self.all]
        mask = np.repeat([outcome.method == MAP_ELITES for outcome in self.all], counts)
        rows = np.flatnonzero(mask & self.everything.feasible)
        designs = np.full(cells, -1)
        for row in rows[np.argsort(-self.everything.cost[rows], kind="stable")].tolist():
            designs[tuple(places[row])] = row
        return Archive(designs, columns, ranges)


@dataclass(frozen=True)
class Archive:
    """The archive of MAP-Elites.

    Args:
        designs: rows of a search's `everything`, by cell; -1 in empty cells.
        columns: of `measured`, one per direction of the cells. ranges: that the cells divide, (2, 2).
    """

    designs: NDArray[np.int64]
    columns: Sequence[int]
    ranges: Array


def words(name: str) -> str:
    """A name in words."""
    return TITLES.get(name, name.replace("_", " "))


def plain_number(value: float | Array) -> str:
    """Four significant digits; a dash for a number that is not finite."""
    return f"{float(value):.4g}" if math.isfinite(value) else "–"


def median(values: Sequence[N]) -> N:
    """The median; of an even count the larger of the two middle values, so that an infinite one stays infinite."""
    return sorted(values)[len(values) // 2]


def _for_all_methods(command: str) -> str:
    """A command without the choice of some methods, which are run one after the other."""
    words = shlex.split(command)
    if "--methods" in words:
        begin = words.index("--methods")
        names = itertools.takewhile(lambda word: not word.startswith("--"), words[begin + 1 :])
        del words[begin : begin + 1 + len(list(names))]
    return shlex.join(words)


def _order(run: SearchRun) -> tuple[int, int]:
    method, seed = run.path.parent.name, run.path.name.removeprefix("seed_")
    return list(METHODS).index(method) if method in METHODS else len(METHODS), int(seed) if seed.isdigit() else 0
