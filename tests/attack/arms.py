"""Equilibria of arms recomputed from geometry: hinges, tendon segments, capstan friction, balance of moments."""

from typing import NamedTuple

import numpy as np

from tests.attack.law import gap_tensions

_Z = np.array([0.0, 0.0, 1.0])


class Cuts(NamedTuple):
    """What is found at every hinge: B rows, J hinges, m tendons."""

    angles: np.ndarray  # (B, J)
    R: np.ndarray  # (B, J + 1, 3, 3) orientations of the links
    origins: np.ndarray  # (B, J + 1, 3)
    axes: np.ndarray  # (B, J, 3) of the hinges in the base frame
    pivots: np.ndarray  # (B, J, 3) the hinges, or contacts of links that roll
    above: np.ndarray  # (B, J, m, 3)
    pulls: np.ndarray  # (B, J, m, 3)
    gaps: np.ndarray  # (B, J, m)
    turns: np.ndarray  # (B, J, m, 2)


class ArmGeometry:
    """One arm with straight tendon segments (model "exact")."""

    dimension = 3

    def __init__(self, arm):
        self.chain, self.J, self.m = arm, arm.n_joints, arm.n_tendons
        self.spacing = np.array([bead.spacing for bead in arm.beads])
        self.half = 0.5 * np.array([*(bead.gap for bead in arm.beads), arm.beads[-1].gap])
        self.axes = np.array([bead.axis for bead in arm.beads])
        self.stiffnesses = np.array([bead.stiffness for bead in arm.beads])
        self.rests, self.limits = arm.neutral_angles, np.array(arm.joint_limits).T
        self.ends = [tendon.end % arm.n_links for tendon in arm.tendons]
        self.crossed = np.arange(self.J)[:, None] < self.ends
        self.holes = [
            np.array(list(tendon.holes) * (end + 1) if len(tendon.holes) == 1 else tendon.holes)
            for tendon, end in zip(arm.tendons, self.ends, strict=True)
        ]

    def coordinates(self, result):
        """The angles of the result, (B, J) [rad]."""
        return np.array(result.joint_angles)

    def turning_rates(self, angles):
        """d joint angle / d coordinate, (B, J)."""
        return np.ones_like(angles)

    def inside(self, j):
        """Length of a tendon inside the beads [mm]."""
        end = self.ends[j]
        return (self.spacing[:end] - self.half[:end] - self.half[1 : end + 1]).sum()

    def cuts(self, angles):
        """Everything at hinge angles, (B, J)."""
        B, J, m = len(angles), self.J, self.m
        R, origins, axes = np.zeros((B, J + 1, 3, 3)), np.zeros((B, J + 1, 3)), np.empty((B, J, 3))
        R[:, 0] = np.eye(3)
        above, pulls = np.zeros((2, B, J, m, 3))
        gaps, turns = np.zeros((B, J, m)), np.zeros((B, J, m, 2))
        for i in range(J):
            R[:, i + 1] = R[:, i] @ rotations(self.axes[i], angles[:, i])
            axes[:, i] = R[:, i] @ self.axes[i]
            origins[:, i + 1] = origins[:, i] + self.spacing[i] * R[:, i + 1, :, 2]
            for j in np.flatnonzero(self.crossed[i]):
                below = origins[:, i] + R[:, i] @ [*self.holes[j][i], -self.half[i]]
                above[:, i, j] = origins[:, i] + R[:, i + 1] @ [*self.holes[j][i + 1], self.half[i]]
                way = below - above[:, i, j]
                gaps[:, i, j] = np.linalg.norm(way, axis=-1)
                pulls[:, i, j] = way / gaps[:, i, j, None]
                turns[:, i, j, 0] = between(R[:, i, :, 2], -pulls[:, i, j])
                turns[:, i, j, 1] = between(-pulls[:, i, j], R[:, i + 1, :, 2])
        return Cuts(angles, R, origins, axes, origins[:, :-1], above, pulls, gaps, turns)

    def lengths(self, cuts):
        """Tendon lengths, (B, m) [mm]."""
        return cuts.gaps.sum(axis=1) + [self.inside(j) for j in range(self.m)]

    def wrenches(self, table, cuts):
        """(force, moment about the origin) of all loads on every link, (B, J + 1, 3) each."""
        rows, shape = np.arange(len(table)), cuts.origins.shape
        force, moment = np.zeros(shape), np.zeros(shape)
        for row in np.moveaxis(table, 1, 0):
            link = row[:, 0].astype(int)
            R, origin = cuts.R[rows, link], cuts.origins[rows, link]
            at = origin + times(R, row[:, 1:4])
            pull = row[:, 4:7] + times(R, row[:, 10:13]) + row[:, 16:17] * (row[:, 17:20] - at)
            np.add.at(force, (rows, link), pull)
            np.add.at(moment, (rows, link), np.cross(at, pull) + row[:, 7:10] + times(R, row[:, 13:16]))
        return force, moment

    def gap_tensions(self, cuts, motor, before, rolling):
        """(tensions of every gap, friction states, slips); without a history the motor's in every gap."""
        return gap_tensions(self, cuts, motor, before)

    def imbalance(self, cuts, table, tensions, before=None):
        """(moment about the hinge that is not balanced, sum of its terms, None), (B, J) each."""
        force, moment = self.wrenches(table, cuts)
        beyond, about = (np.cumsum(part[:, :0:-1], axis=1)[:, ::-1] for part in (force, moment))
        loads = about - np.cross(cuts.pivots, beyond)
        levers = np.cross(cuts.above - cuts.pivots[:, :, None], tensions[..., None] * cuts.pulls)
        bending = self.stiffnesses * (cuts.angles - self.rests)
        bending = bending + self.twists(cuts.angles, table)
        along = np.einsum("bia,bia->bi", loads + levers.sum(axis=2), cuts.axes)
        size = np.linalg.norm(about, axis=-1) + np.linalg.norm(levers, axis=-1).sum(axis=2) + np.abs(bending)
        return along - bending, size, None

    def twists(self, angles, table):
        """Moment that torsion springs between neighbours take up about the hinge between them, (B, J)."""
        moment, rows = np.zeros(angles.shape), np.arange(len(table))
        for row in np.moveaxis(table, 1, 0):
            hinge = row[:, 0].astype(int) - 1
            moment[rows, hinge] += row[:, 20] * (angles[rows, hinge] - row[:, 21])
        return moment

    def energy(self, angles, table, tendon_energy):
        """Potential energy at coordinates, (B,); for dead forces and springs."""
        cuts, rows = self.cuts(angles), np.arange(len(angles))
        energy = tendon_energy(self.lengths(cuts))
        energy = energy + 0.5 * (self.stiffnesses * (cuts.angles - self.rests) ** 2).sum(axis=1)
        for row in np.moveaxis(table, 1, 0):
            link = row[:, 0].astype(int)
            at = cuts.origins[rows, link] + times(cuts.R[rows, link], row[:, 1:4])
            energy = energy - np.einsum("ba,ba->b", row[:, 4:7], at)
            energy = energy + 0.5 * row[:, 16] * ((row[:, 17:20] - at) ** 2).sum(axis=1)
            energy = energy + 0.5 * row[:, 20] * (cuts.angles[rows, link - 1] - row[:, 21]) ** 2
        return energy


def rotations(axis, angles):
    """Rotations about one unit axis, (B, 3, 3)."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angles)[:, None, None] * K + (1.0 - np.cos(angles))[:, None, None] * (K @ K)


def between(u, v):
    """Angles between vectors, (..., 3), 0 to pi [rad]."""
    return np.arctan2(np.linalg.norm(np.cross(u, v), axis=-1), np.einsum("...a,...a->...", u, v))


def times(R, vectors):
    return np.einsum("bac,bc->ba", R, vectors)
