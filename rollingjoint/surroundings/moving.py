"""Walls that are moved while a chain stays where it is: which of them pass through it on their way."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.errors import InvalidInput
from rollingjoint.surroundings.lumen import Lumen
from rollingjoint.surroundings.table import Surroundings
from rollingjoint.surroundings.tube import Frames, Tube
from rollingjoint.surroundings.walls import Capsule, Disc, Polygon, Sphere, Wall

Array = NDArray[np.float64]

_CORE = 0.5  # of the radius of a sphere: half the length of the lines that no chain passes over


def walls_through(before: Surroundings, after: Surroundings, line: ArrayLike) -> list[int]:
    """Numbers of the walls that pass through a chain at rest when they move from one place to the other.

    What no chain passes over moves straight on: middles of discs, ends of capsules, corners of polygons, middles of the
    bends of lumens; in space the axes of capsules, three lines across spheres, and the lines through the middles of
    bends. A wall has passed if the line of the chain goes through the way from one side more often than from the other.
    Half planes and planes have no other side. A wall of another shape than before is compared as far as its parts are
    alike. Solvers check the way of the chain between fixed walls (Status.PASSED_THROUGH); this is the other half.

    Args:
        before, after: surroundings with the same walls in other places, in the same order.
        line: points of the chain from its base to its tip in the frame of the walls, (k, 2) or (k, 3) [mm], such as the
            origins of its links.
    Returns:
        Numbers of walls as in `Surroundings.walls`, in order.
    Raises:
        InvalidInput: other numbers or kinds of walls, a line of another dimension.
    """
    kinds = [[type(wall).__name__ for wall in around.walls] for around in (before, after)]
    if kinds[0] != kinds[1]:
        raise InvalidInput("walls after", kinds[1], f"the walls before, {', '.join(kinds[0])}")
    points = np.asarray(line, float)
    if points.ndim != 2 or points.shape[1] != before.dimension or len(points) < 2:
        raise InvalidInput("shape of the line", points.shape, f"(k, {before.dimension}), k at least 2")
    crosses = _crosses_line if before.dimension == 2 else _crosses_strip
    passed = []
    for number, walls in enumerate(zip(before.walls, after.walls, strict=True)):
        ways = zip(*map(_cores, walls), strict=False)
        if any(crosses(points, first, last) for first, last in ways if not np.array_equal(first, last)):
            passed.append(number)
    return passed


def _cores(wall: Wall) -> Sequence[Array]:
    """What of a wall no chain passes over: points of the plane, (2,), or lines in space, (2, 3)."""
    match wall:
        case Disc():
            return [np.array(wall.centre)]
        case Polygon():
            return list(np.array(wall.points))
        case Capsule():
            ends = [np.array(wall.first), np.array(wall.second)]
            return [np.array(ends)] if wall.in_space else ends
        case Sphere():
            return [np.array(wall.centre) + _CORE * wall.radius * np.array([-axis, axis]) for axis in np.eye(3)]
        case Lumen():
            poses, turns = wall.centre_line.pose(wall.borders[:-1]), np.array(wall.curvatures)
            normals = np.stack([-np.sin(poses[:, 2]), np.cos(poses[:, 2])], axis=1)
            return [pose[:2] + n / u for pose, n, u in zip(poses, normals, turns, strict=True) if u != 0.0]
        case Tube():
            frames = Frames(*(part[:-1] for part in wall.frames))
            radius: Any = max(wall.radii)  # type: ignore[arg-type]
            parts = zip(*frames, frames.directions(np.array(wall.directions)), wall.curvatures, strict=True)
            return [
                point + normal / u + radius * np.cross(tangent, normal) * np.array([[-1.0], [1.0]])
                for point, tangent, _, normal, u in parts
                if u != 0.0
            ]
    return []


def _crosses_line(line: Array, first: Array, last: Array) -> bool:
    """Whether the way of a point crosses a line of the plane from one side more often than from the other."""
    count = 0
    for a, b in itertools.pairwise(line):
        sides = [_left(a, b, first), _left(a, b, last)], [_left(first, last, a), _left(first, last, b)]
        if all((low > 0.0) != (high > 0.0) for low, high in sides):
            count += 1 if sides[0][0] > 0.0 else -1
    return count != 0


def _left(a: Array, b: Array, c: Array) -> float:
    """Positive where c is to the left of the line from a to b."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def _crosses_strip(line: Array, first: Array, last: Array) -> bool:
    """Whether a line goes through the strip that a moving line of space sweeps, likewise."""
    count = 0
    for a, b in itertools.pairwise(line):
        count += _through(a, b, first[0], first[1], last[0]) + _through(a, b, first[1], last[1], last[0])
    return count != 0


def _through(first: Array, last: Array, a: Array, b: Array, c: Array) -> int:
    """1 or -1 where a line goes through a triangle, by the side from which it comes, else 0."""
    normal = np.cross(b - a, c - a)
    before, beyond = normal @ (first - a), normal @ (last - a)
    if (before > 0.0) == (beyond > 0.0):
        return 0
    way, corners = last - first, [a - first, b - first, c - first]
    turns = [way @ np.cross(p, q) > 0.0 for p, q in zip(corners, corners[1:] + corners[:1], strict=True)]
    return (1 if beyond > 0.0 else -1) if len(set(turns)) == 1 else 0
