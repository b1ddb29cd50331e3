"""Arrays of what surrounds a chain in space, and the same as seen from its base, which stays where it is.

A wall meets the *points* or the *bars* of an outline: balls and capsules of the links. Planes and tubes meet points,
capsules meet bars; a sphere is a capsule of length 0. The columns of laws are those of walls.py. Lengths in mm, angles
in rad, world frame; body points in the frame of their link.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from rollingjoint._numba.jit import part
from rollingjoint._numba.layout import Floats
from rollingjoint.kernels.lumens import arc_length_at, in_the_bend
from rollingjoint.kernels.vectors import about, dot, in_space, minus, plus, times
from rollingjoint.kernels.walls import N_LAW

# Columns of SpatialSeen.pieces: start, tangent there, unit normal to the inside of the bend, end, tangent there,
# curvature, length, radius at the start and its slope
START, TANGENT, NORMAL, END, END_TANGENT, CURVATURE, LENGTH, RADIUS, SLOPE, N_PIECE = (
    *range(0, 15, 3),
    *range(15, 20),
)
# Columns of SpatialSeen.capsules before the law: first end, unit along it, length, radius
AXIS, AXIS_LENGTH, CAPSULE_RADIUS, CAPSULE_LAW = 3, 6, 7, 8
PLANE_LAW, TUBE_LAW = 4, 2  # first columns of the laws of planes and tubes


class SpatialWalls(NamedTuple):
    """W surroundings of one chain, each with its outline; rows of zeros have no effect and pad them to equal sizes.

    Candidates of contact are numbered in this order: every point with every plane, then with every tube; after all
    points every bar with every capsule.
    """

    points: Annotated[Floats, "W", "points", 6]  # link (>= 1), x, y, z in its frame, radius, length it stands for
    bars: Annotated[Floats, "W", "bars", 8]  # link (>= 1), first end, second end in its frame, radius
    planes: Annotated[Floats, "W", "planes", 4 + N_LAW]  # unit normal n, d: free where n . x >= d; law
    capsules: Annotated[Floats, "W", "capsules", 7 + N_LAW]  # first end, second end, radius; law
    # Of all tubes, one after the other: start, unit tangent there, unit normal to the inside of the bend, curvature,
    # length, radius at the start and at the end, number of the tube.
    pieces: Annotated[Floats, "W", "pieces", 14]
    tubes: Annotated[Floats, "W", "tubes", N_LAW]  # law
    rigid: Annotated[Floats, "W"]  # 1: the walls are rigid, and stiffnesses only penalties; 0: compliant


class SpatialSeen(NamedTuple):
    """Walls as seen from the base, and the outline."""

    points: Annotated[Floats, "points", 6]
    bars: Annotated[Floats, "bars", 8]
    planes: Annotated[Floats, "planes", 4 + N_LAW]
    capsules: Annotated[Floats, "capsules", 8 + N_LAW]
    pieces: Annotated[Floats, "pieces", N_PIECE]
    tubes: Annotated[Floats, "tubes", 2 + N_LAW]  # first piece, and the one after the last; law
    base: Annotated[Floats, 1, 12]  # of the chain in the world: rotation matrix row by row, origin
    rigid: Annotated[Floats, 1]


@part
def fill_frame(base, frame):
    """Fill the row of a pose, (1, 12), from x, y, z and a rotation vector [mm, rad]."""
    x, y, z = base[3], base[4], base[5]
    square = x * x + y * y + z * z
    angle = math.sqrt(square)
    a = math.sin(angle) / angle if angle > 1e-8 else 1.0 - square / 6.0
    half = math.sin(0.5 * angle) / angle if angle > 1e-8 else 0.5
    b = 2.0 * half * half
    frame[0, 0], frame[0, 1], frame[0, 2] = 1.0 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y
    frame[0, 3], frame[0, 4], frame[0, 5] = b * x * y + a * z, 1.0 - b * (x * x + z * z), b * y * z - a * x
    frame[0, 6], frame[0, 7], frame[0, 8] = b * x * z - a * y, b * y * z + a * x, 1.0 - b * (x * x + y * y)
    for axis in range(3):
        frame[0, 9 + axis] = base[axis]


@part(inline=True)
def from_world(frame, k, vector):
    """A vector of the frame of poses, in the frame of row k of these."""
    x, y, z = vector
    return plus(plus(times(in_space(frame, k, 0), x), times(in_space(frame, k, 3), y)), times(in_space(frame, k, 6), z))


@part(inline=True)
def unit(axis):
    """The unit vector along x, y or z."""
    return 1.0 if axis == 0 else 0.0, 1.0 if axis == 1 else 0.0, 1.0 if axis == 2 else 0.0


@part(inline=True)
def put(row, first, vector):
    """Write a vector into a row."""
    row[first], row[first + 1], row[first + 2] = vector


@part
def see_in_space(walls, which, base, seen):
    """Fill the walls as seen from a base at x, y, z with a rotation vector."""
    frame = seen.base
    fill_frame(base, frame)
    origin = in_space(frame, 0, 9)
    seen.rigid[0] = walls.rigid[which]
    for q in range(seen.points.shape[0]):
        for column in range(6):
            seen.points[q, column] = walls.points[which, q, column]
    for q in range(seen.bars.shape[0]):
        for column in range(8):
            seen.bars[q, column] = walls.bars[which, q, column]
    planes, capsules, pieces = walls.planes[which], walls.capsules[which], walls.pieces[which]
    for w in range(seen.planes.shape[0]):
        normal = in_space(planes, w, 0)
        put(seen.planes[w], 0, from_world(frame, 0, normal))
        seen.planes[w, 3] = planes[w, 3] - dot(normal, origin)
        for column in range(N_LAW):
            seen.planes[w, PLANE_LAW + column] = planes[w, 4 + column]
    for w in range(seen.capsules.shape[0]):
        first, second = in_space(capsules, w, 0), in_space(capsules, w, 3)
        way = minus(second, first)
        length = math.sqrt(dot(way, way))
        put(seen.capsules[w], 0, from_world(frame, 0, minus(first, origin)))
        put(seen.capsules[w], AXIS, from_world(frame, 0, times(way, 1.0 / length if length > 0.0 else 0.0)))
        seen.capsules[w, AXIS_LENGTH] = length
        for column in range(1 + N_LAW):
            seen.capsules[w, CAPSULE_RADIUS + column] = capsules[w, 6 + column]
    for w in range(seen.tubes.shape[0]):
        seen.tubes[w, 0] = seen.tubes[w, 1] = 0.0
        for column in range(N_LAW):
            seen.tubes[w, TUBE_LAW + column] = walls.tubes[which, w, column]
    for i in range(seen.pieces.shape[0]):
        if pieces[i, 10] > 0.0:  # else a row without effect
            _see_piece(pieces, i, frame, origin, seen)


@part
def _see_piece(pieces, i, frame, origin, seen):
    """Fill one piece of a tube; its start, tangent and normal continue the piece before it exactly."""
    piece, tube = seen.pieces[i], int(pieces[i, 13])
    tangent, normal = from_world(frame, 0, in_space(pieces, i, 3)), from_world(frame, 0, in_space(pieces, i, 6))
    if seen.tubes[tube, 1] == 0.0:
        seen.tubes[tube, 0] = i
    seen.tubes[tube, 1] = i + 1
    curvature, length = pieces[i, 9], pieces[i, 10]
    start, half = from_world(frame, 0, minus(in_space(pieces, i, 0), origin)), 0.5 * curvature * length
    cos, sin = math.cos(half), math.sin(half)
    chord = length * (sin / half if half != 0.0 else 1.0)
    middle = plus(times(tangent, cos), times(normal, sin))
    put(piece, START, start)
    put(piece, TANGENT, tangent)
    put(piece, NORMAL, normal)
    put(piece, END, plus(start, times(middle, chord)))
    turned = plus(times(tangent, math.cos(2.0 * half)), times(normal, math.sin(2.0 * half)))
    put(piece, END_TANGENT, turned)
    piece[CURVATURE], piece[LENGTH], piece[RADIUS] = curvature, length, pieces[i, 11]
    piece[SLOPE] = (pieces[i, 12] - pieces[i, 11]) / length


@part(inline=True)
def beyond_start(seen, i, x):
    """How far a point is beyond the start of a piece, along the tangent there."""
    return dot(minus(x, in_space(seen.pieces, i, START)), in_space(seen.pieces, i, TANGENT))


@part(inline=True)
def beyond_end(seen, i, x):
    """How far a point is beyond the end of a piece, along the tangent there."""
    return dot(minus(x, in_space(seen.pieces, i, END)), in_space(seen.pieces, i, END_TANGENT))


@part
def piece_from(seen, first, last, i, x):
    """The piece at the nearest point of the centre line, from a piece near it: of a loop, never the other limb."""
    if i < last - 1 and beyond_end(seen, i, x) > 0.0:
        while i < last - 1 and beyond_end(seen, i, x) > 0.0:
            i += 1
    else:
        while i > first and beyond_start(seen, i, x) < 0.0:
            i -= 1
    return i


@part
def nearest_piece_of(seen, first, last, x):
    """The piece of a tube with the nearest centre line."""
    nearest, best = math.inf, first
    for i in range(first, last):
        if (i > first and beyond_start(seen, i, x) < 0.0) or (i < last - 1 and beyond_end(seen, i, x) > 0.0):
            continue
        offset, aside = from_centre_line(seen, i, first, last, x)[:2]
        distance = math.sqrt(offset * offset + aside * aside)
        if distance < nearest:
            nearest, best = distance, i
    return best


@part(inline=True)
def from_centre_line(seen, i, first, last, x):
    """A point from the centre line of a tube, at a piece of it; both ends go on straight.

    Returns (offset to the inside of the bend, offset across its plane, q = 1 - curvature offset, arc length from the
    start, curvature, slope of the radius, radius at the start, tangent, normal and binormal at the nearest point).
    """
    pieces = seen.pieces
    after = i == last - 1 and beyond_end(seen, i, x) > 0.0
    before = i == first and not after and beyond_start(seen, i, x) < 0.0
    curvature, slope, radius = pieces[i, CURVATURE], pieces[i, SLOPE], pieces[i, RADIUS]
    tangent, normal = in_space(pieces, i, TANGENT), in_space(pieces, i, NORMAL)
    across = about(tangent, normal)
    way = minus(x, in_space(pieces, i, START))
    if after:
        radius += slope * pieces[i, LENGTH]
        tangent, way = in_space(pieces, i, END_TANGENT), minus(x, in_space(pieces, i, END))
        normal = about(across, tangent)
    if after or before:
        curvature = slope = 0.0
    u, v, aside = dot(way, tangent), dot(way, normal), dot(way, across)
    offset, q, cos, sin = in_the_bend(u, v, curvature)
    arc = arc_length_at(u, offset, cos, sin, curvature)
    there = plus(times(tangent, cos), times(normal, sin))
    inwards = minus(times(normal, cos), times(tangent, sin))
    return offset, aside, q, arc, curvature, slope, radius, there, inwards, across
