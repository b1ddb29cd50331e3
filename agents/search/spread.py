"""Runs of large batches: this process asks and tells, workers score the batches in chunks.

A chunk has the same designs as if its run were one unit, so journals are the same to the bit.
"""

from __future__ import annotations

import pickle
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from agents.executors.driver import Ended, Unit
from agents.executors.folders import FolderUnit
from agents.executors.progress import Progress
from agents.search.config import SearchConfig
from agents.search.folder import SearchRun
from agents.search.optimiser import Derivatives, Evaluated
from agents.search.problem import design_problem, optimiser
from agents.search.run import RunInWork, RunProgress, chunks, evaluated_by
from rollingjoint.design import Problem
from rollingjoint.errors import one_line


@dataclass(frozen=True)
class ChunkUnit(Unit):
    """The designs of a chunk.

    Args:
        folder: of the run. place: of the chunk in its batch.
    """

    folder: Path = Path()
    place: int = 0


class SpreadRuns:
    """Units of runs of a search; of those with large batches this process makes chunks of the batches.

    They are searched side by side: further ones begin where those begun leave workers without chunks. A context
    manager, which holds the locks of those that have begun.

    Args:
        units: named after the folders of the runs. progress: counts runs, not chunks.
    """

    def __init__(self, units: Sequence[FolderUnit], progress: Progress) -> None:
        self._units = {Path(unit.name): unit for unit in units}
        self._large = [folder for folder in self._units if has_chunks(SearchRun(folder).config)]
        self._begun: dict[Path, _SpreadRun] = {}
        self._progress, self._ended = progress, list[Ended[FolderUnit]]()

    def __enter__(self) -> SpreadRuns:
        return self

    def __exit__(self, *exception: object) -> None:
        for run in self._begun.values():
            run.held.close()

    def units(self) -> Iterator[Unit | None]:
        """The units that stay whole, then chunks; None while none is ready."""
        yield from (unit for folder, unit in self._units.items() if folder not in self._large)
        remaining = list(self._large)
        while remaining or self._begun:
            waiting = next((run.waiting for run in self._begun.values() if run.waiting), None)
            if waiting:
                yield waiting.pop(0)
            elif remaining:
                self._begin(remaining.pop(0))
            else:
                yield None

    def runs(self, ended: Iterable[Ended[Any]]) -> Iterator[Ended[FolderUnit]]:
        """The runs among the ended units, with their RunProgress; a run in chunks ends with its last chunk."""
        for end in ended:
            if isinstance(end.unit, ChunkUnit):
                self._take(end, end.unit.folder, end.unit.place)
            else:
                yield end
            yield from self._ended_runs()
        yield from self._ended_runs()

    def _ended_runs(self) -> Iterator[Ended[FolderUnit]]:
        while self._ended:
            yield self._ended.pop(0)

    def _begin(self, folder: Path) -> None:
        with ExitStack() as held:
            try:
                held.enter_context(SearchRun(folder).locked())
                run = _SpreadRun(folder)
            except Exception as error:  # the other runs go on
                self._end(folder, error)
                return
            if run.work.is_finished:  # by another command
                self._end(folder, run.work.now)
                return
            run.held = held.pop_all()
        self._begun[folder] = run

    def _take(self, ended: Ended[Any], folder: Path, place: int) -> None:
        run = self._begun.get(folder)
        if run is None:  # another chunk has failed
            return
        try:
            if ended.error is not None:
                raise ended.error
            run.take(place, *ended.value)
        except Exception as error:  # a full disk, for example
            self._end(folder, error)
        else:
            if run.work.is_finished:
                self._end(folder, run.work.now)

    def _end(self, folder: Path, outcome: RunProgress | Exception) -> None:
        """Report that a run has ended, with its progress or its error."""
        if run := self._begun.pop(folder, None):
            run.held.close()
        if isinstance(outcome, RunProgress):
            self._progress.done += 1
            self._ended.append(Ended(self._units[folder], outcome))
        else:
            self._progress.failed += 1
            reason = one_line(str(outcome) or repr(outcome))
            self._ended.append(Ended(self._units[folder], failure=reason, error=outcome))


def has_chunks(config: SearchConfig) -> bool:
    """Whether the first batch of a run, of one method and one seed, makes two chunks or more."""
    if not config.chunk:
        return False
    first = optimiser(config, design_problem(config)).ask(config.budget)
    return len(chunks(first, config.chunk)) > 1


class _SpreadRun:
    """A run in work: the chunks of its batch that wait for a worker, and the evaluations of the others."""

    def __init__(self, folder: Path) -> None:
        run = SearchRun(folder)
        self.folder, self.held, self.chunk = folder, ExitStack(), run.config.chunk
        self.problem = design_problem(run.config)
        self.pickled = pickle.dumps(self.problem)
        self.work = RunInWork(run, optimiser(run.config, self.problem), run.config.budget)
        self.waiting: list[ChunkUnit] = []
        self.evaluations: list[tuple[Evaluated, float] | None] = []
        self._ask()

    def take(self, place: int, evaluated: Evaluated, seconds: float) -> None:
        """Store the evaluation of a chunk; after the last of a batch, tell the optimiser and ask for the next batch."""
        self.evaluations[place] = evaluated, seconds
        complete = [part for part in self.evaluations if part is not None]
        if len(complete) == len(self.evaluations):
            self.work.tell(Evaluated.whole([part for part, _ in complete]), sum(used for _, used in complete))
            self._ask()

    def _ask(self) -> None:
        if self.work.is_finished:
            return
        wants = self.work.optimiser.wants
        for place, x in enumerate(parts := chunks(self.work.ask(), self.chunk)):
            name = f"{self.folder}, chunk {place + 1} of {len(parts)}"
            self.waiting.append(
                ChunkUnit(name, scored, (self.pickled, wants, x), is_part=True, folder=self.folder, place=place)
            )
        self.evaluations = [None] * len(parts)


def scored(pickled: bytes, wants: Derivatives, x: np.ndarray) -> tuple[Evaluated, float]:
    """In a worker: the evaluation of designs by a pickled problem, and its processor time [s].

    Objectives may be of modules that the worker imports first, by their paths.
    """
    problem = _prepared(pickled, wants)
    start = time.process_time()
    evaluated = evaluated_by(problem, wants, x)
    return evaluated, time.process_time() - start


@cache
def _prepared(pickled: bytes, wants: Derivatives) -> Problem:
    """The problem, with one thread for torch; compilation does not count as time of a run."""
    import torch

    torch.set_num_threads(1)
    problem: Problem = pickle.loads(pickled)
    evaluated_by(problem, wants, problem.space.reference()[None])
    return problem
