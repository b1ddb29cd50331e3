"""Gaps between the outline of a link and the walls around it in the plane, and the way along the wall: scalar fields.

Every pair is described by two fields f of a point: of a body point x, which the link carries along, or of a fixed point
seen from the link. A field is (value, gradient x and y, second derivatives xx, xy, yy), all in the frame in which the
walls are given, and a gradient by the turn of the link for the way, which rolls off the radius. The gap has no clamp:
its gradient is continuous. A way grows in one sense along the wall; only differences count. Source: docs/theory.md,
section 12.
"""

from __future__ import annotations

import math

from rollingjoint._numba.jit import part

_AT_THE_AXIS = 1e-12  # mm: nearer to the axis of a capsule the direction to it is a normal


@part(inline=True)
def nearest_on_segment(x, y, ax, ay, ux, uy, length):
    """The point of a segment from a along unit u that is nearest to (x, y).

    Returns (distance, unit direction to (x, y), place along the segment, -1 at its first end, 1 at the second, else 0).
    """
    along = (x - ax) * ux + (y - ay) * uy
    at = min(max(along, 0.0), length)
    end = 1 if along >= length else (-1 if along <= 0.0 else 0)
    dx, dy = x - (ax + at * ux), y - (ay + at * uy)
    distance = math.sqrt(dx * dx + dy * dy)
    if distance < _AT_THE_AXIS:
        return distance, -uy, ux, along, 0
    return distance, dx / distance, dy / distance, along, end


@part(inline=True)
def round_end(distance, nx, ny, end):
    """Second derivatives xx, xy, yy of the distance from a segment: at an end its lines of equal distance are round."""
    if end == 0:
        return 0.0, 0.0, 0.0
    return (1.0 - nx * nx) / distance, -nx * ny / distance, (1.0 - ny * ny) / distance


@part(inline=True)
def turn_from_right(nx, ny, ux, uy):
    """Angle from the normal of the right side of an axis u to n, -π/2 to 3π/2: it jumps behind the first end only."""
    angle = math.atan2(ux * nx + uy * ny, uy * nx - ux * ny)
    return angle if angle >= -0.5 * math.pi else angle + 2.0 * math.pi


@part(inline=True)
def way_around(nearest, ux, uy, length, on_outline, other):
    """Field of the way of the contact between a capsule and a disc, as seen from the capsule.

    It is the arc length along the capsule of radius `on_outline`, counter-clockwise from its right side, and the turn
    of the normal on a disc of radius `other`.
    """
    distance, nx, ny, along, end = nearest
    if end == 0:
        right = nx * uy - ny * ux > 0.0
        if right:
            return along, ux, uy, 0.0, 0.0, 0.0
        return math.pi * (other + on_outline) + 2.0 * length - along, -ux, -uy, 0.0, 0.0, 0.0
    turn, both = turn_from_right(nx, ny, ux, uy), other + on_outline
    before = length if end == 1 else (2.0 * length if turn > 0.5 * math.pi else 0.0)
    jx, jy, per = -ny, nx, both / distance
    second = -per / distance
    return (
        both * turn + before,
        per * jx,
        per * jy,
        second * 2.0 * nx * jx,
        second * (nx * jy + ny * jx),
        second * 2.0 * ny * jy,
    )


@part(inline=True)
def press(k, toe, multiplier, gap):
    """(energy, normal force, its rate by -gap) of one contact [N·mm, N, N/mm].

    toe: the force starts as a parabola over this depth [mm]. multiplier: the normal force of a rigid wall so far, of
    which k is only the penalty.
    """
    if toe > 0.0 and multiplier == 0.0:
        depth = -gap
        if depth <= 0.0:
            return 0.0, 0.0, 0.0
        if depth < toe:
            return k * depth**3 / (6.0 * toe), 0.5 * k * depth * depth / toe, k * depth / toe
        rest = depth - 0.5 * toe
        return 0.5 * k * rest * rest + k * toe * toe / 24.0, k * rest, k
    force = multiplier - k * gap
    if force <= 0.0:
        return -0.5 * multiplier * multiplier / k, 0.0, 0.0
    return 0.5 * (force * force - multiplier * multiplier) / k, force, k
