"""A run of a search, new or resumed, to the end of its budget."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.runs.command_line import signals_seen
from agents.runs.files import RunFolderError, cut_off_unfinished_line
from agents.search.folder import SearchRun
from agents.search.optimiser import Derivatives, Evaluated, Optimiser

AGREEMENT = 1e-9  # largest difference between designs in the journal and those that a resumed optimiser asks for


class RunProgress(NamedTuple):
    """Designs evaluated, the least cost of a feasible one (infinite before), seconds of processor time."""

    evaluations: int
    best: float
    seconds: float


def search_in(folder: Path) -> RunProgress:
    """Search the run in its folder to the end of its budget; its last progress.

    Raises:
        RollingJointError: it cannot be searched.
        KeyboardInterrupt: a signal came; the batch in work was finished and is in the journal.
    """
    import torch

    from agents.search.problem import design_problem, optimiser

    torch.set_num_threads(1)
    run = SearchRun(folder)
    problem, first = design_problem(run.config), optimiser(run.config, design_problem(run.config))
    # compilation does not count as time of a run
    first.tell(evaluated_by(problem, first.wants, first.ask(run.config.budget)))
    with signals_seen() as signals:
        for now in search(run, problem, optimiser(run.config, problem), run.config.budget):
            if signals and now.evaluations < run.config.budget:
                raise KeyboardInterrupt
    return now


def search(run: SearchRun, problem: Any, optimiser: Optimiser, budget: int) -> Iterator[RunProgress]:
    """Run to the end of the budget; yields after every batch, and once before the first.

    Its seconds are processor time of this process with all its threads; work of other processes does not count.

    Args:
        problem: `evaluate`, `with_gradient` and `with_jacobian`, as rollingjoint.design.Problem has them.
        optimiser: new.
        budget: designs of the whole run, kept exactly.
    Raises:
        RunFolderError: the journal does not agree with the designs that the optimiser asks for; another process holds
            the run.
    """
    with run.locked():
        work = RunInWork(run, optimiser, budget)
        yield work.now
        while not work.is_finished:
            x, start = work.ask(), time.process_time()
            parts = [evaluated_by(problem, optimiser.wants, part) for part in chunks(x, run.config.chunk)]
            work.tell(Evaluated.whole(parts), time.process_time() - start)
            yield work.now


class RunInWork:
    """A locked run after its last complete batch; callers score its designs.

    Args:
        optimiser: new; it is told the content of the journal.
        budget: designs of the whole run.
    Raises:
        RunFolderError: the journal does not agree with the designs that the optimiser asks for.
    """

    def __init__(self, run: SearchRun, optimiser: Optimiser, budget: int) -> None:
        cut_off_unfinished_line(run.journal)
        self.run, self.optimiser, self.budget = run, optimiser, budget
        self.now = _replay(run, optimiser, budget)
        self._asking = 0.0  # seconds

    @property
    def is_finished(self) -> bool:
        """Whether the budget is used up."""
        return self.now.evaluations == self.budget

    def ask(self) -> np.ndarray:
        """The next batch, (B, d)."""
        start = time.process_time()
        x = self.optimiser.ask(self.budget - self.now.evaluations)
        self._asking = time.process_time() - start
        return x

    def tell(self, evaluated: Evaluated, seconds: float) -> None:
        """Tell the optimiser the evaluation of the batch, which took `seconds` of processor time, and write it down."""
        start = time.process_time()
        self.optimiser.tell(evaluated)
        seconds += self.now.seconds + self._asking + time.process_time() - start
        self.run.append(evaluated, seconds)
        self.now = _advanced(self.now, evaluated, seconds)


def chunks(x: np.ndarray, smallest: int) -> list[np.ndarray]:
    """A batch in the largest number of equal parts of at least `smallest` designs; whole where that is 0.

    The last bits of an evaluation depend on the other designs of the part, but not on where it is scored.
    """
    return np.array_split(x, max(len(x) // smallest, 1)) if smallest else [x]


def evaluated_by(problem: Any, wants: Derivatives, x: np.ndarray) -> Evaluated:
    """The evaluation of designs by the problem, with these derivatives."""
    if wants == "gradient":
        evaluation, gradient = problem.with_gradient(x)
        return Evaluated.of(evaluation, gradient=gradient)
    if wants == "jacobian":
        evaluation, jacobian = problem.with_jacobian(x)
        return Evaluated.of(evaluation, jacobian=jacobian)
    return Evaluated.of(problem.evaluate(x))


def _replay(run: SearchRun, optimiser: Optimiser, budget: int) -> RunProgress:
    """Tell the optimiser all batches of the journal; the progress after the last one."""
    now = RunProgress(0, np.inf, 0.0)
    for batch, seconds in run.batches():
        designs = optimiser.ask(budget - now.evaluations) if now.evaluations < budget else np.empty(0)
        if designs.shape != batch.x.shape or np.abs(designs - batch.x).max() > AGREEMENT:
            hint = "Other versions of the packages may have written it (versions.json); --force begins the run anew."
            allowed = f"after {now.evaluations} evaluations the designs that the method asks for"
            raise RunFolderError("journal", str(run.journal), allowed, hint)
        optimiser.tell(batch)
        now = _advanced(now, batch, seconds)
    return now


def _advanced(now: RunProgress, evaluated: Evaluated, seconds: float) -> RunProgress:
    best = min([now.best, *evaluated.cost[evaluated.feasible].tolist()])
    return RunProgress(now.evaluations + len(evaluated), best, seconds)
