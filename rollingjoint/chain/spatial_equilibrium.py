"""Equilibria of chains in space: poses, contact points, and the reactions that contacts carry."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.contact_line import least_friction, least_tooth_force
from rollingjoint.chain.equilibrium import EquilibriumInSpace
from rollingjoint.chain.solution import lazy_fields
from rollingjoint.chain.stacks import distinct
from rollingjoint.checks import as_friction, as_number
from rollingjoint.tables import Column

if TYPE_CHECKING:
    from rollingjoint.chain.spatial import SpatialChain

Array = NDArray[np.float64]

FRICTION = 0.3  # of links on links
PRESSURE_ANGLE = float(np.radians(20.0))  # of the flanks of teeth [rad]


@lazy_fields(contact_points="contacts", reactions="reactions")
@dataclass(frozen=True, eq=False, repr=False)
class SpatialEquilibrium(EquilibriumInSpace):
    """One equilibrium, or many with a leading axis B on every array.

    Attributes beyond `EquilibriumInSpace`:
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
        (_, designs), angles = self._designs, self._rows(self.joint_angles)
        s = np.empty_like(angles)
        for design, chain in enumerate(self._chains):
            rows = designs == design
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
            Column("tilting_margin_N", "tilting margin [N]", self.tilting_margins),
            Column("slip_margin_N", "slip margin [N]", self.slip_margins(friction)),
            Column("tooth_force_N", "", self.tooth_forces(friction)),
            Column("strap_forces_N", "", self.strap_forces),
        ]

    def figures(self, friction: float) -> dict[str, Any]:
        """Number of unstable equilibria that the solver left, and the coefficient of the slip margins."""
        return {**super().figures(friction), "friction": friction}

    @property
    def pressing_margins(self) -> Array:
        """(n - 1,) normal force on the contact [N]: negative means that the links would separate."""
        return self._bounded(self.reactions[..., 1])

    @property
    def end_forces(self) -> Array:
        """(n - 1, 2, 2) of two point contacts that carry the reaction of the line, along tangent and normal [N].

        At half_width and -half_width along the axis; they share the axial force. NaN at hinges.
        """
        along, pressing, about_tangent, about_normal = (self.reactions[..., k] for k in (0, 1, 3, 4))
        tilt, twist = about_tangent / self._half_widths, about_normal / self._half_widths
        side, normal = (
            np.stack([along + twist, along - twist], axis=-1),
            np.stack([pressing - tilt, pressing + tilt], -1),
        )
        finite = np.isfinite(self._half_widths)[..., None, None]
        return np.where(finite, 0.5 * np.stack([side, normal], axis=-1), np.nan)

    @property
    def tilting_margins(self) -> Array:
        """(n - 1,) twice the smaller force at an end of the contact line [N]: negative means that this end lifts."""
        return self._bounded(2.0 * self.end_forces[..., 1].min(axis=-1))

    @property
    def centres_of_pressure(self) -> Array:
        """(n - 1,) place of the normal force along the axis, from the middle of the contact line [mm].

        NaN where no force presses, and at hinges. The contact line reaches from -half_width to half_width.
        """
        pressing = self.reactions[..., 1]
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(
                (pressing > 0.0) & np.isfinite(self._half_widths), -self.reactions[..., 3] / pressing, np.nan
            )

    @property
    def friction_required(self) -> Array:
        """(n - 1,) smallest coefficient of friction with which the contact line can carry the reaction.

        inf where an end of the line lifts; 0 at hinges. Source: docs/theory.md, section 11.
        """
        side, normal = np.moveaxis(self.end_forces, -1, 0)
        required = least_friction(normal, side, self.reactions[..., 2])
        return np.where(np.isfinite(self._half_widths), required, 0.0)

    def slip_margins(self, friction: float = FRICTION) -> Array:
        """(n - 1,) (friction - friction_required) × normal force [N]: negative means that the links would slip."""
        friction = as_friction(friction)
        return self._bounded((friction - self.friction_required) * np.abs(self.reactions[..., 1]))

    def tooth_forces(self, friction: float = FRICTION, shoulders: bool = True) -> Array:
        """(n - 1,) force in the contact plane that teeth at each end of the line have to carry beside friction [N].

        0 where friction holds, and at hinges.

        Args:
            friction: coefficient of the surfaces beside the teeth; 0: the teeth carry everything.
            shoulders: teeth hold along the axis, too, as pins or teeth between shoulders do; spur teeth and straps that
                cross from surface to surface do not: inf where friction cannot hold the axial force.
        Source: docs/theory.md, section 11.
        """
        side, normal = np.moveaxis(self.end_forces, -1, 0)
        least = least_tooth_force(normal, side, self.reactions[..., 2], as_friction(friction), shoulders)
        return np.where(np.isfinite(self._half_widths), least, 0.0)

    def tooth_margins(self, pressure_angle: float = PRESSURE_ANGLE) -> Array:
        """(n - 1,) normal force at the end pressed less that remains when spur teeth carry all tangential force [N].

        Teeth push each other apart. Negative means that they climb out of mesh.

        Args:
            pressure_angle: of the flanks, from 0 to below π/2 [rad].
        Source: docs/theory.md, section 11.
        """
        angle = as_pressure_angle(pressure_angle)
        side, normal = np.moveaxis(self.end_forces, -1, 0)
        return self._bounded((normal - np.abs(side) * np.tan(angle)).min(axis=-1))

    @property
    def strap_forces(self) -> Array:
        """(n - 1, 2) tension across the contact that keeps each end of its line from lifting, along the normal [N].

        At half_width and -half_width along the axis. 0 where an end is pressed, and at hinges.
        Source: docs/theory.md, section 11.
        """
        return np.where(np.isfinite(self._half_widths)[..., None], np.maximum(-self.end_forces[..., 1], 0.0), 0.0)

    @property
    def contact_frames(self) -> Array:
        """(n - 1, 3, 3) tangent of the child surface, normal and axis in the base frame, the directions of reactions.

        At hinges they are the directions of the joint's frame at angle 0.
        """
        (_, designs), angles = self._designs, self._rows(self.joint_angles)
        frames = np.empty((*angles.shape, 3, 3))
        for design, chain in enumerate(self._chains):
            rows = designs == design
            for i, joint in enumerate(chain.joints):
                frames[rows, i] = joint.contact_frames(angles[rows, i])
        frames = frames.reshape(*self.joint_angles.shape, 3, 3)
        return np.asarray(frames @ np.swapaxes(self.rotations[..., :-1, :, :], -1, -2))

    @cached_property
    def _half_widths(self) -> Array:
        """(n - 1,) of the contact lines [mm]; inf at hinges."""
        widths = np.array([[joint.line for joint in chain.joints] for chain in self._chains])
        return widths[self._designs[1]].reshape(self.joint_angles.shape)

    @property
    def _chains(self) -> tuple[SpatialChain, ...]:
        """The distinct chains, which `_designs` numbers."""
        return distinct(self.mechanism) if isinstance(self.mechanism, tuple) else (self.mechanism,)

    def _bounded(self, margins: Array) -> Array:
        """The margins of contacts, inf at hinges."""
        return np.where(np.isfinite(self._half_widths), margins, np.inf)

    @property
    def _pivots(self) -> Array:
        return self.contact_points

    def _shapes(self, n_joints: int, n_tendons: int) -> dict[str, tuple[int, ...]]:
        more = {"contact_points": (n_joints, 3), "reactions": (n_joints, 6)}
        return super()._shapes(n_joints, n_tendons) | more


def as_pressure_angle(value: object) -> float:
    """The value as a float; InvalidInput unless it is a pressure angle of flanks, from 0 to below π/2 [rad]."""
    allowed = "0 or more, below π/2 [rad]"
    return as_number("pressure_angle", value, 0.0, np.nextafter(0.5 * np.pi, 0.0), allowed=allowed)
