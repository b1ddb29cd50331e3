"""What surrounds an instrument in an episode, in arrays of many episodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint.surroundings import Lumen
from rollingjoint.surroundings.walls import Wall

Array = NDArray[np.float64]

SPACING = 1.0
"""Distance of neighbouring points of an observed centre line [mm]."""

INDICES = {"points": slice(0, 1), "bars": slice(0, 1), "pieces": slice(8, 9)}
"""Columns of the tables of walls that kernels take for numbers of links and lumens."""


class DrawnScene(NamedTuple):
    """The surroundings of one episode, in the frame of the base at the start.

    Fields: the walls and their coefficient of friction; the target of the tip, (2,) [mm]; points of the way to it,
    SPACING apart, (K, 2) [mm], and how far along them the target is [mm]: K is 0 where the way is a straight line.
    values: other drawn numbers, for info["sampled"].
    """

    walls: Sequence[Wall]
    mu: float
    target: Array
    line: Array
    goal: float
    values: dict[str, Any]


class Scenes(NamedTuple):
    """The scenes of B episodes: tables of walls (rollingjoint's Walls), the fields of DrawnScene with a leading axis B.

    first_way: way to the target at the start, (B,) [mm]. noise: standard normal numbers of every step and noisy entry,
    (B, T + 1, E).
    """

    walls: Any
    target: Array
    line: Array
    goal: Array
    first_way: Array
    noise: Array

    def put(self, rows: NDArray[np.int64], other: Scenes) -> Scenes:
        """These scenes with others in some rows, in fresh arrays."""
        if len(rows) == len(self.target):
            return other
        new = type(self)(type(self.walls)(*map(np.copy, self.walls)), *(np.copy(part) for part in self[1:]))
        for mine, array in zip((*new.walls, *new[1:]), (*other.walls, *other[1:]), strict=True):
            mine[rows] = array
        return new

    def arrays(self) -> dict[str, Array]:
        """All arrays by name."""
        walls = {f"walls.{name}": array for name, array in self.walls._asdict().items()}
        return walls | {name: getattr(self, name) for name in self._fields[1:]}


def padded(walls: Any, sizes: Any) -> Any:
    """The tables of walls, rows added that have no effect, as many as in `sizes`."""
    parts = [
        np.pad(array, ((0, 0), (0, like.shape[1] - array.shape[1]), (0, 0))) if array.ndim > 1 else array
        for array, like in zip(walls, sizes, strict=True)
    ]
    return type(walls)(*parts)


def centre_points(lumen: Lumen, first: float, last: float) -> Array:
    """Points of the centre line from one arc length to another, SPACING apart, (K, 2) [mm]."""
    return np.array(lumen.pose(first + SPACING * np.arange(int((last - first) / SPACING) + 1))[:, :2])


def along(line: Array, points: Array) -> tuple[Array, Array]:
    """Arc length from the start of lines (B, K, 2) to the place nearest to points (B, 2), and the distance there."""
    lanes, square = np.arange(len(line)), np.square(line - points[:, None]).sum(-1)
    nearest = np.clip(square.argmin(1), 1, line.shape[1] - 2)
    best, found = np.full(len(line), np.inf), np.zeros(len(line))
    for first in (nearest - 1, nearest):
        begin, way = line[lanes, first], line[lanes, first + 1] - line[lanes, first]
        arm = points - begin
        share = np.clip((arm * way).sum(-1) / np.square(way).sum(-1), 0.0, 1.0)
        distance = np.hypot(*(arm - share[:, None] * way).T)
        closer = distance < best
        best, found = np.where(closer, distance, best), np.where(closer, SPACING * (first + share), found)
    return found, best


def places(line: Array, arcs: Array) -> Array:
    """Points of lines (B, K, 2) at arc lengths (B, k), (B, k, 2) [mm]."""
    at = np.clip(arcs / SPACING, 0.0, line.shape[1] - 1.0)
    first = np.minimum(at.astype(np.int64), line.shape[1] - 2)
    lanes, share = np.arange(len(line))[:, None], (at - first)[..., None]
    points: Array = (1.0 - share) * line[lanes, first] + share * line[lanes, first + 1]
    return points
