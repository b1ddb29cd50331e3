"""Planar rigid-body motions: poses, velocities (w, v) and loads (m, f) as 3 x 3 matrices, in plain NumPy.

Source: rolling-contact paper, sec. II and appendix A.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def transform(t: Array, angle: float) -> Array:
    """Homogeneous transformation (3, 3) with position t and rotation by angle (1)."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine, t[0]], [sine, cosine, t[1]], [0.0, 0.0, 1.0]])


def inverse(T: Array) -> Array:
    """Inverse of a homogeneous transformation (3, 3)."""
    result = np.eye(3)
    result[:2, :2] = T[:2, :2].T
    result[:2, 2] = -T[:2, :2].T @ T[:2, 2]
    return result


def skew(w: float) -> Array:
    """[w] of (2)."""
    return np.array([[0.0, -w], [w, 0.0]])


def turned(t: Array) -> Array:
    """[t] of (43)."""
    return np.array([t[1], -t[0]])


def adjoint(T: Array) -> Array:
    """Adjoint matrix (3, 3) that carries velocities (w, v) (40)."""
    matrix = np.eye(3)
    matrix[1:, 0], matrix[1:, 1:] = turned(T[:2, 2]), T[:2, :2]
    return matrix


def dual_adjoint(T: Array) -> Array:
    """Dual adjoint matrix (3, 3) that carries loads (m, f) (41)."""
    matrix = np.eye(3)
    matrix[0, 1:], matrix[1:, 1:] = -turned(T[:2, 2]) @ T[:2, :2], T[:2, :2]
    return matrix


def dual_bracket(xi: Array) -> Array:
    """ad* of a velocity (w, v) (42)."""
    matrix = np.zeros((3, 3))
    matrix[0, 1:], matrix[1:, 1:] = -turned(xi[1:]), skew(xi[0])
    return matrix
