"""Rolling joints: the rows of their tables, the normal at their contacts, and gaps between holes with their rates.

For chains in the plane and in space, for numbers and SIMD lanes alike.
"""

from __future__ import annotations

import math

import numpy as np

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import part
from rollingjoint._numba.simd import columns, fused, where
from rollingjoint._numba.views import numbers, of_width, table_rows
from rollingjoint.kernels.vectors import about, dot, minus, plus, plus_dot, times

N_COEFFICIENTS = 10  # polynomial coefficients per cell of a joint table
BUCKETS = 64  # equal parts of a joint's angles in which cells are looked up
BUCKET_ENDS = 2 * BUCKETS

# Columns of a row of a joint table, in the proximal link's frame: cos and sin of the angle, contact point, origin of
# the distal link, rate d contact point / d angle
COS, SIN, CX, CY, GX, GY, PX, PY = range(8)
CLOSED_GAP = 1e-9  # mm; below it the gap's direction is the contact normal (its limit as the two holes meet)


def aligned(values: np.ndarray) -> np.ndarray:
    """A copy that begins at a multiple of 64 bytes, so that a table's row of eight numbers lies in one cache line."""
    memory = np.empty(values.nbytes + 64, np.uint8)
    start = -memory.ctypes.data % 64
    copy = memory[start : start + values.nbytes].view(values.dtype).reshape(values.shape)
    copy[...] = values
    return copy


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


@part(inline=True)
def evaluate_rows(lookup, chain, state):
    """Fill state.joint at the angles; lookup: limits and buckets per radian of the chain's tables, (J, 3)."""
    buckets, cells = chain.buckets, of_width(borrow(chain.cells), 4)
    coefficients = of_width(table_rows(borrow(chain.coefficients)), N_COEFFICIENTS)
    rows, angle = table_rows(borrow(state.joint)), state.angle
    for i in range(angle.size):
        cell, u = locate(lookup, buckets, cells, i, angle[i])
        rows[i] = table_row(coefficients, cell, u)


@part(inline=True)
def evaluate_rows_of_lanes(lookup, chain, designs, state, rows):
    """As `evaluate_rows`, each lane from the tables of its design; rows: memory of a row per lane."""
    angle, joint = numbers(state.angle), state.joint
    cells, lookup, buckets = of_width(chain.cells, 4), of_width(lookup, 3), of_width(chain.buckets, BUCKET_ENDS)
    coefficients = of_width(table_rows(chain.coefficients), N_COEFFICIENTS)
    n_joints = angle.shape[0]
    for i in range(n_joints):
        for lane in range(rows.size):
            which = designs[lane]
            if which < 0:
                continue
            cell, u = locate(lookup[which], buckets[which], cells, i, angle[i, lane])
            rows[lane] = table_row(coefficients, cell, u)
        cos, sin, cx, cy, gx, gy, px, py = columns(rows)
        joint[i, COS], joint[i, SIN], joint[i, CX], joint[i, CY] = cos, sin, cx, cy
        joint[i, GX], joint[i, GY], joint[i, PX], joint[i, PY] = gx, gy, px, py


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
    """(g', g'') of a segment; its upper end turns about `axis` through `contact`, which moves by `pole` per angle."""
    motion = about(axis, minus(plus(below, times(direction, length)), contact))
    rate = dot(direction, motion)
    turn = (dot(motion, motion) - rate * rate) * per_length
    return rate, plus_dot(turn, direction, about(axis, minus(motion, pole)))
