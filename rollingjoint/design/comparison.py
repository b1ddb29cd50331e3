"""Comparing designs: objectives of any mechanism, and Pareto-optimal designs."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.checks import as_floats
from rollingjoint.design.objectives import Objective, check_fits, checked_measure
from rollingjoint.differentiable import DifferentiableChain, DifferentiableSpatialChain
from rollingjoint.differentiable.parameters import ChainTensors
from rollingjoint.errors import InvalidInput, SolverError

Array = NDArray[np.float64]


def measure(mechanism: AnyChain, objectives: Iterable[Objective]) -> Array:
    """Values of objectives of one mechanism, which need not lie in a design space, (objectives,).

    Raises:
        InvalidInput: objectives of other chains, or a number of tendons or links that does not fit them.
        SolverError: no stable equilibrium in one of their cases.
    """
    in_space = isinstance(mechanism, SpatialChain)
    kind: type[ChainTensors] = DifferentiableSpatialChain if in_space else DifferentiableChain
    chain = kind.from_mechanism([mechanism])
    values = []
    for objective in objectives:
        check_fits(objective, kind)
        with torch.no_grad():
            measured = checked_measure(objective, chain)
        if not bool(measured.ok):
            raise SolverError(f"{objective.name}: {mechanism.name!r} has no stable equilibrium in one of its cases")
        values.append(float(measured.values))
    return np.array(values)


def nondominated(values: ArrayLike, maximise: Iterable[bool]) -> NDArray[np.bool_]:
    """True for Pareto-optimal rows, (B,): no other row is at least equal in every column and better in one.

    Args:
        values: (B, k); rows with a NaN are not Pareto-optimal.
        maximise: for every column, whether more is better.
    Raises:
        InvalidInput: shapes that disagree.
    """
    table = as_floats("values", values, "numbers (B, k)")
    signs = np.where(np.array(list(maximise), bool), -1.0, 1.0)
    if table.ndim != 2 or signs.shape != table.shape[1:]:
        raise InvalidInput("shape of values", table.shape, f"(B, {len(signs)}), a column for each of `maximise`")
    costs = table * signs
    optimal = np.all(~np.isnan(costs), axis=1)
    for row in np.flatnonzero(optimal):
        if optimal[row]:
            optimal &= ~((costs >= costs[row]).all(1) & (costs > costs[row]).any(1))
    return optimal
