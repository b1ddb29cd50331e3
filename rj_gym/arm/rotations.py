"""Rotations of frames, compiled."""

from __future__ import annotations

import math

from rollingjoint.compiled import part


@part
def rotation_vector(E):
    """Rotation vector of a rotation matrix (3, 3) [rad] and its length, at most pi: (x, y, z, angle).

    Exact to rounding near 0 and pi, too. Source: as rollingjoint.chain.se3.rotation_vector.
    """
    sx, sy, sz = E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]
    sine, cosine = 0.5 * math.sqrt(sx * sx + sy * sy + sz * sz), 0.5 * (E[0, 0] + E[1, 1] + E[2, 2] - 1.0)
    angle = math.atan2(sine, cosine)
    if cosine >= -0.5:
        scale = 0.5 * (angle / sine if sine > 1e-8 else 1.0)
        return scale * sx, scale * sy, scale * sz, angle
    k = 0
    for i in range(1, 3):
        if E[i, i] > E[k, k]:
            k = i
    x, y, z = 0.5 * (E[0, k] + E[k, 0]), 0.5 * (E[1, k] + E[k, 1]), 0.5 * (E[2, k] + E[k, 2])
    x, y, z = x - (cosine if k == 0 else 0.0), y - (cosine if k == 1 else 0.0), z - (cosine if k == 2 else 0.0)
    scale = angle / math.sqrt(x * x + y * y + z * z)
    if x * sx + y * sy + z * sz < 0.0:
        scale = -scale
    return scale * x, scale * y, scale * z, angle


@part
def turn_frame(R, wx, wy, wz):
    """Turn a rotation matrix (3, 3) by a rotation vector of the base frame [rad], in place."""
    square = wx * wx + wy * wy + wz * wz
    angle = math.sqrt(square)
    a = math.sin(angle) / angle if angle > 1e-4 else 1.0 - square / 6.0
    b = (1.0 - math.cos(angle)) / square if angle > 1e-4 else 0.5 - square / 24.0
    for column in range(3):
        x, y, z = R[0, column], R[1, column], R[2, column]
        ux, uy, uz = wy * z - wz * y, wz * x - wx * z, wx * y - wy * x
        R[0, column] = x + a * ux + b * (wy * uz - wz * uy)
        R[1, column] = y + a * uy + b * (wz * ux - wx * uz)
        R[2, column] = z + a * uz + b * (wx * uy - wy * ux)
