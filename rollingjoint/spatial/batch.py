"""Batches of spatial hinge chains solved into arrays that the caller keeps.

Nothing is checked here; `rollingjoint.statics.solve` is the front door.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rollingjoint._numba.jit import machine_code
from rollingjoint._numba.layout import fields
from rollingjoint.kernels.shared.arrays import TendonLaw
from rollingjoint.kernels.spatial.arrays import BatchArrays, HingeResults
from rollingjoint.kernels.spatial.arrays import new_hinge_results as new_results
from rollingjoint.kernels.spatial.batch import solve_hinge_lanes
from rollingjoint.solution import Status
from rollingjoint.spatial.chain import HingeChain
from rollingjoint.spatial.equilibrium import HingeEquilibrium

Array = NDArray[np.float64]

__all__ = ["BatchArrays", "PinnedRange", "new_results", "pack", "solve_one", "solve_range"]

_FIRST = np.zeros(1, np.int64)  # the only design of a mechanism's own arrays


def solve_one(mechanism: HingeChain, law: TendonLaw, table: Array, start: Array) -> HingeEquilibrium:
    """The equilibrium of one mechanism. law: (m,) each; table: (rows, columns); start: (n - 1,)."""
    results = new_results(1, len(start), len(law.low))
    laws = TendonLaw(law.command[None], law.stiffness[None], law.low[None], law.high[None])
    _on_batch()(mechanism.arrays, _FIRST, laws, table[None], start[None], results, 0, 1)
    *arrays, residual, iterations, status, escapes = results
    numbers = residual.item(), iterations.item(), Status(status.item()), escapes.item()
    return pack(mechanism, table, HingeResults._make([*[array[0] for array in arrays], *numbers]))


def pack(mechanism: HingeChain | tuple[HingeChain, ...], table: Array, results: HingeResults) -> HingeEquilibrium:
    """The equilibria in the results of the kernels."""
    angles, poses, tensions, lengths, rates, torques, elastic, residual, iterations, status, escapes = results
    solved = angles, poses, tensions, lengths, rates, elastic, residual, iterations, status
    return HingeEquilibrium(mechanism, table, *solved, torques, escapes)


@functools.cache
def _on_batch() -> Callable[..., None]:
    """The machine code of `solve_hinge_lanes`."""
    return machine_code(solve_hinge_lanes, *fields(BatchArrays), int, int)


def solve_range(batch: BatchArrays, first: int, last: int) -> None:
    """Solve rows first to last - 1; Python's lock is released meanwhile."""
    _on_batch()(*batch, first, last)


class PinnedRange:
    """`solve_range` on arrays that stay where they are; the interface of planar.batch.PinnedRange.

    No kernel calls it (`entry` is 0): a call from Python costs a fiftieth of a solve.
    """

    entry = pins = 0

    def __init__(self, batch: BatchArrays) -> None:
        self._solve = partial(_on_batch(), *batch)

    def __call__(self, first: int, last: int) -> None:
        """Solve rows first to last - 1; Python's lock is released meanwhile."""
        self._solve(first, last)

    solve_the_rest = __call__
