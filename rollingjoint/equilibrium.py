"""Equilibria: what a solve returns, and how it ended."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint._kernels.batch import Results, stiffness_of
from rollingjoint.errors import SolverError
from rollingjoint.rolling_chain import RollingChain

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
        """True where the result is a stable equilibrium, at a surface limit or not."""
        return np.asarray(status) <= Status.AT_LIMIT


_MESSAGES = {
    Status.CONVERGED: "stable equilibrium",
    Status.AT_LIMIT: "equilibrium with a contact at the end of its surface: a stop would have to hold that joint",
    Status.INDETERMINATE: "slack: nothing holds some joints; the pose is the admissible one nearest the start",
    Status.UNSTABLE: "unstable equilibrium: the smallest eigenvalue of the stiffness is negative",
    Status.NOT_CONVERGED: "not converged: the residual is above 1e-8 N·mm; try another start or smaller loads",
    Status.INVALID_INPUT: "invalid numbers: NaN, beyond 1e12, a pushing tendon, a negative spring; returned the start",
}


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """One equilibrium, or many with a leading axis B on every array.

    Attributes:
        mechanism: the chain that was solved.
        loads: load table, (rows, 11), columns load.LOAD_COLUMNS.
        joint_angles: (n - 1,) relative angle of every joint [rad].
        arc_lengths: (n - 1,) contact point on both surfaces [mm].
        poses: (n, 3) x, y, angle of every link in the base frame [mm, rad].
        contact_points, contact_tangents: (n - 1, 2) contact and unit tangent there, base frame [mm].
        tensions: (m,) [N]. lengths: (m,) tendon lengths [mm].
        tendon_rates: (n - 1, m) d length / d joint angle [mm/rad].
        tendon_stiffness: (m,) d tension / d length [N/mm]: zero for a prescribed tension, a slack or a yielding tendon.
        contact_forces: (n - 1, 2) on the distal link, along the child surface's tangent and normal [N].
        residual: largest joint moment that is not balanced, joints at a surface limit left out [N·mm].
        iterations: Newton steps. status: Status, or (B,) integers.
    """

    mechanism: RollingChain
    loads: Array
    joint_angles: Array
    arc_lengths: Array
    poses: Array
    contact_points: Array
    contact_tangents: Array
    tensions: Array
    lengths: Array
    tendon_rates: Array
    tendon_stiffness: Array
    contact_forces: Array
    residual: float | Array
    iterations: int | NDArray[np.int64]
    status: Status | NDArray[np.int64]

    def __repr__(self) -> str:
        name = self.mechanism.name
        if np.ndim(self.status):
            codes, counts = np.unique(self.status, return_counts=True)
            found = ", ".join(f"{n} {Status(code).name}" for code, n in zip(codes, counts, strict=True))
            return f"<Equilibrium of {name!r}, {len(self.poses)} lanes: {found or 'none'}>"
        x, y = self.tip
        return f"<Equilibrium of {name!r}: {Status(int(self.status)).name}, tip at ({x:.3f}, {y:.3f}) mm>"

    @property
    def ok(self) -> bool | NDArray[np.bool_]:
        """True for a stable equilibrium (Status CONVERGED or AT_LIMIT)."""
        usable = Status.usable(self.status)
        return bool(usable) if usable.ndim == 0 else usable

    @property
    def tip(self) -> Array:
        """Origin of the last link, (2,) [mm]."""
        return self.poses[..., -1, :2]

    @cached_property
    def free_joints(self) -> NDArray[np.bool_]:
        """(n - 1,) False where the contact is at the end of a surface."""
        low, high = self.mechanism.joint_limits.T
        return (self.arc_lengths > low + 1e-9) & (self.arc_lengths < high - 1e-9)

    @cached_property
    def stiffness(self) -> Array:
        """(n - 1, n - 1) d residual / d joint angle, tendon stretch included for given lengths [N·mm/rad]."""
        n_joints = self.mechanism.n_joints
        lanes = np.size(self.status)
        known = np.asarray(self.status) != Status.INVALID_INPUT
        loads = np.where(known[..., None, None], self.loads, 0.0)
        H = np.empty((*self.joint_angles.shape[:-1], n_joints, n_joints))
        stiffness_of(
            self.mechanism.arrays,
            self.tensions.reshape(lanes, -1),
            self.tendon_stiffness.reshape(lanes, -1),
            loads.reshape(lanes, *loads.shape[-2:]),
            self.arc_lengths.reshape(lanes, n_joints),
            H.reshape(lanes, n_joints, n_joints),
        )
        return H

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

    @property
    def pressing_margins(self) -> Array:
        """(n - 1,) normal contact force [N]: negative means that the links would separate."""
        return self.contact_forces[..., 1]

    def slip_margins(self, friction: float = 0.3) -> Array:
        """(n - 1,) friction × normal - |tangential| contact force [N]: negative means that the links would slip."""
        return friction * self.contact_forces[..., 1] - np.abs(self.contact_forces[..., 0])

    def require(self) -> Equilibrium:
        """This equilibrium.

        Raises:
            SolverError: when it is not a stable equilibrium.
        """
        if not np.all(self.ok):
            statuses = sorted({Status(code) for code in np.ravel(self.status)} - {Status.CONVERGED, Status.AT_LIMIT})
            raise SolverError("; ".join(f"{status.name}: {status.message}" for status in statuses))
        return self


_FAR = 1e15  # eigenvalue given to joints that are held


def pack(mechanism: RollingChain, table: Array, results: Results) -> Equilibrium:
    """The equilibria in the results of the kernels, or the one in a single lane of them."""
    one = np.ndim(results.status) == 0
    return Equilibrium(
        mechanism=mechanism,
        loads=table,
        joint_angles=results.joint_angles,
        arc_lengths=results.arc_lengths,
        poses=results.poses,
        contact_points=results.contacts[..., :2],
        contact_tangents=results.contacts[..., 2:],
        tensions=results.tensions,
        lengths=results.lengths,
        tendon_rates=results.rates,
        tendon_stiffness=results.elastic,
        contact_forces=results.contact_forces,
        residual=float(results.residual) if one else results.residual,
        iterations=int(results.iterations) if one else results.iterations,
        status=Status(int(results.status)) if one else results.status,
    )


def pack_one(mechanism: RollingChain, table: Array, results: Results) -> Equilibrium:
    """The single lane of results, without its leading axis."""
    return pack(mechanism, table, Results(*(array[0] for array in results)))
