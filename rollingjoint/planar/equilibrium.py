"""Equilibria of planar rolling chains: what a solve returns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.planar.forward import arc_lengths_of
from rollingjoint.kernels.shared.batch import stiffness_of
from rollingjoint.kernels.shared.rubbed import begin_histories, rubbed_stiffness_of
from rollingjoint.load import LOAD_COLUMNS, check_table
from rollingjoint.mechanism import distinct
from rollingjoint.planar.chain import RollingChain
from rollingjoint.solution import Solution, parts

Array = NDArray[np.float64]


@parts(
    contact_points=("contacts", slice(0, 2)),
    contact_tangents=("contacts", slice(2, 4)),
    contact_forces="contact_forces",
)
@dataclass(frozen=True, eq=False, repr=False)
class Equilibrium(Solution):
    """One equilibrium, or many with a leading axis B on every array.

    Attributes, beside those of Solution:
        contact_points, contact_tangents: (n - 1, 2) contact and unit tangent there, base frame [mm].
        contact_forces: (n - 1, 2) on the distal link, along the child surface's tangent and normal [N].
    """

    mechanism: RollingChain | tuple[RollingChain, ...]
    contact_points: Array
    contact_tangents: Array
    contact_forces: Array

    @property
    def chain(self) -> RollingChain:
        """The mechanism of all rows.

        Raises:
            InvalidInput: rows that have mechanisms of their own.
        """
        if not isinstance(self.mechanism, tuple):
            return self.mechanism
        raise InvalidInput("equilibrium", self, "one mechanism", "Take that of a row: equilibrium.mechanism[row].")

    @property
    def tip(self) -> Array:
        """Origin of the last link, (2,) [mm]."""
        return self.poses[..., -1, :2]

    @cached_property
    def arc_lengths(self) -> Array:
        """(n - 1,) contact point on both surfaces [mm], within the limits of the joint."""
        chain, designs = self._designs
        chains = distinct(self.mechanism) if isinstance(self.mechanism, tuple) else (self.mechanism,)
        low, high = np.moveaxis(np.array([each.joint_limits for each in chains])[designs], -1, 0)
        angles = self._rows(self.joint_angles)
        s = np.empty_like(angles)
        arc_lengths_of(chain, designs, angles, s)
        return np.clip(s, low, high).reshape(self.joint_angles.shape)

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

    def _shapes(self, n_joints: int, n_tendons: int) -> dict[str, tuple[int, ...]]:
        contacts = dict.fromkeys(("contact_points", "contact_tangents", "contact_forces"), (n_joints, 2))
        return super()._shapes(n_joints, n_tendons) | {"poses": (n_joints + 1, 3)} | contacts

    @staticmethod
    def _check_loads(loads: Array, n_links: int) -> None:
        check_table(loads, LOAD_COLUMNS, n_links)

    _fill_stiffness = staticmethod(stiffness_of)
    _fill_rubbed_stiffness = staticmethod(rubbed_stiffness_of)
    _begin_histories = staticmethod(begin_histories)

    @property
    def pressing_margins(self) -> Array:
        """(n - 1,) normal contact force [N]: negative means that the links would separate."""
        return self.contact_forces[..., 1]

    def slip_margins(self, friction: float = 0.3) -> Array:
        """(n - 1,) friction × normal - |tangential| contact force [N]: negative means that the links would slip."""
        return friction * self.contact_forces[..., 1] - np.abs(self.contact_forces[..., 0])
