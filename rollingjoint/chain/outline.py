"""Outlines of links and surfaces for any drawing; no drawing library is imported."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.rolling import Link
from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.profile import Surface

Array = NDArray[np.float64]


def surface_points(surface: Surface, count: int = 41) -> Array:
    """Points along a surface from its first to its last arc length, breakpoints included, (k, 2) [mm]."""
    lo, hi = surface.limits
    return surface.point(np.union1d(np.linspace(lo, hi, count), surface.profile.breaks))


def link_outline(link: Link, count: int = 41) -> Array:
    """Closed outline of a link in its own frame, (k, 2) [mm]: parent surface, side, child surface, side.

    Args:
        link: the link.
        count: evenly spaced points on each surface; breakpoints come on top.
    """
    parent, child = surface_points(link.parent, count), surface_points(link.child, count)
    return np.concatenate([parent, child[::-1], parent[:1]])


def right_side(link: Link) -> float:
    """x in the link's frame where its right side crosses half height [mm]."""
    ends = [surface.point(surface.limits[1])[0] for surface in (link.parent, link.child)]
    return float(0.5 * sum(ends))


def to_world(pose: Array, points: Array) -> Array:
    """Points of a link's frame in the world, (..., 2) [mm]; pose is (x, y, angle)."""
    return np.asarray(points, float) @ rotation(pose[2]).T + pose[:2]


def rotation(angle: float) -> Array:
    """Rotation matrix by an angle [rad], (2, 2)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


class SpatialOutline(NamedTuple):
    """What is drawn of a link in space, in its frame: a round plate between its holes, and rails that roll.

    Attributes:
        low, high: z of the lowest and the highest hole, the faces of the plate [mm].
        strips: its contact surfaces over the width of their lines, each (count, 2, 3) [mm].
        rails: the closed bodies from these surfaces to the plate, as polygons (k, 3), counter-clockwise from outside.
    """

    low: float
    high: float
    strips: list[Array]
    rails: list[list[Array]]


def spatial_outlines(chain: SpatialChain, count: int = 9) -> list[SpatialOutline]:
    """What is drawn of every link, base first, with contact surfaces of `count` places along their curves."""
    strips: list[list[Array]] = [[] for _ in range(chain.n_links)]
    for i, joint in enumerate(chain.joints):
        for link, strip in zip((i, i + 1), joint.strips(count), strict=False):
            strips[link].append(strip)
    outlines = []
    for link, own in enumerate(strips):
        levels = [float(z) for points in chain.hole_points if link < len(points) for z in points[link, :, 2]]
        low, high = min(levels, default=0.0), max(levels, default=0.0)
        outlines.append(SpatialOutline(low, high, own, [_rail(strip, low, high) for strip in own]))
    return outlines


def _rail(strip: Array, low: float, high: float) -> list[Array]:
    """The closed body between a contact surface and the nearer face of a plate."""
    above = float(strip[..., 2].mean()) > 0.5 * (low + high)
    floor = strip.copy()
    floor[..., 2] = min(high, strip[..., 2].min()) if above else max(low, strip[..., 2].max())
    faces = [np.array([strip[0, 0], floor[0, 0], floor[0, 1], strip[0, 1]])]
    faces.append(np.array([strip[-1, 1], floor[-1, 1], floor[-1, 0], strip[-1, 0]]))
    for (a, b), (c, d), (e, f), (g, h) in zip(strip[:-1], strip[1:], floor[:-1], floor[1:], strict=True):
        faces += [np.array(corners) for corners in ([a, b, d, c], [e, g, h, f], [a, c, g, e], [b, f, h, d])]
    return faces if above else [face[::-1] for face in faces]
