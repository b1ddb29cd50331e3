"""Planar equilibria recomputed from geometry: rolling contact, tendons, capstan friction, balance of every part.

Only the mechanism's own description is read: curvatures, places of surfaces and holes, stiffnesses, coefficients.
"""

from typing import NamedTuple

import numpy as np

from rollingjoint import OnSurface
from tests.attack.curve import Curve
from tests.attack.law import gap_tensions

ROLLING_PRESLIDING = 1e-3  # rad


class Cuts(NamedTuple):
    """What is found at every joint: B rows, J joints, m tendons."""

    angles: np.ndarray  # (B, J)
    poses: np.ndarray  # (B, J + 1, 3)
    contacts: np.ndarray  # (B, J, 2)
    normals: np.ndarray  # (B, J, 2) of the surface below
    above: np.ndarray  # (B, J, m, 2) where the tendon enters the link above
    pulls: np.ndarray  # (B, J, m, 2) unit vectors, from there to the hole below
    gaps: np.ndarray  # (B, J, m)
    turns: np.ndarray  # (B, J, m, 2) of the tendon at the hole below and at the hole above


class PlanarGeometry:
    """One chain."""

    dimension = 2

    def __init__(self, chain):
        self.chain, self.J, self.m = chain, chain.n_joints, chain.n_tendons
        self.child = [Curve(link.child) for link in chain.links]
        self.parent = [Curve(link.parent) for link in chain.links]
        self.ends = [tendon.end % chain.n_links for tendon in chain.tendons]
        self.holes = [self._holes(j) for j in range(self.m)]
        self.crossed = np.arange(self.J)[:, None] < self.ends
        self.limits = np.array(chain.joint_limits).T

    def _holes(self, j):
        """(parent hole, child hole) of links 0 to the end, (end + 1, 2, 2)."""
        pairs = self.chain.tendons[j].holes
        pairs = pairs * (self.ends[j] + 1) if len(pairs) == 1 else pairs
        return np.array([[_at(pair[0], self.parent[i]), _at(pair[1], self.child[i])] for i, pair in enumerate(pairs)])

    def inside(self, j):
        """Length of a tendon inside the links [mm]."""
        return np.linalg.norm(self.holes[j][:, 1] - self.holes[j][:, 0], axis=1).sum()

    def coordinates(self, result):
        """Arc lengths at which the surfaces' tangents make the joint angles of the result, (B, J) [mm]."""
        s = np.array(result.arc_lengths)
        low, high = self.limits
        for i in range(self.J):
            child, parent = self.child[i], self.parent[i + 1]
            error = child.tangent(s[:, i]) - parent.tangent(s[:, i]) - result.joint_angles[:, i]
            slope = child.curvature(s[:, i]) - parent.curvature(s[:, i])
            s[:, i] = np.clip(s[:, i] - error / slope, low[i], high[i])
        return s

    def turning_rates(self, s):
        """d joint angle / d arc length, (B, J) [1/mm]."""
        pairs = zip(self.child[:-1], self.parent[1:], s.T, strict=True)
        return np.stack([child.curvature(at) - parent.curvature(at) for child, parent, at in pairs], axis=-1)

    def cuts(self, s):
        """Everything at arc lengths s, (B, J)."""
        B, J, m = len(s), self.J, self.m
        angles, poses = np.empty((B, J)), np.zeros((B, J + 1, 3))
        contacts, normals, (above, pulls) = np.empty((B, J, 2)), np.empty((B, J, 2)), np.zeros((2, B, J, m, 2))
        gaps, turns = np.zeros((B, J, m)), np.zeros((B, J, m, 2))
        for i in range(J):
            child, parent, at = self.child[i], self.parent[i + 1], s[:, i]
            tangent, place = child.tangent(at), child.point(at)
            angles[:, i] = tangent - parent.tangent(at)
            origin = place - turned(angles[:, i], parent.point(at))
            poses[:, i + 1, :2] = poses[:, i, :2] + turned(poses[:, i, 2], origin)
            poses[:, i + 1, 2] = poses[:, i, 2] + angles[:, i]
            contacts[:, i] = poses[:, i, :2] + turned(poses[:, i, 2], place)
            normal = poses[:, i, 2] + tangent
            normals[:, i] = np.stack([-np.sin(normal), np.cos(normal)], axis=-1)
            for j in np.flatnonzero(self.crossed[i]):
                below = poses[:, i, :2] + turned(poses[:, i, 2], self.holes[j][i, 1])
                above[:, i, j] = poses[:, i + 1, :2] + turned(poses[:, i + 1, 2], self.holes[j][i + 1, 0])
                way = below - above[:, i, j]
                gaps[:, i, j] = np.linalg.norm(way, axis=-1)
                pulls[:, i, j] = way / np.maximum(gaps[:, i, j], 1e-300)[:, None]
                turns[:, i, j, 0] = between(self._channel(j, i, poses), -pulls[:, i, j])
                turns[:, i, j, 1] = between(-pulls[:, i, j], self._channel(j, i + 1, poses))
        return Cuts(angles, poses, contacts, normals, above, pulls, gaps, turns)

    def _channel(self, j, i, poses):
        """The way of a tendon through a link; one without length counts as the link's y axis."""
        through = self.holes[j][i, 1] - self.holes[j][i, 0]
        return turned(poses[:, i, 2], through if np.linalg.norm(through) > 0.0 else np.array([0.0, 1.0]))

    def lengths(self, cuts):
        """Tendon lengths, (B, m) [mm]."""
        return cuts.gaps.sum(axis=1) + [self.inside(j) for j in range(self.m)]

    def wrenches(self, table, poses):
        """(force, moment about the origin) of all loads on every link, (B, J + 1, 2) and (B, J + 1)."""
        rows = np.arange(len(poses))
        force, moment = np.zeros((*poses.shape[:2], 2)), np.zeros(poses.shape[:2])
        standing = self._standing(table)
        for row in np.moveaxis(np.concatenate([table, standing], axis=1), 1, 0):
            link, other = row[:, 0].astype(int), row[:, 13].astype(int)
            angle = poses[rows, link, 2]
            at = poses[rows, link, :2] + turned(angle, row[:, 1:3])
            pull = row[:, 3:5] + turned(angle, row[:, 5:7]) + row[:, 8:9] * (row[:, 9:11] - at)
            np.add.at(force, (rows, link), pull)
            np.add.at(moment, (rows, link), cross(at, pull) + row[:, 7])
            torque = row[:, 11] * (angle - poses[rows, other, 2] - row[:, 12])
            np.add.at(moment, (rows, link), -torque)
            np.add.at(moment, (rows, other), torque)
        return force, moment

    def _standing(self, table):
        """Rows of the mechanism's own springs."""
        rows = [row for spring in self.chain.springs for row in spring.rows(self.chain.n_links)]
        standing = np.zeros((len(rows), 14))
        columns = ["link", "px", "py", "fx", "fy", "bx", "by", "moment", "k", "ax", "ay", "torsion", "rest", "other"]
        for place, row in enumerate(rows):
            for name, value in row.items():
                standing[place, columns.index(name)] = value
        return np.repeat(standing[None], len(table), axis=0)

    def gap_tensions(self, cuts, motor, before, rolling):
        """(tensions of every gap, friction states, slips); without a history the motor's in every gap."""
        return gap_tensions(self, cuts, motor, before)

    def imbalance(self, cuts, table, tensions, before=None, outside=(0.0, 0.0, 0.0)):
        """(torque that is not balanced, sum of its terms, contact force along the normal), (B, J) each.

        outside: further force and moment about the origin on every link, and the sum of the moment's terms.
        """
        force, moment = self.wrenches(table, cuts.poses)
        force, moment = force + outside[0], moment + outside[1]
        beyond, about = (np.cumsum(part[:, :0:-1], axis=1)[:, ::-1] for part in (force, moment))
        tendon = tensions[..., None] * cuts.pulls
        levers = cross(cuts.above - cuts.contacts[:, :, None], tendon)
        torque = about - cross(cuts.contacts, beyond) + levers.sum(axis=2)
        size = np.abs(about) + np.abs(cross(cuts.contacts, beyond)) + np.abs(levers).sum(axis=2) + tensions.sum(axis=2)
        size = size + np.cumsum((outside[2] + np.zeros_like(moment))[:, :0:-1], axis=1)[:, ::-1]
        normal = -np.einsum("bia,bia->bi", beyond + tendon.sum(axis=2), cuts.normals)
        arm = self.chain.friction.rolling if before is not None and self.chain.friction else 0.0
        if arm > 0.0:
            state = np.clip(before.rolling + (cuts.angles - before.angles) / ROLLING_PRESLIDING, -1.0, 1.0)
            torque = torque - arm * state * np.maximum(normal, 0.0)
        return torque, size, normal

    def energy(self, s, table, tendon_energy):
        """Potential energy at arc lengths, (B,); for loads with a potential."""
        cuts = self.cuts(s)
        rows, energy = np.arange(len(s)), tendon_energy(self.lengths(cuts))
        for row in np.moveaxis(np.concatenate([table, self._standing(table)], axis=1), 1, 0):
            link, other = row[:, 0].astype(int), row[:, 13].astype(int)
            angle = cuts.poses[rows, link, 2]
            at = cuts.poses[rows, link, :2] + turned(angle, row[:, 1:3])
            energy = energy - np.einsum("ba,ba->b", row[:, 3:5], at) - row[:, 7] * angle
            energy = energy + 0.5 * row[:, 8] * ((row[:, 9:11] - at) ** 2).sum(axis=1)
            energy = energy + 0.5 * row[:, 11] * (angle - cuts.poses[rows, other, 2] - row[:, 12]) ** 2
        return energy


def _at(hole, curve):
    return curve.point(np.array(hole.s)) if isinstance(hole, OnSurface) else np.array(hole, float)


def turned(angle, vector):
    """Vectors (..., 2) turned by angles (...)."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack([cos * vector[..., 0] - sin * vector[..., 1], sin * vector[..., 0] + cos * vector[..., 1]], -1)


def cross(a, b):
    """Of plane vectors."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def between(u, v):
    """Angles between plane vectors, 0 to pi [rad]."""
    return np.arctan2(np.abs(cross(u, v)), np.einsum("...a,...a->...", u, v))
