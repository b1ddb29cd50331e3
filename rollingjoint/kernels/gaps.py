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

BLEND = 0.005  # mm on either side of a joint of a wall, where the rate of the way goes from one to the other
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
    of the normal on a disc of radius `other`. Its rate jumps where a side meets an end, unless the walls do not give
    way, and is blended there (`blend`).
    """
    distance, nx, ny, along, end = nearest
    both, (share, fall) = other + on_outline, blend(along if along < 0.5 * length else along - length)
    more = both / distance - 1.0
    if end == 0:
        right = nx * uy - ny * ux > 0.0
        sense = 1.0 if right else -1.0
        rate, k = sense * (1.0 + share * more), sense * fall * more
        value = along if right else math.pi * both + 2.0 * length - along
        return value, rate * ux, rate * uy, k * ux * ux, k * ux * uy, k * uy * uy
    turn = turn_from_right(nx, ny, ux, uy)
    before = length if end == 1 else (2.0 * length if turn > 0.5 * math.pi else 0.0)
    jx, jy, per = -ny, nx, both / distance
    second, rate, k = -per / distance, per - share * more, -fall * more
    return (
        both * turn + before,
        rate * jx,
        rate * jy,
        second * 2.0 * nx * jx + k * ux * jx,
        second * (nx * jy + ny * jx) + 0.5 * k * (ux * jy + uy * jx),
        second * 2.0 * ny * jy + k * uy * jy,
    )


@part(inline=True)
def blend(along):
    """(share of the rate on the other side of a joint of a wall, its rate by the way) at a way from the joint.

    The rate of the way along a wall that gives way jumps with the curvature of the wall, and friction with it: near a
    joint it goes from one to the other, or a pose there could have no balance.
    """
    if abs(along) >= BLEND:
        return 0.0, 0.0
    return 0.5 * (1.0 - abs(along) / BLEND), -0.5 / BLEND * (1.0 if along >= 0.0 else -1.0)


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
