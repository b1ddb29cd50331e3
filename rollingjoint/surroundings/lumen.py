"""Lumens: tubes around a centre line of arcs, inside of which links move."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.checks import as_positive
from rollingjoint.errors import InvalidInput
from rollingjoint.profile import Profile, Surface
from rollingjoint.surroundings.arcs import AroundArcs, numbers_of, radii_of
from rollingjoint.surroundings.walls import Row

Array = NDArray[np.float64]

Start = tuple[float, float, float]

_MOST_PIECES = 1000
_SAMPLES = 8  # points of a piece at which a curve is compared with its arcs
_MOST_STEPS = 50  # of a fit with one number of pieces
_RENEWALS = 8  # of the nearest points of a fit; each squares their error
_UP = (0.0, 0.0, float(np.pi / 2))


@dataclass(frozen=True)
class Lumen(AroundArcs):
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
        self._keep_pieces()
        start = numbers_of("Lumen start", self.start)
        if start.shape != (3,):
            raise InvalidInput("Lumen start", self.start, "three numbers (x, y, angle) [mm, rad]")
        object.__setattr__(self, "start", tuple(start.tolist()))
        self._check_room()
        self._check_overlap()

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
        corners, steps, sizes, radii = cls._polyline(points, radii, 2)
        angles = np.arctan2(steps[:, 1], steps[:, 0])
        turns = (np.diff(angles) + np.pi) % (2.0 * np.pi) - np.pi
        straight, bends = cls._between_bends(bend_radius, sizes, np.abs(turns))
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
        numbers, lengths, ends = cls._fitted(points, radii, tolerance, _fitted)
        x, y, angle = numbers[:3].tolist()
        return cls(lengths, numbers[3:].tolist(), ends, (x, y, angle), **law)

    @cached_property
    def centre_line(self) -> Surface:
        """The centre line between its straight ends, as a curve over arc length."""
        profile = Profile.piecewise_constant(self.borders, self.curvatures)
        return Surface(profile, self.start[:2], self.start[2])

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

    def sides(self, t: ArrayLike) -> tuple[Array, Array]:
        """Points of the left and the right wall at arc lengths t, (..., 2) each [mm]."""
        pose, radius = self.pose(t), self.radius(t)[..., None]
        normal = np.stack([-np.sin(pose[..., 2]), np.cos(pose[..., 2])], axis=-1)
        return pose[..., :2] + radius * normal, pose[..., :2] - radius * normal

    def rows(self) -> Mapping[str, Sequence[Row]]:
        """A piece for every arc, without the number of the lumen."""
        poses = self.centre_line.pose(self.borders[:-1])
        ends = itertools.pairwise(self.border_radii)
        pieces = zip(poses, self.curvatures, self.lengths, self.borders, ends, strict=False)
        return {"pieces": [(*pose, u, length, t, *ends) for pose, u, length, t, ends in pieces], "lumens": [()]}

    def points(self, t: ArrayLike) -> Array:
        """Points of the centre line at arc lengths t, (..., 2) [mm]."""
        return self.pose(t)[..., :2]


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


def _fitted(points: Array, guesses: Array, pieces: int) -> tuple[Array, Array, Array]:
    """The numbers of the line of so many arcs that fits points, distances of these from it and places along it.

    guesses: their places along the polyline through them.
    """
    from scipy.optimize import least_squares

    chords = np.diff(points, axis=0)
    angles, middles = np.unwrap(np.arctan2(chords[:, 1], chords[:, 0])), 0.5 * (guesses[1:] + guesses[:-1])
    borders = np.linspace(0.0, guesses[-1], pieces + 1)
    turns = np.interp(borders, middles, angles)
    start = np.concatenate([points[0], turns[:1], np.diff(turns) / np.diff(borders)])
    result = least_squares(lambda x: _offsets(x, points, guesses)[0], start, x_scale="jac", max_nfev=_MOST_STEPS)
    offsets, along = _offsets(result.x, points, guesses)
    return result.x, np.abs(offsets), along


def _offsets(numbers: Array, points: Array, guesses: Array) -> tuple[Array, Array]:
    """Signed distances of points from the line to its left, and the places nearest to them; both ends go on straight.

    numbers: x, y and angle of its start, and the curvatures of pieces of equal lengths.
    """
    length = guesses[-1]
    borders = np.linspace(0.0, length, numbers.size - 2)
    line = Surface(Profile.piecewise_constant(borders, numbers[3:]), (numbers[0], numbers[1]), numbers[2])
    along = guesses.copy()
    for _ in range(_RENEWALS):
        at = np.clip(along, 0.0, length)
        pose = line.pose(at)
        cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        dx, dy = (points - pose[:, :2]).T
        ahead, across = dx * cos + dy * sin, dy * cos - dx * sin
        bend = np.where(at == along, 1.0 - line.curvature(at) * across, 1.0)
        along = at + ahead / np.maximum(bend, 0.2)
    return across, along
