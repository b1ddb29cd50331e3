"""Walls around a chain in a person's hands: obstacles that are moved, a bent lumen, a base that moves in."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rollingjoint import (
    Capsule,
    Disc,
    HalfPlane,
    Lumen,
    Plane,
    Polygon,
    RollingChain,
    Sphere,
    Surroundings,
    Tube,
    WallFriction,
)
from rollingjoint.errors import InvalidInput
from rollingjoint.surroundings import Wall, walls_through
from rollingjoint.surroundings.outline import half_width

Array = NDArray[np.float64]
Place = tuple[float, ...]

NO_WALLS = "none"
FARTHEST = 2.0  # mm that a wall or the base moves in one step of friction
MOST_STEPS = 100
_BEND = math.pi / 3.0  # turn of the lumen that comes with the viewer, where its bend is 1
_ENDS: dict[type, tuple[str, ...]] = {Disc: ("centre",), Sphere: ("centre",), Capsule: ("first", "second")}
_OBSTACLES = (*_ENDS, Polygon)


@dataclass(frozen=True)
class Around:
    """Walls as a person has set them.

    Args:
        walls: name of the scene, or NO_WALLS.
        moved: offset of every obstacle from its place in the scene [mm].
        bend: factor of all curvatures of lumens.
        feed: way by which the base is pushed in, along its y axis, in space its z axis [mm].
        stiffness: of all walls [N/mm]; None: as in the scene.
        friction: coefficient of all walls; None: as in the scene.
    """

    walls: str = NO_WALLS
    moved: tuple[Place, ...] = ()
    bend: float = 1.0
    feed: float = 0.0
    stiffness: float | None = None
    friction: float | None = None

    def on_the_way(self, end: Around, share: float) -> Around:
        """The walls after a share of the way to the end."""
        moved = tuple(
            tuple(a + share * (b - a) for a, b in zip(here, there, strict=True))
            for here, there in zip(self.moved, end.moved, strict=True)
        )
        bend, feed = (a + share * (b - a) for a, b in ((self.bend, end.bend), (self.feed, end.feed)))
        return replace(end, moved=moved, bend=bend, feed=feed)


@dataclass(frozen=True)
class WallScene:
    """Surroundings, and the pose of the base among them before it is pushed in: x, y [mm], angle [rad].

    In space the pose is x, y, z [mm], and after them a rotation vector [rad] if it is turned.
    """

    surroundings: Surroundings
    base: Place = (0.0, 0.0, 0.0)

    @property
    def obstacles(self) -> list[Any]:
        """The walls that can be moved."""
        return [wall for wall in self.surroundings.walls if isinstance(wall, _OBSTACLES)]

    @property
    def lumens(self) -> list[Lumen | Tube]:
        """The walls that can be bent."""
        return [wall for wall in self.surroundings.walls if isinstance(wall, Lumen | Tube)]

    def begun(self, name: str) -> Around:
        """The walls where they are in the scene."""
        return Around(name, ((0.0,) * self.surroundings.dimension,) * len(self.obstacles))

    def places(self, around: Around) -> Array:
        """A place of every obstacle, by which it is moved, (k, 2 or 3) [mm]."""
        middles, d = [np.mean(_points(wall), axis=0) for wall in self.obstacles], self.surroundings.dimension
        return np.array(middles).reshape(-1, d) + np.array(around.moved).reshape(-1, d)

    def walls(self, around: Around) -> Surroundings:
        """The surroundings as a person has set them; raises InvalidInput for a lumen that cannot be bent so far."""
        offsets = iter(around.moved)
        walls = [self._changed(wall, around, offsets) for wall in self.surroundings.walls]
        friction = self.surroundings.friction if around.friction is None else WallFriction(around.friction)
        return replace(self.surroundings, walls=walls, friction=friction)

    def base_at(self, around: Around) -> Place:
        """The pose of the base among the walls."""
        origin = self.frame_at(around)[1]
        return (*origin.tolist(), *self.base[len(origin) :])

    def frame_at(self, around: Around) -> tuple[Array, Array]:
        """Rotation matrix, (d, d), and origin, (d,) [mm], of the base among the walls."""
        d = self.surroundings.dimension
        turned = np.zeros(3)
        turned[3 - len(self.base[d:]) :] = self.base[d:]
        turn = np.asarray(Rotation.from_rotvec(turned).as_matrix())[:d, :d]
        return turn, np.array(self.base[:d]) + around.feed * turn[:, -1]

    def check_way(self, begin: Around, end: Around, line: Array) -> None:
        """Raise InvalidInput if a wall passes through a chain at rest on its way; line: of the chain, (k, d) [mm]."""
        if (begin.moved, begin.bend) == (end.moved, end.bend):
            return
        passed = walls_through(self.walls(begin), self.walls(end), line)
        if passed:
            kind = type(self.surroundings.walls[passed[0]]).__name__
            hint = f"{kind} {passed[0]} would pass through it."
            raise InvalidInput("way of a wall", end.moved, "a way around the chain", hint)

    def steps(self, begin: Around, end: Around) -> int:
        """Steps from one setting to another in which nothing moves farther than FARTHEST."""
        moved = np.subtract(end.moved, begin.moved).reshape(-1, self.surroundings.dimension)
        turns = (np.abs(np.array(lumen.lengths) * lumen.curvatures).sum() * lumen.length for lumen in self.lumens)
        ways = [
            *np.linalg.norm(moved, axis=1),
            abs(end.feed - begin.feed),
            abs(end.bend - begin.bend) * max(turns, default=0.0),
        ]
        return min(max(1, math.ceil(max(ways) / FARTHEST)), MOST_STEPS)

    @staticmethod
    def _changed(wall: Wall, around: Around, offsets: Any) -> Wall:
        changes: dict[str, Any] = {} if around.stiffness is None else {"stiffness": around.stiffness}
        if around.stiffness is not None and hasattr(wall, "stiffness_per_length"):
            changes["stiffness_per_length"] = None
        if around.friction is not None:
            changes["friction"] = None
        if isinstance(wall, Lumen | Tube):
            changes["curvatures"] = [around.bend * curvature for curvature in wall.curvatures]
        if isinstance(wall, _OBSTACLES):
            points = _points(wall) + next(offsets)
            names = _ENDS.get(type(wall), ())
            changes |= dict(zip(names, points.tolist(), strict=True)) if names else {"points": points.tolist()}
        return replace(wall, **changes)


def _points(wall: Any) -> Array:
    """The points of an obstacle by which it is moved, (k, 2 or 3) [mm]."""
    names = _ENDS.get(type(wall))
    return np.array([getattr(wall, name) for name in names] if names else wall.points)


def scenes(mechanism: Any, of_files: Mapping[str, WallScene] | None = None) -> dict[str, WallScene]:
    """What can be around a chain: scenes of files for chains of its kind, then those that come with the viewer."""
    length, flat = float(mechanism.length), isinstance(mechanism, RollingChain)
    wide = max(half_width(link) for link in mechanism.links) if flat else float(mechanism.hole_radius)
    radius, piece, away = 1.35 * wide, 0.6 * length, 0.2 * length + wide
    curvatures = [_BEND / piece, 0.0]
    obstacle: Wall = Disc((away, 0.7 * length), 0.1 * length)
    plane: Wall = HalfPlane((-1.0, 0.0), -0.15 * length - wide)
    lumen: Wall
    if flat:
        lumen = Lumen([piece, piece], curvatures, radius, (0.0, 1.1 * length, 0.5 * math.pi))
    else:
        lumen = Tube([piece, piece], curvatures, [0.0, 0.0], radius, (0.0, 0.0, 1.1 * length))
        obstacle = Sphere((away, 0.0, 0.7 * length), 0.1 * length)
        plane = Plane((-1.0, 0.0, 0.0), -0.15 * length - wide)
    of_kind = {name: s for name, s in (of_files or {}).items() if s.surroundings.dimension == mechanism.dimension}
    own = {"an obstacle": obstacle, "a lumen": lumen, "a flat wall": plane}
    return {**of_kind, **{name: WallScene(Surroundings([wall])) for name, wall in own.items()}}
