"""Arrays and codes that both families share: status codes and the tendon law."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint._numba.layout import Floats

_MANY_LANES = 1024

# Status codes, the values of solution.Status
CONVERGED, AT_LIMIT, INDETERMINATE, UNSTABLE, NOT_CONVERGED, INVALID_INPUT = range(6)


class TendonLaw(NamedTuple):
    """tension = clip(stiffness (length - command), low, high); low = high prescribes the tension."""

    command: Annotated[Floats, "m"]
    stiffness: Annotated[Floats, "m"]
    low: Annotated[Floats, "m"]
    high: Annotated[Floats, "m"]


def empty_arrays(shapes: Sequence[tuple[int, ...]], n_lanes: int) -> list[np.ndarray]:
    """Empty arrays of floats; those of many lanes in one allocation: large memory comes in large pages, much faster."""
    if n_lanes < _MANY_LANES:
        return [np.empty(shape) for shape in shapes]
    ends = list(itertools.accumulate(math.prod(shape) for shape in shapes))
    memory = np.empty(ends[-1])
    return [memory[end - math.prod(shape) : end].reshape(shape) for shape, end in zip(shapes, ends, strict=True)]
