"""Equilibria of chains in space: poses, contact points, and the reactions that contacts carry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.equilibrium import EquilibriumInSpace
from rollingjoint.chain.solution import lazy_fields
from rollingjoint.chain.stacks import distinct
from rollingjoint.tables import Column

if TYPE_CHECKING:
    from rollingjoint.chain.spatial import SpatialChain

Array = NDArray[np.float64]


@lazy_fields(contact_points="contacts", reactions="reactions")
@dataclass(frozen=True, eq=False, repr=False)
class SpatialEquilibrium(EquilibriumInSpace):
    """One equilibrium, or many with a leading axis B on every array.

    Attributes, in addition to those of every equilibrium in space:
        contact_points: (n - 1, 3) middle of the contact line, or the point of a hinge, base frame [mm].
        reactions: (n - 1, 6) force on the link above and its moment about the contact point [N, N·mm], each along the
            tangent of the child surface, the normal and the axis. The spring of a joint carries the last moment.
    """

    mechanism: SpatialChain | tuple[SpatialChain, ...]
    contact_points: Array
    reactions: Array

    @property
    def arc_lengths(self) -> Array:
        """(n - 1,) contact on both surfaces [mm]; NaN at joints without surfaces."""
        angles = self._rows(self.joint_angles)
        chains = self.mechanism if isinstance(self.mechanism, tuple) else (self.mechanism,) * len(angles)
        s = np.empty_like(angles)
        for chain in distinct(chains):
            rows = [row for row, other in enumerate(chains) if other is chain]
            for i, joint in enumerate(chain.joints):
                s[rows, i] = joint.arc_lengths(angles[rows, i])
        return s.reshape(self.joint_angles.shape)

    def joint_columns(self, friction: float) -> list[Column]:
        """Joints of one equilibrium, for reports; friction: coefficient for slip margins."""
        return [
            Column("angle_rad", "angle [rad]", self.joint_angles, 6),
            Column("contact_mm", "", self.contact_points),
            Column("normal_N", "normal [N]", self.reactions[:, 1]),
            Column("reaction", "", self.reactions),
        ]

    @property
    def _pivots(self) -> Array:
        return self.contact_points

    def _shapes(self, n_joints: int, n_tendons: int) -> dict[str, tuple[int, ...]]:
        more = {"contact_points": (n_joints, 3), "reactions": (n_joints, 6)}
        return super()._shapes(n_joints, n_tendons) | more
