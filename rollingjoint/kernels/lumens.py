"""A point in a lumen: the piece of the centre line that it is near, and the fields of its gap and its way (gaps.py).

Both ends of a lumen go on straight. Source: docs/theory.md, section 12.
"""

from __future__ import annotations

import math

from rollingjoint._numba.jit import part
from rollingjoint.kernels.gaps import BLEND, blend
from rollingjoint.kernels.seen_walls import (
    ARC,
    CURVATURE,
    END,
    END_TANGENT,
    LENGTH,
    MEAN,
    RADIUS,
    SLOPE,
    START,
    START_TANGENT,
    TURNED,
    TURNED_MEAN,
)


@part(inline=True)
def in_the_bend(u, v, curvature):
    """A point in a piece of a centre line of constant curvature: u along the tangent at its start, v to the left.

    Returns (offset d from the centre line to its left, q = 1 - curvature d, cos and sin of the turn to that point).
    """
    along, across = curvature * u, 1.0 - curvature * v
    q = math.sqrt(along * along + across * across)
    offset = (2.0 * v - curvature * (u * u + v * v)) / (1.0 + q)
    return offset, q, across / q, along / q


@part(inline=True)
def arc_length_at(u, offset, cos, sin, curvature):
    """Arc length of the nearest point of a piece from its start; of a straight one with its rate by the curvature."""
    return math.atan2(sin, cos) / curvature if curvature != 0.0 else u * (1.0 + curvature * offset)


@part(inline=True)
def _lumen_gap(side, radius, slope, curvature, offset, q, tx, ty):
    """Field of the gap to the wall of a lumen on one side, the radius of the point not yet taken off."""
    nx, ny = -ty, tx
    e, f = side * curvature / q, slope * curvature / (q * q)
    per = slope / q
    return (
        radius - side * offset,
        per * tx - side * nx,
        per * ty - side * ny,
        e * tx * tx + 2.0 * f * nx * tx,
        e * tx * ty + f * (nx * ty + ny * tx),
        e * ty * ty + 2.0 * f * ny * ty,
    )


@part(inline=True)
def _lumen_way(side, way, scale, curvature, q, tx, ty):
    """Field of the way along the wall of a lumen on one side, against the sense of arc length on the left.

    way: arc length along the wall; scale: its rate by the arc length of the centre line.
    """
    nx, ny = -ty, tx
    per = -side * scale / q
    f = per * curvature / q
    return (
        -side * way,
        per * tx,
        per * ty,
        2.0 * f * nx * tx,
        f * (nx * ty + ny * tx),
        2.0 * f * ny * ty,
    )


@part
def nearest_piece(seen, first, last, x, y):
    """The piece of a lumen with the nearest centre line."""
    nearest, best = math.inf, first
    for i in range(first, last):
        piece = seen.pieces[i]
        if (i > first and _beyond_start(piece, x, y) < 0.0) or (i < last - 1 and _beyond_end(piece, x, y) > 0.0):
            continue
        dx, dy = x - piece[START], y - piece[START + 1]
        tx, ty = piece[START_TANGENT], piece[START_TANGENT + 1]
        offset, _, _, _ = in_the_bend(dx * tx + dy * ty, dy * tx - dx * ty, piece[CURVATURE])
        if abs(offset) < nearest:
            nearest, best = abs(offset), i
    return best


@part(inline=True)
def _beyond_start(piece, x, y):
    """How far a point is beyond the start of a piece, along the tangent there."""
    dx, dy = x - piece[START], y - piece[START + 1]
    return dx * piece[START_TANGENT] + dy * piece[START_TANGENT + 1]


@part(inline=True)
def _beyond_end(piece, x, y):
    """How far a point is beyond the end of a piece, along the tangent there."""
    dx, dy = x - piece[END], y - piece[END + 1]
    return dx * piece[END_TANGENT] + dy * piece[END_TANGENT + 1]


@part
def piece_near(seen, first, last, i, x, y):
    """The piece at the nearest point of the centre line, from a piece near it: of a loop, never the other limb."""
    if i < last - 1 and _beyond_end(seen.pieces[i], x, y) > 0.0:
        while i < last - 1 and _beyond_end(seen.pieces[i], x, y) > 0.0:
            i += 1
    else:
        while i > first and _beyond_start(seen.pieces[i], x, y) < 0.0:
            i -= 1
    return i


@part(inline=True)
def _from_start(seen, first, last, i, x, y):
    """A point from the start of a piece, or beyond the lumen from its end.

    Returns (u along the tangent there, v to its left, that tangent, whether the point is before, beyond the lumen).
    """
    piece = seen.pieces[i]
    beyond = i == last - 1 and _beyond_end(piece, x, y) > 0.0
    at = END if beyond else START
    dx, dy, tx, ty = x - piece[at], y - piece[at + 1], piece[at + 2], piece[at + 3]
    u, v = dx * tx + dy * ty, dy * tx - dx * ty
    return u, v, tx, ty, i == first and not beyond and u < 0.0, beyond


@part(inline=True)
def point_in_lumen(seen, w, i, x, y):
    """A point in a lumen, at a piece of it, for `lumen_room` and `lumen_fields`.

    Returns (u along the tangent at the start of the piece, v to its left, offset, q, cos and sin of the turn to it,
    that tangent, whether the point is before, beyond the lumen).
    """
    u, v, tx, ty, before, after = _from_start(seen, int(seen.lumens[w, 0]), int(seen.lumens[w, 1]), i, x, y)
    offset, q, cos, sin = in_the_bend(u, v, 0.0 if before or after else seen.pieces[i, CURVATURE])
    return u, v, offset, q, cos, sin, tx, ty, before, after


@part
def lumen_fields(seen, w, i, point, radius, rubs):
    """(gap, way, side): the fields of a point in a lumen, at a piece of it, and the wall that it is nearer to.

    point: of `point_in_lumen`. rubs: whether the way is wanted.
    """
    piece, first, last = seen.pieces[i], int(seen.lumens[w, 0]), int(seen.lumens[w, 1])
    u, v, offset, q, cos, sin, tx, ty, before, after = point
    curvature, slope, wall_radius = piece[CURVATURE], piece[SLOPE], piece[RADIUS]
    if before or after:  # both ends go on straight
        wall_radius = piece[RADIUS] + piece[SLOPE] * piece[LENGTH] if after else piece[RADIUS]
        curvature = slope = 0.0
    arc = arc_length_at(u, v, cos, sin, curvature) if rubs or slope != 0.0 else 0.0
    tx, ty = tx * cos - ty * sin, ty * cos + tx * sin
    side = 1.0 if offset > 0.0 else -1.0
    gap = _lumen_gap(side, wall_radius + slope * arc, slope, curvature, offset, q, tx, ty)
    if not rubs:
        return gap, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), side
    turn = piece[TURNED] + (piece[CURVATURE] * piece[LENGTH] if after else 0.0)
    turn_mean = piece[TURNED_MEAN] + (piece[CURVATURE] * piece[LENGTH] * piece[MEAN] if after else 0.0)
    start = piece[ARC] - seen.pieces[first, ARC] + (piece[LENGTH] if after else 0.0)
    scale = 1.0 - curvature * side * (piece[MEAN] - radius)
    way = start - side * (turn_mean - radius * turn) + scale * arc
    field = _lumen_way(side, way, scale, curvature, q, tx, ty)
    other, along = _joint_near(i, first, last, u if after else arc, piece[LENGTH], before or after)
    if abs(along) >= BLEND:
        return gap, field, side
    turn = seen.pieces[max(other, 0), CURVATURE] if other >= 0 else 0.0
    mean = seen.pieces[max(other, 0), MEAN]
    more = (1.0 - turn * side * (mean - radius)) / (1.0 - turn * offset) - scale / q
    share, fall = blend(along)
    per, k = -side * more * share, -side * more * fall / q
    _, fx, fy, xx, xy, yy = field
    return gap, (field[0], fx + per * tx, fy + per * ty, xx + k * tx * tx, xy + k * tx * ty, yy + k * ty * ty), side


@part(inline=True)
def _joint_near(i, first, last, arc, length, straight):
    """(piece on the other side of the nearer end of piece i, or -1 for a straight end, arc length from there).

    straight: whether the point is on a straight end.
    """
    if straight:
        return i, arc
    if arc > 0.5 * length:
        return (i + 1 if i < last - 1 else -1), arc - length
    return (i - 1 if i > first else -1), arc


@part(inline=True)
def lumen_room(piece, point):
    """A lower bound of the distance of a point from the walls of a lumen, at a piece of it, without its arc length."""
    return min(piece[RADIUS], piece[RADIUS] + piece[SLOPE] * piece[LENGTH]) - abs(point[2])
