"""Outlines of links and surfaces for any drawing; no drawing library is imported."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.rolling import Link
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
