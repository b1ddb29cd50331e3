"""Joints of chains in space: planar maps of one angle, tabulated, in a plane that is fixed in their links.

docs/theory.md, section 11.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain import joint_table, se3
from rollingjoint.chain.hinge import CLOSED, open_range
from rollingjoint.chain.joint_table import JointTable
from rollingjoint.checks import as_floats, as_number, as_positive
from rollingjoint.errors import MechanismError
from rollingjoint.kernels.joints import CLOSED_GAP, N_COEFFICIENTS
from rollingjoint.profile import Surface

Array = NDArray[np.float64]

_ALONG_Z = 1e-9  # of an axis: its part across z, below which the lateral direction is x
_LARGEST_CELL = 0.2  # rad; sine and cosine are polynomials of degree 9 there, to rounding


def _as_angle(what: str, value: object) -> float:
    """The value as a float; MechanismError unless it is an angle of one turn at most, which degrees rarely are."""
    allowed = "an angle in radians, from -2π to 2π"
    return as_number(what, value, -2.0 * np.pi, 2.0 * np.pi, allowed=allowed, error=MechanismError)


class SpatialJoint(ABC):
    """A joint of a chain in space, with one angle about an axis that is fixed in both of its links.

    Each kind of joint is a frozen dataclass on top. Directions are in the frame of the link below, and at angle 0 also
    in the frame of the link above.

    Attributes:
        stiffness: of its torsion spring [N·mm/rad]. rest_angle: where that carries no moment [rad].
    """

    stiffness: float
    rest_angle: float

    def _check_spring(self, name: str) -> None:
        """Raise MechanismError for a wrong spring; hold plain numbers."""
        stiffness = as_number(f"{name} stiffness", self.stiffness, 0.0, allowed="0 or more", error=MechanismError)
        rest_angle = _as_angle(f"{name} rest_angle", self.rest_angle)
        object.__setattr__(self, "stiffness", stiffness)
        object.__setattr__(self, "rest_angle", rest_angle)

    @property
    @abstractmethod
    def frame(self) -> Array:
        """Lateral and axial direction of its plane, and its axis, the rows of a rotation matrix (3, 3)."""

    @property
    @abstractmethod
    def neutral(self) -> float:
        """Its angle at rest [rad]."""

    @property
    @abstractmethod
    def range(self) -> tuple[float, float]:
        """Smallest and largest angle [rad]."""

    @property
    @abstractmethod
    def offsets(self) -> tuple[float, float]:
        """Along the axis: the contact from the origin of the link below, the origin of the link above from there."""

    @property
    @abstractmethod
    def ends(self) -> tuple[Array, Array]:
        """Where the axes of its links meet at rest, in the frames of the links below and above, (3,) both [mm]."""

    @property
    def line(self) -> float:
        """Half width of its contact line [mm]; inf where it carries any reaction."""
        return np.inf

    @abstractmethod
    def table(self) -> JointTable:
        """Its map, in the lateral and axial directions."""

    @abstractmethod
    def spacing(self) -> float:
        """Distance between the origins of its links at rest [mm]."""

    def check(self, number: int) -> None:  # noqa: B027  (most kinds are checked when they are made)
        """Raise MechanismError where no such joint can be made; number: of the joint, for the message."""

    def open_range(self, number: int, tendons: Sequence[int], below: Array, above: Array) -> tuple[float, float]:
        """Smallest and largest angle at which the gaps of tendons are open [rad].

        Args:
            number: of the joint, for messages. tendons: the numbers of those that cross it, likewise.
            below, above: their holes, (tendons, 3) [mm], in the directions of `frame`.
        Raises:
            MechanismError: holes that cross.
        """
        return self.range

    def arc_lengths(self, angles: Array) -> Array:
        """Contact arc lengths at joint angles, any shape [mm, rad]; NaN where no surfaces roll."""
        return np.full(np.shape(angles), np.nan)

    def strips(self, count: int) -> list[Array]:
        """Its contact surfaces over the width of the line, on the link below and on the link above; none without.

        Each (count, 2, 3) in the frame of its link [mm]: places along the curve, the ends of the line there.
        """
        return []

    def contact_frames(self, angles: Array) -> Array:
        """Tangent and normal of the contact, and the axis, in the link below at joint angles (...,), (..., 3, 3)."""
        return np.broadcast_to(self.frame, (*np.shape(angles), 3, 3))


@dataclass(frozen=True)
class RollingContact(SpatialJoint):
    """Two surfaces that roll on each other without slip, drawn in a plane and extruded along its normal.

    Args:
        azimuth: angle of the plane about z [rad]. Its lateral direction is (cos, sin, 0), its axial direction z; the
            joint turns about the lateral direction × z: 0 is pitch, in the plane x-z, π/2 is yaw, in the plane y-z.
        parent: surface of the link above; its points are (lateral, axial), in the frame of its link.
        child: surface of the link below, on which the parent surface rolls.
        half_width: of the contact line, along the axis [mm].
        middle: of the contact line, from the plane through z, along the axis [mm].
        stiffness: of a torsion spring [N·mm/rad].
        rest_angle: where the spring carries no moment [rad].
    Raises:
        MechanismError: no Surface, a half_width or a stiffness that is not possible, angles beyond 2π, numbers that are
            not finite.
    """

    azimuth: float
    parent: Surface
    child: Surface
    half_width: float
    middle: float = 0.0
    stiffness: float = 0.0
    rest_angle: float = 0.0

    def __post_init__(self) -> None:
        for side in ("parent", "child"):
            if not isinstance(getattr(self, side), Surface):
                raise MechanismError(f"contact {side}", getattr(self, side), "a Surface")
        object.__setattr__(self, "azimuth", _as_angle("contact azimuth", self.azimuth))
        middle = as_number("contact middle", self.middle, allowed="a number [mm]", error=MechanismError)
        object.__setattr__(self, "middle", middle)
        half_width = as_positive("contact half_width", self.half_width, "a positive number [mm]", MechanismError)
        object.__setattr__(self, "half_width", half_width)
        self._check_spring("contact")

    @property
    def frame(self) -> Array:
        """Lateral and axial direction of its plane, and its axis, the rows of a rotation matrix (3, 3)."""
        cos, sin = np.cos(self.azimuth), np.sin(self.azimuth)
        return np.array([[cos, sin, 0.0], [0.0, 0.0, 1.0], [sin, -cos, 0.0]])

    @cached_property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest arc length of the contact [mm]."""
        return joint_table.common_range(self.child, self.parent)

    @property
    def neutral(self) -> float:
        """Its angle with the contact at s = 0, or at the limit nearest to it [rad]."""
        return self._angle(float(np.clip(0.0, *self.limits)))

    @property
    def range(self) -> tuple[float, float]:
        """Its angles with the contact at the last and the first arc length [rad]."""
        low, high = self.limits
        return self._angle(high), self._angle(low)

    @property
    def offsets(self) -> tuple[float, float]:
        """Along the axis: the middle of the contact line; the links are not shifted against each other."""
        return self.middle, 0.0

    @property
    def ends(self) -> tuple[Array, Array]:
        """The contact at s = 0 in the plane through z, in the frames of the links below and above, (3,) both [mm]."""
        return np.array(self.child.start) @ self.frame[:2], np.array(self.parent.start) @ self.frame[:2]

    @property
    def line(self) -> float:
        """Half width of its contact line [mm]."""
        return self.half_width

    def table(self) -> JointTable:
        """Its map, in the lateral and axial directions."""
        return joint_table.tabulate(self.child, self.parent)

    def spacing(self) -> float:
        """Distance between the origins of its links at rest [mm]."""
        s, angle = float(np.clip(0.0, *self.limits)), self.neutral
        turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ self.parent.point(s)
        return float(np.linalg.norm(self.child.point(s) - turned))

    def check(self, number: int) -> None:
        """Raise MechanismError unless the surfaces can roll on each other."""
        joint_table.check_rolling(number, self.child, self.parent)

    def open_range(self, number: int, tendons: Sequence[int], below: Array, above: Array) -> tuple[float, float]:
        """Smallest and largest angle of the contact [rad]; MechanismError where holes cross between them."""
        surfaces, aside = (self.child, self.parent), above[:, 2] - below[:, 2]
        joint_table.check_gaps(number, tendons, *surfaces, below[:, :2], above[:, :2], aside)
        return self.range

    def arc_lengths(self, angles: Array) -> Array:
        """Contact arc lengths at joint angles, any shape [mm, rad]; beyond the range, the limit."""
        table, (low, high) = self.table(), self.range
        angles = np.clip(angles, low, high)
        cell = np.clip(np.searchsorted(table.cells[:, 0], angles, side="right") - 1, 0, None)
        u = (angles - table.cells[cell, 2]) * table.cells[cell, 3]
        powers = u[..., None] ** np.arange(N_COEFFICIENTS)
        return np.clip((table.arc_coefficients[cell] * powers).sum(axis=-1), *self.limits)

    def contact_frames(self, angles: Array) -> Array:
        """Tangent and normal of the contact, and the axis, in the link below at joint angles (...,), (..., 3, 3)."""
        slopes = self.child.tangent_angle(self.arc_lengths(angles))[..., None]
        lateral, axial, axis = self.frame
        tangents = np.cos(slopes) * lateral + np.sin(slopes) * axial
        return np.stack([tangents, np.cross(axis, tangents), np.broadcast_to(axis, tangents.shape)], axis=-2)

    def strips(self, count: int) -> list[Array]:
        """Its contact surfaces over the width of the line, on the links below and above, (count, 2, 3) [mm]."""
        curves = (side.point(np.linspace(*side.limits, count)) for side in (self.child, self.parent))
        ends = self.middle - self.half_width, self.middle + self.half_width
        return [
            np.stack([np.insert(curve, 2, along, axis=1) @ self.frame for along in ends], axis=1) for curve in curves
        ]

    def _angle(self, s: float) -> float:
        return float(self.child.tangent_angle(s) - self.parent.tangent_angle(s))


@dataclass(frozen=True)
class PointHinge(SpatialJoint):
    """A hinge of any axis, among rolling contacts or alone: the limit of surfaces without size.

    Args:
        axis: a direction, in the link below; the same in the link above. Held as a unit vector.
        below, above: the hinge in the frames of the links below and above it, (x, y, z) [mm].
        stiffness: of a torsion spring [N·mm/rad].
        rest_angle: where the spring carries no moment [rad]. The hinge is there at rest, or at the limit nearest to it.
        limits: smallest and largest angle [rad]. It ends earlier where two holes meet.
    Raises:
        MechanismError: an axis without direction, points that are not three numbers, limits that are not in order,
            angles beyond 2π.
    """

    axis: Sequence[float]
    below: Sequence[float]
    above: Sequence[float]
    stiffness: float = 0.0
    rest_angle: float = 0.0
    limits: tuple[float, float] = (-np.pi, np.pi)

    def __post_init__(self) -> None:
        for name, count in (("axis", 3), ("below", 3), ("above", 3), ("limits", 2)):
            values = as_floats(f"hinge {name}", getattr(self, name), f"{count} numbers", MechanismError)
            if values.shape != (count,) or not np.isfinite(values).all():
                raise MechanismError(f"hinge {name}", getattr(self, name), f"{count} numbers")
            object.__setattr__(self, name, tuple(values.tolist()))
        length = float(np.linalg.norm(self.axis))
        if not 0 < length < np.inf:
            raise MechanismError("hinge axis", self.axis, "a direction other than (0, 0, 0)")
        object.__setattr__(self, "axis", tuple((np.array(self.axis) / length).tolist()))
        low, high = self.limits
        if not -2 * np.pi <= low < high <= 2 * np.pi:
            raise MechanismError("hinge limits", self.limits, "two angles in order, from -2π to 2π [rad]")
        self._check_spring("hinge")

    @property
    def ends(self) -> tuple[Array, Array]:
        """The hinge in the frames of the links below and above, (3,) both [mm]."""
        return np.array(self.below, float), np.array(self.above, float)

    @property
    def frame(self) -> Array:
        """Lateral and axial direction of its plane, and its axis; the lateral direction lies across z, too."""
        axis = np.array(self.axis)
        lateral = np.cross([0.0, 0.0, 1.0], axis)
        if np.linalg.norm(lateral) <= _ALONG_Z:
            lateral = np.array([1.0, 0.0, 0.0]) - axis[0] * axis
        lateral /= np.linalg.norm(lateral)
        return np.stack([lateral, np.cross(axis, lateral), axis])

    @property
    def neutral(self) -> float:
        """Its rest angle, or the limit nearest to it [rad]."""
        return float(np.clip(self.rest_angle, *self.limits))

    @property
    def range(self) -> tuple[float, float]:
        """Its limits [rad]."""
        return self.limits

    @property
    def offsets(self) -> tuple[float, float]:
        """Along the axis: the hinge, and the origin of the link above."""
        below, above = (float(np.dot(self.axis, point)) for point in (self.below, self.above))
        return below, below - above

    def table(self) -> JointTable:
        """Its map, in the lateral and axial directions: sine and cosine as polynomials, exact to rounding."""
        low, high = self.limits
        edges = np.linspace(low, high, 1 + int(np.ceil((high - low) / _LARGEST_CELL)))
        middle, half = 0.5 * (edges[:-1] + edges[1:]), 0.5 * np.diff(edges)
        power = np.arange(N_COEFFICIENTS)
        factorials = np.cumprod(np.maximum(power, 1))
        terms = (half[:, None] ** power / factorials)[..., None]  # of a Taylor series about the middle of each cell
        turns = middle[:, None] + 0.5 * np.pi * power
        cos, sin = (terms[..., 0] * np.cos(turns))[..., None], (terms[..., 0] * np.sin(turns))[..., None]
        (bx, by), (ax, ay) = (self.frame[:2] @ point for point in (self.below, self.above))
        fixed = (power == 0)[:, None] * np.array([bx, by])
        origin = fixed - np.concatenate([cos * ax - sin * ay, sin * ax + cos * ay], axis=-1)
        still = np.zeros((len(middle), N_COEFFICIENTS, 2))
        coefficients = np.concatenate([cos, sin, still + fixed, origin, still], axis=-1)
        cells = np.stack([edges[:-1], edges[1:], middle, 1.0 / half], axis=1)
        return JointTable(cells, coefficients, np.zeros((len(middle), N_COEFFICIENTS)))

    def spacing(self) -> float:
        """Distance between the origins of its links at rest [mm]."""
        turned = se3.rotation(self.neutral * np.array(self.axis)) @ self.above
        return float(np.linalg.norm(np.subtract(self.below, turned)))

    def open_range(self, number: int, tendons: Sequence[int], below: Array, above: Array) -> tuple[float, float]:
        """Its limits, or nearer angles where holes meet [rad]; MechanismError where they meet at rest."""
        low, high = self.limits
        turn = self.neutral
        cos, sin = np.cos(turn), np.sin(turn)
        below = below - [*(self.frame[:2] @ self.below), 0.0]
        above = above - [*(self.frame[:2] @ self.above), 0.0]
        above = above @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        for tendon, w, u in zip(tendons, below, above, strict=True):
            length = float(np.linalg.norm(u - w))
            if length <= CLOSED_GAP:
                allowed = "a positive length [mm]: the holes meet"
                raise MechanismError(f"gap of tendon {tendon} across joint {number} at rest", length, allowed)
            closest = u[:2] @ w[:2], w[1] * u[0] - w[0] * u[1]
            square = u[:2] @ u[:2] + w[:2] @ w[:2] + (u[2] - w[2]) ** 2
            first, last = open_range(np.array([square, *closest]), CLOSED * length)
            low, high = max(low, turn + first), min(high, turn + last)
        return low, high
