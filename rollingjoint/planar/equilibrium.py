"""Equilibria of planar rolling chains: what a solve returns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.planar.batch import stiffness_of
from rollingjoint.kernels.planar.forward import arc_lengths_of
from rollingjoint.planar.batch import Chain, Problem, Results, TendonLaw, designs_of, new_results, solve_range
from rollingjoint.planar.chain import RollingChain
from rollingjoint.solution import Solution, Status

Array = NDArray[np.float64]

__all__ = ["Equilibrium", "Status", "pack", "solve_lane"]


@dataclass(frozen=True, eq=False, repr=False)
class Equilibrium(Solution):
    """One equilibrium, or many with a leading axis B on every array.

    Attributes:
        mechanism: the chain that was solved, or a tuple of them, one per lane.
        loads: load table, (rows, columns), columns load.LOAD_COLUMNS; the mechanism's springs are not in it.
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
    def tip(self) -> Array:
        """Origin of the last link, (2,) [mm]."""
        return self.poses[..., -1, :2]

    @cached_property
    def arc_lengths(self) -> Array:
        """(n - 1,) contact point on both surfaces [mm]."""
        return arc_lengths_of(*self._designs, self._lanes(self.joint_angles)).reshape(self.joint_angles.shape)

    @property
    def pose_jacobian(self) -> Array:
        """(n, 3, n - 1) d link poses (x, y, angle) / d joint angles [mm/rad, 1]."""
        arm = self.poses[..., :, None, :2] - self.contact_points[..., None, :, :]
        n = self.poses.shape[-2]
        moves = np.tri(n, n - 1, -1)  # joint i moves link k > i
        return np.stack([-arm[..., 1] * moves, arm[..., 0] * moves, np.broadcast_to(moves, arm.shape[:-1])], axis=-2)

    def point_jacobian(self, link: int, point: Sequence[float] | None = None) -> Array:
        """(3, n - 1) d (x, y, angle) of a body point [mm], default the link's origin, / d joint angles [mm/rad, 1]."""
        px, py = (0.0, 0.0) if point is None else point
        pose = self.poses[..., link, :]
        cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
        where = pose[..., :2] + np.stack([cos * px - sin * py, sin * px + cos * py], axis=-1)
        arm = where[..., None, :] - self.contact_points
        jacobian = np.stack([-arm[..., 1], arm[..., 0], np.ones_like(arm[..., 0])], axis=-2)
        jacobian[..., link:] = 0.0
        return jacobian

    @cached_property
    def _designs(self) -> tuple[Chain, NDArray[np.int64]]:
        return designs_of(self.mechanism, np.size(self.status))

    _fill_stiffness = staticmethod(stiffness_of)

    @property
    def pressing_margins(self) -> Array:
        """(n - 1,) normal contact force [N]: negative means that the links would separate."""
        return self.contact_forces[..., 1]

    def slip_margins(self, friction: float = 0.3) -> Array:
        """(n - 1,) friction × normal - |tangential| contact force [N]: negative means that the links would slip."""
        return friction * self.contact_forces[..., 1] - np.abs(self.contact_forces[..., 0])


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
        table: load table, (rows, columns).
        start: joint angles, (n - 1,) [rad].
    """
    results = new_results(1, len(start), len(law.command))
    laws = TendonLaw(law.command[None], law.stiffness[None], law.low[None], law.high[None])
    solve_range(Problem(mechanism.arrays, _FIRST, laws, table[None], start[None], results), 0, 1)
    *arrays, residual, iterations, status = results
    numbers = residual.item(), iterations.item(), Status(status.item())
    return pack(mechanism, table, Results._make([*[array[0] if len(array) else array for array in arrays], *numbers]))
