"""Equilibria of many lanes into arrays that the caller keeps: what the solvers and the environments share.

Nothing is checked here; `rollingjoint.statics.solve` is the front door.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from rollingjoint._numba.borrowed import pin
from rollingjoint._numba.jit import direct, entry_address, machine_code
from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.planar.arrays import Chain, Results, aligned, new_results
from rollingjoint.kernels.planar.batch import solve_lanes
from rollingjoint.kernels.planar.side_by_side import MOST_JOINTS, PENDING, solve_pinned, solve_side_by_side
from rollingjoint.kernels.shared.arrays import TendonLaw
from rollingjoint.planar.chain import RollingChain

Array = NDArray[np.float64]
_T = TypeVar("_T")

__all__ = [
    "PENDING",
    "Chain",
    "PinnedRange",
    "Problem",
    "Results",
    "TendonLaw",
    "designs_of",
    "distinct",
    "new_results",
    "solve_range",
    "stack",
]


def stack(mechanisms: Sequence[RollingChain]) -> Chain:
    """The arrays of several mechanisms as one stack; lanes choose theirs by its index.

    Raises:
        InvalidInput: mechanisms whose numbers of links, of tendons or of joints that a tendon crosses differ.
    """
    if len(mechanisms) == 1:
        return mechanisms[0].arrays
    parts = [mechanism.arrays for mechanism in mechanisms]
    for mechanism, part in zip(mechanisms, parts, strict=True):
        alike = part.holes.shape == parts[0].holes.shape and np.array_equal(part.tendon_joints, parts[0].tendon_joints)
        if not alike:
            raise InvalidInput(
                "mechanism", mechanism, "as many links and tendons, crossing as many joints, as the first"
            )
    before = np.cumsum([0] + [len(part.cells) for part in parts[:-1]])
    rows = max(part.standing.shape[1] for part in parts)
    parts = [part._replace(standing=_with_rows(part.standing, rows)) for part in parts]
    joined = Chain(*(aligned(np.concatenate(arrays)) for arrays in zip(*parts, strict=True)))
    return joined._replace(buckets=joined.buckets + before[:, None, None], tendon_joints=parts[0].tendon_joints)


def _with_rows(tables: Array, count: int) -> Array:
    """Load tables (D, rows, columns) with rows of zeros, which do nothing, up to a count."""
    return np.pad(tables, ((0, 0), (0, count - tables.shape[1]), (0, 0)))


def distinct(mechanisms: Sequence[_T]) -> tuple[_T, ...]:
    """The different ones of the mechanisms, in the order in which they come first."""
    return tuple(dict.fromkeys(mechanisms))


def designs_of(mechanism: RollingChain | Sequence[RollingChain], n_lanes: int) -> tuple[Chain, NDArray[np.int64]]:
    """The arrays of the distinct mechanisms as one stack, and which of them each lane has, (B,).

    Raises:
        InvalidInput: more or fewer than one mechanism per lane, or what `stack` refuses.
    """
    if isinstance(mechanism, RollingChain):
        return mechanism.arrays, np.zeros(n_lanes, np.int64)
    if len(mechanism) != n_lanes:
        raise InvalidInput("number of mechanisms", len(mechanism), f"{n_lanes}, one per lane")
    different = distinct(mechanism)
    places = {each: place for place, each in enumerate(different)}
    return stack(different), np.array([places[each] for each in mechanism], np.int64)


class Problem(NamedTuple):
    """Equilibria to be solved, and where they go; all arrays contiguous.

    Args:
        chain: from `stack`.
        designs: which of the stacked mechanisms each lane has, (B,).
        laws: tendon laws, (B, m) each.
        loads: load tables, (B, rows, columns).
        starts: joint angles to start from, (B, J) [rad].
        results: from `new_results(B, J, m)`.
    """

    chain: Chain
    designs: NDArray[np.int64]
    laws: TendonLaw
    loads: Array
    starts: Array
    results: Results


def solve_range(problem: Problem, first: int, last: int) -> None:
    """Solve lanes first to last - 1; Python's lock is released meanwhile."""
    everything = problem.starts.shape[1] > MOST_JOINTS
    if everything or direct(solve_side_by_side, *problem, first, last):
        _solve_the_rest(problem, first, last, everything)


class PinnedRange:
    """`solve_range` on arrays that stay where they are, for callers that come back: only what is in them changes.

    Kernels call it by `entry(pins, first, last)` (borrowed.call_range), which returns how many lanes it leaves to
    `solve_the_rest`. `entry` is 0 where those are all of them.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        chain, designs, laws, loads, starts, results = problem
        self._addresses = pin(*chain, designs, *laws, loads, starts, *results)
        self._long = starts.shape[1] > MOST_JOINTS
        self.pins = self._addresses.ctypes.data
        self.entry = 0 if self._long else entry_address(solve_pinned, self.pins, 0, 0)
        self._solve = partial(machine_code(solve_pinned, self.pins, 0, 0), self.pins)

    def __call__(self, first: int, last: int) -> None:
        """Solve lanes first to last - 1."""
        if self._long or self._solve(first, last):
            self.solve_the_rest(first, last)

    def solve_the_rest(self, first: int, last: int) -> None:
        """Solve those of the lanes first to last - 1 that `entry` has left."""
        _solve_the_rest(self._problem, first, last, self._long)


def _solve_the_rest(problem: Problem, first: int, last: int, everything: bool) -> None:
    """Solve the lanes that are left to the solver for all cases."""
    lanes = np.arange(first, last)
    left = lanes if everything else lanes[problem.results.status[first:last] == PENDING]
    direct(solve_lanes, *problem, left)
