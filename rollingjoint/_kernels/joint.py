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
    cells, coefficients, terms = chain.cells, chain.coefficients, chain.angle_terms
    first, last = chain.cell_first[i], chain.cell_first[i + 1] - 1
    cell = first
    while cell < last and phi < cells[cell, 3]:
        cell += 1
    s_lo, s_hi = cells[cell, 0], cells[cell, 1]
    phi_lo, phi_hi = cells[cell, 2], cells[cell, 3]
    if phi >= phi_lo:
        return s_lo
    if phi <= phi_hi:
        return s_hi
    low, high = -1.0, 1.0  # bracket of the cell coordinate; phi is above target at low
    u = 2.0 * (phi - phi_lo) / (phi_hi - phi_lo) - 1.0
    for _ in range(60):
        value, slope = 0.0, 0.0
        for k in range(terms - 1, -1, -1):
            slope = slope * u + value
            value = value * u + coefficients[cell, k, PHI]
        error = value - phi
        if error > 0.0:
            low = u
        else:
            high = u
        step = error / slope
        if low <= u - step <= high:
            u -= step
            if abs(step) < 1e-8:  # convergence is quadratic: the next step would be rounding
                break
        else:
            u = 0.5 * (low + high)
    return 0.5 * ((1.0 - u) * s_lo + (1.0 + u) * s_hi)


@kernel
def evaluate_joint(chain, i, s, joint):
    """Fill row i of joint: angle, relative curvature, contact point and tangent in link i's frame, relative pose."""
    cells, coefficients = chain.cells, chain.coefficients
    first, last = chain.cell_first[i], chain.cell_first[i + 1] - 1
    cell = first
    while cell < last and s >= cells[cell, 1]:
        cell += 1
    s_lo, s_hi = cells[cell, 0], cells[cell, 1]
    per_s = 2.0 / (s_hi - s_lo)
    u = (s - s_lo) * per_s - 1.0
    phi = xc = yc = xp = yp = dphi = dxc = dyc = 0.0
    for k in range(N_COEFFICIENTS - 1, -1, -1):
        dphi = dphi * u + phi
        dxc = dxc * u + xc
        dyc = dyc * u + yc
        phi = phi * u + coefficients[cell, k, PHI]
        xc = xc * u + coefficients[cell, k, XC]
        yc = yc * u + coefficients[cell, k, YC]
        xp = xp * u + coefficients[cell, k, XP]
        yp = yp * u + coefficients[cell, k, YP]
    cos, sin = math.cos(phi), math.sin(phi)
    joint[i, ANGLE], joint[i, KAPPA] = phi, dphi * per_s
    joint[i, CX], joint[i, CY] = xc, yc
    joint[i, EX], joint[i, EY] = dxc * per_s, dyc * per_s
    joint[i, COS], joint[i, SIN] = cos, sin
    joint[i, GX], joint[i, GY] = xc - (cos * xp - sin * yp), yc - (sin * xp + cos * yp)


@kernel
def gap_direction(child_holes, parent_holes, i, j, joint):
    """(unit vector of tendon j's segment across joint i in link i's frame, its length)."""
    x, y = parent_holes[i, j, 0], parent_holes[i, j, 1]
    vx = joint[i, GX] + joint[i, COS] * x - joint[i, SIN] * y - child_holes[i, j, 0]
    vy = joint[i, GY] + joint[i, SIN] * x + joint[i, COS] * y - child_holes[i, j, 1]
    length = math.sqrt(vx * vx + vy * vy)
    if length > _CLOSED_GAP:
        return vx / length, vy / length, length
    return -joint[i, EY], joint[i, EX], length


@kernel
def evaluate_gap(child_holes, parent_holes, i, j, joint, gap):
    """Fill gap[i, j]: length of the straight tendon segment and its first two derivatives in phi."""
    vx, vy, length = gap_direction(child_holes, parent_holes, i, j, joint)
    jrx = -(child_holes[i, j, 1] + length * vy - joint[i, CY])
    jry = child_holes[i, j, 0] + length * vx - joint[i, CX]
    along = vx * jrx + vy * jry
    turn = (jrx * jrx + jry * jry - along * along) / length if length > _CLOSED_GAP else 0.0
    to_pole = 1.0 / joint[i, KAPPA]
    gap[i, j, 0], gap[i, j, 1] = length, along
    gap[i, j, 2] = turn - vx * (jry - joint[i, EY] * to_pole) + vy * (jrx - joint[i, EX] * to_pole)
