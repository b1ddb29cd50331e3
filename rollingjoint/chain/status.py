"""How a solve ended."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray


class Status(IntEnum):
    """How a solve ended."""

    CONVERGED = 0
    AT_LIMIT = 1
    INDETERMINATE = 2
    UNSTABLE = 3
    NOT_CONVERGED = 4
    INVALID_INPUT = 5
    NO_ROOM = 6
    PASSED_THROUGH = 7

    @property
    def message(self) -> str:
        """Meaning and remedy, one line."""
        return _MESSAGES[self]

    @staticmethod
    def usable(status: ArrayLike) -> NDArray[np.bool_]:
        """True where the result is a stable equilibrium, at a joint limit or not."""
        return codes_of(status) <= int(Status.AT_LIMIT)


def codes_of(status: ArrayLike) -> NDArray[np.int64]:
    """Statuses as integers, () of a single one.

    NumPy would ask the class of an enum for attributes, and drop whatever is raised meanwhile: in Python 3.11, where
    that runs Python code, a Ctrl-C too.
    """
    return np.asarray(int(status) if isinstance(status, Status) else status)


_MESSAGES = {
    Status.CONVERGED: "stable equilibrium",
    Status.AT_LIMIT: "equilibrium with a joint at its limit, as at the end of a surface: a stop would have to hold it",
    Status.INDETERMINATE: "slack: nothing holds some joints; the pose is the admissible one nearest the start",
    Status.UNSTABLE: "unstable equilibrium: the smallest eigenvalue of the stiffness is negative",
    Status.NOT_CONVERGED: "not converged: a residual above 1e-8 N·mm, or follower forces on over 1,000 joints; "
    "try another start or smaller loads",
    Status.INVALID_INPUT: "invalid numbers: NaN, beyond 1e12, a pushing tendon, a negative spring; returned the start",
    Status.NO_ROOM: "no room: rigid walls cannot all be kept out of; the pose that enters them least",
    Status.PASSED_THROUGH: "passed through a wall: the step ends beyond it, also in smaller parts; take smaller steps",
}

STATUSES = tuple(Status)
"""Every status at the place of its number: a look-up takes a tenth of Status(number)."""
