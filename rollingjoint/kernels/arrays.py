"""Arrays and numbers of every kernel: status codes, the tendon law, the tolerances by which iterations stop."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint._numba.jit import part
from rollingjoint._numba.layout import Floats

_MANY_LANES = 1024

# Status codes, the values of chain.status.Status
CONVERGED, AT_LIMIT, INDETERMINATE, UNSTABLE, NOT_CONVERGED, INVALID_INPUT, NO_ROOM, PASSED_THROUGH = range(8)


class TendonLaw(NamedTuple):
    """tension = clip(stiffness (length - command), low, high); low = high prescribes the tension."""

    command: Annotated[Floats, "m"]
    stiffness: Annotated[Floats, "m"]
    low: Annotated[Floats, "m"]
    high: Annotated[Floats, "m"]


def empty_arrays(shapes: Sequence[tuple[int, ...]], n_lanes: int) -> list[np.ndarray]:
    """Empty arrays of floats; for many lanes in one allocation: large memory comes in large pages, much faster."""
    if n_lanes < _MANY_LANES:
        return [np.empty(shape) for shape in shapes]
    ends = list(itertools.accumulate(math.prod(shape) for shape in shapes))
    memory = np.empty(ends[-1])
    return [memory[end - math.prod(shape) : end].reshape(shape) for shape, end in zip(shapes, ends, strict=True)]


LARGEST_INPUT = 1e12  # beyond it (or NaN) an input cannot be resolved
RESIDUAL_LIMIT = 1e-8  # N·mm: no result above it is called converged
RESIDUAL_GOAL = 1e-9  # N·mm: where iteration stops; smaller for small forces
RESIDUAL_FLOOR = 1e-12
RELATIVE_GOAL = 1e-11  # of the force scale
NEGLIGIBLE = 1e-8  # N·mm/rad: without a stiffness above it the pose is indeterminate
SMALLEST_PIVOT = 1e-10  # of the largest entry: a stiffness with smaller ones is not positive definite
MAX_STEP = 0.5  # rad in any joint
ROUNDING = 1e-14  # of the magnitude of the energy terms


@part(inline=True)
def resolvable(value):
    """True for finite values up to LARGEST_INPUT."""
    return abs(value) <= LARGEST_INPUT


@part
def all_resolvable(values):
    """`resolvable` of every value."""
    for i in range(values.size):
        if not resolvable(values[i]):
            return False
    return True
