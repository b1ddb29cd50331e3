"""Designs to compare a co-designed pair with: the best of a mechanical objective, and random ones."""

from __future__ import annotations

import numpy as np

from agents.codesign.task import Array
from agents.search.optimiser import Evaluated, Optimiser
from agents.search.run import evaluated_by
from rollingjoint.design import Problem

_MOST_DRAWS = 60


def best_design(problem: Problem, optimiser: Optimiser, budget: int) -> tuple[Array, float]:
    """The feasible design of least cost that a search of this budget finds, (d,), and its cost.

    Where none is feasible it is the reference of the space, with an infinite cost.
    """
    batches, count = list[Evaluated](), 0
    while count < budget:
        batches.append(evaluated_by(problem, optimiser.wants, optimiser.ask(budget - count)))
        optimiser.tell(batches[-1])
        count += len(batches[-1])
    every = Evaluated.joined(batches)
    if not every.feasible.any():
        return np.asarray(problem.space.reference()), np.inf
    best = int(np.where(every.feasible, every.cost, np.inf).argmin())
    return every.x[best], float(every.cost[best])


def random_designs(problem: Problem, count: int, seed: int) -> Array:
    """Random feasible designs, (count, d): uniform in the box, or in the largest part of it around the reference.

    Designs that are not feasible are drawn again from a box that is smaller by a tenth each time, so that limits which
    hardly any design of the whole box keeps are kept by designs that are as far from the reference as it takes.
    """
    rng, reference = np.random.default_rng(seed), np.asarray(problem.space.reference())
    designs, missing = np.tile(reference, (count, 1)), np.arange(count)
    for draw in range(_MOST_DRAWS):
        drawn = reference + 0.9**draw * (rng.uniform(-1.0, 1.0, (len(missing), problem.dimensions)) - reference)
        feasible = problem.evaluate(drawn).feasible
        designs[missing[feasible]] = drawn[feasible]
        missing = missing[~feasible]
        if not len(missing):
            break
    return designs
