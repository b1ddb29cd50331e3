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

from rollingjoint.chain.batch import PinnedAmongWalls, PinnedRange
from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.wall_step import WALL_OUTPUTS, new_wall_arrays, step_class, wall_outputs, with_outputs
from rollingjoint.kernels.arrays import PASSED_THROUGH, TendonLaw
from rollingjoint.statics.among import ORIGIN, equilibrium_among
from rollingjoint.threads import run_in_threads, runs_at_once

Array = NDArray[np.float64]

Law = tuple[ArrayLike, ArrayLike, ArrayLike, ArrayLike]
"""The fields of a TendonLaw, numbers for all tendons or (m,)."""

_FIRST = np.zeros(1, np.int64)  # the only design of a mechanism's own arrays
_MOST_SPARES = 64  # lists of slots
_item = np.ndarray.item


class Slot:
    """Room for one solve of a mechanism under a number of load rows, used by one thread at a time.

    Attributes:
        law: commanded lengths, stiffnesses and tension limits, (m,) each; a caller fills them in.
        arrays: the mechanism's. loads: load table, (rows, columns). start: joint angles, (n - 1,) [rad].
    """

    def __init__(self, mechanism: AnyChain, rows: int, walls: Any = None) -> None:
        n_joints, m = mechanism.n_joints, mechanism.n_tendons
        kernels, self._n_joints = mechanism.kernels, n_joints
        self._pack = mechanism.equilibrium.of_outputs
        results, around = kernels.new_results(1, n_joints, m), None
        if walls is not None:
            bases, unknown = np.zeros((1, step_class(walls).motions)), _unknown(results.poses.shape[1:], walls)
            around = new_wall_arrays(walls, _FIRST, bases, n_joints, None, unknown)
        self._outputs, self._places, results, around = _in_one_block(results, around)
        if around is not None:
            around = around._replace(poses_before=results.poses)  # read before the new ones are written
        laws, tables, starts = (
            np.zeros((4, 1, m)),
            np.zeros((1, rows, len(mechanism.load_columns))),
            np.zeros((1, n_joints)),
        )
        self.law, self.loads, self.start = TendonLaw(*laws[:, 0]), tables[0], starts[0]
        self.arrays, self.walls = mechanism.arrays, walls
        self._around: Any = around
        arrays = kernels.batch_arrays(self.arrays, _FIRST, TendonLaw(*laws), tables, starts, results)
        solve: Any = PinnedRange(kernels, arrays) if around is None else PinnedAmongWalls(arrays, around)
        self._solve = solve.__call__  # looked up once: 70 ns of every solve
        self._at_once = runs_at_once(n_joints)
        self._numbers = [array for array in results if array.ndim == 1]
        # among walls: outputs of the last equilibrium, the pose of the base there, and the one of the step before it
        self._last: Any = ()
        self._base: Any = ORIGIN
        self._before: Any = None

    def enter(self, law: Law, table: Array, start: Array) -> None:
        """Fill everything in."""
        command, stiffness, low, high = self.law
        command[...], stiffness[...], low[...], high[...] = law  # [:] takes half as long again
        self.loads[...] = table
        self.start[...] = start

    def enter_way(self, base: ArrayLike, start: Any, history: Any) -> None:
        """Fill in the pose of the base among walls, and the equilibrium there from which the step begins, if any.

        start, history: of the step, as a caller gives them.
        """
        around, before = self._around, self._base
        if start is None or getattr(start, "_outputs", None) is not self._last:  # else its poses are here still
            at = equilibrium_among(start, history, self._n_joints + 1)
            if at is None:
                around.bases_before[...], self._before = math.nan, None
            else:
                around.poses_before[...], around.bases_before[...] = at.poses, at.base_among_walls
                self._before = at
        elif not (before is ORIGIN and self._before is ORIGIN):
            around.bases_before[...], self._before = around.bases, before
        if not (base is ORIGIN and before is ORIGIN):
            around.bases[...], self._base = 0.0 if base is ORIGIN else base, base

    def solve(self, mechanism: AnyChain, table: Array, promised: bool = True) -> Any:
        """The equilibrium for the inputs of `enter`; table: its load table, read-only.

        promised: whether the start is a pose nearby, from which a chain among walls may jump. None for a step through a
        wall.
        """
        if self._at_once:
            self._solve(0, 1)
        else:
            run_in_threads(self._solve, 1, self._n_joints, abandon=True)
        numbers = tuple(map(_item, self._numbers))
        memory = self._outputs.tobytes()  # read-only, and so are all arrays in it
        outputs = np.frombuffer(memory, float, self._n_joints), memory, self._places
        if self.walls is None:
            return self._pack(mechanism, table, outputs, *numbers)
        if numbers[2] == PASSED_THROUGH:
            self._last = ()
            return None
        self._last, jumped = outputs, promised and self._around.jumped.item() > 0
        return self._pack(mechanism, table, outputs, *numbers, around=(self.walls, jumped))


def _in_one_block(results: Any, around: Any) -> tuple[Array, dict[str, tuple[Any, int]], Any, Any]:
    """One block of memory for all outputs of floats; shape and first byte of each; results and walls with them there.

    Of walls with the pose of the base, which results keep.
    """
    shapes = {name: array.shape for name, array in results._asdict().items() if array.ndim > 1 and len(array)}
    own = list(shapes)
    if around is not None:
        shapes |= {part: array.shape for part, array in zip(WALL_OUTPUTS, wall_outputs(around), strict=True)}
    ends = np.cumsum([0, *map(math.prod, shapes.values())]).tolist()
    outputs = np.zeros(ends[-1])
    arrays = {
        name: outputs[slice(*at)].reshape(shape)
        for (name, shape), at in zip(shapes.items(), itertools.pairwise(ends), strict=True)
    }
    places = {name: (shape[1:], 8 * first) for (name, shape), first in zip(shapes.items(), ends, strict=False)}
    results = results._replace(**{name: arrays[name] for name in own})
    if around is not None:
        around = with_outputs(around, [arrays[name] for name in WALL_OUTPUTS])
    return outputs, places, results, around


def _unknown(poses: tuple[int, ...], walls: Any) -> tuple[Array, Array]:
    """No equilibrium among walls before a solve, and room for one; poses: shape of the poses of links."""
    return np.zeros((1, *poses)), np.full((1, step_class(walls).motions), math.nan)


def full_law(law: Law, n_tendons: int) -> TendonLaw:
    """The law as new arrays, (m,): kernels would be compiled again for read-only ones."""
    return TendonLaw(*(np.full(n_tendons, values, float) for values in law))


def spare_slot(mechanism: AnyChain, rows: int, kind: type[Any] = Slot, walls: Any = None) -> tuple[Any, list[Any]]:
    """An unused slot of the mechanism, and the list to put it back into.

    kind: of the slot, made by kind(mechanism, rows) or, among walls, kind(mechanism, rows, walls); it has `arrays` of
    the mechanism and `walls`.
    Lists pop and append in one step, safe between threads; after an interrupted solve a slot is not put back, since an
    abandoned thread may still be writing into it.
    """
    kept, around = mechanism.spares, () if walls is None else (walls,)
    spares = kept.setdefault((kind, rows, id(walls)), [])
    try:
        slot = spares.pop()
    except IndexError:
        if len(kept) > _MOST_SPARES:
            kept.clear()
        return kind(mechanism, rows, *around), spares
    # of a mechanism from which this one was copied with other numbers, or of walls that are gone
    if slot.arrays is not mechanism.arrays or (around and slot.walls is not walls):
        slot = kind(mechanism, rows, *around)
    return slot, spares
