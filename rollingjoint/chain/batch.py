"""Batches of chains solved into arrays that the caller keeps, for solvers and environments.

Inputs are not checked here; `rollingjoint.statics.solve` has the public functions.
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
from rollingjoint.chain.chain import AnyChain, Kernels
from rollingjoint.chain.friction_step import FrictionStep, friction_laws
from rollingjoint.chain.solution import strictly_within
from rollingjoint.chain.wall_step import WallStep
from rollingjoint.friction import FrictionState
from rollingjoint.kernels.arrays import TendonLaw
from rollingjoint.kernels.batch import solve_lanes, stiffness_of
from rollingjoint.kernels.friction import FrictionArrays, FrictionLaw, History, histories_of, new_friction_arrays
from rollingjoint.kernels.lanes import MOST_JOINTS, PENDING
from rollingjoint.kernels.rubbed import begin_histories, rubbed_stiffness_of, step_lanes
from rollingjoint.kernels.walled_lanes import PinnedAmong, memory_among_walls, solve_among_in_lane
from rollingjoint.kernels.walled_solve import WallArrays, solve_among_walls, step_among_walls
from rollingjoint.threads import run_in_threads

Array = NDArray[np.float64]

_LEFT = Annotated[Integers, "left"]
_FIRST = np.zeros(1, np.int64)  # the only design of a mechanism's own arrays


class PinnedRange:
    """Solves ranges of rows of arrays that stay where they are; Python's lock is released while there are several.

    Kernels call it by call_range(entry, pins, PinnedBatch, first, last), which returns the number of rows that it
    leaves to `solve_the_rest`. `entry` is 0 where it leaves all rows: of long chains. The arrays are kept alive.

    Args:
        kernels: of the class of chains.
        batch: inputs and results.
        memory: of lanes, for a batch of one row: shared by ranges of which only one is solved at a time; None: new
            memory.
    Raises:
        InvalidInput: an array of another type or shape than the batch declares.
    """

    def __init__(self, kernels: Kernels, batch: Any, memory: Array | None = None) -> None:
        alone, self._is_long = len(batch.starts) == 1, batch.starts.shape[1] > kernels.most_joints
        if memory is None:
            memory = kernels.memory(batch) if alone and not self._is_long else np.zeros(0)
        self._batch, self._pinned, self.entry = batch, Pinned(kernels.pinned_batch(batch, memory)), 0
        self.pins = self._pinned.address_for(kernels.pinned_batch)
        if not self._is_long:
            kernel = kernels.solve_alone if alone else kernels.solve
            self.entry = entry_address(kernel, int, int, int)
            self._solve = partial(machine_code(kernel, int, int, int), self.pins)

    def __call__(self, first: int, last: int) -> None:
        """Solve rows first to last - 1."""
        if self._is_long or self._solve(first, last):
            self.solve_the_rest(first, last)

    def solve_the_rest(self, first: int, last: int) -> None:
        """Solve the rows that `entry` has left among first to last - 1."""
        self._for_all_cases(_left(self._batch, first, last, self._is_long))

    @functools.cached_property
    def _for_all_cases(self) -> Callable[[NDArray[np.int64]], None]:
        """Solves rows of the batch; bound once, since that takes a fiftieth of the solve of an arm."""
        return partial(_on_batch(solve_lanes, _kind(self._batch), _LEFT), *self._batch)


def step_range(kernels: Kernels, batch: Any, friction: FrictionArrays, first: int, last: int) -> None:
    """Solve the steps with friction of rows first to last - 1; Python's lock is released meanwhile."""
    is_long = batch.starts.shape[1] > kernels.most_with_friction
    if is_long or _on_batch(kernels.step, _kind(batch), FrictionArrays, int, int)(*batch, friction, first, last):
        remaining = _left(batch, first, last, is_long)
        _on_batch(step_lanes, _kind(batch), FrictionArrays, _LEFT)(*batch, friction, remaining)


class PinnedAmongWalls:
    """Solves ranges of rows among walls, without friction, of arrays that stay where they are, as PinnedRange does.

    Kernels call it by call_range(entry, pins, PinnedAmong, first, last). In space there are no lanes.
    """

    def __init__(self, batch: Any, walls: Any) -> None:
        self._batch, self._walls, self._is_long = batch, walls, batch.starts.shape[1] > MOST_JOINTS
        if not isinstance(walls, WallArrays):
            self._is_long, self.entry, self.pins = True, 0, 0
            return
        alone = len(batch.starts) == 1 and not self._is_long
        memory = memory_among_walls(batch, walls) if alone else np.zeros(0)
        self._pinned, self.entry = Pinned(PinnedAmong(batch, walls, memory)), 0
        self.pins = self._pinned.address_for(PinnedAmong)
        if not self._is_long:
            self.entry = entry_address(solve_among_in_lane, int, int, int)
            self._solve = machine_code(solve_among_in_lane, int, int, int)

    def __call__(self, first: int, last: int) -> None:
        """Solve rows first to last - 1; Python's lock is released meanwhile."""
        if self._is_long or self._solve(self.pins, first, last):
            self.solve_the_rest(first, last)

    def solve_the_rest(self, first: int, last: int) -> None:
        """Solve the rows that `entry` has left among first to last - 1."""
        rows = _left(self._batch, first, last, self._is_long)
        _on_batch(solve_among_walls, _kind(self._batch), _kind(self._walls), _LEFT)(*self._batch, self._walls, rows)


def range_among_walls(batch: Any, walls: Any, first: int, last: int) -> None:
    """Solve rows first to last - 1 among walls, without friction; Python's lock is released meanwhile.

    On the same arrays again, PinnedAmongWalls takes less time.
    """
    PinnedAmongWalls(batch, walls)(first, last)


def step_range_among_walls(batch: Any, friction: FrictionArrays, walls: Any, first: int, last: int) -> None:
    """Solve the steps with friction of rows first to last - 1 among walls; Python's lock is released meanwhile."""
    step = _on_batch(step_among_walls, _kind(batch), FrictionArrays, _kind(walls), _LEFT)
    step(*batch, friction, walls, np.arange(first, last))


def begin_range(batch: Any, friction: FrictionArrays, first: int, last: int) -> None:
    """Fill the histories of rows first to last - 1: at `starts` under the lowest tensions, before any slip."""
    rows, (law, history) = slice(first, last), histories_of(friction, first, last)
    begin_histories(batch.chain, batch.designs[rows], law, batch.laws.low[rows], batch.starts[rows], history)


def stiffnesses(kernels: Kernels, batch: Any, friction: FrictionArrays | None = None) -> tuple[Array, Array]:
    """Stiffness (B, J, J) [N·mm/rad] and d residual / d tension (B, J, m) [mm] of the solved rows.

    With friction, after the steps that left its histories: holes that stick go on sticking, the others sliding.
    """
    results, H = batch.results, np.empty((*batch.starts.shape, batch.starts.shape[1]))
    torques = getattr(results, kernels.torques)
    designs = batch.chain, batch.designs
    state = results.tensions, results.elastic, batch.loads, results.joint_angles
    if friction is None:
        stiffness_of(*designs, *state, H)
        return H, torques
    torques = np.empty_like(torques)
    rubbed_stiffness_of(*designs, friction.law, *state, friction.after, H, torques)
    return H, torques


def free_joints(batch: Any) -> NDArray[np.bool_]:
    """False where a joint of a solved row is at its limit, (B, J)."""
    low, high = np.moveaxis(batch.chain.joints[batch.designs, :, :2], -1, 0)
    return strictly_within(batch.results.joint_angles, low, high)


def tip_rates(kernels: Kernels, batch: Any) -> Array:
    """d tip / d joint angle of solved rows of chains in space, (B, 3, J) [mm/rad]."""
    poses, axes = batch.results.poses, batch.chain.axes[batch.designs]
    turning = (poses[:, :-1, :3, :3] @ axes[..., None])[..., 0]
    return np.swapaxes(np.cross(turning, poses[:, -1:, :3, 3] - pivots_of(kernels, batch.results)), 1, 2)


def pivots_of(kernels: Kernels, results: Any) -> Array:
    """Points about which the joints of chains in space turn, (B, J, 3) [mm]."""
    pivots: Array = getattr(results, kernels.pivots) if kernels.pivots else results.poses[:, :-1, :3, 3]
    return pivots


def solve_batch(
    kind: type[AnyChain],
    mechanism: Any,
    chain: Any,
    designs: NDArray[np.int64],
    laws: TendonLaw,
    tables: Array,
    starts: Array,
    walls: Any = None,
) -> Any:
    """The equilibria of a batch of mechanisms of one class, unchecked.

    Args:
        kind: the class. mechanism: one, or one per row.
        chain, designs, laws, tables, starts: as in Kernels.batch_arrays.
        walls: around the rows.
    """
    arrays = _new_batch(kind, chain, designs, laws, tables, starts)
    if walls is not None:
        run_in_threads(PinnedAmongWalls(arrays, walls), len(starts), starts.shape[1], abandon=True)
        return kind.equilibrium.of_results(mechanism, tables, arrays.results, walls=WallStep.of(walls, False))
    run_in_threads(PinnedRange(kind.kernels, arrays), len(starts), starts.shape[1], abandon=True)
    return kind.equilibrium.of_results(mechanism, tables, arrays.results)


def step_batch(
    kind: type[AnyChain],
    mechanism: Any,
    chain: Any,
    designs: NDArray[np.int64],
    laws: TendonLaw,
    tables: Array,
    starts: Array,
    before: FrictionState,
    friction: FrictionLaw | None = None,
    walls: Any = None,
) -> Any:
    """The equilibria of a batch of steps with friction; the first arguments as of `solve_batch`.

    before: histories of all rows; friction: their coefficients, default the mechanisms'; walls: around the rows. Given
    both, the walls are all that rubs.
    """
    arrays = _new_batch(kind, chain, designs, laws, tables, starts)
    law = friction or friction_laws(mechanism, len(starts))
    steps = new_friction_arrays(law, History(*before))
    if walls is not None:
        work = partial(step_range_among_walls, arrays, steps, walls)
        run_in_threads(work, len(starts), starts.shape[1], abandon=True)
        step = FrictionStep.of(steps) if friction is None else None
        return kind.equilibrium.of_results(mechanism, tables, arrays.results, step, WallStep.of(walls, True))
    work = partial(step_range, kind.kernels, arrays, steps)
    run_in_threads(work, len(starts), starts.shape[1], abandon=True)
    return kind.equilibrium.of_results(mechanism, tables, arrays.results, FrictionStep.of(steps))


def solve_one(
    mechanism: AnyChain,
    law: TendonLaw,
    table: Array,
    start: Array,
    before: FrictionState | None = None,
    walls: Any = None,
) -> Any:
    """The equilibrium of one mechanism, unchecked; `before` makes it a step with friction.

    law: (m,) each; table: (rows, columns); start: (n - 1,) [rad]; walls: of one row.
    """
    laws = TendonLaw(*(values[None] for values in law))
    inputs = type(mechanism), mechanism, mechanism.arrays, _FIRST, laws, table[None], start[None]
    if before is None:
        return solve_batch(*inputs, walls).row(0)
    return step_batch(*inputs, FrictionState(*(array[None] for array in before)), walls=walls).row(0)


def _new_batch(
    kind: type[AnyChain], chain: Any, designs: NDArray[np.int64], laws: TendonLaw, tables: Array, starts: Array
) -> Any:
    """The arrays of a batch, with room for its results."""
    results = kind.kernels.new_results(len(starts), starts.shape[1], laws.low.shape[1])
    return kind.kernels.batch_arrays(chain, designs, laws, tables, starts, results)


def _kind(batch: Any) -> Any:
    """Its class."""
    return type(batch)


@functools.cache
def _on_batch(kernel: Any, kind: Any, *kinds: Any) -> Callable[..., Any]:
    """The machine code of a kernel of the fields of a class of batches, and of arguments of these kinds after them."""
    return machine_code(kernel, *fields(kind), *kinds)


def _left(batch: Any, first: int, last: int, everything: bool) -> NDArray[np.int64]:
    """The rows that are left to the general solver."""
    rows = np.arange(first, last)
    return rows if everything else rows[batch.results.status[first:last] == PENDING]
