"""Tensions that meet measured tendon lengths in the least-squares sense, with friction and its history.

solve_lengths(method="least_squares") does the same without friction. Here the search is Newton's on the logarithms of
the tensions, from where the same step ended at the last parameters; its second derivatives come from differences of the
gradient and are kept until they fail. Without a load only ratios of tensions matter, and the mean logarithm stays.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.status import Status
from rollingjoint.load import Load
from rollingjoint.statics.sensitivity import dlengths_dtensions
from rollingjoint.statics.solve import solve_tensions

Array = NDArray[np.float64]

_GOAL = 1e-10  # step of the logarithms that ends the search
_DIFFERENCE = 1e-4
_SINGULAR = 1e-6  # a smaller curvature, relative to the largest, belongs to the mean, which has no effect
_LARGEST_STEP, _LARGEST = 0.5, 7.0  # of the logarithms
_MAX_ITERATIONS = 60


@dataclass
class NearestLengths:
    """Searches by key, each started where the one before with the same key ended."""

    _known: dict[Hashable, tuple[Array, Array]] = field(default_factory=dict)

    def solve(self, mechanism: AnyChain, lengths: Array, loads: Sequence[Load], history: Any, key: Hashable) -> Any:
        """The equilibrium with the nearest lengths; Status.NOT_CONVERGED where positive tensions give none."""

        def at(logs: Array) -> tuple[Any, Array | None]:
            """The equilibrium and the gradient of half the sum of squares."""
            equilibrium = solve_tensions(mechanism, np.exp(logs), loads, history=history)
            if not equilibrium.ok:
                return equilibrium, None
            rates = dlengths_dtensions(equilibrium) * np.exp(logs)
            return equilibrium, rates.T @ (equilibrium.lengths - lengths)

        logs, inverse = self._known.get(key, (np.zeros(mechanism.n_tendons), None))
        fresh, last = False, np.inf
        for _ in range(_MAX_ITERATIONS):
            equilibrium, gradient = at(logs)
            if gradient is None or np.abs(logs).max() > _LARGEST:
                break
            if inverse is None:
                inverse, fresh = _inverse_curvature(at, logs, gradient), True
            step = -inverse @ gradient
            size = float(np.abs(step).max())
            if size < _GOAL:
                self._known[key] = logs, inverse
                return equilibrium
            if size > 0.3 * last and not fresh:
                inverse, last = None, np.inf
                continue
            logs, last, fresh = logs + step * min(1.0, _LARGEST_STEP / size), size, False
        self._known.pop(key, None)
        return dataclasses.replace(equilibrium, status=max(equilibrium.status, Status.NOT_CONVERGED))


def _inverse_curvature(at: Any, logs: Array, gradient: Array) -> Array:
    """Pseudoinverse of the second derivatives, which are differences of the gradient, made positive."""
    columns = []
    for unit in np.eye(len(logs)):
        _, moved = at(logs + _DIFFERENCE * unit)
        columns.append(np.zeros_like(gradient) if moved is None else (moved - gradient) / _DIFFERENCE)
    rows = np.array(columns)
    sizes, directions = np.linalg.eigh((rows + rows.T) / 2)
    sizes = np.abs(sizes)
    counted = sizes > _SINGULAR * sizes.max()
    inverse = np.divide(1.0, sizes, out=np.zeros_like(sizes), where=counted)
    return np.asarray((directions * inverse) @ directions.T)
