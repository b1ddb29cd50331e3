"""Lumens: tubes around a centre line of arcs, inside of which links move."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.checks import as_floats, as_positive
from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.arrays import LARGEST_INPUT
from rollingjoint.profile import Profile, Surface
from rollingjoint.surroundings.walls import Boundary, Row, as_points

Array = NDArray[np.float64]

Start = tuple[float, float, float]

STEEPEST = 0.5  # largest change of a radius per length
_MOST_PIECES = 1000
_BLOCK = 64  # places that are compared with all others at a time
_SAMPLES = 8  # points of a piece at which a curve is compared with its arcs
_UP = (0.0, 0.0, float(np.pi / 2))


@dataclass(frozen=True)
class Lumen(Boundary):
    """A tube in which a chain lies: a centre line of arcs, without corners, and a radius along it.

    Both ends go on straight, with the radius there. Links have to be inside; a closed end is a HalfPlane on top.

    Args:
        lengths: of the pieces of the centre line, (p,) [mm].
        curvatures: of the pieces, positive where it bends to the left, (p,) [1/mm].
        radii: one number, or the radius at every border of the pieces, linear between them, (p + 1,) [mm].
        start: where the centre line begins, (x, y, angle of its tangent) [mm, rad].
        stiffness, stiffness_per_length, toe, friction: of `Boundary`.
    Raises:
        InvalidInput: a piece without length; a radius that is not positive, or changes by more than half the length;
            radius × curvature >= 1, where the inner wall would fold; a lumen that overlaps itself or its straight ends.
    """

    lengths: Sequence[float]
    curvatures: Sequence[float]
    radii: float | Sequence[float]
    start: Start = _UP

    def __post_init__(self) -> None:
        super().__post_init__()
        lengths, curvatures = numbers_of("Lumen lengths", self.lengths), numbers_of("Lumen curvatures", self.curvatures)
        if not lengths.size or not bool((lengths > 0.0).all()):
            raise InvalidInput("Lumen lengths", self.lengths, "one or more numbers above 0 [mm]")
        if lengths.shape != curvatures.shape:
            raise InvalidInput("Lumen curvatures", self.curvatures, f"{lengths.size} numbers, one per piece [1/mm]")
        radii = radii_of("Lumen radii", self.radii, lengths.size + 1, "border of the pieces")
        start = numbers_of("Lumen start", self.start)
        if start.shape != (3,):
            raise InvalidInput("Lumen start", self.start, "three numbers (x, y, angle) [mm, rad]")
        for name, numbers in (("lengths", lengths), ("curvatures", curvatures), ("radii", radii), ("start", start)):
            object.__setattr__(self, name, tuple(numbers.tolist()))
        check_room("Lumen", self, self._radii)
        check_overlap("Lumen", self, self._radii)

    @classmethod
    def along(
        cls, profile: Profile, radii: ArrayLike, start: Start = _UP, tolerance: float = 0.01, **law: Any
    ) -> Lumen:
        """A lumen with the curvature of a profile, in arcs that stay within `tolerance` of its curve.

        Args:
            profile: curvature of the centre line; it begins at the profile's first arc length.
            radii: one number, or radii at evenly spaced arc lengths, linear between them, at least two [mm].
            start: (x, y, angle) of its beginning [mm, rad].
            tolerance: largest distance from the exact curve [mm].
            law: of `Boundary`, such as stiffness=2.0.
        Raises:
            InvalidInput: more than 1,000 arcs; as the class.
        """
        if not isinstance(profile, Profile):
            raise InvalidInput("Lumen profile", profile, "a Profile, such as Profile.constant(0.02, (0, 60))")
        tolerance = as_positive("Lumen tolerance", tolerance, "a number above 0 [mm]")
        radii = radii_of("Lumen radii", radii)
        low, high = profile.limits
        knots = np.linspace(low, high, radii.size)
        borders, count = np.union1d(profile.breaks, knots), 1
        bends = np.any(profile.coefficients[:, 1:] != 0.0, axis=1)
        while True:
            arcs = _divided(borders, bends[_piece(profile, borders)], count)
            curvatures = np.diff(profile.turning(arcs)) / np.diff(arcs)
            lumen_line = Surface(Profile.piecewise_constant(arcs - low, curvatures), (0.0, 0.0))
            error = _distance(profile, lumen_line, arcs)
            if error <= tolerance:
                break
            count *= 2
            if (borders.size - 1) * count > _MOST_PIECES:
                raise InvalidInput("Lumen tolerance", tolerance, f"{error:.2g} mm or more for this profile")
        return cls(np.diff(arcs).tolist(), curvatures.tolist(), np.interp(arcs, knots, radii).tolist(), start, **law)

    @classmethod
    def through(cls, points: ArrayLike, radii: ArrayLike, bend_radius: ArrayLike, **law: Any) -> Lumen:
        """A lumen along straight lines from point to point, with an arc in every corner.

        Args:
            points: at least two, (k, 2) [mm]; the lumen begins at the first and ends at the last.
            radii: one number, or one per point; linear along the straight lines, constant in the arcs [mm].
            bend_radius: of the arcs, one number or one per corner, (k - 2,) [mm].
            law: of `Boundary`, such as stiffness=2.0.
        Raises:
            InvalidInput: points in one place, lines too short for their arcs; as the class.
        """
        corners = np.array(as_points("Lumen points", points, 2))
        steps = np.diff(corners, axis=0)
        sizes = np.hypot(*steps.T)
        if not bool((sizes > 0.0).all()):
            raise InvalidInput("Lumen points", points, "neighbours in different places", "Leave out the repeated one.")
        radii = radii_of("Lumen radii", radii, len(corners), "point")
        bends = np.zeros(0)
        if len(corners) > 2:
            bends = radii_of("Lumen bend_radius", bend_radius, len(corners) - 2, "corner")
        angles = np.arctan2(steps[:, 1], steps[:, 0])
        turns = (np.diff(angles) + np.pi) % (2.0 * np.pi) - np.pi
        straight = straight_parts("Lumen bend_radius", bend_radius, sizes, bends, np.abs(turns))
        pieces: list[tuple[float, float, float]] = []  # length, curvature, radius at the end
        for i, length in enumerate(straight):
            pieces.append((length, 0.0, radii[i + 1]))
            if i < len(turns) and turns[i] != 0.0:
                pieces.append((bends[i] * abs(turns[i]), np.sign(turns[i]) / bends[i], radii[i + 1]))
        lengths, curvatures, ends = np.array([piece for piece in pieces if piece[0] > 1e-9]).T.tolist()
        start = (float(corners[0, 0]), float(corners[0, 1]), float(angles[0]))
        return cls(lengths, curvatures, [radii[0], *ends], start, **law)

    @classmethod
    def fit(cls, points: ArrayLike, radii: ArrayLike, tolerance: float = 0.1, **law: Any) -> Lumen:
        """A lumen of arcs of equal lengths whose centre line fits points by least squares, with as few arcs as suffice.

        Args:
            points: along the centre line, in order, such as a segmented airway, at least three, (k, 2) [mm].
            radii: one number, or one per point [mm].
            tolerance: largest distance of a point from the centre line [mm].
            law: of `Boundary`, such as stiffness=2.0.
        Raises:
            InvalidInput: points that no k - 2 arcs fit so well; as the class.
        """
        from rollingjoint.surroundings.fitting import fitted_line

        places = np.array(as_points("Lumen points", points, 3))
        tolerance = as_positive("Lumen tolerance", tolerance, "a number above 0 [mm]")
        radii = radii_of("Lumen radii", radii, len(places), "point")
        lengths, curvatures, start, along = fitted_line(places, tolerance)
        borders = np.concatenate([[0.0], np.cumsum(lengths)])
        return cls(lengths.tolist(), curvatures.tolist(), np.interp(borders, along, radii).tolist(), start, **law)

    @property
    def length(self) -> float:
        """Of the centre line between its straight ends [mm]."""
        return float(sum(self.lengths))

    @cached_property
    def borders(self) -> Array:
        """Arc lengths at which pieces begin and end, (p + 1,) [mm]."""
        return np.concatenate([[0.0], np.cumsum(self.lengths)])

    @cached_property
    def centre_line(self) -> Surface:
        """The centre line between its straight ends, as a curve over arc length."""
        profile = Profile.piecewise_constant(self.borders, self.curvatures)
        return Surface(profile, self.start[:2], self.start[2])

    @cached_property
    def _radii(self) -> Array:
        return np.array(self.radii)

    def pose(self, t: ArrayLike) -> Array:
        """Point and angle of the tangent of the centre line at arc lengths t, (..., 3) [mm, rad].

        Arc lengths below 0 or above `length` are on the straight ends.
        """
        along = np.asarray(t, float)
        at = np.clip(along, 0.0, self.borders[-1])
        pose = self.centre_line.pose(at)
        beyond = (along - at)[..., None]
        pose[..., :2] += beyond * np.stack([np.cos(pose[..., 2]), np.sin(pose[..., 2])], axis=-1)
        return pose

    def radius(self, t: ArrayLike) -> Array:
        """Radius at arc lengths t, the shape of t [mm]."""
        return np.interp(np.asarray(t, float), self.borders, self._radii)

    def sides(self, t: ArrayLike) -> tuple[Array, Array]:
        """Points of the left and the right wall at arc lengths t, (..., 2) each [mm]."""
        pose, radius = self.pose(t), self.radius(t)[..., None]
        normal = np.stack([-np.sin(pose[..., 2]), np.cos(pose[..., 2])], axis=-1)
        return pose[..., :2] + radius * normal, pose[..., :2] - radius * normal

    def rows(self) -> Mapping[str, Sequence[Row]]:
        """A piece for every arc, without the number of the lumen."""
        poses = self.centre_line.pose(self.borders[:-1])
        pieces = zip(poses, self.curvatures, self.lengths, self.borders, itertools.pairwise(self._radii), strict=False)
        return {"pieces": [(*pose, u, length, t, *ends) for pose, u, length, t, ends in pieces], "lumens": [()]}

    def points(self, t: ArrayLike) -> Array:
        """Points of the centre line at arc lengths t, (..., 2) [mm]."""
        return self.pose(t)[..., :2]


class CentreLine(Protocol):
    """A lumen or a tube: arcs without corners, and a radius along them."""

    @property
    def lengths(self) -> Sequence[float]:
        """Of its pieces [mm]."""

    @property
    def curvatures(self) -> Sequence[float]:
        """Of its pieces [1/mm]."""

    @property
    def length(self) -> float:
        """Sum of the lengths [mm]."""

    def points(self, t: ArrayLike) -> Array:
        """Points at arc lengths t [mm]."""

    def radius(self, t: ArrayLike) -> Array:
        """Radius at arc lengths t [mm]."""


def check_room(name: str, line: CentreLine, radii: Array) -> None:
    """Raise InvalidInput where the radius changes too fast, or the inner wall of a bend would fold."""
    slopes = np.abs(np.diff(radii)) / line.lengths
    if slopes.max() > STEEPEST:
        piece = int(np.argmax(slopes))
        allowed = f"radii that change by at most {STEEPEST:g} of the length of their piece"
        ends = f"from {radii[piece]:.4g} to {radii[piece + 1]:.4g} mm"
        hint = f"Piece {piece} of {line.lengths[piece]:.4g} mm goes {ends}."
        raise InvalidInput(f"{name} radii", tuple(radii.tolist()), allowed, hint)
    folds = np.maximum(radii[:-1], radii[1:]) * np.abs(line.curvatures)
    if folds.max() >= 1.0:
        piece = int(np.argmax(folds))
        allowed = f"less than the bend radius of piece {piece}, {1.0 / abs(line.curvatures[piece]):.4g} mm"
        largest = float(radii[piece : piece + 2].max())
        raise InvalidInput(f"{name} radii", largest, allowed, "Else the inner wall folds.")


def check_overlap(name: str, line: CentreLine, border_radii: Array) -> None:
    """Raise InvalidInput if places far from each other along a lumen or a tube share points."""
    largest = border_radii.max()
    spacing = max(0.5 * border_radii.min(), line.length / 1000.0)
    inner = np.linspace(0.0, line.length, 2 + int(line.length / spacing))
    reach = np.ptp(line.points(inner), axis=0).max() + 2.0 * largest
    ends = np.arange(1, 2 + int(reach / spacing)) * spacing
    t = np.concatenate([-ends[::-1], inner, line.length + ends])
    places, radii = line.points(t), line.radius(t)
    for i in range(0, len(t), _BLOCK):
        block = slice(i, i + _BLOCK)
        far = t > t[block, None] + np.pi * largest  # two places of a bend of radius R: 2 R apart, pi R along it
        apart = np.linalg.norm(places - places[block, None], axis=-1)
        first, second = np.nonzero(far & (apart < (radii + radii[block, None]) * (1.0 - 1e-9)))
        if first.size:
            meet = f"{t[i + first[0]]:.4g} and {t[second[0]]:.4g} mm"
            allowed = "a centre line that stays clear of itself, its straight ends included"
            hint = f"It meets itself at arc lengths {meet}. Shorten it."
            raise InvalidInput(name, f"{line.length:.4g} mm long", allowed, hint)


def straight_parts(what: str, given: ArrayLike, sizes: Array, bends: Array, turns: Array) -> Array:
    """What arcs of these radii in the corners leave of the lines from point to point, (k - 1,) [mm].

    Args:
        what, given: the radii as a caller gave them, for the message. sizes: lengths of the lines, (k - 1,) [mm].
        bends, turns: radius [mm] and angle [rad] of every corner, (k - 2,).
    Raises:
        InvalidInput: arcs that do not fit.
    """
    # Length of the straight line that an arc replaces on both sides of its corner
    cuts = np.concatenate([[0.0], bends * np.tan(0.5 * turns), [0.0]])
    straight = sizes - cuts[:-1] - cuts[1:]
    if not bool((straight >= -1e-9 * sizes).all()):
        line = int(np.argmin(straight / sizes))
        allowed = f"arcs that fit on the line from point {line} to point {line + 1}, {sizes[line]:.4g} mm long"
        needed = f"They take {cuts[line] + cuts[line + 1]:.4g} mm of it."
        raise InvalidInput(what, given, allowed, needed)
    return straight


def _divided(borders: Array, bends: NDArray[np.bool_], count: int) -> Array:
    """The borders with pieces whose curvature changes divided into `count` parts."""
    parts = [
        np.linspace(low, high, 1 + (count if bent else 1))[:-1]
        for (low, high), bent in zip(itertools.pairwise(borders), bends, strict=True)
    ]
    return np.concatenate([*parts, borders[-1:]])


def _piece(profile: Profile, borders: Array) -> NDArray[np.intp]:
    """The piece of the profile in which every interval of the borders lies."""
    return np.searchsorted(profile.breaks, borders[:-1], side="right") - 1


def _distance(profile: Profile, line: Surface, arcs: Array) -> float:
    """Largest distance of the profile's curve from a line that begins at its first point along its tangent [mm]."""
    low = profile.limits[0]
    within = np.linspace(0.0, 1.0, _SAMPLES, endpoint=False)
    s = np.append((arcs[:-1, None] + np.diff(arcs)[:, None] * within).ravel(), arcs[-1])
    angle = -float(profile.turning(low))
    exact = Surface(profile, (0.0, 0.0), angle)
    return float(np.hypot(*(exact.point(s) - exact.point(low) - line.point(s - low)).T).max())


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
