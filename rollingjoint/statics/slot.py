"""Memory for one solve, kept from solve to solve: pinned inputs, and outputs in one block that a single copy takes out.

A solve on new arrays spends more on making, pinning and write-protecting some twenty of them than on its Newton steps.
With slots, and with fields that are made when they are read, `solve_lengths` takes half the time on a warm walk, 13.5
instead of 26.5 µs in one run (20 µs if all fields are read), and a prepared problem 6.8 µs.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.batch import PinnedRange
from rollingjoint.chain.chain import AnyChain
from rollingjoint.kernels.arrays import TendonLaw
from rollingjoint.threads import run_in_threads, runs_at_once

Array = NDArray[np.float64]

Law = tuple[ArrayLike, ArrayLike, ArrayLike, ArrayLike]
"""The fields of a TendonLaw, numbers for all tendons or (m,)."""

_FIRST = np.zeros(1, np.int64)  # the only design of a mechanism's own arrays
_item = np.ndarray.item


class Slot:
    """Room for one solve of a mechanism under a number of load rows, used by one thread at a time.

    Attributes:
        law: commanded lengths, stiffnesses and tension limits, (m,) each; a caller fills them in.
        arrays: the mechanism's. loads: load table, (rows, columns). start: joint angles, (n - 1,) [rad].
    """

    def __init__(self, mechanism: AnyChain, rows: int) -> None:
        n_joints, m = mechanism.n_joints, mechanism.n_tendons
        kernels, self._n_joints = mechanism.kernels, n_joints
        self._pack = mechanism.equilibrium.of_outputs
        empty = kernels.new_results(1, n_joints, m)
        floats = {name: array.shape for name, array in empty._asdict().items() if array.ndim > 1 and len(array)}
        ends = np.cumsum([0, *map(math.prod, floats.values())]).tolist()
        self._outputs = np.zeros(ends[-1])
        parts = {name: slice(*at) for name, at in zip(floats, itertools.pairwise(ends), strict=True)}
        results = empty._replace(**{name: self._outputs[parts[name]].reshape(floats[name]) for name in floats})
        self._places = {name: (shape[1:], 8 * parts[name].start) for name, shape in floats.items()}
        laws, tables, starts = (
            np.zeros((4, 1, m)),
            np.zeros((1, rows, len(mechanism.load_columns))),
            np.zeros((1, n_joints)),
        )
        self.law, self.loads, self.start = TendonLaw(*laws[:, 0]), tables[0], starts[0]
        self.arrays = mechanism.arrays
        arrays = kernels.batch_arrays(self.arrays, _FIRST, TendonLaw(*laws), tables, starts, results)
        solve: Any = PinnedRange(kernels, arrays)
        self._solve = solve.__call__  # looked up once: 70 ns of every solve
        self._at_once = runs_at_once(n_joints)
        self._numbers = [array for array in results if array.ndim == 1]

    def enter(self, law: Law, table: Array, start: Array) -> None:
        """Fill everything in."""
        command, stiffness, low, high = self.law
        command[...], stiffness[...], low[...], high[...] = law  # [:] takes half as long again
        self.loads[...] = table
        self.start[...] = start

    def solve(self, mechanism: AnyChain, table: Array) -> Any:
        """The equilibrium for the inputs of `enter`; table: its load table, read-only."""
        if self._at_once:
            self._solve(0, 1)
        else:
            run_in_threads(self._solve, 1, self._n_joints, abandon=True)
        memory = self._outputs.tobytes()  # read-only, and so are all arrays in it
        outputs = np.frombuffer(memory, float, self._n_joints), memory, self._places
        return self._pack(mechanism, table, outputs, *map(_item, self._numbers))


def full_law(law: Law, n_tendons: int) -> TendonLaw:
    """The law as new arrays, (m,): kernels would be compiled again for read-only ones."""
    return TendonLaw(*(np.full(n_tendons, values, float) for values in law))


def spare_slot(mechanism: AnyChain, rows: int, kind: type[Any] = Slot) -> tuple[Any, list[Any]]:
    """An unused slot of the mechanism, and the list to put it back into.

    kind: of the slot, made by kind(mechanism, rows); its `arrays` are the mechanism's.
    Lists pop and append in one step, safe between threads; after an interrupted solve a slot is not put back, since an
    abandoned thread may still be writing into it.
    """
    spares = mechanism.spares.setdefault((kind, rows), [])
    try:
        slot = spares.pop()
    except IndexError:
        return kind(mechanism, rows), spares
    if slot.arrays is not mechanism.arrays:  # the slot of a mechanism from which this one was copied with other numbers
        slot = kind(mechanism, rows)
    return slot, spares
