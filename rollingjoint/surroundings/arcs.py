"""Centre lines of arcs, around which lumens and tubes lie."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.checks import as_floats, as_positive
from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.arrays import LARGEST_INPUT
from rollingjoint.surroundings.walls import Boundary, point_array

Array = NDArray[np.float64]
Line = TypeVar("Line")
Fitted = Callable[[Array, Array, int], tuple[Line, Array, Array]]

STEEPEST = 0.5  # largest change of a radius per length
_BLOCK = 64  # places that are compared with all others at a time
_PLACES = {False: "(x, y)", True: "(x, y, z)"}  # by whether walls are in space


class AroundArcs(Boundary):
    """Base class of walls around a centre line of arcs, without corners, that goes on straight at both ends."""

    lengths: Sequence[float]
    curvatures: Sequence[float]
    radii: float | Sequence[float]

    @abstractmethod
    def points(self, t: ArrayLike) -> Array:
        """Points of the centre line at arc lengths t, (..., 2 or 3) [mm]."""

    @property
    def length(self) -> float:
        """Of the centre line between its straight ends [mm]."""
        return float(sum(self.lengths))

    @cached_property
    def borders(self) -> Array:
        """Arc lengths at which pieces begin and end, (p + 1,) [mm]."""
        return np.concatenate([[0.0], np.cumsum(self.lengths)])

    @cached_property
    def border_radii(self) -> Array:
        """Radii at the borders, (p + 1,) [mm]."""
        return np.array(self.radii)

    def radius(self, t: ArrayLike) -> Array:
        """Radius at arc lengths t, the shape of t [mm]."""
        return np.interp(np.asarray(t, float), self.borders, self.border_radii)

    def _keep_pieces(self, **others: tuple[ArrayLike, str]) -> None:
        """Check and keep the pieces, with other numbers of each and their units; raises InvalidInput."""
        name = type(self).__name__
        lengths = numbers_of(f"{name} lengths", self.lengths)
        if not lengths.size or not bool((lengths > 0.0).all()):
            raise InvalidInput(f"{name} lengths", self.lengths, "one or more numbers above 0 [mm]")
        each = {"lengths": lengths}
        for which, (values, unit) in {"curvatures": (self.curvatures, "1/mm"), **others}.items():
            each[which] = numbers_of(f"{name} {which}", values)
            if each[which].shape != lengths.shape:
                raise InvalidInput(f"{name} {which}", values, f"{lengths.size} numbers, one per piece [{unit}]")
        each["radii"] = radii_of(f"{name} radii", self.radii, lengths.size + 1, "border of the pieces")
        for which, numbers in each.items():
            object.__setattr__(self, which, tuple(numbers.tolist()))

    def _check_room(self) -> None:
        """Raise InvalidInput where the radius changes too fast, or the inner wall of a bend would fold."""
        name, radii = type(self).__name__, self.border_radii
        slopes = np.abs(np.diff(radii)) / self.lengths
        if slopes.max() > STEEPEST:
            piece = int(np.argmax(slopes))
            allowed = f"radii that change by at most {STEEPEST:g} of the length of their piece"
            ends = f"from {radii[piece]:.4g} to {radii[piece + 1]:.4g} mm"
            hint = f"Piece {piece} of {self.lengths[piece]:.4g} mm goes {ends}."
            raise InvalidInput(f"{name} radii", tuple(radii.tolist()), allowed, hint)
        folds = np.maximum(radii[:-1], radii[1:]) * np.abs(self.curvatures)
        if folds.max() >= 1.0:
            piece = int(np.argmax(folds))
            allowed = f"less than the bend radius of piece {piece}, {1.0 / abs(self.curvatures[piece]):.4g} mm"
            largest = float(radii[piece : piece + 2].max())
            raise InvalidInput(f"{name} radii", largest, allowed, "Else the inner wall folds.")

    def _check_overlap(self) -> None:
        """Raise InvalidInput if places far from each other along the line share points."""
        largest = self.border_radii.max()
        spacing = max(0.5 * self.border_radii.min(), self.length / 1000.0)
        inner = np.linspace(0.0, self.length, 2 + int(self.length / spacing))
        reach = np.ptp(self.points(inner), axis=0).max() + 2.0 * largest
        ends = np.arange(1, 2 + int(reach / spacing)) * spacing
        t = np.concatenate([-ends[::-1], inner, self.length + ends])
        places, radii = self.points(t), self.radius(t)
        for i in range(0, len(t), _BLOCK):
            block = slice(i, i + _BLOCK)
            far = t > t[block, None] + np.pi * largest  # two places of a bend of radius R: 2 R apart, pi R along it
            apart = np.linalg.norm(places - places[block, None], axis=-1)
            first, second = np.nonzero(far & (apart < (radii + radii[block, None]) * (1.0 - 1e-9)))
            if first.size:
                meet = f"{t[i + first[0]]:.4g} and {t[second[0]]:.4g} mm"
                allowed = "a centre line that stays clear of itself, its straight ends included"
                hint = f"It meets itself at arc lengths {meet}. Shorten it."
                raise InvalidInput(type(self).__name__, f"{self.length:.4g} mm long", allowed, hint)

    @classmethod
    def _polyline(cls, points: ArrayLike, radii: ArrayLike, least: int) -> tuple[Array, Array, Array, Array]:
        """At least so many points, (k, d), vectors from each to the next, their lengths, and radii at the points."""
        name = cls.__name__
        places = point_array(f"{name} points", points, least, _PLACES[cls.in_space])
        steps = np.diff(places, axis=0)
        sizes = np.linalg.norm(steps, axis=1)
        if not bool((sizes > 0.0).all()):
            hint = "Leave out the repeated one."
            raise InvalidInput(f"{name} points", points, "neighbours in different places", hint)
        return places, steps, sizes, radii_of(f"{name} radii", radii, len(places), "point")

    @classmethod
    def _between_bends(cls, bend_radius: ArrayLike, sizes: Array, turns: Array) -> tuple[Array, Array]:
        """What arcs in the corners leave of the lines from point to point, (k - 1,), and their radii, (k - 2,) [mm].

        Args:
            bend_radius: one, or one per corner [mm]. sizes: lengths of the lines, (k - 1,) [mm].
            turns: angle of every corner, (k - 2,) [rad].
        Raises:
            InvalidInput: arcs that do not fit.
        """
        what, bends = f"{cls.__name__} bend_radius", np.zeros(0)
        if len(turns):
            bends = radii_of(what, bend_radius, len(turns), "corner")
        # Length of the straight line that an arc replaces on both sides of its corner
        cuts = np.concatenate([[0.0], bends * np.tan(0.5 * turns), [0.0]])
        straight = sizes - cuts[:-1] - cuts[1:]
        if not bool((straight >= -1e-9 * sizes).all()):
            line = int(np.argmin(straight / sizes))
            allowed = f"arcs that fit on the line from point {line} to point {line + 1}, {sizes[line]:.4g} mm long"
            needed = f"They take {cuts[line] + cuts[line + 1]:.4g} mm of it."
            raise InvalidInput(what, bend_radius, allowed, needed)
        return straight, bends

    @classmethod
    def _fitted(
        cls, points: ArrayLike, radii: ArrayLike, tolerance: float, fitted: Fitted[Line]
    ) -> tuple[Line, list[float], list[float]]:
        """The line of the fewest arcs of equal lengths that fits points, these lengths, and the radii at their ends.

        fitted: the line of so many arcs, distances of the points from it, (k,), and their places along it, by the
            points, their places along the polyline through them, and the number of arcs.
        """
        name = cls.__name__
        tolerance = as_positive(f"{name} tolerance", tolerance, "a number above 0 [mm]")
        places, _, sizes, radii = cls._polyline(points, radii, 3)
        guesses, closest, pieces = np.concatenate([[0.0], np.cumsum(sizes)]), np.inf, 1
        while pieces <= len(places) - 2:
            line, distances, along = fitted(places, guesses, pieces)
            error = float(distances.max())
            if error <= tolerance:
                if np.diff(along).min() < -tolerance:
                    hint = f"Point {1 + int(np.argmin(np.diff(along)))} lies before the one before it."
                    raise InvalidInput(f"{name} points", points, f"points in order along the {name.lower()}", hint)
                borders = np.linspace(0.0, guesses[-1], pieces + 1)
                ends = np.interp(borders, np.maximum.accumulate(along), radii)
                return line, np.diff(borders).tolist(), ends.tolist()
            closest = min(closest, error)
            pieces = max(pieces + 1, int(1.3 * pieces))
        hint = f"{len(places) - 2} arcs come within {closest:.2g} mm."
        raise InvalidInput(f"{name} tolerance", tolerance, "a distance that arcs reach at these points [mm]", hint)


def numbers_of(what: str, values: ArrayLike) -> Array:
    """A row of numbers that solvers take, (k,)."""
    allowed = "a list of finite numbers"
    array = as_floats(what, values, allowed)
    if array.ndim != 1 or not bool((np.abs(array) <= LARGEST_INPUT).all()):
        raise InvalidInput(what, values, allowed)
    return array


def radii_of(what: str, values: ArrayLike, count: int | None = None, each: str = "") -> Array:
    """Positive numbers, `count` of them or one for all; for no count one stands for two, and there are at least two."""
    more = "two or more" if count is None else f"{count}, one per {each}"
    allowed = f"one positive number, or {more} [mm]"
    array = np.atleast_1d(as_floats(what, values, allowed))
    if array.shape == (1,):
        array = np.repeat(array, 2 if count is None else count)
    size = max(2, array.size) if count is None else count
    if array.shape != (size,) or not bool(((array > 0.0) & (array <= LARGEST_INPUT)).all()):
        raise InvalidInput(what, values, allowed)
    return array
