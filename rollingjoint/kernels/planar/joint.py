"""One rolling joint: its table over the joint angle, and the tendon gaps across it."""

from __future__ import annotations

import math

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import part
from rollingjoint._numba.simd import any_lane, fused, where
from rollingjoint._numba.views import of_width, table_rows
from rollingjoint.kernels.planar.arrays import BUCKETS, COS, CX, CY, GX, GY, N_COEFFICIENTS, PX, PY, SIN
from rollingjoint.kernels.shared.vectors import about, choose, dot, minus, plus, plus_dot, times

CLOSED_GAP = 1e-9  # mm; below it the gap's direction is the contact normal (its limit as the two holes meet)


@part(inline=True)
def locate(joints, buckets, cells, i, phi):
    """(cell of joint i at angle phi, coordinate in it)."""
    place = (phi - joints[i, 0]) * joints[i, 2]
    place = place if place > 0.0 else 0.0  # also where it is not a number
    bucket = int(min(place, BUCKETS - 1.0))
    cell, last = buckets[i, 2 * bucket], buckets[i, 2 * bucket + 1]
    while last > cell + 1:
        middle = (cell + last) // 2
        if phi >= cells[middle, 0]:
            cell = middle
        else:
            last = middle - 1
    cell = last if phi >= cells[last, 0] else cell
    return cell, (phi - cells[cell, 2]) * cells[cell, 3]


@part(inline=True)
def table_row(coefficients, cell, u):
    """The eight columns of State.joint at coordinate u of a cell; coefficients: rows (cells, 10)."""
    value = coefficients[cell, N_COEFFICIENTS - 1]
    for k in range(N_COEFFICIENTS - 2, -1, -1):
        value = fused(value, u, coefficients[cell, k])
    return value


@part
def evaluate_joints(chain, state):
    """Fill state.joint at state.angle; one configuration."""
    joints, buckets, cells = chain.joints, chain.buckets, of_width(borrow(chain.cells), 4)
    coefficients = of_width(table_rows(borrow(chain.coefficients)), N_COEFFICIENTS)
    rows, angle = table_rows(borrow(state.joint)), state.angle
    for i in range(angle.size):
        cell, u = locate(joints, buckets, cells, i, angle[i])
        rows[i] = table_row(coefficients, cell, u)


@part(inline=True)
def arc_length(chain, i, phi):
    """s of joint i at angle phi, beyond the limits that of the limit."""
    low, high = chain.joints[i, 0], chain.joints[i, 1]
    cell, u = locate(chain.joints, chain.buckets, chain.cells, i, min(max(phi, low), high))
    s = 0.0
    for k in range(N_COEFFICIENTS - 1, -1, -1):
        s = s * u + chain.arc_coefficients[cell, k]
    return s


@part(inline=True)
def normal(joint, i):
    """Unit normal of the proximal surface at the contact, in the proximal link's frame."""
    px, py = joint[i, PX], joint[i, PY]  # against the tangent: the angle falls as s grows
    per_length = 1.0 / math.sqrt(px * px + py * py)
    return py * per_length, -px * per_length


@part(inline=True)
def straight_gap(below, above):
    """(length, unit direction, 1 / length, whether it is closed) of a straight segment between two points."""
    segment = minus(above, below)
    length = math.sqrt(dot(segment, segment))
    closed = length <= CLOSED_GAP
    per_length = 1.0 / where(closed, 1.0, length)
    return length, times(segment, per_length), where(closed, 0.0, per_length), closed


@part(inline=True)
def gap_rates(axis, below, length, direction, per_length, contact, pole):
    """(g', g'') of a segment whose upper end turns about `axis` through `contact`, which moves by `pole` per angle."""
    motion = about(axis, minus(plus(below, times(direction, length)), contact))
    rate = dot(direction, motion)
    turn = (dot(motion, motion) - rate * rate) * per_length
    return rate, plus_dot(turn, direction, about(axis, minus(motion, pole)))


@part(inline=True)
def evaluate_gap(holes, i, j, joint, gap):
    """Fill gap[i, j]: length of the straight tendon segment, its first two derivatives in the angle, its direction."""
    x, y = holes[i, j, 2], holes[i, j, 3]
    above = (
        joint[i, GX] + joint[i, COS] * x - joint[i, SIN] * y,
        joint[i, GY] + joint[i, SIN] * x + joint[i, COS] * y,
    )
    below, contact, pole = (holes[i, j, 0], holes[i, j, 1]), (joint[i, CX], joint[i, CY]), (joint[i, PX], joint[i, PY])
    length, direction, per_length, closed = straight_gap(below, above)
    if any_lane(closed):
        direction = choose(closed, normal(joint, i), direction)
    gap[i, j, 0], (gap[i, j, 3], gap[i, j, 4]) = length, direction
    gap[i, j, 1], gap[i, j, 2] = gap_rates(1.0, below, length, direction, per_length, contact, pole)
