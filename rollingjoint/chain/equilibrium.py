"""Equilibria of planar rolling chains, of chains in space, and of hinge chains, the results of solves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain import se3
from rollingjoint.chain.solution import Solution, lazy_fields
from rollingjoint.chain.stacks import distinct
from rollingjoint.checks import as_friction
from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.rolling import arc_lengths_of
from rollingjoint.tables import Column

if TYPE_CHECKING:
    from rollingjoint.chain.hinge import HingeChain
    from rollingjoint.chain.rolling import RollingChain

Array = NDArray[np.float64]

_DEGREES = 180.0 / math.pi


@lazy_fields(
    contact_points=("contacts", slice(0, 2)),
    contact_tangents=("contacts", slice(2, 4)),
    contact_forces="contact_forces",
)
@dataclass(frozen=True, eq=False, repr=False)
class Equilibrium(Solution):
    """One equilibrium, or many with a leading axis B on every array.

    Attributes, in addition to Solution's:
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
            InvalidInput: rows of several mechanisms.
        """
        if not isinstance(self.mechanism, tuple):
            return self.mechanism
        raise InvalidInput("equilibrium", self, "one mechanism", "Take that of a row: equilibrium.mechanism[row].")

    @property
    def positions(self) -> Array:
        """Origins of the links, (n, 2) [mm]."""
        return self.poses[..., :2]

    @cached_property
    def arc_lengths(self) -> Array:
        """(n - 1,) contact point on both surfaces [mm], within the limits of the joint."""
        chain, designs = self._designs
        chains = distinct(self.mechanism) if isinstance(self.mechanism, tuple) else (self.mechanism,)
        low, high = np.moveaxis(np.array([mechanism.joint_limits for mechanism in chains])[designs], -1, 0)
        angles = self._rows(self.joint_angles)
        s = np.empty_like(angles)
        arc_lengths_of(chain, designs, angles, s)
        return np.clip(s, low, high).reshape(self.joint_angles.shape)

    @property
    def _pivots(self) -> Array:
        return self.contact_points

    def _placed(self, link: int, point: Array) -> Array:
        (px, py), pose = point, self.poses[..., link, :]
        cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
        return pose[..., :2] + np.stack([cos * px - sin * py, sin * px + cos * py], axis=-1)

    def _twists(self, arms: Array) -> Array:
        return np.stack([-arms[..., 1], arms[..., 0], np.ones_like(arms[..., 0])], axis=-2)

    def _shapes(self, n_joints: int, n_tendons: int) -> dict[str, tuple[int, ...]]:
        contacts = dict.fromkeys(("contact_points", "contact_tangents", "contact_forces"), (n_joints, 2))
        return super()._shapes(n_joints, n_tendons) | {"poses": (n_joints + 1, 3)} | contacts

    @property
    def pressing_margins(self) -> Array:
        """(n - 1,) normal contact force [N]: negative means that the links would separate."""
        return self.contact_forces[..., 1]

    def slip_margins(self, friction: float = 0.3) -> Array:
        """(n - 1,) friction × normal - |tangential| contact force [N]: negative means that the links would slip."""
        return as_friction(friction) * self.contact_forces[..., 1] - np.abs(self.contact_forces[..., 0])

    def link_columns(self) -> list[Column]:
        """Poses of the links of one equilibrium, for reports."""
        x, y, angle = self.poses.T
        return [
            Column("x_mm", "x [mm]", x),
            Column("y_mm", "y [mm]", y),
            Column("angle_rad", "angle [rad]", angle, 6),
            Column("", "angle [deg]", angle * _DEGREES, 3),
        ]

    def joint_columns(self, friction: float) -> list[Column]:
        """Contacts of one equilibrium, for reports; friction: coefficient for slip margins."""
        return [
            Column("arc_length_mm", "s [mm]", self.arc_lengths),
            Column("angle_rad", "angle [rad]", self.joint_angles, 6),
            Column("contact_mm", "", self.contact_points),
            Column("normal_N", "normal [N]", self.contact_forces[:, 1]),
            Column("tangential_N", "tangential [N]", self.contact_forces[:, 0]),
            Column("slip_margin_N", "slip margin [N]", self.slip_margins(friction)),
        ]

    def figures(self, friction: float) -> dict[str, Any]:
        """The coefficient that slip margins are reported for."""
        return {"friction": friction}


@lazy_fields(tendon_torques="torques")
@dataclass(frozen=True, eq=False, repr=False)
class EquilibriumInSpace(Solution):
    """One equilibrium of a chain in space, or many with a leading axis B on every array.

    Attributes, in addition to Solution's:
        tendon_torques: (n - 1, m) d residual / d tension at the motor [mm]; tendon_rates unless there is friction or
            the tendons are end couples.
        escapes: unstable equilibria that the solver met and left downhill. Not 0: the chain has buckled, and this is
            one of several stable equilibria.
    """

    tendon_torques: Array
    escapes: int | NDArray[np.int64]

    _NUMBER = "escapes"

    @property
    def remark(self) -> str:
        """Whether the chain has buckled, for reports."""
        return f", buckled: {self.escapes} escapes" if self.escapes else ""

    def link_columns(self) -> list[Column]:
        """Poses of the links of one equilibrium, for reports."""
        turns = se3.rotation_vector(self.rotations)
        return [
            *(Column(f"{axis}_mm", f"{axis} [mm]", self.positions[:, i]) for i, axis in enumerate("xyz")),
            Column("rotation", "", self.rotations),
            *(Column("", f"turn {axis} [rad]", turns[:, i], 6) for i, axis in enumerate("xyz")),
        ]

    def figures(self, friction: float) -> dict[str, Any]:
        """Number of unstable equilibria that the solver left."""
        return {"escapes": int(self.escapes)}

    @property
    def positions(self) -> Array:
        """Origins of the links, (n, 3) [mm]."""
        return self.poses[..., :3, 3]

    @property
    def rotations(self) -> Array:
        """Rotation matrices of the links, (n, 3, 3)."""
        return self.poses[..., :3, :3]

    @property
    def torques_per_tension(self) -> Array:
        """(n - 1, m) d residual / d tension at the motor [mm]."""
        return self.tendon_torques

    def _placed(self, link: int, point: Array) -> Array:
        return self.positions[..., link, :] + self.rotations[..., link, :, :] @ point

    def _twists(self, arms: Array) -> Array:
        chain, designs = self._designs
        axes = chain.axes[designs].reshape(*self.joint_angles.shape, 3)
        axes = (self.rotations[..., :-1, :, :] @ axes[..., None])[..., 0]
        axes = np.broadcast_to(axes[..., None, :, :] if arms.ndim > axes.ndim else axes, arms.shape)
        return np.swapaxes(np.concatenate([np.cross(axes, arms), axes], axis=-1), -1, -2)

    def _shapes(self, n_joints: int, n_tendons: int) -> dict[str, tuple[int, ...]]:
        more = {"poses": (n_joints + 1, 4, 4), "tendon_torques": (n_joints, n_tendons), "escapes": ()}
        return super()._shapes(n_joints, n_tendons) | more


@dataclass(frozen=True, eq=False, repr=False)
class HingeEquilibrium(EquilibriumInSpace):
    """One equilibrium of an arm, or many with a leading axis B on every array."""

    mechanism: HingeChain | tuple[HingeChain, ...]

    def joint_columns(self, friction: float) -> list[Column]:
        """Hinges of one equilibrium, for reports; `friction` has no effect."""
        assert not isinstance(self.mechanism, tuple)
        angles, beads = self.joint_angles, self.mechanism.beads
        stiffnesses = np.array([bead.stiffness for bead in beads])
        return [
            Column("angle_rad", "angle [rad]", angles, 6),
            Column("", "angle [deg]", angles * _DEGREES, 3),
            Column("spring_moment_N_mm", "spring [N·mm]", stiffnesses * (angles - self.mechanism.neutral_angles)),
        ]

    @property
    def _pivots(self) -> Array:
        """Hinge i is at the origin of link i, and the last origin amid the distal face."""
        return self.positions[..., :-1, :]
