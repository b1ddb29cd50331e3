"""Tubes: lumens in space, around a centre line of arcs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.errors import InvalidInput
from rollingjoint.surroundings.arcs import AroundArcs
from rollingjoint.surroundings.walls import Row, Triple, as_direction, as_place

Array = NDArray[np.float64]

_MOST_STEPS = 100  # of a fit with one number of pieces


class Frames(NamedTuple):
    """Frames along a centre line that are carried along without twist, (k, 3) each: points, tangents and x axes."""

    points: Array
    tangents: Array
    sideways: Array

    def directions(self, angles: Array) -> Array:
        """Unit vectors across the line at angles from the x axes about the tangents, (k, 3)."""
        across = np.cross(self.tangents, self.sideways)
        return np.cos(angles)[:, None] * self.sideways + np.sin(angles)[:, None] * across


@dataclass(frozen=True)
class Tube(AroundArcs):
    """A tube in space in which a chain lies: a centre line of arcs, without corners, and a radius along it.

    Every arc has a plane of its own, so that the line may wind. Both ends go on straight, with the radius there. Links
    have to be inside; a closed end is a Plane on top.

    Args:
        lengths: of the pieces of the centre line, (p,) [mm].
        curvatures: of the pieces, 0 or more, (p,) [1/mm].
        directions: to which side every piece bends, (p,) [rad]: an angle about the tangent in a frame that is carried
            along without twist. It begins with the part of the x axis across the tangent; of the y axis where the
            tangent is along x.
        radii: one number, or the radius at every border of the pieces, linear between them, (p + 1,) [mm].
        start: where the centre line begins, (x, y, z) [mm].
        tangent: its direction there; of any length.
        stiffness, stiffness_per_length, toe, friction: of `Boundary`.
    Raises:
        InvalidInput: a piece without length; a radius that is not positive, or changes by more than half the length;
            radius × curvature >= 1, where the inner wall would fold; a tube that overlaps itself or its straight ends.
    """

    in_space: ClassVar[bool] = True

    lengths: Sequence[float]
    curvatures: Sequence[float]
    directions: Sequence[float]
    radii: float | Sequence[float]
    start: Triple = (0.0, 0.0, 0.0)
    tangent: Triple = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._keep_pieces(directions=(self.directions, "rad"))
        if min(self.curvatures) < 0.0:
            raise InvalidInput("Tube curvatures", self.curvatures, "0 or more [1/mm]", "Turn the direction by pi.")
        object.__setattr__(self, "start", as_place("Tube start", self.start))
        object.__setattr__(self, "tangent", as_direction("Tube tangent", self.tangent))
        self._check_room()
        self._check_overlap()

    @classmethod
    def through(cls, points: ArrayLike, radii: ArrayLike, bend_radius: ArrayLike, **law: Any) -> Tube:
        """A tube along straight lines from point to point, with an arc in every corner.

        Args:
            points: at least two, (k, 3) [mm]; the tube begins at the first and ends at the last.
            radii: one number, or one per point; linear along the straight lines, constant in the arcs [mm].
            bend_radius: of the arcs, one number or one per corner, (k - 2,) [mm].
            law: of `Boundary`, such as stiffness=2.0.
        Raises:
            InvalidInput: points in one place, lines too short for their arcs, a line that turns right back; as the
                class.
        """
        corners, steps, sizes, radii = cls._polyline(points, radii, 2)
        ways = steps / sizes[:, None]
        aside = ways[1:] - np.einsum("ka,ka->k", ways[1:], ways[:-1])[:, None] * ways[:-1]
        turns = np.arctan2(np.linalg.norm(aside, axis=1), np.einsum("ka,ka->k", ways[1:], ways[:-1]))
        if bool((turns > np.pi - 1e-6).any()):
            raise InvalidInput("Tube points", points, "lines that do not turn right back")
        straight, bends = cls._between_bends(bend_radius, sizes, turns)
        frame = first_frame(corners[0], ways[0])
        pieces: list[tuple[float, float, float, float]] = []  # length, curvature, direction, radius at the end
        for i, length in enumerate(straight):
            pieces.append((length, 0.0, 0.0, radii[i + 1]))
            if i < len(turns) and turns[i] > 0.0:
                (tangent,), (sideways,) = frame.tangents, frame.sideways
                angle = float(np.arctan2(aside[i] @ np.cross(tangent, sideways), aside[i] @ sideways))
                arc = bends[i] * turns[i], 1.0 / bends[i], angle
                pieces.append((*arc, radii[i + 1]))
                frame = carried(frame, *(np.array([value]) for value in arc))
        lengths, curvatures, directions, ends = np.array([piece for piece in pieces if piece[0] > 1e-9]).T.tolist()
        first: Any = tuple(corners[0].tolist()), tuple(ways[0].tolist())
        return cls(lengths, curvatures, directions, [radii[0], *ends], *first, **law)

    @classmethod
    def fit(cls, points: ArrayLike, radii: ArrayLike, tolerance: float = 0.1, **law: Any) -> Tube:
        """A tube of arcs of equal lengths whose centre line fits points by least squares, with as few arcs as suffice.

        Args:
            points: along the centre line, in order, such as a segmented airway, at least three, (k, 3) [mm].
            radii: one number, or one per point [mm].
            tolerance: largest distance of a point from the centre line [mm].
            law: of `Boundary`, such as stiffness=2.0.
        Raises:
            InvalidInput: points that no k - 2 arcs fit so well; as the class.
        """
        line, lengths, ends = cls._fitted(points, radii, tolerance, _fitted)
        curvatures, directions = line.curvatures.tolist(), line.angles.tolist()
        first: Any = tuple(line.frames.points[0].tolist()), tuple(line.frames.tangents[0].tolist())
        return cls(lengths, curvatures, directions, ends, *first, **law)

    @cached_property
    def frames(self) -> Frames:
        """The frames at the borders, (p + 1, 3) each."""
        start = first_frame(np.array(self.start), np.array(self.tangent))
        return _all_frames(start, *map(np.array, (self.lengths, self.curvatures, self.directions)))

    def frames_at(self, t: ArrayLike) -> Frames:
        """The frames at arc lengths t, (k,) [mm]; those below 0 or above `length` are on the straight ends."""
        t = np.atleast_1d(np.asarray(t, float))
        piece = np.clip(np.searchsorted(self.borders, t, side="right") - 1, 0, len(self.lengths) - 1)
        nearest = np.clip(t, 0.0, self.length)
        curvatures, angles = np.array(self.curvatures)[piece], np.array(self.directions)[piece]
        frames = carried(
            Frames(*(part[piece] for part in self.frames)), nearest - self.borders[piece], curvatures, angles
        )
        return frames._replace(points=frames.points + (t - nearest)[:, None] * frames.tangents)

    def points(self, t: ArrayLike) -> Array:
        """Points of the centre line at arc lengths t, (..., 3) [mm]."""
        return self.frames_at(np.ravel(t)).points.reshape(*np.shape(t), 3)

    def rows(self) -> Mapping[str, Sequence[Row]]:
        """A piece for every arc, without the number of the tube."""
        frames = Frames(*(part[:-1] for part in self.frames))
        normals = frames.directions(np.array(self.directions))
        radii = self.border_radii
        columns = frames.points, frames.tangents, normals, self.curvatures, self.lengths, radii[:-1], radii[1:]
        table = np.column_stack([np.asarray(column, float) for column in columns])
        return {"pieces": [tuple(row) for row in table.tolist()], "tubes": [()]}


def first_frame(point: Array, tangent: Array) -> Frames:
    """The frame at the start of a centre line: x, or y where the tangent is along x, without its part along it."""
    axis = np.eye(3)[1 if abs(tangent[0]) > 0.999999 else 0]
    sideways = axis - (axis @ tangent) * tangent
    return Frames(point[None], tangent[None], (sideways / np.linalg.norm(sideways))[None])


def carried(frames: Frames, lengths: Array, curvatures: Array, angles: Array) -> Frames:
    """The frames at the ends of arcs, (k,) each, that begin at frames."""
    normals = frames.directions(angles)
    turns = curvatures * lengths
    half = 0.5 * turns[:, None]
    middle = np.cos(half) * frames.tangents + np.sin(half) * normals
    points = frames.points + lengths[:, None] * np.sinc(half / np.pi) * middle
    cos, sin = np.cos(turns)[:, None], np.sin(turns)[:, None]
    tangents = cos * frames.tangents + sin * normals
    share = np.einsum("ka,ka->k", frames.sideways, normals)[:, None]  # turns with the tangent; the rest stays
    sideways = frames.sideways + share * ((cos - 1.0) * normals - sin * frames.tangents)
    return Frames(points, tangents, sideways)


def _all_frames(start: Frames, lengths: Array, curvatures: Array, angles: Array) -> Frames:
    """The frames at all borders of pieces that follow one another."""
    every = [start]
    for i in range(len(lengths)):
        every.append(carried(every[-1], lengths[i : i + 1], curvatures[i : i + 1], angles[i : i + 1]))
    return Frames(*(np.concatenate(parts) for parts in zip(*every, strict=True)))


class _Line(NamedTuple):
    """A centre line of arcs."""

    lengths: Array
    curvatures: Array
    angles: Array
    frames: Frames  # at all borders


def _line_of(numbers: Array, first: Frames, length: float) -> _Line:
    """The line of arcs of equal lengths with these numbers.

    numbers: the shift of its start, the turn of its tangent along the x and y axis of the first frame, and the
        curvature of every piece along both.
    """
    (tangent,), (sideways,) = first.tangents, first.sideways
    aside = numbers[3] * sideways + numbers[4] * np.cross(tangent, sideways)
    turned = (tangent + aside) / np.linalg.norm(tangent + aside)
    pieces = numbers[5:].reshape(-1, 2)
    lengths = np.full(len(pieces), length / len(pieces))
    curvatures, angles = np.hypot(*pieces.T), np.arctan2(pieces[:, 1], pieces[:, 0])
    start = first_frame(first.points[0] + numbers[:3], turned)
    return _Line(lengths, curvatures, angles, _all_frames(start, lengths, curvatures, angles))


def _offsets(line: _Line, points: Array) -> tuple[Array, Array]:
    """Vectors from the nearest places of a line to points, (k, 3), and the arc lengths there; both ends go on straight.

    A point belongs to the nearest piece between whose border planes it lies.
    """
    count, starts = len(line.lengths), np.concatenate([[0.0], np.cumsum(line.lengths)])
    frames = Frames(*(part[:-1] for part in line.frames))
    normals = frames.directions(line.angles)
    ways = points[:, None] - frames.points
    u, v = np.einsum("kpa,pa->kp", ways, frames.tangents), np.einsum("kpa,pa->kp", ways, normals)
    bent = line.curvatures > 1e-12
    curvatures = np.where(bent, line.curvatures, 1.0)
    arcs = np.where(bent, np.arctan2(curvatures * u, 1.0 - curvatures * v) / curvatures, u)
    low = np.where(np.arange(count) == 0, -np.inf, 0.0)
    high = np.where(np.arange(count) == count - 1, np.inf, line.lengths)
    arc = np.clip(arcs, low, high)
    along = starts[:-1] + arc
    flat = np.clip(arc, 0.0, line.lengths)
    repeated = Frames(*(np.tile(part, (len(points), 1)) for part in frames))
    every = np.tile(line.curvatures, len(points)), np.tile(line.angles, len(points))
    there = carried(repeated, flat.ravel(), *every)
    at = there.points + (arc - flat).reshape(-1, 1) * there.tangents
    vectors = points[:, None] - at.reshape(len(points), count, 3)
    best = np.argmin(np.linalg.norm(vectors, axis=-1), axis=1)
    rows = np.arange(len(points))
    return vectors[rows, best], along[rows, best]


def _fitted(points: Array, guesses: Array, pieces: int) -> tuple[_Line, Array, Array]:
    """The line of so many arcs of equal lengths that fits points, distances of these from it and places along it.

    guesses: their places along the polyline through them.
    """
    from scipy.optimize import least_squares

    length = float(guesses[-1])
    first = first_frame(points[0], (points[1] - points[0]) / np.linalg.norm(points[1] - points[0]))
    start = np.zeros(5 + 2 * pieces)
    start[5:] = _bends(points, guesses, first, pieces).ravel()
    result = least_squares(
        lambda x: _offsets(_line_of(x, first, length), points)[0].ravel(),
        start,
        x_scale=np.concatenate([np.ones(3), np.full(2, 0.1), np.full(2 * pieces, 1.0 / length)]),
        max_nfev=_MOST_STEPS,
    )
    line = _line_of(result.x, first, length)
    offsets, along = _offsets(line, points)
    return line, np.linalg.norm(offsets, axis=1), along


def _bends(points: Array, guesses: Array, first: Frames, pieces: int) -> Array:
    """Curvatures of pieces along both axes of the frame that goes along the polyline through points, (pieces, 2)."""
    borders = np.linspace(0.0, guesses[-1], pieces + 1)
    chords = np.diff(points, axis=0) / np.diff(guesses)[:, None]
    middles = 0.5 * (guesses[1:] + guesses[:-1])
    ways = np.stack([np.interp(borders, middles, chords[:, axis]) for axis in range(3)], axis=1)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    sideways, bends = first.sideways[0], []
    for i in range(pieces):
        sideways = sideways - (sideways @ ways[i]) * ways[i]
        sideways /= np.linalg.norm(sideways)
        change = (ways[i + 1] - ways[i]) / (borders[i + 1] - borders[i])
        bends.append((change @ sideways, change @ np.cross(ways[i], sideways)))
    return np.array(bends)
