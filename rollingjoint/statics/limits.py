"""Limits of tendon tensions as callers give them, checked."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.checks import as_floats
from rollingjoint.errors import InvalidInput

Array = NDArray[np.float64]


def broadcast_limits(limits: tuple[ArrayLike, ArrayLike], n_tendons: int) -> tuple[ArrayLike, ArrayLike]:
    """`tension_limits_of` to be broadcast: two floats, the usual ones, stay as they are, in a fifth of the time."""
    if type(limits) is tuple and len(limits) == 2 and type(limits[0]) is float and type(limits[1]) is float:
        return limits
    low, high = tension_limits_of(limits, n_tendons)
    return low, high


def tension_limits_of(limits: tuple[ArrayLike, ArrayLike], n_tendons: int) -> Array:
    """Minimum and maximum tension of every tendon, (2, m) [N]; InvalidInput for anything else."""
    both = np.empty((2, n_tendons))
    allowed = f"(lowest, highest), numbers or {n_tendons} values each"
    try:
        for side, values in zip(both, limits, strict=True):
            array = as_floats("tension_limits", values, allowed)
            if array.shape not in ((), (n_tendons,)):
                raise InvalidInput("tension_limits", limits, allowed)
            side[:] = array
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput("tension_limits", limits, allowed) from None
    return both
