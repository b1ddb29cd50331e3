"""Chains in space recomputed from geometry: rolling contacts and hinges, tendons, and the balance of every link.

Only the mechanism's own description is read: curvatures, places of surfaces and holes, axes, stiffnesses, coefficients.
"""

from typing import NamedTuple

import numpy as np

from rollingjoint import PointHinge
from rollingjoint.load import SPATIAL_LOAD_COLUMNS
from tests.attack import arms
from tests.attack.arms import ArmGeometry, between, rotations, times
from tests.attack.curve import Curve
from tests.attack.planar import ROLLING_PRESLIDING


class Placed(NamedTuple):
    """A joint at B angles, in the frame of the link below."""

    angles: np.ndarray  # (B,)
    pivot: np.ndarray  # (B, 3)
    origin: np.ndarray  # (B, 3) of the link above
    tangent: np.ndarray  # (B, 3)
    normal: np.ndarray  # (B, 3)


class _Rolling:
    """Two surfaces in a plane through z; its coordinate is the arc length of the contact."""

    def __init__(self, joint, _):
        self.child, self.parent, self.middle = Curve(joint.child), Curve(joint.parent), joint.middle
        cos, sin = np.cos(joint.azimuth), np.sin(joint.azimuth)
        self.plane, self.axis = np.array([[cos, sin, 0.0], [0.0, 0.0, 1.0]]), np.array([sin, -cos, 0.0])
        sides = np.array([joint.child.profile.limits, joint.parent.profile.limits])
        self.limits = sides[:, 0].max(), sides[:, 1].min()

    def coordinate(self, angles, arc_lengths):
        error = self.child.tangent(arc_lengths) - self.parent.tangent(arc_lengths) - angles
        return np.clip(arc_lengths - error / self.rate(arc_lengths), *self.limits)

    def rate(self, s):
        return self.child.curvature(s) - self.parent.curvature(s)

    def placed(self, s):
        tangent = self.child.tangent(s)
        angles = tangent - self.parent.tangent(s)
        pivot = self.child.point(s) @ self.plane + self.middle * self.axis
        lever = self.parent.point(s) @ self.plane + self.middle * self.axis
        along = np.stack([np.cos(tangent), np.sin(tangent)], axis=-1) @ self.plane
        origin = pivot - times(rotations(self.axis, angles), lever)
        return Placed(angles, pivot, origin, along, np.cross(self.axis, along))


class _Hinge:
    """A point and an axis; its coordinate is its angle."""

    def __init__(self, joint, limits):
        self.axis, self.limits = np.array(joint.axis), limits
        self.below, self.above = np.array(joint.below), np.array(joint.above)
        across = np.cross([0.0, 0.0, 1.0], self.axis)
        self.tangent = across / np.linalg.norm(across)

    def coordinate(self, angles, _):
        return angles

    def rate(self, angles):
        return np.ones_like(angles)

    def placed(self, angles):
        pivot = np.tile(self.below, (len(angles), 1))
        tangent = np.tile(self.tangent, (len(angles), 1))
        origin = pivot - rotations(self.axis, angles) @ self.above
        return Placed(angles, pivot, origin, tangent, np.cross(self.axis, tangent))


class Cuts(NamedTuple):
    """As arms.Cuts, with the directions at every joint, in the base frame."""

    angles: np.ndarray
    R: np.ndarray
    origins: np.ndarray
    axes: np.ndarray
    pivots: np.ndarray
    above: np.ndarray
    pulls: np.ndarray
    gaps: np.ndarray
    turns: np.ndarray
    tangents: np.ndarray  # (B, J, 3)
    normals: np.ndarray  # (B, J, 3)


assert Cuts._fields[: len(arms.Cuts._fields)] == arms.Cuts._fields


class SpaceGeometry(ArmGeometry):
    """One chain."""

    def __init__(self, chain):
        self.chain, self.J, self.m = chain, chain.n_joints, chain.n_tendons
        ranges = np.array(chain.joint_limits)
        self.hinged = np.array([isinstance(joint, PointHinge) for joint in chain.joints])
        self.joints = [
            (_Hinge if hinged else _Rolling)(joint, tuple(ends))
            for hinged, joint, ends in zip(self.hinged, chain.joints, ranges, strict=True)
        ]
        self.stiffnesses = np.array([joint.stiffness for joint in chain.joints])
        self.rests = np.array([joint.rest_angle for joint in chain.joints])
        self.limits = np.array([joint.limits for joint in self.joints]).T
        self.ends = [tendon.end % chain.n_links for tendon in chain.tendons]
        self.crossed = np.arange(self.J)[:, None] < self.ends
        self.holes = [
            np.array(list(tendon.holes) * (end + 1) if len(tendon.holes) == 1 else tendon.holes)
            for tendon, end in zip(chain.tendons, self.ends, strict=True)
        ]
        rows = [row for spring in chain.springs for row in spring.spatial_rows(chain.n_links)]
        columns = [[row.get(name, 0.0) for row in rows] for name in SPATIAL_LOAD_COLUMNS]
        self.standing = np.array(columns).T

    def coordinates(self, result):
        """Arc lengths of contacts that make the joint angles, and angles of hinges, (B, J)."""
        pairs = zip(self.joints, np.array(result.joint_angles).T, np.array(result.arc_lengths).T, strict=True)
        return np.stack([joint.coordinate(angles, s) for joint, angles, s in pairs], axis=-1)

    def turning_rates(self, at):
        """d joint angle / d coordinate, (B, J)."""
        return np.stack([joint.rate(part) for joint, part in zip(self.joints, at.T, strict=True)], axis=-1)

    def inside(self, j):
        """Length of a tendon inside the links [mm]."""
        return np.linalg.norm(self.holes[j][:, 1] - self.holes[j][:, 0], axis=1).sum()

    def cuts(self, at):
        """Everything at coordinates, (B, J)."""
        B, J, m = len(at), self.J, self.m
        R, origins, angles = np.zeros((B, J + 1, 3, 3)), np.zeros((B, J + 1, 3)), np.empty((B, J))
        axes, pivots, tangents, normals = np.empty((4, B, J, 3))
        R[:, 0] = np.eye(3)
        above, pulls = np.zeros((2, B, J, m, 3))
        gaps, turns = np.zeros((B, J, m)), np.zeros((B, J, m, 2))
        for i, joint in enumerate(self.joints):
            here, below = joint.placed(at[:, i]), R[:, i]
            angles[:, i], axes[:, i] = here.angles, below @ joint.axis
            R[:, i + 1] = below @ rotations(joint.axis, here.angles)
            pivots[:, i] = origins[:, i] + times(below, here.pivot)
            origins[:, i + 1] = origins[:, i] + times(below, here.origin)
            tangents[:, i], normals[:, i] = times(below, here.tangent), times(below, here.normal)
            for j in np.flatnonzero(self.crossed[i]):
                start = origins[:, i] + below @ self.holes[j][i, 1]
                above[:, i, j] = origins[:, i + 1] + R[:, i + 1] @ self.holes[j][i + 1, 0]
                way = start - above[:, i, j]
                gaps[:, i, j] = np.linalg.norm(way, axis=-1)
                pulls[:, i, j] = way / np.maximum(gaps[:, i, j], 1e-300)[:, None]
                turns[:, i, j, 0] = between(below @ self._channel(j, i), -pulls[:, i, j])
                turns[:, i, j, 1] = between(-pulls[:, i, j], R[:, i + 1] @ self._channel(j, i + 1))
        return Cuts(angles, R, origins, axes, pivots, above, pulls, gaps, turns, tangents, normals)

    def _channel(self, j, i):
        """The way of a tendon through a link; one without length counts as the link's z axis."""
        through = self.holes[j][i, 1] - self.holes[j][i, 0]
        return through if np.linalg.norm(through) > 0.0 else np.array([0.0, 0.0, 1.0])

    def _with_standing(self, table):
        return np.concatenate([table, np.repeat(self.standing[None], len(table), axis=0)], axis=1)

    def imbalance(self, cuts, table, tensions, before=None):
        """(moment about the axis that is not balanced, sum of its terms, force along the normal), (B, J) each."""
        table = self._with_standing(table)
        torque, size, _ = super().imbalance(cuts, table, tensions)
        force, _ = self.wrenches(table, cuts)
        beyond = np.cumsum(force[:, :0:-1], axis=1)[:, ::-1] + (tensions[..., None] * cuts.pulls).sum(axis=2)
        normal = -np.einsum("bia,bia->bi", beyond, cuts.normals)
        arm = self.chain.friction.rolling if before is not None and self.chain.friction else 0.0
        if arm > 0.0:
            state = np.clip(before.rolling + (cuts.angles - before.angles) / ROLLING_PRESLIDING, -1.0, 1.0)
            torque = torque - np.where(self.hinged, 0.0, arm * state * np.maximum(normal, 0.0))
        return torque, size, normal

    def unbalanced(self, cuts, table, tensions, reactions):
        """What reactions, tendons and loads leave on every moving link, (B, J), of one plus the sum of what acts there.

        reactions: (B, J, 6) on the link above at the pivot, along tangent, normal and axis. The larger of a force [N]
        and a moment about the pivot below the link [N·mm].
        """
        force, moment = self.wrenches(self._with_standing(table), cuts)
        frames = np.stack([cuts.tangents, cuts.normals, cuts.axes], axis=-2)
        push, couple = (np.einsum("bik,bika->bia", reactions[..., part], frames) for part in (slice(3), slice(3, 6)))
        pull = tensions[..., None] * cuts.pulls
        below = cuts.above + cuts.gaps[..., None] * cuts.pulls
        sizes = np.abs(force).sum(axis=-1) + np.abs(moment).sum(axis=-1)
        for link, sign, place in ((slice(1, None), 1.0, cuts.above), (slice(0, -1), -1.0, below)):
            force[:, link] += sign * (push + pull.sum(axis=2))
            levers = np.cross(place, pull)
            moment[:, link] += sign * (np.cross(cuts.pivots, push) + couple + levers.sum(axis=2))
            sizes[:, link] += np.abs(push).sum(axis=-1) + np.abs(couple).sum(axis=-1) + np.abs(levers).sum(axis=(2, 3))
        about = moment[:, 1:] - np.cross(cuts.pivots, force[:, 1:])
        left = np.maximum(np.abs(force[:, 1:]).max(axis=-1), np.abs(about).max(axis=-1))
        return left / (1.0 + sizes[:, 1:])

    def energy(self, at, table, tendon_energy):
        """Potential energy at coordinates, (B,); for dead forces and springs."""
        return super().energy(at, self._with_standing(table), tendon_energy)
