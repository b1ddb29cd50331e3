"""Walls and outlines for tests, as kernels take them, written out from their definitions."""

import math

import numpy as np

from rollingjoint.kernels.walls import Walls


def sleeve(chain, radius, per_link=2):
    """Points and bars of a chain in a sleeve."""
    points, bars = [], []
    for k, link in enumerate(chain.links[1:], 1):
        a, b = np.array(link.parent.start), np.array(link.child.start)
        bars.append((k, *a, *b, radius))
        points += [(k, *(a + (b - a) * (q + 1) / per_link), radius) for q in range(per_link)]
    return points, bars


def bare(chain, rounding, per_side=3):
    """Points and bars of naked links."""
    points, bars = [], []
    for k, link in enumerate(chain.links[1:], 1):
        for side in (0, 1):
            inward = np.array([rounding if side == 0 else -rounding, 0.0])
            a, b = (np.array(surface.point(surface.limits[side])) + inward for surface in (link.parent, link.child))
            bars.append((k, *a, *b, rounding))
            points += [(k, *(a + (b - a) * q / (per_side - 1)), rounding) for q in range(per_side)]
    top = np.array(chain.links[-1].child.start) - [0.0, rounding]
    k, child = chain.n_links - 1, chain.links[-1].child
    points.append((k, *top, rounding))
    low, high = (
        child.point(limit) + np.array([inward, 0.0])
        for limit, inward in zip(child.limits, (rounding, -rounding), strict=True)
    )
    return points, [*bars, (k, *low, *top, rounding), (k, *top, *high, rounding)]


def walls(outline, planes=(), discs=(), capsules=(), lumens=(), mu=0.0, presliding=0.05, toe=0.0, rigid=False):
    """Walls around an outline; the last number of a plane, disc or capsule is its stiffness.

    lumens: (start, pieces of length, curvature and two radii, stiffness).
    """
    law = (toe, mu, presliding, 0.0)
    rows = [[(*wall, *law) for wall in kind] for kind in (planes, discs, capsules)]
    pieces, lumen_laws = [], []
    for number, (start, parts, stiffness) in enumerate(lumens):
        lumen_laws.append((stiffness, *law))
        (x, y, angle), arc = start, 0.0
        for length, curvature, first, last in parts:
            pieces.append((x, y, angle, curvature, length, arc, first, last, number))
            if curvature:
                x += (math.sin(angle + curvature * length) - math.sin(angle)) / curvature
                y -= (math.cos(angle + curvature * length) - math.cos(angle)) / curvature
            else:
                x, y = x + length * math.cos(angle), y + length * math.sin(angle)
            angle, arc = angle + curvature * length, arc + length
    points, bars = outline
    tables = [[(*point, 0.0) for point in points], bars, *rows, pieces, lumen_laws]
    widths = (5, 6, 8, 8, 10, 9, 5)
    arrays = [np.array(table, float).reshape(1, -1, width) for table, width in zip(tables, widths, strict=True)]
    return Walls(*arrays, np.array([float(rigid)]))
