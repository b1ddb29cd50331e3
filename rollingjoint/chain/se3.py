"""Spatial rigid-body motions: twists (w, v) and wrenches (m, f) as 6-vectors, poses as 4 x 4 matrices, in plain NumPy.

Every function takes leading batch axes. Source: flexible-joint paper, sec. II and appendix; its (34) and (35) are
printed for the order (v, w) of a twist, and stand here for the order (w, v) that the paper uses.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def skew(w: ArrayLike) -> Array:
    """[w], (..., 3, 3), so that [w] x is the cross product w × x (33)."""
    x, y, z = np.moveaxis(np.asarray(w, float), -1, 0)
    zero = np.zeros_like(x)
    rows = (zero, -z, y), (z, zero, -x), (-y, x, zero)
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def pose(R: ArrayLike, p: ArrayLike) -> Array:
    """Homogeneous transformation (..., 4, 4) of a rotation matrix and a position (1)."""
    R, p = np.asarray(R, float), np.asarray(p, float)
    T = np.zeros((*np.broadcast_shapes(R.shape[:-2], p.shape[:-1]), 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, p, 1.0
    return T


def inverse(T: ArrayLike) -> Array:
    """Inverse of a homogeneous transformation (..., 4, 4)."""
    T = np.asarray(T, float)
    R = np.swapaxes(T[..., :3, :3], -1, -2)
    return pose(R, -(R @ T[..., :3, 3:])[..., 0])


def rotation(w: ArrayLike) -> Array:
    """Rotation matrix (..., 3, 3) of a rotation vector [rad]."""
    return _series(w)[0]


def rotation_vector(R: ArrayLike) -> Array:
    """Rotation vector (..., 3) of a rotation matrix, at most pi long [rad]; exact to rounding near 0 and pi, too."""
    R = np.asarray(R, float)
    twice_sine = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], -1)
    sine, cosine = 0.5 * np.linalg.norm(twice_sine, axis=-1), 0.5 * (np.trace(R, axis1=-2, axis2=-1) - 1.0)
    angle = np.arctan2(sine, cosine)
    # near pi the axis is the largest column of (R + R^T) / 2 - cos I = (1 - cos) a a^T, with the sign of the sine
    outer = 0.5 * (R + np.swapaxes(R, -1, -2)) - cosine[..., None, None] * np.eye(3)
    leader = np.argmax(np.diagonal(outer, axis1=-2, axis2=-1), axis=-1)
    column = np.take_along_axis(outer, leader[..., None, None], axis=-1)[..., 0]
    column = column * np.where(np.sum(column * twice_sine, axis=-1) < 0.0, -1.0, 1.0)[..., None]
    with np.errstate(invalid="ignore", divide="ignore"):
        far = column / np.linalg.norm(column, axis=-1, keepdims=True) * angle[..., None]
        near = 0.5 * twice_sine * np.where(sine > 1e-8, angle / sine, 1.0)[..., None]
    return np.where((cosine < -0.5)[..., None], far, near)


def exp(xi: ArrayLike) -> Array:
    """Pose (..., 4, 4) reached after unit time at the twist (..., 6) (3)."""
    xi = np.asarray(xi, float)
    R, V = _series(xi[..., :3])
    return pose(R, (V @ xi[..., 3:, None])[..., 0])


def log(T: ArrayLike) -> Array:
    """Twist (..., 6) with exp(twist) = T, its rotation at most pi."""
    T = np.asarray(T, float)
    w = rotation_vector(T[..., :3, :3])
    _, V = _series(w)
    return np.concatenate([w, np.linalg.solve(V, T[..., :3, 3:])[..., 0]], axis=-1)


def adjoint(T: ArrayLike) -> Array:
    """Adjoint matrix (..., 6, 6) that carries twists (w, v) from a frame to the one in which T is given (35)."""
    T = np.asarray(T, float)
    R = T[..., :3, :3]
    matrix = np.zeros((*T.shape[:-2], 6, 6))
    matrix[..., :3, :3] = matrix[..., 3:, 3:] = R
    matrix[..., 3:, :3] = skew(T[..., :3, 3]) @ R
    return matrix


def bracket(xi: ArrayLike) -> Array:
    """ad of a twist (w, v), (..., 6, 6) (34)."""
    xi = np.asarray(xi, float)
    matrix = np.zeros((*xi.shape[:-1], 6, 6))
    matrix[..., :3, :3] = matrix[..., 3:, 3:] = skew(xi[..., :3])
    matrix[..., 3:, :3] = skew(xi[..., 3:])
    return matrix


def _series(w: ArrayLike) -> tuple[Array, Array]:
    """The rotation matrix of a rotation vector, and its mean from no rotation on, both (..., 3, 3)."""
    w = np.asarray(w, float)
    square = np.sum(w * w, axis=-1)[..., None, None]
    angle, W = np.sqrt(square), skew(w)
    small = angle < 1e-2
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 1 - square / 6 * (1 - square / 20 * (1 - square / 42)), np.sin(safe) / safe)
    b = np.where(small, 0.5 - square / 24 * (1 - square / 30 * (1 - square / 56)), (1 - np.cos(safe)) / safe**2)
    c = np.where(small, 1 / 6 - square / 120 * (1 - square / 42), (safe - np.sin(safe)) / safe**3)
    return np.eye(3) + a * W + b * (W @ W), np.eye(3) + b * W + c * (W @ W)
