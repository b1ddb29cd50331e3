"""Walls and outlines as shapes to be drawn, from the arrays of kernels; no drawing library is imported."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rollingjoint.kernels.walls import Walls
from rollingjoint.surroundings.lumen import Lumen

Array = NDArray[np.float64]
Strip = tuple[Array, Array]
"""Both edges of a shape, (k, 2) each, point by point across from each other [mm]."""

_THICK = 0.25  # of a wall of a lumen, in radii of the lumen
_DEEP = 0.08  # of a half plane, in lengths of what is near


def wall_strips(walls: Walls, which: int, places: Array) -> Iterator[Strip]:
    """The shapes of all walls of one stack in the world; half planes and ends of lumens as far as places are near.

    Args:
        walls, which: the stack, and the index of the surroundings in it.
        places: of the links in the world, (k, 2) [mm].
    """
    centre = 0.5 * (places.min(axis=0) + places.max(axis=0))
    reach = 0.75 * float(np.ptp(places, axis=0).max()) + 2.0 * float(walls.bars[which, :, 5].max())
    for nx, ny, d, stiffness, *_ in walls.planes[which]:
        normal = np.array([nx, ny])
        distance = normal @ centre - d
        if stiffness > 0.0 and abs(distance) < reach:
            foot, along = centre - distance * normal, reach * np.array([ny, -nx])
            edge = np.stack([foot - along, foot + along])
            yield edge, edge - _DEEP * reach * normal
    for x, y, radius, stiffness, *_ in walls.discs[which]:
        if stiffness > 0.0:
            yield stadium(np.array([x, y]), np.array([x, y]), radius)
    for x, y, u, v, radius, stiffness, *_ in walls.capsules[which]:
        if stiffness > 0.0:
            yield stadium(np.array([x, y]), np.array([u, v]), max(radius, 0.002 * reach))
    for lumen in wall_lumens(walls, which):
        yield from _lumen_walls(lumen, places, 2.0 * reach)


def _lumen_walls(lumen: Lumen, places: Array, near: float) -> Iterator[Strip]:
    """Both walls of a lumen, with its straight ends as far as places within a distance of them."""
    ends = lumen.pose([0.0, lumen.length])
    ahead = [(places - pose[:2]) @ [np.cos(pose[2]), np.sin(pose[2])] for pose in ends]
    close = [np.hypot(*(places - pose[:2]).T) < near for pose in ends]
    before = min(0.0, float(ahead[0][close[0]].min(initial=0.0)))
    beyond = max(0.0, float(ahead[1][close[1]].max(initial=0.0)))
    inner = np.union1d(np.linspace(0.0, lumen.length, 1 + int(np.ceil(lumen.length))), lumen.borders)
    t = np.concatenate([[before], inner, [lumen.length + beyond]])
    middle = lumen.pose(t)[:, :2]
    for side in lumen.sides(t):
        outwards = (side - middle) / np.hypot(*(side - middle).T)[:, None]
        yield side, side + _THICK * lumen.radius(t)[:, None] * outwards


def wall_lumens(walls: Walls, which: int) -> list[Lumen]:
    """The lumens of one stack."""
    pieces = walls.pieces[which]
    lumens = []
    for number in range(walls.lumens.shape[1]):
        rows = pieces[(pieces[:, 8] == number) & (pieces[:, 4] > 0.0)]
        if len(rows):
            x, y, angle = rows[0, :3].tolist()
            radii = [*rows[:, 6].tolist(), float(rows[-1, 7])]
            lumens.append(Lumen(rows[:, 4].tolist(), rows[:, 3].tolist(), radii, (x, y, angle)))
    return lumens


def outline_shapes(walls: Walls, which: int) -> Iterator[tuple[int, Strip]]:
    """Link and shape of every bar of the outline, in the frame of its link."""
    for link, ax, ay, bx, by, radius in walls.bars[which]:
        yield int(link), stadium(np.array([ax, ay]), np.array([bx, by]), radius)


def stadium(first: Array, second: Array, radius: float, count: int = 16) -> Strip:
    """All points within a radius of the straight line between two points, which may be one."""
    length = float(np.hypot(*(second - first)))
    axis = (second - first) / length if length > 0.0 else np.array([1.0, 0.0])
    quarter = np.linspace(0.0, 0.5 * np.pi, count)
    along = np.concatenate([-radius * np.cos(quarter), length + radius * np.sin(quarter)])
    across = radius * np.concatenate([np.sin(quarter), np.cos(quarter)])
    middle, aside = first + along[:, None] * axis, across[:, None] * np.array([-axis[1], axis[0]])
    return middle + aside, middle - aside


def closed(strip: Strip) -> Array:
    """The closed outline of a shape, (2 k + 1, 2) [mm]."""
    first, second = strip
    return np.concatenate([first, second[::-1], first[:1]])
