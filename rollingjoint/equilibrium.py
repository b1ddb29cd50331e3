"""Equilibria: what a solve returns, and how it ended."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint._kernels.batch import stiffness_of
from rollingjoint._kernels.forward import arc_lengths_of
from rollingjoint.errors import InvalidInput, SolverError
from rollingjoint.lanes import Chain, Problem, Results, TendonLaw, designs_of, new_results, solve_range
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
        mechanism: the chain that was solved, or a tuple of them, one per lane.
        loads: load table, (rows, 11), columns load.LOAD_COLUMNS.
        joint_angles: (n - 1,) relative angle of every joint [rad].
        poses: (n, 3) x, y, angle of every link in the base frame [mm, rad].
        contact_points, contact_tangents: (n - 1, 2) contact and unit tangent there, base frame [mm].
        tensions: (m,) [N]. lengths: (m,) tendon lengths [mm].
        tendon_rates: (n - 1, m) d length / d joint angle [mm/rad].
        tendon_stiffness: (m,) d tension / d length [N/mm]: zero for a prescribed tension, a slack or a yielding tendon.
        contact_forces: (n - 1, 2) on the distal link, along the child surface's tangent and normal [N].
        residual: largest joint moment that is not balanced, joints at a surface limit left out [N·mm].
        iterations: Newton steps. status: Status, or (B,) integers.
    """

    mechanism: RollingChain | tuple[RollingChain, ...]
    loads: Array
    joint_angles: Array
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
        name = self.mechanism.name if isinstance(self.mechanism, RollingChain) else "several mechanisms"
        if np.ndim(self.status):
            codes, counts = np.unique(self.status, return_counts=True)
            found = ", ".join(f"{n} {Status(code).name}" for code, n in zip(codes, counts, strict=True))
            return f"<Equilibrium of {name!r}, {len(self.poses)} lanes: {found or 'none'}>"
        x, y = self.tip
        return f"<Equilibrium of {name!r}: {Status(int(self.status)).name}, tip at ({x:.3f}, {y:.3f}) mm>"

    @property
    def chain(self) -> RollingChain:
        """The mechanism of every lane.

        Raises:
            InvalidInput: lanes that have mechanisms of their own.
        """
        if isinstance(self.mechanism, RollingChain):
            return self.mechanism
        raise InvalidInput("equilibrium", self, "one mechanism", "Take that of a lane: equilibrium.mechanism[lane].")

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
    def arc_lengths(self) -> Array:
        """(n - 1,) contact point on both surfaces [mm]."""
        return arc_lengths_of(*self._designs, self._lanes(self.joint_angles)).reshape(self.joint_angles.shape)

    @cached_property
    def free_joints(self) -> NDArray[np.bool_]:
        """(n - 1,) False where the contact is at the end of a surface."""
        chain, designs = self._designs
        low, high = np.moveaxis(chain.joints[designs, :, :2], -1, 0).reshape(2, *self.joint_angles.shape)
        return (self.joint_angles > low + 1e-12) & (self.joint_angles < high - 1e-12)

    @cached_property
    def stiffness(self) -> Array:
        """(n - 1, n - 1) d residual / d joint angle, tendon stretch included for given lengths [N·mm/rad]."""
        known = np.asarray(self.status) != Status.INVALID_INPUT
        loads = np.where(known[..., None, None], self.loads, 0.0)
        angles = self._lanes(self.joint_angles)
        H = np.empty((*angles.shape, angles.shape[1]))
        tendons = self._lanes(self.tensions), self._lanes(self.tendon_stiffness)
        stiffness_of(*self._designs, *tendons, self._lanes(loads, axes=2), angles, H)
        return H.reshape(*self.joint_angles.shape, angles.shape[1])

    @cached_property
    def _designs(self) -> tuple[Chain, NDArray[np.int64]]:
        """The arrays of the mechanisms, and which of them each lane has."""
        return designs_of(self.mechanism, np.size(self.status))

    def _lanes(self, values: Array, axes: int = 1) -> Array:
        """A copy with a leading axis of lanes, in the form that kernels are compiled for."""
        return np.array(values, float, order="C").reshape(np.size(self.status), *values.shape[values.ndim - axes :])

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
_FIRST = np.zeros(1, np.int64)  # the only design of a mechanism's own arrays


def pack(mechanism: RollingChain | tuple[RollingChain, ...], table: Array, results: Results) -> Equilibrium:
    """The equilibria in the results of the kernels."""
    angles, poses, contacts, tensions, lengths, rates, elastic, forces, _, residual, iterations, status = results
    points, tangents = contacts[..., :2], contacts[..., 2:]
    solved = (angles, poses, points, tangents, tensions, lengths, rates, elastic, forces, residual, iterations, status)
    return Equilibrium(mechanism, table, *solved)


def solve_lane(mechanism: RollingChain, law: TendonLaw, table: Array, start: Array) -> Equilibrium:
    """The equilibrium of one mechanism; nothing is checked here.

    Args:
        mechanism: the chain.
        law: tendon law, (m,) each.
        table: load table, (rows, 11).
        start: joint angles, (n - 1,) [rad].
    """
    results = new_results(1, len(start), len(law.command))
    laws = TendonLaw(law.command[None], law.stiffness[None], law.low[None], law.high[None])
    solve_range(Problem(mechanism.arrays, _FIRST, laws, table[None], start[None], results), 0, 1)
    *arrays, residual, iterations, status = results
    numbers = residual.item(), iterations.item(), Status(status.item())
    return pack(mechanism, table, Results._make([*[array[0] if len(array) else array for array in arrays], *numbers]))
