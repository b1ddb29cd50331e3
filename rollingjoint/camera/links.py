"""Which balls belong to which link: three balls per link, a triangle with three different sides.

Every set of three balls that has the triangle's sides, and its sense of turning, is a link somewhere. From each of them
as the base the chain is followed upwards: where a link is, rolling contact leaves one way for the next. The base is the
link from which most others follow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.rolling import RollingChain
from rollingjoint.checks import as_floats, as_positive
from rollingjoint.errors import InvalidInput

Array = NDArray[np.float64]

_ANGLES = 201  # of a joint, between its limits
_LONGEST_WAY = 2.5  # mm: from where rolling contact has the next link
MOST_BALLS = 300


@dataclass(frozen=True)
class LinkBalls:
    """Three balls on every link of a planar chain, at the same places.

    Args:
        mechanism: as designed. balls: of a link, in its frame, (3, 2) [mm].
        tolerance: by which sides of a triangle in a picture may be off [mm].
    Raises:
        InvalidInput: another mechanism, or a triangle with equal sides, which says not where up is.
    """

    mechanism: RollingChain
    balls: ArrayLike
    tolerance: float = 0.3
    _joints: tuple[Array, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not isinstance(self.mechanism, RollingChain):
            raise InvalidInput("mechanism", type(self.mechanism).__name__, "a planar chain of rolling links")
        as_positive("tolerance", self.tolerance, "a positive number [mm]")
        balls = as_floats("balls", self.balls, "three places in the frame of a link, (3, 2) [mm]")
        if balls.shape != (3, 2) or not np.isfinite(balls).all():
            raise InvalidInput("balls", self.balls, "three places in the frame of a link, (3, 2) [mm]")
        sides = np.sort(_sides(balls))
        if (np.diff(sides) < 3.0 * self.tolerance).any() or sides[0] < 3.0 * self.tolerance:
            allowed = f"sides of the triangle that differ by {3.0 * self.tolerance:g} mm or more"
            raise InvalidInput("balls", np.round(sides, 3).tolist(), allowed, "Move one of the three.")
        object.__setattr__(self, "balls", balls)
        object.__setattr__(self, "_joints", tuple(_next_poses(self.mechanism)))

    def poses(self, places: ArrayLike) -> Array:
        """Poses (x, y, angle) of the links in the frame of the base, (n, 3) [mm, rad]; NaN: not seen.

        Args:
            places: of balls in the plane of the picture, in any order and frame, (N, 2) [mm].
        """
        points = np.asarray(places, float).reshape(-1, 2)
        points = points[np.isfinite(points).all(axis=1)]
        n = self.mechanism.n_links
        result = np.full((n, 3), np.nan)
        if len(points) > MOST_BALLS:
            raise InvalidInput(
                "balls in the picture", len(points), f"at most {MOST_BALLS}", "Cover what else is round."
            )
        candidates = self._candidates(points)
        if not len(candidates):
            return result
        chains = [self._followed(first, candidates) for first in range(len(candidates))]
        members, _ = min(chains, key=lambda chain: (-len(chain[0]), chain[1]))
        base = candidates[members[0]]
        result[: len(members)] = _relative(base, candidates[members])
        return result

    def _candidates(self, points: Array) -> Array:
        """Poses of all triangles among the places, (K, 3)."""
        balls = np.asarray(self.balls)
        apart = np.linalg.norm(points[:, None] - points[None], axis=-1)
        a, b, c = _sides(balls)
        poses = []
        for i, j in np.argwhere(np.abs(apart - a) < self.tolerance):
            for k in np.flatnonzero((np.abs(apart[j] - b) < self.tolerance) & (np.abs(apart[i] - c) < self.tolerance)):
                pose, rms = _fitted(balls, points[[i, j, k]])
                if rms < self.tolerance:
                    poses.append(pose)
        return np.array(poses).reshape(-1, 3)

    def _followed(self, first: int, candidates: Array) -> tuple[list[int], float]:
        """The links that follow from a base, as places among the candidates, and how far they are off in all [mm]."""
        members, off = [first], 0.0
        for curve in self._joints:
            steps = _relative(candidates[members[-1]], candidates)
            distances = np.linalg.norm(steps[:, None, :2] - curve[:, :2], axis=-1)
            arm = np.abs(np.asarray(self.balls)).max()
            distances = distances + arm * np.abs(_turn(steps[:, None, 2] - curve[:, 2]))
            nearest = distances.min(axis=1)
            nearest[members] = np.inf
            chosen = int(np.argmin(nearest))
            if not nearest[chosen] < _LONGEST_WAY:
                break
            members.append(chosen)
            off += float(nearest[chosen])
        return members, off


def _sides(balls: Array) -> Array:
    """Lengths from the first ball to the second, on to the third, and back, (3,) [mm]."""
    return np.asarray(np.linalg.norm(np.roll(balls, -1, axis=0) - balls, axis=1))


def _fitted(balls: Array, points: Array) -> tuple[Array, float]:
    """The pose that takes balls to where they were seen, by least squares, and what is left [mm]; inf: mirrored."""
    a, b = balls - balls.mean(axis=0), points - points.mean(axis=0)
    angle = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    turn = _rotation(angle)
    place = points.mean(axis=0) - turn @ balls.mean(axis=0)
    left = balls @ turn.T + place - points
    return np.array([*place, angle]), float(np.sqrt((left**2).sum(axis=1).mean()))


def _rotation(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def _turn(angle: Array) -> Array:
    """Angles in [-pi, pi) [rad]."""
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


def _relative(base: Array, poses: Array) -> Array:
    """Poses in the frame of a base, (K, 3)."""
    places = (poses[:, :2] - base[:2]) @ _rotation(base[2])
    return np.concatenate([places, _turn(poses[:, 2:] - base[2])], axis=1)


def _next_poses(mechanism: RollingChain) -> Sequence[Array]:
    """For every joint poses of the upper link in the frame of the lower one, all over its travel, (_ANGLES, 3)."""
    curves = []
    for joint, (low, high) in enumerate(mechanism.joint_limits):
        arcs = np.zeros((_ANGLES, mechanism.n_joints))
        arcs[:, joint] = np.linspace(low, high, _ANGLES)
        poses = mechanism.poses(mechanism.joint_angles(arcs))
        curves.append(np.stack([_relative(row[joint], row[joint + 1 : joint + 2])[0] for row in poses]))
    return curves
