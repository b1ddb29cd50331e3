"""The base class of all equilibria: status, stiffness and stability."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.errors import SolverError
from rollingjoint.mechanism import designs_of

Array = NDArray[np.float64]


class Status(IntEnum):
    """How a solve ended."""

    CONVERGED = 0
    AT_LIMIT = 1
    INDETERMINATE = 2
    UNSTABLE = 3
    NOT_CONVERGED = 4
    INVALID_INPUT = 5

    @property
    def message(self) -> str:
        """What it means and what to do, one line."""
        return _MESSAGES[self]

    @staticmethod
    def usable(status: ArrayLike) -> NDArray[np.bool_]:
        """True where the result is a stable equilibrium, at a joint limit or not."""
        return np.asarray(status) <= Status.AT_LIMIT


_MESSAGES = {
    Status.CONVERGED: "stable equilibrium",
    Status.AT_LIMIT: "equilibrium with a joint at its limit, as at the end of a surface: a stop would have to hold it",
    Status.INDETERMINATE: "slack: nothing holds some joints; the pose is the admissible one nearest the start",
    Status.UNSTABLE: "unstable equilibrium: the smallest eigenvalue of the stiffness is negative",
    Status.NOT_CONVERGED: "not converged: the residual is above 1e-8 N·mm; try another start or smaller loads",
    Status.INVALID_INPUT: "invalid numbers: NaN, beyond 1e12, a pushing tendon, a negative spring; returned the start",
}

_FAR = 1e15  # eigenvalue assigned to joints that are held


@dataclass(frozen=True, eq=False, repr=False)
class Solution(ABC):
    """One equilibrium, or many with a leading axis B on every array; each family adds to it.

    Attributes:
        mechanism: what was solved, or a tuple of mechanisms, one per row.
        loads: load table, (rows, columns), columns of the family.
        joint_angles: (n - 1,) angle of every joint [rad].
        poses: of every link in the base frame: (n, 3) x, y, angle [mm, rad], or (n, 4, 4) frames [mm].
        tensions: (m,) [N]. lengths: (m,) tendon lengths [mm].
        tendon_rates: (n - 1, m) d length / d joint angle [mm/rad].
        tendon_stiffness: (m,) d tension / d length [N/mm]: zero for a prescribed tension, a slack or a yielding tendon.
        residual: largest joint moment that is not balanced, joints at their limit left out [N·mm].
        iterations: Newton steps. status: Status, or (B,) integers.
    """

    mechanism: Any
    loads: Array
    joint_angles: Array
    poses: Array
    tensions: Array
    lengths: Array
    tendon_rates: Array
    tendon_stiffness: Array
    residual: float | Array
    iterations: int | NDArray[np.int64]
    status: Status | NDArray[np.int64]

    @property
    def ok(self) -> bool | NDArray[np.bool_]:
        """True for a stable equilibrium (Status CONVERGED or AT_LIMIT)."""
        usable = Status.usable(self.status)
        return bool(usable) if usable.ndim == 0 else usable

    @property
    @abstractmethod
    def tip(self) -> Array:
        """Origin of the last link, (2,) or (3,) [mm]."""

    @property
    @abstractmethod
    def pose_jacobian(self) -> Array:
        """(n, 3 or 6, n - 1) d link poses / d joint angles [mm/rad, 1]."""

    @property
    def torques_per_tension(self) -> Array:
        """(n - 1, m) d residual / d tension [mm]: the rates of the lengths, where tendons have an energy."""
        return self.tendon_rates

    @abstractmethod
    def point_jacobian(self, link: int, point: Sequence[float] | None = None) -> Array:
        """(3 or 6, n - 1) d pose of a frame at a body point [mm], default the link's origin, / d joint angles."""

    @cached_property
    def free_joints(self) -> NDArray[np.bool_]:
        """(n - 1,) False where a joint is at its limit."""
        chain, designs = self._designs
        low, high = np.moveaxis(chain.joints[designs, :, :2], -1, 0).reshape(2, *self.joint_angles.shape)
        return (self.joint_angles > low + 1e-12) & (self.joint_angles < high - 1e-12)

    @cached_property
    def stiffness(self) -> Array:
        """(n - 1, n - 1) d residual / d joint angle, tendon stretch included for given lengths [N·mm/rad]."""
        known = np.asarray(self.status) != Status.INVALID_INPUT
        loads = np.where(known[..., None, None], self.loads, 0.0)
        angles = self._rows(self.joint_angles)
        H = np.empty((*angles.shape, angles.shape[1]))
        tendons = self._rows(self.tensions), self._rows(self.tendon_stiffness)
        self._fill_stiffness(*self._designs, *tendons, self._rows(loads, axes=2), angles, H)
        return H.reshape(*self.joint_angles.shape, angles.shape[1])

    @cached_property
    def smallest_eigenvalue(self) -> float | Array:
        """Smallest real part of the eigenvalues of the stiffness over the free joints [N·mm/rad]; inf if none is free.

        Positive: stable; its size is the distance from snap-through.
        """
        free = self.free_joints
        masked = np.where(free[..., :, None] & free[..., None, :], self.stiffness, 0.0)
        values = np.linalg.eigvals(masked + np.eye(free.shape[-1]) * np.where(free, 0.0, _FAR)[..., None, :])
        smallest = values.real.min(axis=-1)
        smallest = np.where(free.any(axis=-1), smallest, np.inf)
        return float(smallest) if smallest.ndim == 0 else smallest

    def require(self) -> Self:
        """This equilibrium.

        Raises:
            SolverError: when it is not a stable equilibrium.
        """
        if not np.all(self.ok):
            statuses = sorted({Status(code) for code in np.ravel(self.status)} - {Status.CONVERGED, Status.AT_LIMIT})
            raise SolverError("; ".join(f"{status.name}: {status.message}" for status in statuses))
        return self

    def __repr__(self) -> str:
        kind = type(self).__name__
        name = repr("several mechanisms" if isinstance(self.mechanism, tuple) else self.mechanism.name)
        if np.ndim(self.status):
            codes, counts = np.unique(self.status, return_counts=True)
            found = ", ".join(f"{n} {Status(code).name}" for code, n in zip(codes, counts, strict=True))
            return f"<{kind} of {name}, {np.size(self.status)} rows: {found or 'none'}>"
        point = ", ".join(f"{x:.3f}" for x in self.tip)
        return f"<{kind} of {name}: {Status(int(self.status)).name}, tip at ({point}) mm>"

    @cached_property
    def _designs(self) -> tuple[Any, NDArray[np.int64]]:
        """The arrays of the mechanisms, and which of them each row has."""
        return designs_of(self.mechanism, np.size(self.status))

    @staticmethod
    @abstractmethod
    def _fill_stiffness(*arguments: Any) -> None:
        """The family's kernel: (chain, designs, tensions, elastic, loads, angles, H)."""

    def _rows(self, values: Array, axes: int = 1) -> Array:
        """A copy with a leading axis of rows, in the form that kernels are compiled for."""
        return np.array(values, float, order="C").reshape(np.size(self.status), *values.shape[values.ndim - axes :])
