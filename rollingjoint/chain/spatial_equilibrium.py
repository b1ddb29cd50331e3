"""Equilibria of chains in space: poses, contact points, and the reactions that contacts carry."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.equilibrium import EquilibriumInSpace
from rollingjoint.chain.solution import lazy_fields
from rollingjoint.chain.stacks import distinct
from rollingjoint.tables import Column

if TYPE_CHECKING:
    from rollingjoint.chain.spatial import SpatialChain

Array = NDArray[np.float64]


def least_friction(normal: Array, side: Array, axial: Array) -> Array:
    """Smallest coefficient of friction with which two point contacts carry their forces; inf where one of them lifts.

    A line contact carries a reaction by some pressure and friction along it if and only if two contacts at its ends do.

    Args:
        normal, side: force of each contact along the normal and the tangent, (..., 2) [N].
        axial: force along the line, shared by both, (...) [N].
    Source: docs/theory.md, section 11: the root of |axial| = sum of sqrt(mu² normal² - side²).
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        alpha, beta, c = normal**2, side**2, axial**2
        low = np.max(beta / alpha, axis=-1)
        room = np.sqrt(np.maximum(low[..., None] * alpha - beta, 0.0)).sum(axis=-1)
        (first, second), (b, d) = np.moveaxis(alpha, -1, 0), np.moveaxis(beta, -1, 0)
        sum_of_sides = c + b + d
        A = (first - second) ** 2
        B = 2.0 * (first + second) * sum_of_sides - 4.0 * (first * d + second * b)
        C = sum_of_sides**2 - 4.0 * b * d
        root = 2.0 * C / (B + np.sqrt(np.maximum(B**2 - 4.0 * A * C, 0.0)))
        squared = np.where(np.abs(axial) <= room, low, np.maximum(root, low))
        return np.where(np.all(normal > 0.0, axis=-1), np.sqrt(squared), np.inf)


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
        ]

    def figures(self, friction: float) -> dict[str, Any]:
        """Number of unstable equilibria that the solver left, and the coefficient of the slip margins."""
        return {**super().figures(friction), "friction": friction}

    @property
    def pressing_margins(self) -> Array:
        """(n - 1,) normal force on the contact [N]: negative means that the links would separate."""
        return self._bounded(self.reactions[..., 1])

    @property
    def tilting_margins(self) -> Array:
        """(n - 1,) twice the smaller force at an end of the contact line [N]: negative means that this end lifts."""
        return self._bounded(2.0 * self._ends[0].min(axis=-1))

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
        normal, side = self._ends
        required = least_friction(normal, side, self.reactions[..., 2])
        return np.where(np.isfinite(self._half_widths), required, 0.0)

    def slip_margins(self, friction: float = 0.3) -> Array:
        """(n - 1,) (friction - friction_required) × normal force [N]: negative means that the links would slip."""
        return self._bounded((friction - self.friction_required) * np.abs(self.reactions[..., 1]))

    @cached_property
    def _half_widths(self) -> Array:
        """(n - 1,) of the contact lines [mm]; inf at hinges."""
        widths = np.array([[joint.line for joint in chain.joints] for chain in self._chains])
        return widths[self._designs[1]].reshape(self.joint_angles.shape)

    @property
    def _chains(self) -> tuple[SpatialChain, ...]:
        """The distinct chains, which `_designs` numbers."""
        return distinct(self.mechanism) if isinstance(self.mechanism, tuple) else (self.mechanism,)

    @property
    def _ends(self) -> tuple[Array, Array]:
        """Normal and tangential forces at both ends of the contact lines that carry the reactions, (n - 1, 2) [N]."""
        along, pressing, about_tangent, about_normal = (self.reactions[..., k] for k in (0, 1, 3, 4))
        tilt, twist = about_tangent / self._half_widths, about_normal / self._half_widths
        normal = 0.5 * np.stack([pressing - tilt, pressing + tilt], axis=-1)
        return normal, 0.5 * np.stack([along + twist, along - twist], axis=-1)

    def _bounded(self, margins: Array) -> Array:
        """The margins of contacts, inf at hinges."""
        return np.where(np.isfinite(self._half_widths), margins, np.inf)

    @property
    def _pivots(self) -> Array:
        return self.contact_points

    def _shapes(self, n_joints: int, n_tendons: int) -> dict[str, tuple[int, ...]]:
        more = {"contact_points": (n_joints, 3), "reactions": (n_joints, 6)}
        return super()._shapes(n_joints, n_tendons) | more
