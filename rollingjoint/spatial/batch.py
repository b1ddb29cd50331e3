"""Batches of spatial hinge chains solved into arrays that the caller keeps.

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
from rollingjoint.kernels.shared.batch import solve_lanes, stiffness_of
from rollingjoint.kernels.shared.friction import FrictionArrays, histories_of
from rollingjoint.kernels.shared.lanes import MOST_JOINTS, PENDING
from rollingjoint.kernels.shared.rubbed import begin_histories, rubbed_stiffness_of, step_lanes
from rollingjoint.kernels.spatial.arrays import BatchArrays, HingeResults, PinnedHinges
from rollingjoint.kernels.spatial.arrays import new_hinge_results as new_results
from rollingjoint.kernels.spatial.lanes import MOST_HINGES, memory_alone, solve_hinges_alone, solve_hinges_pinned
from rollingjoint.kernels.spatial.rubbed_block import step_hinges_side_by_side
from rollingjoint.solution import STATUSES, Outputs, strictly_within
from rollingjoint.spatial.chain import HingeChain
from rollingjoint.spatial.equilibrium import HingeEquilibrium

Array = NDArray[np.float64]

__all__ = [
    "BatchArrays",
    "PinnedRange",
    "begin_range",
    "free_joints",
    "new_results",
    "pack",
    "pack_outputs",
    "step_range",
    "stiffnesses",
]


def pack(
    mechanism: HingeChain | tuple[HingeChain, ...],
    table: Array,
    results: HingeResults,
    friction: FrictionStep | None = None,
) -> HingeEquilibrium:
    """The equilibria in the results of the kernels."""
    angles, poses, tensions, lengths, rates, torques, elastic, residual, iterations, status, escapes = results
    for array in (table, angles, poses, tensions, lengths, rates, torques, elastic):
        array.setflags(write=False)
    if isinstance(status, np.ndarray):
        for outcome in (residual, iterations, status, escapes):
            outcome.setflags(write=False)
    return HingeEquilibrium.filled(
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
            "tendon_torques": torques,
            "escapes": escapes,
            "friction": friction,
        }
    )


def pack_outputs(
    mechanism: HingeChain, table: Array, outputs: Outputs, residual: float, iterations: int, status: int, escapes: int
) -> HingeEquilibrium:
    """One equilibrium whose arrays are made from its outputs, fields as of HingeResults, when they are asked for."""
    return HingeEquilibrium.filled(
        {
            "mechanism": mechanism,
            "loads": table,
            "joint_angles": outputs[0],
            "residual": residual,
            "iterations": iterations,
            "status": STATUSES[status],
            "escapes": escapes,
            "friction": None,
            "_outputs": outputs,
        }
    )


@functools.cache
def _on_batch(kernel: Any, *kinds: Any) -> Callable[..., int]:
    """The machine code of a kernel of the fields of BatchArrays, and of arguments of these kinds after them."""
    return machine_code(kernel, *fields(BatchArrays), *kinds)


def step_range(batch: BatchArrays, friction: FrictionArrays, first: int, last: int) -> None:
    """Solve the steps with friction of rows first to last - 1; Python's lock is released meanwhile."""
    everything = batch.starts.shape[1] > MOST_JOINTS
    if everything or _on_batch(step_hinges_side_by_side, FrictionArrays, int, int)(*batch, friction, first, last):
        left = _left(batch, first, last, everything)
        _on_batch(step_lanes, FrictionArrays, Annotated[Integers, "left"])(*batch, friction, left)


def begin_range(batch: BatchArrays, friction: FrictionArrays, first: int, last: int) -> None:
    """Fill the histories of rows first to last - 1: at `starts` under the lowest tensions, nothing has ever slipped."""
    rows, (law, history) = slice(first, last), histories_of(friction, first, last)
    begin_histories(batch.chain, batch.designs[rows], law, batch.laws.low[rows], batch.starts[rows], history)


def stiffnesses(batch: BatchArrays, friction: FrictionArrays | None = None) -> tuple[Array, Array]:
    """Stiffness (B, J, J) [N·mm/rad] and d residual / d tension (B, J, m) [mm] of the solved rows.

    With friction, those after the steps that left its histories: holes that stick go on sticking, the others sliding.
    """
    results, H = batch.results, np.empty((*batch.starts.shape, batch.starts.shape[1]))
    known = batch.chain, batch.designs
    there = results.tensions, results.elastic, batch.loads, results.joint_angles
    if friction is None:
        stiffness_of(*known, *there, H)
        return H, results.torques
    torques = np.empty_like(results.torques)
    rubbed_stiffness_of(*known, friction.law, *there, friction.after, H, torques)
    return H, torques


def free_joints(batch: BatchArrays) -> NDArray[np.bool_]:
    """False where a joint of a solved row is at its limit, (B, J)."""
    low, high = np.moveaxis(batch.chain.joints[batch.designs, :, :2], -1, 0)
    return strictly_within(batch.results.joint_angles, low, high)


class PinnedRange:
    """Solves ranges of rows of arrays that stay where they are; the interface of planar.batch.PinnedRange."""

    def __init__(self, batch: BatchArrays) -> None:
        alone, self._long = len(batch.starts) == 1, batch.starts.shape[1] > MOST_HINGES
        memory = memory_alone(batch) if alone and not self._long else np.zeros(0)
        self._batch, self._pinned, self.entry = batch, Pinned(PinnedHinges(batch, memory)), 0
        self.pins = self._pinned.address_for(PinnedHinges)
        if not self._long:
            kernel = solve_hinges_alone if alone else solve_hinges_pinned
            self.entry = entry_address(kernel, int, int, int)
            self._solve = partial(machine_code(kernel, int, int, int), self.pins)

    def __call__(self, first: int, last: int) -> None:
        """Solve rows first to last - 1."""
        if self._long or self._solve(first, last):
            self.solve_the_rest(first, last)

    def solve_the_rest(self, first: int, last: int) -> None:
        """Solve those of the rows first to last - 1 that `entry` has left."""
        left = _left(self._batch, first, last, self._long)
        _on_batch(solve_lanes, Annotated[Integers, "left"])(*self._batch, left)


def _left(batch: BatchArrays, first: int, last: int, everything: bool) -> NDArray[np.int64]:
    """The rows that are left to the solver for all cases."""
    rows = np.arange(first, last)
    return rows if everything else rows[batch.results.status[first:last] == PENDING]
