"""The bodies of links in space: round, between two faces, with a channel for every tendon.

A face at a rolling joint is the contact surface, extruded over the width of the contact line and continued along the
tangents at its ends, which stop the joint at its limits; beside the line it is set back. A face at a hinge is flat
through the outermost hole, and bevelled where neighbours would meet in the range of the joint. Any other face is flat.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rollingjoint.cad.fabrication import Fabrication
from rollingjoint.cad.sampling import surface_polyline
from rollingjoint.chain.hinge import HingeChain
from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.chain.spatial_joints import PointHinge, RollingContact, SpatialJoint
from rollingjoint.errors import MechanismError
from rollingjoint.profile import Surface

Array = NDArray[np.float64]

SET_BACK = 0.2  # mm, of a face beside its contact line
BELOW, ABOVE = -1, 1  # the sides of a body, as signs of z

_STEEPEST = np.radians(80.0)  # of a surface against the plane of its link
_WIDEST = np.radians(60.0)  # half angle of a flare
_POSES = 33  # over the ranges of all joints, at which tendons leave their holes
_ROUNDING = 1e-6  # mm that a hole may lie outside
_ACROSS = 1e-9  # cosine of the angle between z and an axis across it
_ALONG_Z = np.array([0.0, 0.0, 1.0])
_UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True, eq=False)
class SpatialFace:
    """One end of a body.

    Attributes:
        side: BELOW or ABOVE.
        frame: lateral and axial direction and the axis, the rows of a rotation matrix (3, 3).
        curve: from left to right in the lateral and the axial direction, (k, 2) [mm].
        slopes: of its tangents at both ends.
        middle, half_width: of the contact line along the axis [mm]; an infinite half width for a flat face.
    """

    side: int
    frame: Array
    curve: Array
    slopes: tuple[float, float] = (0.0, 0.0)
    middle: float = 0.0
    half_width: float = np.inf

    @property
    def rolls(self) -> bool:
        """Whether it is a contact surface."""
        return bool(np.isfinite(self.half_width))

    @property
    def corners(self) -> Array:
        """The corners of a contact surface, (4, 3) [mm]; none of a flat face."""
        if not self.rolls:
            return np.zeros((0, 3))
        ends = self.middle - self.half_width, self.middle + self.half_width
        return np.array([[*point, along] for point in self.curve[[0, -1]] for along in ends]) @ self.frame

    def continued(self, reach: float) -> Array:
        """The curve with tangents at its ends, out to the lateral places -reach and reach, (k + 2, 2) [mm]."""
        ends = zip(self.curve[[0, -1]], self.slopes, (-reach, reach), strict=True)
        first, last = ([to, z + (to - x) * slope] for (x, z), slope, to in ends)
        return np.array([first, *self.curve, last])

    def height(self, points: Array) -> Array:
        """z of the face above or below points (..., 3) [mm]."""
        lateral, _, along = np.moveaxis(points @ self.frame.T, -1, 0)
        curve = self.continued(1.0 + float(np.max(np.abs([*lateral.ravel(), *self.curve[:, 0]]))))
        beside = np.abs(along - self.middle) > self.half_width
        return np.asarray(np.interp(lateral, *curve.T) - self.side * SET_BACK * beside)


@dataclass(frozen=True, eq=False)
class SpatialChannel:
    """A round hole through a link, straight from a tendon's parent hole to its child hole and flared from there.

    Attributes:
        tendon: index of the tendon.
        holes: parent and child hole, (2, 3) [mm].
        flares: half angles of the cones outside of both holes, in which the tendon turns, (2,) [rad].
        diameter: [mm].
    """

    tendon: int
    holes: Array
    flares: Array
    diameter: float


@dataclass(frozen=True, eq=False)
class SpatialBody:
    """A link as manufactured, in its frame.

    Attributes:
        below, above: its faces.
        radius: of its round outline about z [mm].
        channels: one per tendon that passes.
        bore: diameter of a hole along z, 0 for none [mm].
    """

    below: SpatialFace
    above: SpatialFace
    radius: float
    channels: tuple[SpatialChannel, ...]
    bore: float = 0.0

    @property
    def faces(self) -> tuple[SpatialFace, SpatialFace]:
        """The faces, the lower one first."""
        return self.below, self.above

    def alike(self, other: SpatialBody) -> bool:
        """Whether both are identical to 1e-9 mm."""
        pairs = list(zip(self._numbers, other._numbers, strict=True))
        return all(a.shape == b.shape and bool(np.allclose(a, b, rtol=0.0, atol=1e-9)) for a, b in pairs)

    @cached_property
    def _numbers(self) -> list[Array]:
        faces = [
            number
            for face in self.faces
            for number in (face.frame, face.curve, np.array([*face.slopes, face.middle, face.half_width]))
        ]
        channels = [np.array([[*c.holes.ravel(), *c.flares, c.diameter] for c in self.channels])]
        return [*faces, np.array([self.radius, self.bore]), *channels]


def spatial_bodies(mechanism: SpatialChain | HingeChain, fabrication: Fabrication | None = None) -> list[SpatialBody]:
    """The body of every link, base first; the base of an arm is as thick as the fabrication says.

    Raises:
        MechanismError: a surface that is too steep, a hole outside the body, a channel with too thin a wall, an arm
            with tendons that are not exact.
    """
    making = fabrication or Fabrication()
    chain = mechanism if isinstance(mechanism, SpatialChain) else _with_ends(mechanism, making.thickness)
    flares = _flares(chain)
    return [_body(chain, link, making, flares) for link in range(chain.n_links)]


def _with_ends(arm: HingeChain, thickness: float) -> SpatialChain:
    """The arm as a chain in space, its holes led through a base of this thickness and to the last distal face."""
    chain, last, tendons = SpatialChain.from_arm(arm), arm.n_joints, []
    for tendon, points in zip(chain.tendons, chain.hole_points, strict=True):
        holes = points.copy()
        holes[0, 0, 2] -= thickness
        holes[last:, 1, 2] = 0.0
        tendons.append(replace(tendon, holes=holes.tolist()))
    return chain.replace(tendons=tendons)


def _body(chain: SpatialChain, link: int, making: Fabrication, flares: list[Array]) -> SpatialBody:
    passing = [tendon for tendon, points in enumerate(chain.hole_points) if link < len(points)]
    holes = np.array([chain.hole_points[tendon][link] for tendon in passing]).reshape(-1, 2, 3)
    below, above = _faces(chain, link, holes, making)
    room = 0.5 * making.channel_diameter + (making.wall if making.channel_diameter else 0.0)
    reaches = [
        *(np.hypot(*corner[:2]) for face in (below, above) for corner in face.corners),
        *(np.hypot(*hole[:2]) + room for hole in holes.reshape(-1, 3)),
    ]
    if making.bore:
        reaches.append(0.5 * making.bore + making.wall)
    radius = float(max(reaches, default=0.5 * making.thickness))
    if not making.channel_diameter:
        return SpatialBody(below, above, radius, (), making.bore)
    channels = tuple(
        SpatialChannel(tendon, pair, flares[tendon][link], making.channel_diameter)
        for tendon, pair in zip(passing, holes, strict=True)
    )
    body = SpatialBody(below, above, radius, channels, making.bore)
    _check_holes(link, body)
    _check_walls(link, body, making.wall)
    return body


def _faces(chain: SpatialChain, link: int, holes: Array, making: Fabrication) -> tuple[SpatialFace, SpatialFace]:
    """Lower and upper face of a link: contact surfaces where it rolls, else flat at its outermost hole."""
    joints: dict[int, SpatialJoint | None] = {
        BELOW: chain.joints[link - 1] if link else None,
        ABOVE: chain.joints[link] if link < chain.n_joints else None,
    }
    faces = {
        side: _contact_face(link, side, joint, making.tolerance)
        for side, joint in joints.items()
        if isinstance(joint, RollingContact)
    }
    for side in {BELOW, ABOVE} - set(faces):
        joint, levels = joints[side], holes[:, int(side > 0), 2]
        if len(levels):
            level = float(side * np.max(side * levels))
        elif isinstance(joint, PointHinge):
            level = float((joint.below if side == ABOVE else joint.above)[2])
        else:
            opposite = faces[-side].curve[:, 1] if -side in faces else np.zeros(1)
            level = float(side * np.max(side * opposite) + side * making.thickness)
        faces[side] = _hinge_face(chain, link, side, level) or SpatialFace(side, _UPRIGHT, _flat(1.0, level))
    return faces[BELOW], faces[ABOVE]


def _hinge_face(chain: SpatialChain, link: int, side: int, level: float) -> SpatialFace | None:
    """A face at a hinge across z, flat around it; beyond, it stays on its side of the middle plane of the bend."""
    number = link if side == ABOVE else link - 1
    joint = chain.joints[number] if 0 <= number < chain.n_joints else None
    if not isinstance(joint, PointHinge) or abs(joint.frame[2, 2]) > _ACROSS:
        return None
    lateral, height, _ = joint.frame @ (joint.below if side == ABOVE else joint.above)
    slope = float(np.tan(min(0.5 * np.abs(chain.joint_limits[number]).max(), _WIDEST)))
    room = side * (height - level)
    if room <= 0.0 or slope <= 0.0:
        return None
    curve = _flat(room / slope, level) + np.array([lateral, 0.0])
    return SpatialFace(side, joint.frame, curve, (side * slope, -side * slope))


def _flat(half: float, level: float) -> Array:
    return np.array([[-half, level], [half, level]])


def _contact_face(link: int, side: int, joint: RollingContact, tolerance: float) -> SpatialFace:
    surface: Surface = joint.child if side == ABOVE else joint.parent
    curve = surface_polyline(surface, tolerance)
    x, z = np.diff(curve, axis=0).T
    slopes = np.abs(np.arctan2(z, x))
    if slopes.max() > _STEEPEST:
        name = "child" if side == ABOVE else "parent"
        raise MechanismError(
            f"slope of the {name} surface of link {link}",
            round(float(slopes.max()), 4),
            f"at most {_STEEPEST:.4g} rad against the plane across z",
            "Narrow the surface limits.",
        )
    first, last = np.tan(surface.tangent_angle(np.array(surface.limits))).tolist()
    return SpatialFace(side, joint.frame, curve, (first, last), joint.middle, joint.half_width)


def _flares(chain: SpatialChain) -> list[Array]:
    """For every tendon the largest angle between channel and gap at both holes of its links, (links, 2) [rad]."""
    shares = np.linspace(0.0, 1.0, _POSES)[:, None]
    poses = chain.poses(np.clip((1.0 - shares) * chain.joint_limits[:, 0] + shares * chain.joint_limits[:, 1],
                                *chain.joint_limits.T))  # fmt: skip
    flares = [np.zeros((len(points), 2)) for points in chain.hole_points]
    for placed in poses:
        for turns, line in zip(flares, chain.tendon_polyline(placed), strict=True):
            channels, gaps = line[1::2] - line[::2], line[2::2] - line[1:-1:2]
            turns[:-1, 1] = np.maximum(turns[:-1, 1], _angles(channels[:-1], gaps))
            turns[1:, 0] = np.maximum(turns[1:, 0], _angles(gaps, channels[1:]))
    return [np.minimum(turns, _WIDEST) for turns in flares]


def _angles(first: Array, second: Array) -> Array:
    """Angles between vectors (k, 3) in pairs, (k,) [rad]."""
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(first, second), axis=-1), (first * second).sum(axis=-1)))


def _check_holes(link: int, body: SpatialBody) -> None:
    for channel in body.channels:
        span = float(np.linalg.norm(np.subtract(*channel.holes)))
        if span < channel.diameter:
            allowed = f"at least the diameter, {channel.diameter:g} mm: their line is the channel"
            raise MechanismError(f"distance of the holes of tendon {channel.tendon} in link {link}", span, allowed)
        for face, hole, name in zip(body.faces, channel.holes, ("parent", "child"), strict=True):
            outside = float(face.side * (hole[2] - face.height(hole[None])[0]))
            if outside > _ROUNDING:
                raise MechanismError(
                    f"{name} hole of tendon {channel.tendon} in link {link}",
                    hole.tolist(),
                    f"a point inside the body; it lies {outside:.3g} mm outside",
                    "Move it along z into the link.",
                )


def _check_walls(link: int, body: SpatialBody, wall: float) -> None:
    for channel in body.channels if body.bore else ():
        thickness = float(_distance(channel.holes, channel.holes * _ALONG_Z) - 0.5 * (channel.diameter + body.bore))
        if thickness < wall:
            raise MechanismError(
                f"wall between the bore and the channel of tendon {channel.tendon} in link {link}",
                round(thickness, 4),
                f"at least {wall:g} mm",
                "Make the bore narrower.",
            )
    for first, second in itertools.combinations(body.channels, 2):
        thickness = _distance(first.holes, second.holes) - first.diameter
        if thickness < wall:
            raise MechanismError(
                f"wall between the channels of tendons {first.tendon} and {second.tendon} in link {link}",
                round(thickness, 4),
                f"at least {wall:g} mm",
                "Move the holes apart, or make the channels narrower.",
            )


def _distance(first: Array, second: Array) -> float:
    """Smallest distance of two segments (2, 3) [mm]."""
    (p, u), (q, v) = ((points[0], points[1] - points[0]) for points in (first, second))
    w, a, b, c = p - q, u @ u, u @ v, v @ v
    across = a * c - b * b
    share = np.clip((b * (v @ w) - c * (u @ w)) / across, 0.0, 1.0) if across > 1e-12 * a * c else 0.0
    other = np.clip((b * share + v @ w) / c, 0.0, 1.0)
    share = np.clip((b * other - u @ w) / a, 0.0, 1.0)
    return float(np.linalg.norm(w + share * u - other * v))
