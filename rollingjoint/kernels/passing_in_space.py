"""Whether a chain in space has passed through a wall in a step, by the surface that it sweeps.

A chain is a line from its base to its tip. Points of the line before and after a step span a strip of triangles. No
chain can pass over the axis of a capsule, over three lines across a sphere, nor over the middle of a bend of a tube,
about which its inner wall is wound: it has passed if such a line goes through the strip more often from one side than
from the other. A plane has no other side. All in the frame of the walls. Source: docs/theory.md, section 12.
"""

from __future__ import annotations

import math

from rollingjoint._numba.jit import part
from rollingjoint.kernels.hinges import PX, turned
from rollingjoint.kernels.spatial_walls import fill_frame, put, unit
from rollingjoint.kernels.vectors import about, dot, in_space, minus, plus, times
from rollingjoint.kernels.walls import STIFFNESS

_CORE = 0.5  # of the radius of a sphere: half the length of the lines that no chain passes over


@part
def curve_passes(walls, lane, which, state, seen, curve):
    """True if the step of a lane passes through a wall; seen.base: the present base; curve: room for both lines."""
    n = state.pose.shape[0]
    for k in range(n):
        put(curve[k], 0, _on_line(walls.walls.bars[which], k, n))
        put(curve[n + k], 0, in_space(curve, k, 0))
    for k in range(n):
        after = plus(turned(state.pose, k, in_space(curve, n + k, 0)), in_space(state.pose, k, PX))
        put(curve[n + k], 0, plus(turned(seen.base, 0, after), in_space(seen.base, 0, PX)))
    fill_frame(walls.bases_before[lane], seen.base)
    poses = walls.poses_before[lane]
    for k in range(n):
        x = in_space(curve, k, 0)
        at = _times(poses, k, 0, x), _times(poses, k, 1, x), _times(poses, k, 2, x)
        put(curve[k], 0, plus(turned(seen.base, 0, at), in_space(seen.base, 0, PX)))
    fill_frame(walls.bases[lane], seen.base)
    return _strip_is_crossed(walls.walls, which, curve, n)


@part(inline=True)
def _times(poses, k, row, x):
    """A row of a 4 x 4 pose times a point."""
    return poses[k, row, 0] * x[0] + poses[k, row, 1] * x[1] + poses[k, row, 2] * x[2] + poses[k, row, 3]


@part
def _on_line(bars, k, n):
    """The point of link k on the line of a chain, in its frame: the middle of its bars, of the last link their ends."""
    at, count, share = (0.0, 0.0, 0.0), 0.0, 1.0 if k == n - 1 else 0.5
    for q in range(bars.shape[0] if k > 0 else 0):
        if int(bars[q, 0]) == k:
            first, second = in_space(bars, q, 1), in_space(bars, q, 4)
            at, count = plus(at, plus(first, times(minus(second, first), share))), count + 1.0
    return times(at, 1.0 / max(count, 1.0))


@part
def _strip_is_crossed(walls, which, curve, n):
    """True if a line that no chain passes over goes through the strip."""
    capsules, pieces = walls.capsules[which], walls.pieces[which]
    for w in range(capsules.shape[0]):
        first, second = in_space(capsules, w, 0), in_space(capsules, w, 3)
        if capsules[w, 7 + STIFFNESS] <= 0.0:
            continue
        way = minus(second, first)
        if dot(way, way) > 0.0:
            if _crossings(first, second, curve, n) != 0:
                return True
            continue
        reach = _CORE * capsules[w, 6]
        for axis in range(3):
            half = times(unit(axis), reach)
            if _crossings(minus(first, half), plus(first, half), curve, n) != 0:
                return True
    for i in range(pieces.shape[0]):
        if pieces[i, 10] <= 0.0 or pieces[i, 9] == 0.0 or walls.tubes[which, int(pieces[i, 13]), STIFFNESS] <= 0.0:
            continue
        tangent, normal = in_space(pieces, i, 3), in_space(pieces, i, 6)
        middle = plus(in_space(pieces, i, 0), times(normal, 1.0 / pieces[i, 9]))
        half = times(about(tangent, normal), max(pieces[i, 11], pieces[i, 12]))
        inside = _is_in_tube(pieces, int(pieces[i, 13]), middle)
        if not inside and _crossings(minus(middle, half), plus(middle, half), curve, n) != 0:
            return True
    return False


@part
def _is_in_tube(pieces, tube, x):
    """True for a point within a piece of a tube: the middle of a wide bend may lie in another limb."""
    for i in range(pieces.shape[0]):
        if int(pieces[i, 13]) != tube or pieces[i, 10] <= 0.0:
            continue
        tangent, normal, curvature = in_space(pieces, i, 3), in_space(pieces, i, 6), pieces[i, 9]
        way = minus(x, in_space(pieces, i, 0))
        along, across, aside = dot(way, tangent), dot(way, normal), dot(way, about(tangent, normal))
        if curvature != 0.0:
            ahead, up = curvature * along, 1.0 - curvature * across
            along, across = math.atan2(ahead, up) / curvature, (1.0 - math.hypot(ahead, up)) / curvature
        if 0.0 <= along <= pieces[i, 10] and math.hypot(across, aside) < max(pieces[i, 11], pieces[i, 12]):
            return True
    return False


@part
def _crossings(first, second, curve, n):
    """How often a line goes through the strip from one side more often than from the other."""
    count = 0
    for k in range(n - 1):
        a, b = in_space(curve, k, 0), in_space(curve, k + 1, 0)
        c, d = in_space(curve, n + k, 0), in_space(curve, n + k + 1, 0)
        count += _through(first, second, a, b, c) + _through(first, second, b, d, c)
    return count


@part(inline=True)
def _through(first, second, a, b, c):
    """1 or -1 where a line goes through a triangle, by the side from which it comes, else 0."""
    normal = about(minus(b, a), minus(c, a))
    before, beyond = dot(normal, minus(first, a)), dot(normal, minus(second, a))
    if (before > 0.0) == (beyond > 0.0):
        return 0
    way = minus(second, first)
    p, q, r = minus(a, first), minus(b, first), minus(c, first)
    u, v, w = dot(way, about(p, q)), dot(way, about(q, r)), dot(way, about(r, p))
    if (u > 0.0 and v > 0.0 and w > 0.0) or (u <= 0.0 and v <= 0.0 and w <= 0.0):
        return 1 if beyond > 0.0 else -1
    return 0
