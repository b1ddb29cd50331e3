"""A single search from a known equilibrium, in memory that is kept from call to call: Python takes 10 µs of it."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint._numba.jit import machine_code
from rollingjoint.chain.chain import AnyChain, read_only
from rollingjoint.chain.status import Status
from rollingjoint.kernels import inverse as kernels
from rollingjoint.statics.slot import spare_slot

Array = NDArray[np.float64]


class _SearchSlot:
    """Room for one search for a tip of a mechanism under a number of load rows, used by one thread at a time."""

    def __init__(self, chain: AnyChain, rows: int) -> None:
        m, n_joints = chain.n_tendons, chain.n_joints
        low, high, preferred, tensions, lengths = (np.zeros((1, m)) for _ in range(5))
        self.rows = kernels.InverseRows(
            designs=np.zeros(1, np.int64),
            loads=np.zeros((1, rows, len(chain.load_columns))),
            low=low,
            high=high,
            preferred=preferred,
            links=np.array([chain.n_links - 1]),
            points=np.zeros((1, 1, 3)),
            frames=np.zeros((1, 0, 9)),
            lever=np.zeros(1),
            size=np.array([float(chain.length)]),
            angles=np.zeros((1, n_joints)),
            tensions=tensions,
            lengths=lengths,
            distance=np.zeros(1),
            iterations=np.zeros(1, np.int64),
            outcome=np.zeros(1, np.int64),
        )
        self.arrays = chain.arrays
        kind: Any = type(self.arrays)
        self.run = partial(machine_code(kernels.reach_rows, kind, kernels.InverseRows, int, int), self.arrays)


def reach_from(
    chain: AnyChain,
    tip: Array,
    table: Array,
    limits: tuple[ArrayLike, ArrayLike],
    preferred: ArrayLike,
    start: Any,
) -> tuple[Any, Array, float, int]:
    """Equilibrium from rest, the lengths that hold it, its distance from the tip and the steps of one search.

    limits: numbers or (m,) [N]. start: an equilibrium. The distance is infinite where the search finds none.
    """
    search, spares = spare_slot(chain, len(table), _SearchSlot)
    rows, (low, high) = search.rows, limits
    rows.loads[...] = table
    rows.low[...], rows.high[...], rows.preferred[...] = low, high, preferred
    rows.points[0, 0, : len(tip)] = tip
    rows.angles[...], rows.tensions[...] = start.joint_angles, start.tensions
    search.run(rows, 0, 1)
    lengths = rows.lengths[0] - rows.tensions[0] / chain.stiffnesses
    found, steps = rows.outcome.item() <= kernels.STOPPED, rows.iterations.item()
    spares.append(search)
    if not found:
        return None, lengths, math.inf, steps
    slot, slots = spare_slot(chain, len(table))
    slot.enter((lengths, chain.stiffnesses, low, high), table, chain.neutral_angles)
    equilibrium = slot.solve(chain, read_only(table))
    slots.append(slot)
    off = math.dist(equilibrium.tip, tip) if equilibrium.status <= Status.AT_LIMIT else math.inf
    return equilibrium, lengths, off, steps
