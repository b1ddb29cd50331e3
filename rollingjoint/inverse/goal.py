"""Links and where they should be: the tip, its pose, or all links, in the form of the kernels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain import se3
from rollingjoint.chain.chain import AnyChain
from rollingjoint.checks import as_floats
from rollingjoint.errors import InvalidInput

Array = NDArray[np.float64]

_FARTHEST = 1e100  # mm
LEVER = 0.1  # of a mechanism's length: mm of miss that a turn of 1 rad counts as


@dataclass(frozen=True)
class Goal:
    """Links and where they should be, B rows.

    Attributes:
        links: (K,). points: of their origins, (B, K, 3) [mm]; z is 0 in the plane.
        frames: their rotation matrices, (B, K, 9), or (B, 0, 9) where they are free to turn.
        lever: mm of miss per rad. size: length of the mechanism [mm].
    """

    links: NDArray[np.int64]
    points: Array
    frames: Array
    lever: float
    size: float

    @classmethod
    def of(cls, chain: AnyChain, targets: ArrayLike, lever: float | None, single: bool) -> Goal:
        """The goal that targets of one of these shapes mean, single ones or with a leading axis.

        Raises:
            InvalidInput: other shapes, or no numbers.
        """
        d, n = chain.dimension, chain.n_links
        pose: tuple[int, ...] = (3,) if d == 2 else (4, 4)
        shapes = (d,), pose, (n, d), (n, *pose)
        leading = "" if single else "B, "
        allowed = " or ".join(f"({leading}{', '.join(map(str, shape))})" for shape in shapes)
        array = as_floats("tip", targets, f"numbers, of shape {allowed}")
        rows = array[None] if single else array
        if rows.shape[1:] not in shapes:
            raise InvalidInput("shape of the tip", array.shape, f"{allowed}: tip, its pose, all links or their poses")
        whole, turns = rows.shape[1:] in shapes[2:], rows.shape[1:] in (shapes[1], shapes[3])
        links = np.arange(1, n) if whole else np.array([n - 1])
        each = rows[:, 1:] if whole else rows[:, None]
        points = np.zeros((len(rows), len(links), 3))
        points[..., :d] = each[..., :3, 3] if turns and d == 3 else each[..., :d]
        frames = np.zeros((len(rows), len(links) if turns else 0, 9))
        if turns:
            frames[:] = _rotations(each).reshape(frames.shape)
        return cls(links, points, frames, LEVER * chain.length if lever is None else lever, float(chain.length))

    def take(self, rows: NDArray[np.int64]) -> Goal:
        """The goals of these rows."""
        return Goal(self.links, self.points[rows], self.frames[rows], self.lever, self.size)

    @property
    def coordinates(self) -> Array:
        """Weighted coordinates, (B, C) [mm]: their differences are misses, turns to first order."""
        return _joined(self.points, self.frames, self.lever)

    def places(self, solution: Any) -> tuple[Array, Array]:
        """Points and frames of the links at equilibria, or at one, as those of the goal."""
        d = solution.positions.shape[-1]
        single = solution.positions.ndim == 2
        positions, poses = (values[None] if single else values for values in (solution.positions, solution.poses))
        points = np.zeros((len(positions), len(self.links), 3))
        points[..., :d] = positions[:, self.links]
        frames = np.zeros((len(points), len(self.links) if self.frames.shape[1] else 0, 9))
        if frames.size:
            frames[:] = _rotations(poses[:, self.links]).reshape(frames.shape)
        return points, frames

    def coordinates_of(self, solution: Any) -> Array:
        """`coordinates` of the links at equilibria."""
        return _joined(*self.places(solution), self.lever)

    def misses(self, solution: Any) -> Array:
        """Weighted coordinates by which the links are off at equilibria, (B, C) [mm]: places, then turns."""
        points, frames = self.places(solution)
        off = np.clip(points - self.points, -_FARTHEST, _FARTHEST)  # of targets that are no numbers, NaN
        turns = np.zeros((*frames.shape[:-1], 3))
        if frames.size:
            ours, goals = (values.reshape(*values.shape[:2], 3, 3) for values in (frames, self.frames))
            turns = self.lever * se3.rotation_vector(ours @ np.swapaxes(goals, -1, -2))
        return np.concatenate([off.reshape(len(off), -1), turns.reshape(len(off), -1)], axis=1)

    def rates(self, solution: Any) -> Array:
        """d miss / d joint angles at one equilibrium, (C, J) [mm/rad], turns to first order."""
        jacobian, d = solution.pose_jacobian[self.links], solution.positions.shape[-1]
        points, turns = np.zeros((2, len(self.links), 3, jacobian.shape[-1]))
        points[:, :d] = jacobian[:, :d]
        turns[:, (2 if d == 2 else 0) :] = self.lever * jacobian[:, d:]
        joined = points, turns[: self.frames.shape[1]]
        return np.concatenate([part.reshape(-1, jacobian.shape[-1]) for part in joined])

    def distances(self, solution: Any) -> Array:
        """Root of the mean square miss of the links at equilibria, (B,) [mm]."""
        return np.asarray(np.sqrt(np.sum(self.misses(solution) ** 2, axis=1) / len(self.links)))


def _rotations(poses: Array) -> Array:
    """Rotation matrices of poses, (..., 3, 3)."""
    if poses.shape[-1] == 4:
        return poses[..., :3, :3]
    cos, sin, zero = np.cos(poses[..., 2]), np.sin(poses[..., 2]), np.zeros(poses.shape[:-1])
    entries = np.stack([cos, -sin, zero, sin, cos, zero, zero, zero, zero + 1.0], axis=-1)
    return entries.reshape(*poses.shape[:-1], 3, 3)


def _joined(points: Array, frames: Array, lever: float) -> Array:
    """Points and frames as coordinates; two frames differ by the root of 2 times their turn."""
    parts = points.reshape(len(points), -1), frames.reshape(len(points), -1) * (lever / np.sqrt(2.0))
    return np.ascontiguousarray(np.concatenate(parts, axis=1))
