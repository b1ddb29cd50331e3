"""The bare kernel: the fewest operations that we know for a warm solve of the five-link prototype, nothing else.

Written out for four joints, two tendons and a dead force at the origin of the last link. Newton's method with steps of
at most 0.05 rad in place of a line search; no energy, no stop at the end of a surface, no status, nothing stored but
the joint angles. Symbols as in docs/theory.md. The formulas serve one row of numbers and eight rows in SIMD lanes
alike.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from rollingjoint import RollingChain
from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import kernel
from rollingjoint._numba.simd import WIDTH, any_lane, columns, where
from rollingjoint._numba.views import aligned_simd, as_rows, carve, integers, numbers, table_rows
from rollingjoint.kernels.joints import aligned
from rollingjoint.kernels.rolling import Chain

Array = NDArray[np.float64]

JOINTS, CELLS = 4, 384
LONGEST_STEP = 0.05  # rad, in any joint
LAST_STEP = 1e-6  # rad: the error after a step is of the order of its square
MOST_STEPS = 100
# Columns of a row: angles to start from [rad], tendon lengths [mm], force [N], then the solution [rad]
START, COMMAND, FORCE, SOLUTION, N_COLUMNS = 0, 4, 6, 8, 12
# Memory of eight lanes: columns of their rows, largest part of the last step, places in the cells, cells, row numbers
LONGEST, PLACE, CELL, ROW, TABLE_ROWS, N_NUMBERS = 8, 9, 13, 17, 18, 26


class Bare(NamedTuple):
    """What the kernel knows of the mechanism.

    tables: (4, 384, 2, 8) cubic polynomials of the angle beyond the border of a cell, for every joint and cell those of
        the origin x, y of the distal link in the proximal link's frame and of both gaps [mm]: powers 0 and 1, 2 and 3.
    places: (4, 3) lowest angle [rad], cells per radian, radians per cell.
    law: (5,) constant lengths of both tendons [mm], stiffness [N/mm], minimum and maximum tension [N].
    """

    tables: Array
    places: Array
    law: Array


def bare(mechanism: RollingChain, angles: Array, tension_limits: tuple[float, float]) -> Bare:
    """The prototype for angles (..., 4) [rad] and 0.1 rad around them.

    The cubics go through four points of the library's tables in each cell. One border of the cells lies where all
    curvatures of this mechanism jump, at s = 0.
    """
    nodes = 0.5 - 0.5 * np.cos(np.pi * (np.arange(4) + 0.5) / 4)
    to_powers = np.linalg.inv(np.vander(nodes, increasing=True))
    tables, places = np.empty((JOINTS, CELLS, 4, 4)), np.empty((JOINTS, 3))
    reach = angles.reshape(-1, JOINTS).min(0) - 0.1, angles.reshape(-1, JOINTS).max(0) + 0.1
    for i, (low, high, border) in enumerate(zip(*reach, mechanism.neutral_angles, strict=True)):
        width = (high - low) / (CELLS - 1)
        low = border - width * np.ceil((border - low) / width)
        values = _functions(mechanism.arrays, i, low + width * (np.arange(CELLS)[:, None] + nodes))
        tables[i] = np.einsum("pn,cnf->cpf", to_powers, values) / width ** np.arange(4)[:, None]
        places[i] = low, 1.0 / width, width
    law = np.array([*mechanism.arrays.channels[0], mechanism.stiffnesses[0], *tension_limits])
    return Bare(aligned(tables.reshape(JOINTS, CELLS, 2, 8)), places, law)


def _functions(chain: Chain, i: int, phi: Array) -> Array:
    """What is tabulated of joint i at angles phi (...), by the library's tables: (..., 4)."""
    first, last = chain.buckets[0, i, 0], chain.buckets[0, i, -1]
    cell = np.searchsorted(chain.cells[first + 1 : last + 1, 0], phi, side="right") + first
    u = (phi - chain.cells[cell, 2]) * chain.cells[cell, 3]
    cos, sin, _, _, x, y, _, _ = np.einsum("...kf,...k->f...", chain.coefficients[cell], u[..., None] ** np.arange(10))
    below, above = chain.holes[0, i, :, :2], chain.holes[0, i, :, 2:]
    gaps = [
        np.hypot(x + cos * ax - sin * ay - bx, y + sin * ax + cos * ay - by)
        for (bx, by), (ax, ay) in zip(below, above, strict=True)
    ]
    return np.stack([x, y, *gaps], axis=-1)


_inline = numba.njit(fastmath=True, forceinline=True, error_model="numpy")


class Joint(NamedTuple):
    """Origin of the distal link, contact, its rate, gaps of both tendons with derivatives; numbers or SIMD lanes."""

    x: float
    y: float
    cx: float
    cy: float
    px: float
    py: float
    g: float
    g1: float
    g2: float
    h: float
    h1: float
    h2: float


@_inline
def _cubic(low, high, column, u):
    """A polynomial and its first two derivatives."""
    a, b, c, d = low[column], low[4 + column], high[column], high[4 + column]
    return a + u * (b + u * (c + u * d)), b + u * (2.0 * c + u * (3.0 * d)), 2.0 * c + u * (6.0 * d)


@_inline
def _joint(low, high, u):
    """A joint at a place in a cell: its contact is the centre of its rotation, so origin' = J (origin - contact)."""
    x, x1, x2 = _cubic(low, high, 0, u)
    y, y1, y2 = _cubic(low, high, 1, u)
    g, g1, g2 = _cubic(low, high, 2, u)
    h, h1, h2 = _cubic(low, high, 3, u)
    return Joint(x, y, x - y1, y + x1, x1 - y2, y1 + x2, g, g1, g2, h, h1, h2)


@_inline
def _cell(places, i, phi):
    """The cell of an angle, and the place in it [rad]."""
    cell = int(min(max((phi - places[i, 0]) * places[i, 1], 0.0), CELLS - 1.0))
    return cell, phi - (places[i, 0] + cell * places[i, 2])


@_inline
def _turned(phi, fx, fy):
    """A force in the frame of the link beyond a joint."""
    y = phi * phi
    sin = 1.0 + y * (-1 / 6 + y * (1 / 120 + y * (-1 / 5040 + y * (1 / 362880 + y * (-1 / 39916800 + y / 6227020800)))))
    cos = -1 / 720 + y * (1 / 40320 + y * (-1 / 3628800 + y * (1 / 479001600 - y / 87178291200)))
    sin, cos = phi * sin, 1.0 + y * (-1 / 2 + y * (1 / 24 + y * cos))
    return cos * fx + sin * fy, cos * fy - sin * fx


@_inline
def _tension(law, length, command):
    """Tension of a tendon, and its rate."""
    pull = law[2] * (length - command)
    slack, yielding = pull <= law[3], pull >= law[4]
    return where(slack, law[3], where(yielding, law[4], pull)), where(slack, 0.0, where(yielding, 0.0, law[2]))


@_inline
def _arms(joint, x_dot_f, x_cross_f, fx, fy):
    """(x - c)·f, (x - c) × f and p × f; x_dot_f, x_cross_f: x·f and x × f, all from the origin of the proximal link."""
    along, across = x_dot_f - (joint.cx * fx + joint.cy * fy), x_cross_f - (joint.cx * fy - joint.cy * fx)
    return along, across, joint.px * fy - joint.py * fx


@_inline
def _newton_step(law, joints, angles, commands, force):
    """-H⁻¹ r: theory.md, section 3, every force in the frame of the link that it is needed in."""
    a, b, c, d = joints
    s, ks = _tension(law, law[0] + a.g + b.g + c.g + d.g, commands[0])
    t, kt = _tension(law, law[1] + a.h + b.h + c.h + d.h, commands[1])
    ax, ay = force
    bx, by = _turned(angles[0], ax, ay)
    cx, cy = _turned(angles[1], bx, by)
    dx, dy = _turned(angles[2], cx, cy)
    dot, cross = d.x * dx + d.y * dy, d.x * dy - d.y * dx
    along_d, across_d, pole_d = _arms(d, dot, cross, dx, dy)
    dot, cross = dot + c.x * cx + c.y * cy, cross + c.x * cy - c.y * cx
    along_c, across_c, pole_c = _arms(c, dot, cross, cx, cy)
    dot, cross = dot + b.x * bx + b.y * by, cross + b.x * by - b.y * bx
    along_b, across_b, pole_b = _arms(b, dot, cross, bx, by)
    dot, cross = dot + a.x * ax + a.y * ay, cross + a.x * ay - a.y * ax
    along_a, across_a, pole_a = _arms(a, dot, cross, ax, ay)

    # H = L D Lᵀ; at first row by row, the products of an entry of L and a pivot before the entry
    sa, sb, sc, sd, ta, tb, tc, td = (
        ks * a.g1,
        ks * b.g1,
        ks * c.g1,
        ks * d.g1,
        kt * a.h1,
        kt * b.h1,
        kt * c.h1,
        kt * d.h1,
    )
    per_a = 1.0 / (along_a + sa * a.g1 + ta * a.h1 + s * a.g2 + t * a.h2 + pole_a)
    ba, ca, da = along_b + sb * a.g1 + tb * a.h1, along_c + sc * a.g1 + tc * a.h1, along_d + sd * a.g1 + td * a.h1
    lba, lca, lda = ba * per_a, ca * per_a, da * per_a
    per_b = 1.0 / (along_b + sb * b.g1 + tb * b.h1 + s * b.g2 + t * b.h2 + pole_b - lba * ba)
    cb, db = along_c + sc * b.g1 + tc * b.h1 - lca * ba, along_d + sd * b.g1 + td * b.h1 - lda * ba
    lcb, ldb = cb * per_b, db * per_b
    per_c = 1.0 / (along_c + sc * c.g1 + tc * c.h1 + s * c.g2 + t * c.h2 + pole_c - lca * ca - lcb * cb)
    dc = along_d + sd * c.g1 + td * c.h1 - lda * ca - ldb * cb
    ldc = dc * per_c
    per_d = 1.0 / (along_d + sd * d.g1 + td * d.h1 + s * d.g2 + t * d.h2 + pole_d - lda * da - ldb * db - ldc * dc)
    za = across_a - s * a.g1 - t * a.h1
    zb = across_b - s * b.g1 - t * b.h1 - lba * za
    zc = across_c - s * c.g1 - t * c.h1 - lca * za - lcb * zb
    zd = across_d - s * d.g1 - t * d.h1 - lda * za - ldb * zb - ldc * zc
    zd = zd * per_d
    zc = zc * per_c - ldc * zd
    zb = zb * per_b - lcb * zc - ldb * zd
    return za * per_a - lba * zb - lca * zc - lda * zd, zb, zc, zd


@_inline
def _larger(a, b):
    return where(a > b, a, b)


@_inline
def _next(law, joints, angles, commands, force):
    """Angles after a step, and the largest part of the whole step."""
    za, zb, zc, zd = _newton_step(law, joints, angles, commands, force)
    longest = _larger(_larger(abs(za), abs(zb)), _larger(abs(zc), abs(zd)))
    share = where(longest > LONGEST_STEP, LONGEST_STEP / longest, 1.0)
    a, b, c, d = angles
    return (a + share * za, b + share * zb, c + share * zc, d + share * zd), longest


@_inline
def _joint_at(bare, i, phi):
    cell, place = _cell(bare.places, i, phi)
    row = bare.tables[i, cell]
    return _joint(row[0], row[1], place)


@kernel(nogil=True, fastmath=True, title="the bare kernel")
def solve_one(tables, places, law, rows, which):
    """Solve one row of rows (K, 12); returns the number of steps."""
    known, row = Bare(tables, places, law), rows[which]
    angles = row[0], row[1], row[2], row[3]
    longest, steps = np.inf, 0
    while longest > LAST_STEP and steps < MOST_STEPS:
        a, b, c, d = angles
        joints = _joint_at(known, 0, a), _joint_at(known, 1, b), _joint_at(known, 2, c), _joint_at(known, 3, d)
        angles, longest = _next(law, joints, angles, (row[4], row[5]), (row[6], row[7]))
        steps += 1
    row[8], row[9], row[10], row[11] = angles
    return steps


@kernel(nogil=True, fastmath=True, title="the bare kernel")
def solve_range(tables, places, law, rows, first, last):
    """Solve rows first to last - 1 of rows (K, 12), eight side by side; returns the number of steps of all."""
    memory = np.zeros((N_NUMBERS + 1) * WIDTH)
    return _solve_in(memory, borrow(tables), places, law, rows, first, last)


@_inline
def _joint_of_lanes(tables, i, cells, scratch, place):
    for lane in range(WIDTH):
        scratch[lane] = tables[i, cells[lane], 0]
    low = columns(scratch)
    for lane in range(WIDTH):
        scratch[lane] = tables[i, cells[lane], 1]
    return _joint(low, columns(scratch), place)


@_inline
def _lanes_step(tables, places, law, lanes, cells, scratch):
    """A step of all lanes; returns the largest part of each."""
    number = numbers(lanes)
    ca, cb, cc, cd = cells
    for lane in range(WIDTH):
        ca[lane], number[PLACE, lane] = _cell(places, 0, number[START, lane])
        cb[lane], number[PLACE + 1, lane] = _cell(places, 1, number[START + 1, lane])
        cc[lane], number[PLACE + 2, lane] = _cell(places, 2, number[START + 2, lane])
        cd[lane], number[PLACE + 3, lane] = _cell(places, 3, number[START + 3, lane])
    joints = (
        _joint_of_lanes(tables, 0, ca, scratch, lanes[PLACE]),
        _joint_of_lanes(tables, 1, cb, scratch, lanes[PLACE + 1]),
        _joint_of_lanes(tables, 2, cc, scratch, lanes[PLACE + 2]),
        _joint_of_lanes(tables, 3, cd, scratch, lanes[PLACE + 3]),
    )
    angles, longest = _next(
        law,
        joints,
        (lanes[START], lanes[START + 1], lanes[START + 2], lanes[START + 3]),
        (lanes[COMMAND], lanes[COMMAND + 1]),
        (lanes[FORCE], lanes[FORCE + 1]),
    )
    lanes[START], lanes[START + 1], lanes[START + 2], lanes[START + 3] = angles
    return longest


@_inline
def _solve_in(memory, tables, places, law, rows, first, last):
    lanes, tables = aligned_simd(borrow(memory)), table_rows(tables)
    cells = (
        integers(carve(lanes, CELL, (1,))),
        integers(carve(lanes, CELL + 1, (1,))),
        integers(carve(lanes, CELL + 2, (1,))),
        integers(carve(lanes, CELL + 3, (1,))),
    )
    which, scratch, number = integers(carve(lanes, ROW, (1,))), as_rows(carve(lanes, TABLE_ROWS, (8,))), numbers(lanes)
    for lane in range(WIDTH):  # a lane without a row of its own repeats the first one
        which[lane] = -1
        for k in range(SOLUTION):
            number[k, lane] = rows[first, k]
    following, running, steps = first, 0, 0
    while True:
        for lane in range(WIDTH):
            if number[LONGEST, lane] > LAST_STEP:
                continue
            if which[lane] >= 0:
                for k in range(JOINTS):
                    rows[which[lane], SOLUTION + k] = number[k, lane]
                which[lane] = -1
                running -= 1
            if following < last:
                which[lane] = following
                for k in range(SOLUTION):
                    number[k, lane] = rows[following, k]
                following += 1
                running += 1
        if running == 0 or steps > MOST_STEPS * (last - first):
            return steps
        arrived = False
        while not arrived and steps <= MOST_STEPS * (last - first):
            longest = _lanes_step(tables, places, law, lanes, cells, scratch)
            lanes[LONGEST] = longest
            steps += running
            arrived = any_lane(longest <= LAST_STEP)
