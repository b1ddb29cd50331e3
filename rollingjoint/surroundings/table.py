"""All that surrounds a chain, and the arrays of it that kernels take."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rollingjoint.checks import as_boolean
from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.spatial_walls import SpatialWalls
from rollingjoint.kernels.walls import N_LAW, Walls
from rollingjoint.surroundings.lumen import Lumen
from rollingjoint.surroundings.outline import Bare, HasSurfaces, Outline, Sleeve
from rollingjoint.surroundings.tube import Tube
from rollingjoint.surroundings.walls import (
    Capsule,
    Disc,
    HalfPlane,
    Plane,
    Polygon,
    Row,
    Sphere,
    Wall,
    WallFriction,
    checked_wall_friction,
)

Array = NDArray[np.float64]

WALLS = (HalfPlane, Disc, Capsule, Polygon, Lumen)
SPATIAL_WALLS = (Plane, Sphere, Capsule, Tube)
_KINDS = tuple(dict.fromkeys((*WALLS, *SPATIAL_WALLS)))
_NO_FRICTION = WallFriction(0.0)
# Columns of tables without law or number of the lumen or tube
_WIDTHS = {"planes": 3, "discs": 3, "capsules": 5, "pieces": 8, "lumens": 0}
_SPATIAL_WIDTHS = {"planes": 4, "capsules": 7, "pieces": 13, "tubes": 0}


class HasLinks(Protocol):
    """A planar chain."""

    @property
    def links(self) -> Sequence[HasSurfaces]:
        """Its links, base first."""


@dataclass(frozen=True)
class Surroundings:
    """Walls around a chain, and the outline with which its links touch them.

    Args:
        walls: HalfPlane, Disc, Capsule, Polygon or Lumen around a planar chain, Plane, Sphere, Capsule or Tube around
            a chain in space, at least one; a chain has to be on the free side of each.
        outline: Sleeve or Bare; default: a sleeve with half the width of every link as its radius.
        friction: of walls without friction of their own; None: none.
        rigid: links cannot be pressed into walls, and stiffnesses have no effect.
    Raises:
        InvalidInput: no walls, walls of the plane beside walls in space, another kind of wall or outline, a toe of a
            rigid wall.
    Source: docs/theory.md, section 12.
    """

    walls: Sequence[Wall]
    outline: Outline = field(default_factory=Sleeve)
    friction: WallFriction | None = None
    rigid: bool = False

    def __post_init__(self) -> None:
        kinds = ", ".join(kind.__name__ for kind in _KINDS[:-1]) + f" or {_KINDS[-1].__name__}"
        if not isinstance(self.walls, Iterable) or isinstance(self.walls, str):
            raise InvalidInput("walls", self.walls, f"a list of {kinds}")
        object.__setattr__(self, "walls", tuple(self.walls))
        if not self.walls:
            raise InvalidInput("walls", self.walls, f"at least one {kinds}", "Leave the surroundings out for none.")
        for i, wall in enumerate(self.walls):
            if not isinstance(wall, _KINDS):
                raise InvalidInput(f"walls[{i}]", wall, kinds)
            if wall.in_space != self.walls[0].in_space:
                where = "in space" if self.walls[0].in_space else "of the plane"
                raise InvalidInput(f"walls[{i}]", wall, f"a wall {where}, as walls[0]")
        if not isinstance(self.outline, Sleeve | Bare):
            raise InvalidInput("outline", self.outline, "a Sleeve or Bare", "Sleeve(5.0) has a radius of 5 mm.")
        checked_wall_friction(self.friction)
        as_boolean("rigid", self.rigid)
        for i, wall in enumerate(self.walls):
            if self.rigid and wall.toe > 0.0:
                raise InvalidInput(f"walls[{i}] toe", wall.toe, "0 for rigid walls", "Or leave rigid=True out.")

    @property
    def dimension(self) -> int:
        """2 around planar chains, 3 in space."""
        return 3 if self.walls[0].in_space else 2

    @property
    def has_friction(self) -> bool:
        """True if any wall rubs."""
        return any(self._friction(wall).mu > 0.0 for wall in self.walls)

    def arrays_of(self, chain: object) -> Walls | SpatialWalls | None:
        """The arrays for a chain from the last call of `arrays`; None where that was another chain."""
        before: tuple[object, Walls | SpatialWalls] | None = self.__dict__.get("_arrays")
        return before[1] if before is not None and before[0] is chain else None

    def arrays(self, chain: Any) -> Any:
        """The arrays of kernels for a chain, Walls or SpatialWalls, with a leading axis of 1; kept for the next call.

        Args:
            chain: with links as HasLinks has them, or for walls in space a chain of outline.HasAxes.
        Raises:
            InvalidInput: walls of the plane around a chain in space, or the other way round; links that the outline
            does not fit, a tube that is nowhere wider than the outline.
        """
        kept = self.arrays_of(chain)
        if kept is not None:
            return kept
        in_space = self.dimension == 3
        if getattr(chain, "dimension", self.dimension) != self.dimension:
            raise wrong_walls(self, chain)
        outline = self.outline.rows_in_space(chain) if in_space else self.outline.rows(chain.links)
        if in_space:
            self._check_tubes(outline)
        widths = _SPATIAL_WIDTHS if in_space else _WIDTHS
        tables: dict[str, list[Row]] = {name: [] for name in widths}
        for wall in self.walls:
            law = self._law(wall)
            number = len(tables["tubes" if in_space else "lumens"])
            for name, rows in wall.rows().items():
                tables[name] += [(*row, number) if name == "pieces" else (*row, *law) for row in rows]
        arrays = {
            name: np.array(rows, float).reshape(-1, widths[name] + (1 if name == "pieces" else N_LAW))
            for name, rows in tables.items()
        }
        columns = {"points": outline.points, "bars": outline.bars, **arrays, "rigid": np.array(float(self.rigid))}
        kind: Any = SpatialWalls if in_space else Walls
        walls = kind(**{name: np.ascontiguousarray(array[None]) for name, array in columns.items()})
        for array in walls:
            array.setflags(write=False)
        object.__setattr__(self, "_arrays", (chain, walls))
        return walls

    def _check_tubes(self, outline: Any) -> None:
        """Raise InvalidInput for a tube that no link enters: on its centre line forces have no direction."""
        radius = float(outline.points[:, 4].min(initial=np.inf))
        for i, wall in enumerate(self.walls):
            if isinstance(wall, Tube) and max(np.ravel(wall.radii)) <= radius:
                allowed = f"a tube that is somewhere wider than the outline, {radius:g} mm"
                raise InvalidInput(f"walls[{i}] radii", wall.radii, allowed, "Sleeve(radius) sets that of the outline.")

    def _friction(self, wall: Wall) -> WallFriction:
        return wall.friction or self.friction or _NO_FRICTION

    def _law(self, wall: Wall) -> Row:
        friction, (stiffness, toe, per_length) = self._friction(wall), wall.law
        return stiffness, toe, friction.mu, friction.presliding, float(per_length)


def wrong_walls(surroundings: object, chain: Any) -> InvalidInput:
    """The error of walls that are not around chains of this kind."""
    kinds = ", ".join(kind.__name__ for kind in (WALLS if chain.dimension == 2 else SPATIAL_WALLS))
    return InvalidInput("surroundings", surroundings, f"walls around {chain.title}: {kinds}")
