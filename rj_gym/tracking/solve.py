"""Batches of equilibria whose lanes may have different mechanisms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint.equilibrium import Equilibrium
from rollingjoint.load import LOAD_COLUMNS
from rollingjoint.rolling_chain import RollingChain

Array = NDArray[np.float64]

_LINK, _FX, _FY = (LOAD_COLUMNS.index(name) for name in ("link", "fx", "fy"))


class Solved(NamedTuple):
    """The parts of a batch of equilibria that the task needs; names and shapes as in Equilibrium."""

    joint_angles: Array
    poses: Array
    tensions: Array
    lengths: Array
    status: NDArray[np.int64]


def solve_each(mechanisms: Sequence[RollingChain], solve: Callable[[RollingChain, slice], Equilibrium]) -> Solved:
    """`solve(mechanism, rows)` for all lanes: one call where they share the mechanism, else one call per lane."""
    if all(mechanism is mechanisms[0] for mechanism in mechanisms):
        return _parts(solve(mechanisms[0], slice(None)))
    lanes = [_parts(solve(mechanism, slice(i, i + 1))) for i, mechanism in enumerate(mechanisms)]
    return Solved(*(np.concatenate(part) for part in zip(*lanes, strict=True)))


def _parts(equilibria: Equilibrium) -> Solved:
    return Solved(*(np.asarray(getattr(equilibria, name)) for name in Solved._fields))


def force_table(links: NDArray[np.int64], forces: Array) -> Array:
    """Load table of one dead force (B, 2) [N] at the origin of one link (B,) per lane, (B, 1, 11)."""
    table = np.zeros((len(links), 1, len(LOAD_COLUMNS)))
    table[:, 0, _LINK] = links
    table[:, 0, _FX : _FY + 1] = forces
    return table
