"""Batches of planar chains solved into arrays that the caller keeps: what solvers and environments share.

Nothing is checked here; `rollingjoint.statics.solve` is the front door.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from functools import partial
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint._numba.jit import entry_address, machine_code
from rollingjoint._numba.layout import Integers, fields
from rollingjoint._numba.pins import Pinned
from rollingjoint.friction_step import FrictionStep
from rollingjoint.kernels.planar.arrays import BatchArrays, PinnedBatch, Results, new_results
from rollingjoint.kernels.planar.rubbed_block import step_side_by_side
from rollingjoint.kernels.planar.side_by_side import memory_alone, solve_alone, solve_pinned
from rollingjoint.kernels.shared.arrays import TendonLaw
from rollingjoint.kernels.shared.batch import solve_lanes
from rollingjoint.kernels.shared.friction import FrictionArrays, histories_of
from rollingjoint.kernels.shared.lanes import MOST_JOINTS, PENDING
from rollingjoint.kernels.shared.rubbed import begin_histories, step_lanes
from rollingjoint.planar.chain import RollingChain
from rollingjoint.planar.equilibrium import Equilibrium
from rollingjoint.solution import STATUSES, Outputs

Array = NDArray[np.float64]

__all__ = [
    "PENDING",
    "BatchArrays",
    "PinnedBatch",
    "PinnedRange",
    "TendonLaw",
    "begin_range",
    "new_results",
    "pack",
    "pack_outputs",
    "step_range",
]


def pack(
    mechanism: RollingChain | tuple[RollingChain, ...],
    table: Array,
    results: Results,
    friction: FrictionStep | None = None,
) -> Equilibrium:
    """The equilibria in the results of the kernels."""
    angles, poses, contacts, tensions, lengths, rates, elastic, forces, _, residual, iterations, status = results
    for array in (table, angles, poses, contacts, tensions, lengths, rates, elastic, forces):
        array.setflags(write=False)
    if isinstance(status, np.ndarray):
        for outcome in (residual, iterations, status):
            outcome.setflags(write=False)
    return Equilibrium.filled(
        {
            "mechanism": mechanism,
            "loads": table,
            "joint_angles": angles,
            "poses": poses,
            "tensions": tensions,
            "lengths": lengths,
            "tendon_rates": rates,
            "tendon_stiffness": elastic,
            "residual": residual,
            "iterations": iterations,
            "status": status,
            "contact_points": contacts[..., :2],
            "contact_tangents": contacts[..., 2:],
            "contact_forces": forces,
            "friction": friction,
        }
    )


def pack_outputs(
    mechanism: RollingChain, table: Array, outputs: Outputs, residual: float, iterations: int, status: int
) -> Equilibrium:
    """One equilibrium whose arrays are made from its outputs, fields as of Results, when they are asked for."""
    return Equilibrium.filled(
        {
            "mechanism": mechanism,
            "loads": table,
            "joint_angles": outputs[0],
            "residual": residual,
            "iterations": iterations,
            "status": STATUSES[status],
            "friction": None,
            "_outputs": outputs,
        }
    )


def step_range(batch: BatchArrays, friction: FrictionArrays, first: int, last: int) -> None:
    """Solve the steps with friction of rows first to last - 1; Python's lock is released meanwhile."""
    everything = batch.starts.shape[1] > MOST_JOINTS
    if everything or _on_batch(step_side_by_side, FrictionArrays, int, int)(*batch, friction, first, last):
        left = _left(batch, first, last, everything)
        _on_batch(step_lanes, FrictionArrays, Annotated[Integers, "left"])(*batch, friction, left)


def begin_range(batch: BatchArrays, friction: FrictionArrays, first: int, last: int) -> None:
    """Fill the histories of rows first to last - 1: at `starts` under the lowest tensions, nothing has ever slipped."""
    rows, (law, history) = slice(first, last), histories_of(friction, first, last)
    begin_histories(batch.chain, batch.designs[rows], law, batch.laws.low[rows], batch.starts[rows], history)


@functools.cache
def _on_batch(kernel: Any, *kinds: Any) -> Callable[..., int]:
    """The machine code of a kernel of the fields of BatchArrays, and of arguments of these kinds after them."""
    return machine_code(kernel, *fields(BatchArrays), *kinds)


class PinnedRange:
    """Solves ranges of rows of arrays that stay where they are; Python's lock is released while there are several.

    Kernels call it by call_range(entry, pins, PinnedBatch, first, last), which returns how many rows it leaves to
    `solve_the_rest`. `entry` is 0 where those are all of them. The arrays are kept alive.

    Args:
        batch: what is solved.
        memory: of memory_alone, for a batch of one row: shared by ranges of which only one is solved at a time; None:
            memory of its own.
    Raises:
        InvalidInput: an array of another type or shape than BatchArrays declares.
    """

    def __init__(self, batch: BatchArrays, memory: Array | None = None) -> None:
        alone, self._long = len(batch.starts) == 1, batch.starts.shape[1] > MOST_JOINTS
        if memory is None:
            memory = memory_alone(batch) if alone and not self._long else np.zeros(0)
        self._batch, self._pinned, self.entry = batch, Pinned(PinnedBatch(batch, memory)), 0
        self.pins = self._pinned.address_for(PinnedBatch)
        if not self._long:
            kernel = solve_alone if alone else solve_pinned
            self.entry = entry_address(kernel, int, int, int)
            self._solve = partial(machine_code(kernel, int, int, int), self.pins)

    def __call__(self, first: int, last: int) -> None:
        """Solve rows first to last - 1."""
        if self._long or self._solve(first, last):
            self.solve_the_rest(first, last)

    def solve_the_rest(self, first: int, last: int) -> None:
        """Solve those of the rows first to last - 1 that `entry` has left."""
        _solve_the_rest(self._batch, first, last, self._long)


def _solve_the_rest(batch: BatchArrays, first: int, last: int, everything: bool) -> None:
    """Solve the rows that are left to the solver for all cases."""
    _on_batch(solve_lanes, Annotated[Integers, "left"])(*batch, _left(batch, first, last, everything))


def _left(batch: BatchArrays, first: int, last: int, everything: bool) -> NDArray[np.int64]:
    """The rows that are left to the solver for all cases."""
    rows = np.arange(first, last)
    return rows if everything else rows[batch.results.status[first:last] == PENDING]
