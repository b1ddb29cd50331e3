"""The walk solved by the bare kernel: the limit that figures of the speed page stand beside."""

from __future__ import annotations

from functools import partial
from typing import Annotated

import numpy as np

from rollingjoint._numba.jit import machine_code
from rollingjoint._numba.layout import Floats
from rollingjoint.threads import run_in_threads
from speed_rows.bare_kernel import N_COLUMNS, SOLUTION, Bare, bare, solve_one, solve_range
from speed_rows.walk import TENSION_LIMITS, Array, Walk

_KINDS = (
    Annotated[Floats, "joints", "cells", 2, 8],
    Annotated[Floats, "joints", 3],
    Annotated[Floats, 5],
    Annotated[Floats, "K", N_COLUMNS],
)


AGREEMENT = 1e-8  # rad: what the tables of cubics leave


class BareWalk:
    """The walk, or as many lanes of it, over and over, prepared once for the bare kernel.

    Raises:
        RuntimeError: the bare kernel has not the library's answers. Without a line search there are walks in which it
            jumps to and fro between a taut and a slack tendon, and what it does not solve is no limit.
    """

    def __init__(self, walk: Walk, lanes: int | None = None) -> None:
        found = np.array([equilibrium.joint_angles for equilibrium in walk.equilibria])
        self._count = len(walk) if lanes is None else lanes
        steps = np.arange(self._count) % len(walk)
        self._rows = np.full((self._count, N_COLUMNS), np.nan)
        self._rows[:, :SOLUTION] = np.concatenate([walk.starts, walk.commands, walk.forces], axis=1)[steps]
        known: Bare = bare(walk.mechanism, np.concatenate([walk.starts, found]), TENSION_LIMITS)
        self._solve_one = partial(machine_code(solve_one, *_KINDS, int), *known, self._rows)
        self._solve_range = partial(machine_code(solve_range, *_KINDS, int, int), *known, self._rows)
        self._compare(found[steps])

    @property
    def joint_angles(self) -> Array:
        """The answers, (lanes, 4) [rad]."""
        return self._rows[:, SOLUTION:]

    def _compare(self, expected: Array) -> None:
        self.side_by_side()
        away = np.abs(self.joint_angles - expected).max(axis=1)
        wrong = np.flatnonzero(~(away < AGREEMENT))  # NaN is wrong, too
        if wrong.size:
            text = f"the bare kernel misses {wrong.size} of {self._count} answers, the first in row {wrong[0]}"
            raise RuntimeError(text)
        self.joint_angles[:] = np.nan

    def one_by_one(self) -> int:
        """Solve the rows one after the other, a call each; returns the steps of all."""
        return sum(map(self._solve_one, range(self._count)))

    def side_by_side(self) -> int:
        """Solve all rows in one call; returns the steps of all."""
        return int(self._solve_range(0, self._count))

    def batch(self) -> None:
        """Solve all rows on as many threads as the library."""
        run_in_threads(self._solve_range, self._count, self._rows.shape[1] - SOLUTION)
