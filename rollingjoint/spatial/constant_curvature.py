"""Piecewise constant curvature: the usual kinematics of flexible arms, and errors between tip poses.

Forces play no role: every segment is an arc of constant length, bent by the tendons that end at it alone, and the
tendons keep their distance from its axis. Source: flexible-joint paper, sec. IV, which compares its statics with it;
R. J. Webster and B. A. Jones, "Design and kinematic modeling of constant curvature continuum robots" (the paper's [8]).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain import se3
from rollingjoint.chain.hinge import HingeChain
from rollingjoint.checks import as_vector

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Segment:
    """The links between two ends of tendons: indices of its first and last link, the tendons that end at the last."""

    first: int
    last: int
    tendons: tuple[int, ...]


def segments_of(chain: HingeChain) -> tuple[Segment, ...]:
    """The segments of an arm, base first, one per link where a tendon ends."""
    ends = np.array(chain.last_links)
    borders = [0, *np.unique(ends).tolist()]
    return tuple(
        Segment(low, high, tuple(np.flatnonzero(ends == high).tolist())) for low, high in itertools.pairwise(borders)
    )


def bends_of_lengths(chain: HingeChain, lengths: ArrayLike) -> Array:
    """Rotation vector (x, y) of every segment that fits the tendon lengths best, (segments, 2) [rad].

    A tendon at (x, y) changes by x·bend_y - y·bend_x less per segment it passes: least squares over the tendons that
    end at the segment, with the bends below it known.

    Raises:
        InvalidInput: a wrong number of lengths.
    """
    change = as_vector("lengths", lengths, chain.n_tendons, "one per tendon")
    change = change - chain.tendon_lengths(np.zeros(chain.n_joints))
    holes = np.array([tendon.link_holes(chain.n_links)[-1] for tendon in chain.tendons])
    slopes = np.column_stack([holes[:, 1], -holes[:, 0]])  # d length / d bend of one segment
    bends: list[Array] = []
    for segment in segments_of(chain):
        ending = list(segment.tendons)
        remainder = change[ending] - slopes[ending] @ np.sum(bends, axis=0) if bends else change[ending]
        bends.append(np.linalg.lstsq(slopes[ending], remainder, rcond=None)[0])
    return np.array(bends)


def constant_curvature_poses(chain: HingeChain, bends: ArrayLike) -> Array:
    """Poses of all links if every segment is an arc with the given rotation vector (x, y), (n, 4, 4) [mm].

    Args:
        chain: the arm.
        bends: (segments, 2) [rad], from `bends_of_lengths`.
    """
    spacings = np.array([bead.spacing for bead in chain.beads])
    poses = np.empty((chain.n_links, 4, 4))
    poses[0] = np.eye(4)
    for segment, (bend_x, bend_y) in zip(segments_of(chain), np.asarray(bends, float), strict=True):
        along = np.cumsum(spacings[segment.first : segment.last])
        twist = np.array([bend_x, bend_y, 0.0, 0.0, 0.0, along[-1]])
        poses[segment.first + 1 : segment.last + 1] = poses[segment.first] @ se3.exp(np.outer(along / along[-1], twist))
    return poses


@dataclass(frozen=True)
class TipErrors:
    """Errors of a tip pose against a measured pose: absolute [rad, mm], and relative to the measured motion.

    Source: flexible-joint paper, appendix V-D: e_theta, epsilon_theta, e_p, epsilon_p.
    """

    angle: float
    relative_angle: float
    position: float
    relative_position: float


def tip_errors(pose: ArrayLike, measured: ArrayLike, straight: ArrayLike) -> TipErrors:
    """Errors of a tip pose (4, 4) against a measured pose; relative errors are inf if that equals the straight pose.

    Args:
        pose: from a model.
        measured: the reference pose.
        straight: tip pose of the straight arm; relative errors are relative to the motion from there.
    """
    T, T_e, T_0 = (np.asarray(matrix, float) for matrix in (pose, measured, straight))
    angle, moved = (float(np.linalg.norm(se3.rotation_vector(T_e[:3, :3] @ frame[:3, :3].T))) for frame in (T, T_0))
    far, way = (float(np.linalg.norm(frame[:3, 3] - T_e[:3, 3])) for frame in (T, T_0))
    return TipErrors(angle, angle / moved if moved else np.inf, far, far / way if way else np.inf)
