"""Whether a chain has passed through an obstacle between two poses: by the area that the whole chain sweeps.

The chain is a line from its base to its tip. It has passed over a point if that point is inside the closed curve of
the line before, the way of the tip, the line after and the way of the base: contact points and bars of single links
miss a chain that is on the other side as a whole. A capsule may also have been passed lengthwise, by the tip or the
base. All in the frame of the walls. Source: docs/theory.md, section 12.
"""

from __future__ import annotations

import numpy as np

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import kernel, part
from rollingjoint.kernels.walls import STIFFNESS


@kernel(short_loops=True, title="the check of a step for obstacles passed")
def mark_passed(walls, which, poses_before, bases_before, poses, bases, passed):
    """Fill 1 for every lane whose chain has passed through a disc or a capsule, else 0.

    Args:
        walls, which: stack of walls, and the index of each lane's in it, (B,).
        poses_before, poses: of the links, x, y and angle in the base frame, (B, n, 3). bases: of the base, (B, 3).
    """
    _mark_each(walls, which, poses_before, bases_before, poses, bases, passed, np.empty((2 * poses.shape[1], 3)))


@part
def _mark_each(walls, which, poses_before, bases_before, poses, bases, passed, curve):
    walls, which, passed, curve = borrow(walls), borrow(which), borrow(passed), borrow(curve)
    poses_before, bases_before, poses, bases = borrow(poses_before), borrow(bases_before), borrow(poses), borrow(bases)
    n = poses.shape[1]
    for lane in range(passed.size):
        _place_line(walls.bars[which[lane]], poses_before[lane], bases_before[lane], curve, 0, 1)
        _place_line(walls.bars[which[lane]], poses[lane], bases[lane], curve, 2 * n - 1, -1)
        passed[lane] = _has_passed(walls.discs[which[lane]], walls.capsules[which[lane]], curve)


@part
def _place_line(bars, poses, base, curve, first, way):
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
def _has_passed(discs, capsules, curve):
    """1 if the curve of a step goes around an obstacle's middle, or an end of the chain across a capsule, else 0."""
    tip, end = curve.shape[0] // 2 - 1, curve.shape[0] - 1
    for w in range(discs.shape[0]):
        if discs[w, 3 + STIFFNESS] > 0.0 and _is_inside(discs[w, 0], discs[w, 1], curve):
            return 1
    for w in range(capsules.shape[0]):
        if capsules[w, 5 + STIFFNESS] > 0.0:
            for first in (0, 2):
                if _is_inside(capsules[w, first], capsules[w, first + 1], curve):
                    return 1
            if _cross(capsules[w], curve[tip], curve[tip + 1]) or _cross(capsules[w], curve[end], curve[0]):
                return 1
    return 0


@part(inline=True)
def _side(px, py, qx, qy, x, y):
    """Positive for (x, y) to the left of the line from p to q."""
    return (qx - px) * (y - py) - (qy - py) * (x - px)


@part
def _is_inside(x, y, curve):
    """True if the closed curve goes around a point, by its winding number."""
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
