"""An arm with friction, bead by bead: a second formulation in world coordinates, in NumPy and SciPy.

Unknown are the angle of every hinge and the force and moment in it. Every bead is in balance under both its hinges, its
loads and the forces at the mouths of its channels: a mouth carries the tension before it along one direction and the
tension behind it along another. The tensions fall by the capstan law; nothing else is shared with the solver.
"""

from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
from scipy.optimize import root
from scipy.spatial.transform import Rotation


class Step(NamedTuple):
    angles: np.ndarray  # (n - 1,)
    tip: np.ndarray
    lengths: np.ndarray  # (m,)
    motor_tensions: np.ndarray  # (m,)
    gap_tensions: np.ndarray  # (n - 1, m)
    states: np.ndarray  # (n - 1, m)
    slips: np.ndarray  # (n - 1, m)
    error: float  # largest force or moment [N, N·mm] that is not balanced


class Tendon(NamedTuple):
    below: np.ndarray  # (end, 3) mouths of links 0 to end - 1, below the hinges
    above: np.ndarray  # (end, 3) mouths of links 1 to end, above the hinges
    segments: np.ndarray  # (end, 3) unit vectors
    channels: np.ndarray  # (end + 1, 3) unit vectors
    gaps: np.ndarray  # (end,)
    turns: np.ndarray  # (end, 2): behind the mouth below the hinge, and at the mouth above
    length: float


class BeadBalance:
    """The statics of one arm with its friction. forces: (link, body point, force) each, base frame."""

    def __init__(self, arm):
        self.arm, self.friction = arm, [tendon.friction or arm.friction for tendon in arm.tendons]
        self.spacing = np.array([bead.spacing for bead in arm.beads])
        self.axes = np.array([bead.axis for bead in arm.beads])
        self.stiffness = np.array([bead.stiffness for bead in arm.beads])
        self.rest = np.array([bead.rest_angle for bead in arm.beads])
        self.half = 0.5 * np.array([*(bead.gap for bead in arm.beads), arm.beads[-1].gap])

    def start(self, angles, pulls):
        """The history of a pose in which nothing has ever slipped, under these tensions at the motors."""
        frames, slips = self._frames(angles), np.zeros(self._shape)
        for j, end in enumerate(self.arm.last_links):
            slips[:end, j] = self._slips(j, self._tendon(j, *frames), pulls[j])
        return SimpleNamespace(states=np.zeros(self._shape), slips=slips)

    def step(self, tension_of, forces, history, angles):
        """Solve one step. tension_of: motor tensions from tendon lengths."""
        n = self.arm.n_joints
        x = np.concatenate([angles, np.zeros(6 * n)])
        for softness in (1.0, 16.0, 4.0, 1.0):  # of the presliding: a softer one leads to a step that fails
            given = tension_of, forces, history, softness
            x = root(lambda at, given=given: self._unbalanced(at, *given)[0], x, options={"xtol": 1e-14}).x
            balance, tendons, motor, inside, states, slips = self._unbalanced(x, *given)
            if softness == 1.0 and np.abs(balance).max() < 1e-9:
                break
        lengths = np.array([tendon.length for tendon in tendons])
        return Step(x[:n], self._frames(x[:n])[1][-1], lengths, motor, inside, states, slips, np.abs(balance).max())

    @property
    def _shape(self):
        return self.arm.n_joints, self.arm.n_tendons

    def _frames(self, angles):
        """Orientation and origin of every link."""
        turn = Rotation.from_rotvec(angles[:, None] * self.axes).as_matrix()
        R, origin = [np.eye(3)], [np.zeros(3)]
        for i, spacing in enumerate(self.spacing):
            R.append(R[-1] @ turn[i])
            origin.append(origin[-1] + spacing * R[-1][:, 2])
        return np.array(R), np.array(origin)

    def _tendon(self, j, R, origin):
        end = self.arm.last_links[j]
        x, y = np.array(self.arm.tendons[j].link_holes(self.arm.n_links)).T
        h, channels = self.half[:end], R[: end + 1, :, 2]
        below = origin[:end] + np.einsum("kab,bk->ka", R[:end], [x[:-1], y[:-1], -h])
        above = origin[:end] + np.einsum("kab,bk->ka", R[1 : end + 1], [x[1:], y[1:], h])
        gaps = np.linalg.norm(above - below, axis=1)
        segments = (above - below) / gaps[:, None]
        turns = np.stack([_angles(channels[:-1], segments), _angles(segments, channels[1:])], axis=1)
        inside = np.linalg.norm(below[1:] - above[:-1], axis=1).sum()
        last = self.spacing[end - 1] - self.half[end - 1] - self.half[end]
        return Tendon(below, above, segments, channels, gaps, turns, gaps.sum() + inside + last)

    def _slips(self, j, tendon, pull):
        """Length of the tendon beyond every link, less its stretch there."""
        end = len(tendon.gaps)
        return np.cumsum(tendon.gaps[::-1])[::-1] - self.friction[j].compliance * (end - np.arange(end)) / end * pull

    def _unbalanced(self, x, tension_of, forces, history, softness):
        """What is not balanced, and (tendons, motor tensions, gap tensions, states, slips)."""
        n = self.arm.n_joints
        angles, hinge_force, hinge_moment = x[:n], x[n : 4 * n].reshape(n, 3), x[4 * n :].reshape(n, 3)
        R, origin = self._frames(angles)
        force, moment = np.zeros((n + 1, 3)), np.zeros((n + 1, 3))  # on every link, about the origin of the base

        def act(links, points, vectors):
            np.add.at(force, links, vectors)
            np.add.at(moment, links, np.cross(points, vectors))

        for link, point, vector in forces:
            act([link], [origin[link] + R[link] @ point], [vector])
        tendons = [self._tendon(j, R, origin) for j in range(self.arm.n_tendons)]
        motor = tension_of(np.array([tendon.length for tendon in tendons]))
        inside, states, slips = (np.zeros(self._shape) for _ in range(3))
        for j, (tendon, pull) in enumerate(zip(tendons, motor, strict=True)):
            end = len(tendon.gaps)
            slips[:end, j], states[:end, j], inside[:end, j] = self._capstan(j, tendon, pull, history, softness)
            self._pull(self.friction[j].mu, tendon, pull, inside[:end, j], states[:end, j], act)
        upper = np.arange(1, n + 1)
        act(upper, origin[:-1], hinge_force)
        act(upper - 1, origin[:-1], -hinge_force)
        moment[1:] += hinge_moment
        moment[:-1] -= hinge_moment
        about_hinge = moment[1:] - np.cross(origin[:-1], force[1:])
        axes = np.einsum("kab,kb->ka", R[:-1], self.axes)
        spring = np.einsum("ka,ka->k", axes, hinge_moment) + self.stiffness * (angles - self.rest)
        return np.concatenate([spring, force[1:].ravel(), about_hinge.ravel()]), tendons, motor, inside, states, slips

    def _capstan(self, j, tendon, pull, history, softness):
        """Slips, states and tensions behind every link; one state per link, whose channel has a fixed length."""
        law, end = self.friction[j], len(tendon.gaps)
        slips = self._slips(j, tendon, pull)
        way = slips - history.slips[:end, j]
        states = np.clip(history.states[:end, j] - way / (softness * law.presliding), -1.0, 1.0)
        wrap = law.extra_turn + tendon.turns[:, 0] + np.append(0.0, tendon.turns[:-1, 1])
        lost = law.constant * np.cumsum(states)
        return slips, states, np.maximum(pull * np.exp(-law.mu * np.cumsum(states * wrap)) - lost, 0.0)

    def _pull(self, mu, tendon, pull, inside, states, act):
        """Forces at the mouths of every link's channel, and where the tendon ends."""
        links, end = np.arange(len(inside)), len(inside)
        before = np.append(pull, inside[:-1])
        entry_turns = np.append(0.0, tendon.turns[:-1, 1])
        channel = (before * np.exp(-mu * states * entry_turns))[:, None] * tendon.channels[:-1]
        arriving = before[1:, None] * tendon.segments[:-1]
        act(links[1:], tendon.above[:-1], channel[1:] - arriving)
        act(links, tendon.below, inside[:, None] * tendon.segments - channel)
        act([end], tendon.above[-1:], -inside[-1:, None] * tendon.segments[-1:])


def _angles(u, v):
    """Angles between unit vectors, row by row, exact where small."""
    return np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), np.einsum("ka,ka->k", u, v))
