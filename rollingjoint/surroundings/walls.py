"""Walls of constant shape, in the plane and in space, and the law by which a wall presses and rubs.

Source: docs/theory.md, section 12.
"""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from rollingjoint.checks import as_floats, as_number, as_positive
from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.arrays import LARGEST_INPUT

Array = NDArray[np.float64]
Pair = tuple[float, float]
Triple = tuple[float, float, float]
Row = tuple[float, ...]

LARGEST_WALL_FRICTION = 1.0
STIFFNESSES = (1e-6, 1e6)  # N/mm
_UNIT = 1e-14  # rounding error of the length of a unit vector


@dataclass(frozen=True)
class WallFriction:
    """Coulomb friction of links on walls, with memory of the way a contact last slipped.

    The friction force is mu z N along the wall, where z, from -1 to 1, follows the slip of the contact: it sticks until
    it has slipped about `presliding`, and forgets when it opens.

    Args:
        mu: coefficient of friction, 0 to 1.
        presliding: slip over which friction builds up, 0.01 to 10 mm.
    Raises:
        InvalidInput: a number that is not in its range.
    """

    mu: float
    presliding: float = 0.05

    def __post_init__(self) -> None:
        allowed = f"a number from 0 to {LARGEST_WALL_FRICTION:g}"
        for name, number in (
            ("mu", as_number("wall friction mu", self.mu, 0.0, LARGEST_WALL_FRICTION, allowed=allowed)),
            ("presliding", as_number("wall presliding", self.presliding, 0.01, 10.0, allowed="0.01 to 10 [mm]")),
        ):
            object.__setattr__(self, name, number)


@dataclass(frozen=True, kw_only=True)
class Wall(ABC):
    """Base class of walls: the law by which they press and rub.

    A contact that is pressed in by p = -gap has the normal force N = stiffness × p; with a toe the force starts as a
    parabola over the first `toe` mm, as tissue does, and goes on with that stiffness.

    Args:
        stiffness: of every contact, 1e-6 to 1e6 N/mm. Rigid walls do not use it.
        toe: 0 to 100 mm.
        friction: a WallFriction; None: that of the Surroundings.
    Raises:
        InvalidInput: a number that is not in its range.
    """

    in_space: ClassVar[bool] = False  # else in the plane; a Capsule says of itself which

    stiffness: float = 1.0
    toe: float = 0.0
    friction: WallFriction | None = None

    def __post_init__(self) -> None:
        low, high = STIFFNESSES
        allowed = f"a number from {low:g} to {high:g} [N/mm]"
        for name, number in (
            ("stiffness", as_number("wall stiffness", self.stiffness, low, high, allowed=allowed)),
            ("toe", as_number("wall toe", self.toe, 0.0, 100.0, allowed="0 to 100 [mm]")),
        ):
            object.__setattr__(self, name, number)
        checked_wall_friction(self.friction)

    @property
    def law(self) -> tuple[float, float, bool]:
        """Stiffness, toe, and whether the stiffness is per length."""
        return self.stiffness, self.toe, False

    @abstractmethod
    def rows(self) -> Mapping[str, Sequence[Row]]:
        """The rows of the kernels' tables of walls, by the name of the table, without the columns of the law."""


@dataclass(frozen=True, kw_only=True)
class Boundary(Wall):
    """Base class of walls with an inside, which the points of an outline meet.

    Args:
        stiffness_per_length: in place of the stiffness of every contact a stiffness per length of outline, 1e-6 to 1e6
            N/mm² (Winkler's foundation): from 20 points a link on, their number matters little. None: `stiffness`.
        stiffness, toe, friction: of `Wall`.
    Raises:
        InvalidInput: a number that is not in its range.
    """

    stiffness_per_length: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.stiffness_per_length is not None:
            low, high = STIFFNESSES
            allowed = f"a number from {low:g} to {high:g} [N/mm²]"
            number = as_number("wall stiffness_per_length", self.stiffness_per_length, low, high, allowed=allowed)
            object.__setattr__(self, "stiffness_per_length", number)

    @property
    def law(self) -> tuple[float, float, bool]:
        """Stiffness, toe, and whether the stiffness is per length."""
        per_length = self.stiffness_per_length
        return (self.stiffness, self.toe, False) if per_length is None else (per_length, self.toe, True)


@dataclass(frozen=True)
class HalfPlane(Boundary):
    """A straight wall: points x with normal · x >= offset are free.

    Args:
        normal: (x, y), towards the free side; of any length, it is scaled to 1.
        offset: distance of the wall from the origin along the normal [mm].
        stiffness, stiffness_per_length, toe, friction: of `Boundary`.
    Raises:
        InvalidInput: a normal of length 0, a number that is not finite.
    """

    normal: Pair
    offset: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        x, y = as_point("HalfPlane normal", self.normal)
        length = math.hypot(x, y)
        if length == 0.0:
            raise InvalidInput("HalfPlane normal", self.normal, "a direction other than (0, 0)")
        object.__setattr__(self, "normal", (x / length, y / length))
        object.__setattr__(self, "offset", as_coordinate("HalfPlane offset", self.offset))

    def rows(self) -> Mapping[str, Sequence[Row]]:
        """One plane."""
        return {"planes": [(*self.normal, self.offset)]}


@dataclass(frozen=True)
class Plane(Boundary):
    """A flat wall in space: points x with normal · x >= offset are free.

    Args:
        normal: (x, y, z), towards the free side; of any length, it is scaled to 1.
        offset: distance of the wall from the origin along the normal [mm].
        stiffness, stiffness_per_length, toe, friction: of `Boundary`.
    Raises:
        InvalidInput: a normal of length 0, a number that is not finite.
    """

    in_space: ClassVar[bool] = True

    normal: Triple
    offset: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "normal", as_direction("Plane normal", self.normal))
        object.__setattr__(self, "offset", as_coordinate("Plane offset", self.offset))

    def rows(self) -> Mapping[str, Sequence[Row]]:
        """One plane."""
        return {"planes": [(*self.normal, self.offset)]}


@dataclass(frozen=True)
class Sphere(Wall):
    """A round obstacle in space.

    Args:
        centre: (x, y, z) [mm].
        radius: above 0 [mm].
        stiffness, toe, friction: of `Wall`.
    Raises:
        InvalidInput: a radius that is not positive, a number that is not finite.
    """

    in_space: ClassVar[bool] = True

    centre: Triple
    radius: float

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "centre", as_place("Sphere centre", self.centre))
        object.__setattr__(self, "radius", as_positive("Sphere radius", self.radius, "a number above 0 [mm]"))

    def rows(self) -> Mapping[str, Sequence[Row]]:
        """A capsule of length 0."""
        return {"capsules": [(*self.centre, *self.centre, self.radius)]}


@dataclass(frozen=True)
class Disc(Wall):
    """A round obstacle.

    Args:
        centre: (x, y) [mm].
        radius: above 0 [mm].
        stiffness, toe, friction: of `Wall`.
    Raises:
        InvalidInput: a radius that is not positive, a number that is not finite.
    """

    centre: Pair
    radius: float

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "centre", as_point("Disc centre", self.centre))
        object.__setattr__(self, "radius", as_positive("Disc radius", self.radius, "a number above 0 [mm]"))

    def rows(self) -> Mapping[str, Sequence[Row]]:
        """One disc."""
        return {"discs": [(*self.centre, self.radius)]}


@dataclass(frozen=True)
class Capsule(Wall):
    """A straight obstacle with round ends: all points within a radius of the line between two points.

    Args:
        first, second: ends of the line, (x, y), or (x, y, z) for a capsule in space [mm].
        radius: 0 or more [mm].
        stiffness, toe, friction: of `Wall`.
    Raises:
        InvalidInput: ends in one place, one in the plane and one in space, a negative radius, a number that is not
            finite.
    """

    first: Pair | Triple
    second: Pair | Triple
    radius: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        size = np.size(self.first) if np.ndim(self.first) == 1 else 2
        for name in ("first", "second"):
            as_end = as_place if size == 3 else as_point
            object.__setattr__(self, name, as_end(f"Capsule {name}", getattr(self, name)))
        if self.first == self.second:
            use = f"Use a {'Sphere' if size == 3 else 'Disc'}."
            raise InvalidInput("Capsule second", self.second, f"another point than first = {self.first}", use)
        allowed = "a number, 0 or more [mm]"
        object.__setattr__(self, "radius", as_number("Capsule radius", self.radius, 0.0, allowed=allowed))

    @property
    def in_space(self) -> bool:  # type: ignore[override]
        """Whether its ends are points of space."""
        return len(self.first) == 3

    def rows(self) -> Mapping[str, Sequence[Row]]:
        """One capsule."""
        return {"capsules": [(*self.first, *self.second, self.radius)]}


@dataclass(frozen=True)
class Polygon(Wall):
    """An obstacle with corners: a closed row of capsules along its edges, outside of which (or inside) links move.

    Two edges meet in a corner, and both press a link that touches it, which is twice as stiff there.

    Args:
        points: at least three corners in order, (k, 2) [mm].
        radius: rounding of the edges, by which they stand out, 0 or more [mm].
        stiffness, toe, friction: of `Wall`.
    Raises:
        InvalidInput: fewer corners, neighbours in one place, edges that cross, a number that is not finite.
    """

    points: Sequence[Pair]
    radius: float = 0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        corners = as_points("Polygon points", self.points, 3)
        object.__setattr__(self, "points", corners)
        allowed = "a number, 0 or more [mm]"
        object.__setattr__(self, "radius", as_number("Polygon radius", self.radius, 0.0, allowed=allowed))
        edges = self._edges()
        if any(first == second for first, second in edges):
            raise InvalidInput("Polygon points", corners, "corners in different places", "Leave out the repeated one.")
        for (i, one), (j, two) in itertools.combinations(enumerate(edges), 2):
            if j - i not in (1, len(edges) - 1) and _cross(*one, *two):
                raise InvalidInput("Polygon points", corners, "edges that do not cross", f"Edges {i} and {j} do.")

    def _edges(self) -> list[tuple[Pair, Pair]]:
        """First and second corner of every edge."""
        return list(itertools.pairwise([*self.points, self.points[0]]))

    def rows(self) -> Mapping[str, Sequence[Row]]:
        """A capsule for every edge."""
        return {"capsules": [(*first, *second, self.radius) for first, second in self._edges()]}


def checked_wall_friction(friction: object) -> WallFriction | None:
    """The friction; InvalidInput unless it is a WallFriction or None."""
    if friction is not None and not isinstance(friction, WallFriction):
        hint = "WallFriction(0.15) has a coefficient of 0.15."
        raise InvalidInput("wall friction", friction, "a WallFriction or None", hint)
    return friction


def as_coordinate(what: str, value: object) -> float:
    """A number that solvers take."""
    return as_number(what, value, -LARGEST_INPUT, LARGEST_INPUT, allowed="a finite number [mm]")


def as_point(what: str, values: object) -> Pair:
    """Two numbers that solvers take."""
    if not isinstance(values, Sequence | np.ndarray) or isinstance(values, str) or np.shape(values) != (2,):
        raise InvalidInput(what, values, "two numbers (x, y) [mm]")
    x, y = (as_coordinate(what, value) for value in values)
    return x, y


def as_place(what: str, values: object) -> Triple:
    """Three numbers that solvers take."""
    if not isinstance(values, Sequence | np.ndarray) or isinstance(values, str) or np.shape(values) != (3,):
        raise InvalidInput(what, values, "three numbers (x, y, z) [mm]")
    x, y, z = (as_coordinate(what, value) for value in values)
    return x, y, z


def as_direction(what: str, values: object) -> Triple:
    """Three numbers, scaled to a vector of length 1."""
    x, y, z = as_place(what, values)
    length = math.hypot(x, y, z)
    if length == 0.0:
        raise InvalidInput(what, values, "a direction other than (0, 0, 0)")
    length = 1.0 if abs(length - 1.0) < _UNIT else length  # a unit vector is held to the last bit
    return x / length, y / length, z / length


def as_points(what: str, values: object, least: int) -> tuple[Pair, ...]:
    """Pairs of numbers, at least so many."""
    return tuple((float(x), float(y)) for x, y in point_array(what, values, least, "(x, y)"))


def point_array(what: str, values: object, least: int, each: str = "(x, y, z)") -> Array:
    """Points of the plane or of space, at least so many, (k, 2 or 3)."""
    allowed, size = f"at least {least} points {each} [mm]", each.count(",") + 1
    array = as_floats(what, values, allowed)
    fits = array.ndim == 2 and array.shape[1] == size and len(array) >= least
    if not fits or not bool((np.abs(array) <= LARGEST_INPUT).all()):
        raise InvalidInput(what, values, allowed)
    return array


def _cross(a: Pair, b: Pair, c: Pair, d: Pair) -> bool:
    """Whether the line from a to b crosses the one from c to d."""
    return _left(a, b, c) * _left(a, b, d) <= 0.0 and _left(c, d, a) * _left(c, d, b) <= 0.0


def _left(a: Pair, b: Pair, c: Pair) -> float:
    """Positive where c is to the left of the line from a to b."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
