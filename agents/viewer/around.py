"""Walls around a planar chain in a person's hands: obstacles that are moved, a bent lumen, a base that moves in."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint import Capsule, Disc, HalfPlane, Lumen, Polygon, Surroundings, WallFriction
from rollingjoint.surroundings import Wall
from rollingjoint.surroundings.outline import half_width

Array = NDArray[np.float64]
Pair = tuple[float, float]
Pose = tuple[float, float, float]

NO_WALLS = "none"
FARTHEST = 2.0  # mm that a wall or the base moves in one step of friction
MOST_STEPS = 100
_BEND = math.pi / 3.0  # turn of the lumen that comes with the viewer, where its bend is 1
_OBSTACLES = (Disc, Capsule, Polygon)


@dataclass(frozen=True)
class Around:
    """Walls as a person has set them.

    Args:
        walls: name of the scene, or NO_WALLS.
        moved: offset of every obstacle from its place in the scene [mm].
        bend: factor of all curvatures of lumens.
        feed: way by which the base is pushed in, along its y axis [mm].
        stiffness: of all walls [N/mm]; None: as in the scene.
        friction: coefficient of all walls; None: as in the scene.
    """

    walls: str = NO_WALLS
    moved: tuple[Pair, ...] = ()
    bend: float = 1.0
    feed: float = 0.0
    stiffness: float | None = None
    friction: float | None = None

    def on_the_way(self, end: Around, share: float) -> Around:
        """The walls after a share of the way to the end."""
        moved = tuple(
            (x + share * (u - x), y + share * (v - y)) for (x, y), (u, v) in zip(self.moved, end.moved, strict=True)
        )
        bend, feed = (a + share * (b - a) for a, b in ((self.bend, end.bend), (self.feed, end.feed)))
        return replace(end, moved=moved, bend=bend, feed=feed)


@dataclass(frozen=True)
class Scene:
    """Surroundings, and the pose of the base among them before it is pushed in: x, y [mm], angle [rad]."""

    surroundings: Surroundings
    base: Pose = (0.0, 0.0, 0.0)

    @property
    def obstacles(self) -> list[Any]:
        """The walls that can be moved."""
        return [wall for wall in self.surroundings.walls if isinstance(wall, _OBSTACLES)]

    @property
    def lumens(self) -> list[Lumen]:
        """The walls that can be bent."""
        return [wall for wall in self.surroundings.walls if isinstance(wall, Lumen)]

    def begun(self, name: str) -> Around:
        """The walls where they are in the scene."""
        return Around(name, ((0.0, 0.0),) * len(self.obstacles))

    def places(self, around: Around) -> Array:
        """A place of every obstacle, by which it is moved, (k, 2) [mm]."""
        middles = [np.mean(_points(wall), axis=0) for wall in self.obstacles]
        return np.array(middles).reshape(-1, 2) + np.array(around.moved).reshape(-1, 2)

    def walls(self, around: Around) -> Surroundings:
        """The surroundings as a person has set them; raises InvalidInput for a lumen that cannot be bent so far."""
        offsets = iter(around.moved)
        walls = [self._changed(wall, around, offsets) for wall in self.surroundings.walls]
        friction = self.surroundings.friction if around.friction is None else WallFriction(around.friction)
        return replace(self.surroundings, walls=walls, friction=friction)

    def base_at(self, around: Around) -> Pose:
        """The pose of the base among the walls."""
        x, y, angle = self.base
        return x - around.feed * math.sin(angle), y + around.feed * math.cos(angle), angle

    def steps(self, begin: Around, end: Around) -> int:
        """Steps from one setting to another in which nothing moves farther than FARTHEST."""
        moved = np.subtract(end.moved, begin.moved).reshape(-1, 2)
        turns = (np.abs(np.array(lumen.lengths) * lumen.curvatures).sum() * lumen.length for lumen in self.lumens)
        ways = [*np.hypot(*moved.T), abs(end.feed - begin.feed), abs(end.bend - begin.bend) * max(turns, default=0.0)]
        return min(max(1, math.ceil(max(ways) / FARTHEST)), MOST_STEPS)

    @staticmethod
    def _changed(wall: Wall, around: Around, offsets: Any) -> Wall:
        changes: dict[str, Any] = {} if around.stiffness is None else {"stiffness": around.stiffness}
        if around.stiffness is not None and isinstance(wall, HalfPlane | Lumen):
            changes["stiffness_per_length"] = None
        if around.friction is not None:
            changes["friction"] = None
        if isinstance(wall, Lumen):
            changes["curvatures"] = [around.bend * curvature for curvature in wall.curvatures]
        if isinstance(wall, _OBSTACLES):
            points = _points(wall) + next(offsets)
            names = {Disc: ("centre",), Capsule: ("first", "second")}.get(type(wall), ())
            changes |= dict(zip(names, points.tolist(), strict=True)) if names else {"points": points.tolist()}
        return replace(wall, **changes)


def _points(wall: Disc | Capsule | Polygon) -> Array:
    points = {Disc: ("centre",), Capsule: ("first", "second")}.get(type(wall))
    return np.array([getattr(wall, name) for name in points] if points else wall.points)  # type: ignore[union-attr]


def scenes(mechanism: Any, of_files: Mapping[str, Scene] | None = None) -> dict[str, Scene]:
    """What can be around a planar chain: scenes of files first, then those that come with the viewer."""
    length, wide = float(mechanism.length), max(half_width(link) for link in mechanism.links)
    radius = 1.35 * wide
    piece = 0.6 * length
    start = (0.0, 1.1 * length, 0.5 * math.pi)
    lumen = Lumen([piece, piece], [_BEND / piece, 0.0], radius, start)
    disc = Disc((0.2 * length + wide, 0.7 * length), 0.1 * length)
    plane = HalfPlane((-1.0, 0.0), -0.15 * length - wide)
    own: dict[str, list[Wall]] = {"an obstacle": [disc], "a lumen": [lumen], "a flat wall": [plane]}
    return {**(of_files or {}), **{name: Scene(Surroundings(walls)) for name, walls in own.items()}}
