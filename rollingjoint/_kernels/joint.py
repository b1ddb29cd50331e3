"""One rolling joint: its table over arc length, the inverse s(phi), and the tendon gaps across it."""

from __future__ import annotations

import math

from rollingjoint._jit import kernel
from rollingjoint._kernels.arrays import (
    ANGLE,
    COS,
    CX,
    CY,
    EX,
    EY,
    GX,
    GY,
    KAPPA,
    N_COEFFICIENTS,
    PHI,
    SIN,
    XC,
    XP,
    YC,
    YP,
)

_CLOSED_GAP = 1e-9  # mm; below it the gap's direction is the contact normal (its limit as the two holes meet)


@kernel
def arc_length(chain, i, phi):
    """s of joint i at relative angle phi, clipped to the surface limits (phi falls as s grows)."""
    first, last = chain.cell_first[i], chain.cell_first[i + 1] - 1
    cell = first
    while cell < last and phi < chain.cells[cell, 3]:
        cell += 1
    s_lo, s_hi, phi_lo, phi_hi = chain.cells[cell]
    if phi >= phi_lo:
        return s_lo
    if phi <= phi_hi:
        return s_hi
    low, high = -1.0, 1.0  # bracket of the cell coordinate; phi is above target at low
    u = 2.0 * (phi - phi_lo) / (phi_hi - phi_lo) - 1.0
    for _ in range(60):
        value, slope = 0.0, 0.0
        for k in range(N_COEFFICIENTS - 1, -1, -1):
            slope = slope * u + value
            value = value * u + chain.coefficients[cell, k, PHI]
        error = value - phi
        if error > 0.0:
            low = u
        else:
            high = u
        step = error / slope
        u_next = u - step
        if not (low <= u_next <= high):
            u_next = 0.5 * (low + high)
        if abs(u_next - u) < 1e-15 or error == 0.0:
            break
        u = u_next
    return 0.5 * ((1.0 - u) * s_lo + (1.0 + u) * s_hi)


@kernel
def evaluate_joint(chain, i, s, joint):
    """Fill joint: angle, relative curvature, contact point and tangent in link i's frame, and the relative pose."""
    first, last = chain.cell_first[i], chain.cell_first[i + 1] - 1
    cell = first
    while cell < last and s >= chain.cells[cell, 1]:
        cell += 1
    s_lo, s_hi = chain.cells[cell, 0], chain.cells[cell, 1]
    per_s = 2.0 / (s_hi - s_lo)
    u = (s - s_lo) * per_s - 1.0
    phi = xc = yc = xp = yp = dphi = dxc = dyc = 0.0
    for k in range(N_COEFFICIENTS - 1, -1, -1):
        row = chain.coefficients[cell, k]
        dphi = dphi * u + phi
        dxc = dxc * u + xc
        dyc = dyc * u + yc
        phi = phi * u + row[PHI]
        xc = xc * u + row[XC]
        yc = yc * u + row[YC]
        xp = xp * u + row[XP]
        yp = yp * u + row[YP]
    cos, sin = math.cos(phi), math.sin(phi)
    joint[ANGLE], joint[KAPPA] = phi, dphi * per_s
    joint[CX], joint[CY] = xc, yc
    joint[EX], joint[EY] = dxc * per_s, dyc * per_s
    joint[COS], joint[SIN] = cos, sin
    joint[GX], joint[GY] = xc - (cos * xp - sin * yp), yc - (sin * xp + cos * yp)


@kernel
def evaluate_gap(joint, child_hole, parent_hole, gap):
    """Fill gap: length of the straight tendon segment and its first two derivatives in phi."""
    px = joint[GX] + joint[COS] * parent_hole[0] - joint[SIN] * parent_hole[1]
    py = joint[GY] + joint[SIN] * parent_hole[0] + joint[COS] * parent_hole[1]
    vx, vy = px - child_hole[0], py - child_hole[1]
    jrx, jry = -(py - joint[CY]), px - joint[CX]
    pole_x, pole_y = joint[EX] / joint[KAPPA], joint[EY] / joint[KAPPA]
    length = math.sqrt(vx * vx + vy * vy)
    if length > _CLOSED_GAP:
        vx, vy = vx / length, vy / length
        along = vx * jrx + vy * jry
        turn = (jrx * jrx + jry * jry - along * along) / length
    else:
        vx, vy = -joint[EY], joint[EX]
        along = vx * jrx + vy * jry
        turn = 0.0
    gap[0], gap[1] = length, along
    gap[2] = turn + vx * -(jry - pole_y) + vy * (jrx - pole_x)
