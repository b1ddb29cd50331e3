"""Whether a chain has passed through a wall between two poses: by the area that the whole chain sweeps.

The chain is a line from its base to its tip. It has passed over a point if that point is inside the closed curve of
the line before, the way of the tip, the line after and the way of the base: contact points and bars of single links
miss a chain that is on the other side as a whole. Points that no chain can pass over are the middles of discs, the ends
of capsules, and the middles of the bends of a lumen, about which its inner wall is wound. A capsule may also have been
passed lengthwise, by the tip or the base. A half plane has no other side. All in the frame of the walls. Source:
docs/theory.md, section 12.
"""

from __future__ import annotations

import math

import numpy as np

from rollingjoint._numba.jit import part
from rollingjoint.kernels.walls import STIFFNESS


@part
def may_pass(walls, which, poses_before, base_before, poses, base):
    """False where no point of a wall is near both lines of a chain; poses of the links, x and y first."""
    if walls.capsules.shape[1] > 0:
        return True
    points = _n_points(walls)
    if points == 0:
        return False
    bars, reach = walls.bars[which], 0.0
    for q in range(bars.shape[0]):
        for first in (1, 3):
            reach = max(reach, bars[q, first] * bars[q, first] + bars[q, first + 1] * bars[q, first + 1])
    box = _with_origins(poses_before, base_before, (math.inf, -math.inf, math.inf, -math.inf))
    left, right, low, high = _with_origins(poses, base, box)
    reach = math.sqrt(reach)
    for p in range(points):
        x, y, _ = _point(walls, which, p)
        if left - reach <= x <= right + reach and low - reach <= y <= high + reach:
            return True
    return False


@part(inline=True)
def _with_origins(poses, base, box):
    """Smallest and largest x, smallest and largest y of a box and of the origins of the links, in the walls' frame."""
    left, right, low, high = box
    cos, sin = np.cos(base[2]), np.sin(base[2])
    for k in range(poses.shape[0]):
        x, y = base[0] + cos * poses[k, 0] - sin * poses[k, 1], base[1] + sin * poses[k, 0] + cos * poses[k, 1]
        left, right, low, high = min(left, x), max(right, x), min(low, y), max(high, y)
    return left, right, low, high


@part(inline=True)
def _n_points(walls):
    """Number of the points that no chain passes over."""
    return walls.discs.shape[1] + 2 * walls.capsules.shape[1] + walls.pieces.shape[1]


@part
def _point(walls, which, p):
    """(x, y, number of its lumen or -1) of a point that no chain passes over; infinite for a row without effect."""
    discs, capsules = walls.discs.shape[1], walls.capsules.shape[1]
    if p < discs:
        disc = walls.discs[which, p]
        return (disc[0], disc[1], -1) if disc[3 + STIFFNESS] > 0.0 else (math.inf, math.inf, -1)
    p -= discs
    if p < 2 * capsules:
        capsule, first = walls.capsules[which, p // 2], 2 * (p % 2)
        acts = capsule[5 + STIFFNESS] > 0.0
        return (capsule[first], capsule[first + 1], -1) if acts else (math.inf, math.inf, -1)
    piece = walls.pieces[which, p - 2 * capsules]
    lumen, curvature, angle = int(piece[8]), piece[3], piece[2]
    if curvature == 0.0 or walls.lumens[which, lumen, STIFFNESS] <= 0.0:
        return math.inf, math.inf, lumen
    return piece[0] - math.sin(angle) / curvature, piece[1] + math.cos(angle) / curvature, lumen


@part
def place_line(bars, poses, base, curve, first, way):
    """Fill the line of a chain, n points, into rows of the curve: its base, the middles of its links, and its tip."""
    n, cos, sin = poses.shape[0], np.cos(base[2]), np.sin(base[2])
    for k in range(n):
        curve[first + way * k, 0] = curve[first + way * k, 1] = curve[first + way * k, 2] = 0.0
    for q in range(bars.shape[0]):
        k = int(bars[q, 0])
        if k > 0:
            at, share = first + way * k, 1.0 if k == n - 1 else 0.5  # of the way from the first end to the second
            curve[at, 0] += bars[q, 1] + share * (bars[q, 3] - bars[q, 1])
            curve[at, 1] += bars[q, 2] + share * (bars[q, 4] - bars[q, 2])
            curve[at, 2] += 1.0
    for k in range(n):
        at = first + way * k
        x, y = curve[at, 0] / max(curve[at, 2], 1.0), curve[at, 1] / max(curve[at, 2], 1.0)
        c, s = np.cos(poses[k, 2]), np.sin(poses[k, 2])
        x, y = poses[k, 0] + c * x - s * y, poses[k, 1] + s * x + c * y
        curve[at, 0], curve[at, 1] = base[0] + cos * x - sin * y, base[1] + sin * x + cos * y


@part
def has_passed(walls, which, curve):
    """True if the curve of a step goes around a point of a wall, or if an end of the chain goes across a capsule."""
    tip, end = curve.shape[0] // 2 - 1, curve.shape[0] - 1
    for p in range(_n_points(walls)):
        x, y, lumen = _point(walls, which, p)
        if _is_inside(x, y, curve) and not (lumen >= 0 and _is_in_lumen(walls.pieces[which], lumen, x, y)):
            return True
    for w in range(walls.capsules.shape[1]):
        capsule = walls.capsules[which, w]
        if capsule[5 + STIFFNESS] > 0.0:
            if _cross(capsule, curve[tip], curve[tip + 1]) or _cross(capsule, curve[end], curve[0]):
                return True
    return False


@part
def _is_in_lumen(pieces, lumen, x, y):
    """True for a point within a piece of a lumen: the middle of a wide bend may lie in another limb."""
    for i in range(pieces.shape[0]):
        if int(pieces[i, 8]) != lumen or pieces[i, 4] <= 0.0:
            continue
        cos, sin, curvature = math.cos(pieces[i, 2]), math.sin(pieces[i, 2]), pieces[i, 3]
        dx, dy = x - pieces[i, 0], y - pieces[i, 1]
        along, across = dx * cos + dy * sin, dy * cos - dx * sin
        if curvature != 0.0:
            ahead, aside = curvature * along, 1.0 - curvature * across
            along, across = math.atan2(ahead, aside) / curvature, (1.0 - math.hypot(ahead, aside)) / curvature
        if 0.0 <= along <= pieces[i, 4] and abs(across) < max(pieces[i, 6], pieces[i, 7]):
            return True
    return False


@part(inline=True)
def _side(px, py, qx, qy, x, y):
    """Positive for (x, y) to the left of the line from p to q."""
    return (qx - px) * (y - py) - (qy - py) * (x - px)


@part
def _is_inside(x, y, curve):
    """True if the closed curve goes around a point, by its winding number."""
    if math.isinf(x):
        return False
    winding, last = 0, curve.shape[0] - 1
    px, py = curve[last, 0], curve[last, 1]
    for i in range(curve.shape[0]):
        qx, qy = curve[i, 0], curve[i, 1]
        if (py <= y) != (qy <= y):
            left = _side(px, py, qx, qy, x, y) > 0.0
            if py <= y and left:
                winding += 1
            elif py > y and not left:
                winding -= 1
        px, py = qx, qy
    return winding != 0


@part
def _cross(capsule, p, q):
    """True if the way from p to q crosses the axis of a capsule."""
    ax, ay, bx, by = capsule[0], capsule[1], capsule[2], capsule[3]
    apart = (_side(ax, ay, bx, by, p[0], p[1]) > 0.0) != (_side(ax, ay, bx, by, q[0], q[1]) > 0.0)
    return apart and (_side(p[0], p[1], q[0], q[1], ax, ay) > 0.0) != (_side(p[0], p[1], q[0], q[1], bx, by) > 0.0)
