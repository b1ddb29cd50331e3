"""Arrays and codes that both families share: status codes and the tendon law."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import part

# Status codes, the values of solution.Status
CONVERGED, AT_LIMIT, INDETERMINATE, UNSTABLE, NOT_CONVERGED, INVALID_INPUT = range(6)


class TendonLaw(NamedTuple):
    """tension = clip(stiffness (length - command), low, high); low = high prescribes the tension."""

    command: np.ndarray  # (m,)
    stiffness: np.ndarray  # (m,)
    low: np.ndarray  # (m,)
    high: np.ndarray  # (m,)


@part(inline=True)
def borrow_law(law):
    """The law, or laws, without reference counts."""
    return TendonLaw(borrow(law.command), borrow(law.stiffness), borrow(law.low), borrow(law.high))
