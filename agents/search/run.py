"""A run of a search, new or resumed, to the end of its budget."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from agents.runs.files import RunFolderError, cut_off_unfinished_line
from agents.search.folder import SearchRun
from agents.search.optimiser import Evaluated, Optimiser

AGREEMENT = 1e-9  # largest difference between designs in the journal and those that a resumed optimiser asks for


class Progress(NamedTuple):
    """Designs evaluated, the least cost of a feasible one (infinite before), seconds of processor time."""

    evaluations: int
    best: float
    seconds: float


def search(run: SearchRun, problem: Any, optimiser: Optimiser, budget: int) -> Iterator[Progress]:
    """Run to the end of the budget; yields after every batch, and once before the first.

    Its seconds are processor time of this process with all its threads: what other processes do does not count, what
    this one does between two batches would.

    Args:
        problem: `evaluate`, `with_gradient` and `with_jacobian`, as rollingjoint.design.Problem has them.
        optimiser: new.
        budget: designs of the whole run, kept exactly.
    Raises:
        RunFolderError: the journal does not agree with what the optimiser asks for; another process holds the run.
    """
    with run.locked():
        cut_off_unfinished_line(run.journal)
        now = _replay(run, optimiser, budget)
        yield now
        begun = time.process_time() - now.seconds
        while now.evaluations < budget:
            evaluated = evaluated_by(problem, optimiser, optimiser.ask(budget - now.evaluations))
            optimiser.tell(evaluated)
            seconds = time.process_time() - begun
            run.append(evaluated, seconds)
            now = _advanced(now, evaluated, seconds)
            yield now


def evaluated_by(problem: Any, optimiser: Optimiser, x: np.ndarray) -> Evaluated:
    """What the problem says of designs, with the derivatives that the optimiser wants."""
    if optimiser.wants == "gradient":
        evaluation, gradient = problem.with_gradient(x)
        return Evaluated.of(evaluation, gradient=gradient)
    if optimiser.wants == "jacobian":
        evaluation, jacobian = problem.with_jacobian(x)
        return Evaluated.of(evaluation, jacobian=jacobian)
    return Evaluated.of(problem.evaluate(x))


def _replay(run: SearchRun, optimiser: Optimiser, budget: int) -> Progress:
    """Tell the optimiser all that the journal holds."""
    now = Progress(0, np.inf, 0.0)
    for batch, seconds in run.batches():
        asked = optimiser.ask(budget - now.evaluations) if now.evaluations < budget else np.empty(0)
        if asked.shape != batch.x.shape or np.abs(asked - batch.x).max() > AGREEMENT:
            hint = "Other versions of the packages may have written it (versions.json); --force begins the run anew."
            allowed = f"after {now.evaluations} evaluations the designs that the method asks for"
            raise RunFolderError("journal", str(run.journal), allowed, hint)
        optimiser.tell(batch)
        now = _advanced(now, batch, seconds)
    return now


def _advanced(now: Progress, evaluated: Evaluated, seconds: float) -> Progress:
    best = min([now.best, *evaluated.cost[evaluated.feasible].tolist()])
    return Progress(now.evaluations + len(evaluated), best, seconds)
