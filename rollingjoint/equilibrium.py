"""Equilibria: what a solve returns, and the solvers for given tensions and given lengths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint._kernels.arrays import TendonLaw
from rollingjoint._kernels.batch import Results, new_results, solve_lanes, solve_lanes_threaded
from rollingjoint._kernels.least_squares import solve_least_squares
from rollingjoint.errors import InvalidInput, SolverError
from rollingjoint.load import LOAD_COLUMNS, Load, load_table
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
        stiffness: (n - 1, n - 1) d residual / d joint angle, tendon stretch included for given lengths [N·mm/rad].
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
    stiffness: Array
    residual: float | Array
    iterations: int | NDArray[np.int64]
    status: Status | NDArray[np.int64]

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
_LANES_WORTH_THREADS = 128


Start = ArrayLike | Equilibrium | None


def solve_tensions(
    mechanism: RollingChain, tensions: ArrayLike, loads: Sequence[Load] = (), start: Start = None
) -> Equilibrium:
    """Equilibrium under given tendon tensions.

    Args:
        mechanism: the chain.
        tensions: (m,) [N], not negative.
        loads: external loads.
        start: joint angles (n - 1,) [rad] or an Equilibrium to start from; default s = 0 in every joint.
    Returns:
        Equilibrium; look at its status. NaN, huge or negative numbers give Status.INVALID_INPUT.
    Raises:
        InvalidInput: wrong shapes or types, a load on a link that does not exist.
    Source: docs/theory.md, section 3.
    """
    tau = _vector("tensions", tensions, mechanism.n_tendons, "one per tendon")
    law = TendonLaw(np.zeros_like(tau), np.ones_like(tau), tau, tau)
    return _solve_one(mechanism, law, load_table(loads, mechanism.n_links), _start(mechanism, start))


def solve_lengths(
    mechanism: RollingChain,
    lengths: ArrayLike,
    loads: Sequence[Load] = (),
    start: Start = None,
    method: str = "elastic",
    tension_limits: tuple[ArrayLike, ArrayLike] = (0.0, np.inf),
) -> Equilibrium:
    """Equilibrium under given tendon lengths.

    Args:
        mechanism: the chain.
        lengths: (m,) unstretched length that the motors leave in the channels [mm] ("elastic"), or desired lengths
            ("least_squares").
        loads: external loads.
        start: joint angles (n - 1,) [rad] or an Equilibrium to start from; default s = 0 in every joint.
        method: "elastic": tension = clip(stiffness × stretch, *tension_limits), unique and well posed while a tendon is
            taut. "least_squares": tensions within the limits that bring the lengths nearest the desired ones.
        tension_limits: lowest and highest tension, numbers or (m,) [N]; a motor that holds at least the first and gives
            way at the second. With "least_squares" an infinite highest tension stands for 1000 N.
    Returns:
        Equilibrium; look at its status.
    Raises:
        InvalidInput: wrong shapes or types, an unknown method, a load on a link that does not exist.
    Source: docs/theory.md, section 4; least squares: rolling-contact paper, eq. 29.
    """
    command = _vector("lengths", lengths, mechanism.n_tendons, "one per tendon")
    low, high = _tension_limits(tension_limits, mechanism.n_tendons)
    law = TendonLaw(command, mechanism.stiffnesses, low, high)
    table, phi = load_table(loads, mechanism.n_links), _start(mechanism, start)
    if method == "elastic":
        return _solve_one(mechanism, law, table, phi)
    if method == "least_squares":
        results = new_results(1, mechanism.n_joints, mechanism.n_tendons)
        solve_least_squares(mechanism.arrays, law, table, phi, results)
        return _pack_one(mechanism, table, results)
    raise InvalidInput("method", method, '"elastic" or "least_squares"')


def solve_tensions_batch(
    mechanism: RollingChain, tensions: ArrayLike, loads: Sequence[Load] | Array = (), starts: ArrayLike | None = None
) -> Equilibrium:
    """Equilibria under given tensions, lane by lane.

    Args:
        mechanism: the chain.
        tensions: (B, m) [N].
        loads: loads shared by all lanes, or a table (B, rows, 11) with columns load.LOAD_COLUMNS.
        starts: joint angles, (B, n - 1) [rad]; default s = 0.
    Returns:
        Equilibrium whose arrays have a leading axis B.
    Raises:
        InvalidInput: wrong shapes or types.
    """
    tau = _lanes("tensions", tensions, mechanism.n_tendons)
    laws = TendonLaw(np.zeros_like(tau), np.ones_like(tau), tau, tau)
    return _solve_many(mechanism, laws, loads, starts)


def solve_lengths_batch(
    mechanism: RollingChain,
    lengths: ArrayLike,
    loads: Sequence[Load] | Array = (),
    starts: ArrayLike | None = None,
    tension_limits: tuple[ArrayLike, ArrayLike] = (0.0, np.inf),
) -> Equilibrium:
    """Equilibria under given lengths (elastic tendons), lane by lane.

    Args:
        mechanism: the chain.
        lengths: (B, m) unstretched lengths [mm].
        loads: loads shared by all lanes, or a table (B, rows, 11) with columns load.LOAD_COLUMNS.
        starts: joint angles, (B, n - 1) [rad]; default s = 0.
        tension_limits: lowest and highest tension, numbers or (m,) [N].
    Returns:
        Equilibrium whose arrays have a leading axis B.
    Raises:
        InvalidInput: wrong shapes or types.
    """
    command = _lanes("lengths", lengths, mechanism.n_tendons)
    low, high = _tension_limits(tension_limits, mechanism.n_tendons)
    shared = (np.tile(values, (len(command), 1)) for values in (mechanism.stiffnesses, low, high))
    return _solve_many(mechanism, TendonLaw(command, *shared), loads, starts)


def _solve_one(mechanism: RollingChain, law: TendonLaw, table: Array, phi: Array) -> Equilibrium:
    results = new_results(1, mechanism.n_joints, mechanism.n_tendons)
    laws = TendonLaw(law.command[None], law.stiffness[None], law.low[None], law.high[None])
    solve_lanes(mechanism.arrays, laws, table[None], phi[None], results)
    return _pack_one(mechanism, table, results)


def _solve_many(
    mechanism: RollingChain, laws: TendonLaw, loads: Sequence[Load] | Array, starts: ArrayLike | None
) -> Equilibrium:
    n_lanes, n_joints = len(laws.command), mechanism.n_joints
    if isinstance(loads, np.ndarray):
        if loads.ndim != 3 or loads.shape[0] != n_lanes or loads.shape[2] != len(LOAD_COLUMNS):
            raise InvalidInput("shape of the load table", loads.shape, f"({n_lanes}, rows, {len(LOAD_COLUMNS)})")
        table = np.ascontiguousarray(loads, float)
        _check_links(table, mechanism.n_links)
    else:
        table = np.tile(load_table(loads, mechanism.n_links), (n_lanes, 1, 1))
    if starts is None:
        phi = np.tile(mechanism.neutral_angles, (n_lanes, 1))
    else:
        phi = _lanes("starts", starts, n_joints)
        if len(phi) != n_lanes:
            raise InvalidInput("number of starts", len(phi), f"{n_lanes}, one per lane")
    results = new_results(n_lanes, n_joints, mechanism.n_tendons)
    run = solve_lanes if n_lanes < _LANES_WORTH_THREADS else solve_lanes_threaded
    run(mechanism.arrays, laws, table, phi, results)
    return _pack(mechanism, table, results)


def _pack(mechanism: RollingChain, table: Array, results: Results) -> Equilibrium:
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
        stiffness=results.stiffness,
        residual=results.residual,
        iterations=results.iterations,
        status=results.status,
    )


def _pack_one(mechanism: RollingChain, table: Array, results: Results) -> Equilibrium:
    """The single lane of results, without its leading axis."""
    lane = _pack(mechanism, table, Results(*(array[0] for array in results)))
    return replace(
        lane, residual=float(lane.residual), iterations=int(lane.iterations), status=Status(int(lane.status))
    )


def _start(mechanism: RollingChain, start: Start) -> Array:
    if start is None:
        return mechanism.neutral_angles
    angles = start.joint_angles if isinstance(start, Equilibrium) else start
    return _vector("start", angles, mechanism.n_joints, "joint angles [rad], one per joint")


def _tension_limits(limits: tuple[ArrayLike, ArrayLike], n_tendons: int) -> tuple[Array, Array]:
    try:
        low, high = (np.array(np.broadcast_to(np.asarray(side, float), n_tendons)) for side in limits)
    except (TypeError, ValueError):
        raise InvalidInput("tension_limits", limits, f"(lowest, highest), numbers or {n_tendons} values each") from None
    return low, high


def _vector(what: str, values: ArrayLike, size: int, meaning: str) -> Array:
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise InvalidInput(what, values, f"{size} numbers, {meaning}") from None
    if array.shape != (size,):
        raise InvalidInput(what, values, f"{size} numbers, {meaning}")
    return array


def _lanes(what: str, values: ArrayLike, size: int) -> Array:
    array = np.ascontiguousarray(values, dtype=float)
    if array.ndim != 2 or array.shape[1] != size:
        raise InvalidInput(f"shape of {what}", array.shape, f"(B, {size}), one row per lane")
    return array


def _check_links(table: Array, n_links: int) -> None:
    links = table[..., 0]
    if not np.all((links >= 0) & (links < n_links) & (links == np.floor(links))):
        raise InvalidInput("links of the load table", links, f"whole numbers from 0 to {n_links - 1}")
