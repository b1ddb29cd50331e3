"""Vectors in space, as three numbers."""

from __future__ import annotations

from rollingjoint._numba.jit import part


@part(inline=True)
def cross(ax, ay, az, bx, by, bz):
    """a × b."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@part(inline=True)
def turned(pose, k, x, y, z):
    """A vector of link k's frame in the base frame."""
    return (
        pose[k, 0] * x + pose[k, 1] * y + pose[k, 2] * z,
        pose[k, 3] * x + pose[k, 4] * y + pose[k, 5] * z,
        pose[k, 6] * x + pose[k, 7] * y + pose[k, 8] * z,
    )
