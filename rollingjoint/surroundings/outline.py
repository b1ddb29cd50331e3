"""Outlines of links: the discs and capsules with which they touch walls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from rollingjoint.checks import as_integer, as_positive
from rollingjoint.errors import InvalidInput
from rollingjoint.profile import Surface

Array = NDArray[np.float64]

_MOST_POINTS = 100
_SHORTEST = 1e-6  # mm


class HasSurfaces(Protocol):
    """A link of a planar chain."""

    @property
    def parent(self) -> Surface:
        """Its surface on the link below."""

    @property
    def child(self) -> Surface:
        """Its surface that carries the link above."""


class HasAxes(Protocol):
    """A chain in space."""

    @property
    def link_axes(self) -> Array:
        """Both ends of the axis of every moving link, in its frame, (n - 1, 2, 3) [mm]."""

    @property
    def body_ends(self) -> Array:
        """Lowest and highest z of the body of every moving link, (n - 1, 2) [mm]."""

    @property
    def hole_radius(self) -> float:
        """Largest distance of a hole from the z axis of its link [mm]."""


class OutlineRows(NamedTuple):
    """What of a chain touches walls, in the frames of its links; link 0 carries none.

    Attributes:
        points: discs, which meet half planes and lumens: link, x, y, radius, length of outline that the point stands
            for, (P, 5) [mm]; in space balls, which meet planes and tubes: link, x, y, z, and the same, (P, 6).
        bars: capsules, which meet discs, capsules and polygons: link, first end x, y, second end x, y, radius, (Q, 6);
            in space ends are x, y, z, (Q, 8).
    """

    points: Array
    bars: Array


@dataclass(frozen=True)
class Sleeve:
    """A chain in a skin: the axes of its links, from surface to surface at s = 0, swept by a disc, in space by a ball.

    Args:
        radius: of the disc or ball [mm]; None: half the width of each link, in space the largest distance of a hole
            from the axis.
        points: per link that meet half planes and lumens, evenly spaced up to the end of its axis; 1 to 100.
    Raises:
        InvalidInput: a radius that is not positive, another number of points.
    """

    radius: float | None = None
    points: int = 2

    def __post_init__(self) -> None:
        if self.radius is not None:
            object.__setattr__(self, "radius", as_positive("Sleeve radius", self.radius, "a number above 0 [mm]"))
        object.__setattr__(self, "points", as_integer("Sleeve points", self.points, 1, _MOST_POINTS))

    def rows(self, links: Sequence[HasSurfaces]) -> OutlineRows:
        """Points and bars of the links of a chain, base first.

        Raises:
            InvalidInput: a link without length.
        """
        points, bars = [], []
        for k, link in enumerate(links[1:], start=1):
            first, second = np.array(link.parent.start), np.array(link.child.start)
            length = float(np.hypot(*(second - first)))
            if length < _SHORTEST:
                raise InvalidInput(f"links[{k}] height", length, f"{_SHORTEST:g} mm or more for a Sleeve")
            radius = half_width(link) if self.radius is None else self.radius
            bars.append((k, *first, *second, radius))
            for share in np.arange(1, self.points + 1) / self.points:
                points.append((k, *(first + (second - first) * share), radius, length / self.points))
        return _rows(points, bars)

    def rows_in_space(self, chain: HasAxes) -> OutlineRows:
        """Points and bars of a chain in space.

        Raises:
            InvalidInput: a link without length, holes on the axis for a radius of None.
        """
        points, bars = [], []
        radius = chain.hole_radius if self.radius is None else self.radius
        if radius <= 0.0:
            raise InvalidInput("Sleeve radius", None, "a number above 0 [mm]", "All holes are on the axis.")
        for k, (first, second) in enumerate(chain.link_axes, start=1):
            length = float(np.linalg.norm(second - first))
            if length < _SHORTEST:
                raise InvalidInput(f"length of the axis of link {k}", length, f"{_SHORTEST:g} mm or more for a Sleeve")
            bars.append((k, *first, *second, radius))
            for share in np.arange(1, self.points + 1) / self.points:
                points.append((k, *(first + (second - first) * share), radius, length / self.points))
        return _rows_in_space(points, bars)


@dataclass(frozen=True)
class Bare:
    """Naked links: their two sides, moved inwards and rounded by as much, and the face of the last link.

    In space a link is a prism around its axis, with holes at its edges.

    Args:
        rounding: radius of edges [mm].
        points: per side that meet half planes and lumens, evenly spaced from end to end; 2 to 100.
        sides: edges of a link in space, 3 to 100.
    Raises:
        InvalidInput: a rounding that is not positive, another number of points or sides.
    """

    rounding: float = 1.0
    points: int = 3
    sides: int = 8

    def __post_init__(self) -> None:
        object.__setattr__(self, "rounding", as_positive("Bare rounding", self.rounding, "a number above 0 [mm]"))
        object.__setattr__(self, "points", as_integer("Bare points", self.points, 2, _MOST_POINTS))
        object.__setattr__(self, "sides", as_integer("Bare sides", self.sides, 3, _MOST_POINTS))

    def rows(self, links: Sequence[HasSurfaces]) -> OutlineRows:
        """Points and bars of the links of a chain, base first.

        Raises:
            InvalidInput: a side without length, a link that is narrower than twice the rounding.
        """
        rounding, points, bars = self.rounding, [], []
        for k, link in enumerate(links[1:], start=1):
            if half_width(link) <= rounding:
                hint = "Make the rounding smaller."
                raise InvalidInput("Bare rounding", rounding, f"less than half the width of link {k}", hint)
            for end, inwards in ((0, rounding), (1, -rounding)):
                ends = [surface.point(surface.limits[end]) for surface in (link.parent, link.child)]
                first, second = np.array(ends) + np.array([inwards, 0.0])
                length = float(np.hypot(*(second - first)))
                if length < _SHORTEST:
                    raise InvalidInput(f"length of a side of links[{k}]", length, f"{_SHORTEST:g} mm or more for Bare")
                bars.append((k, *first, *second, rounding))
                for share in np.linspace(0.0, 1.0, self.points):
                    points.append((k, *(first + (second - first) * share), rounding, length / self.points))
        face = links[-1].child
        tip = np.array(face.start) - np.array([0.0, rounding])
        low, high = face.point(np.array(face.limits)) + np.array([[rounding, 0.0], [-rounding, 0.0]])
        points.append((len(links) - 1, *tip, rounding, float(np.hypot(*(high - low)))))
        bars += [(len(links) - 1, *low, *tip, rounding), (len(links) - 1, *tip, *high, rounding)]
        return _rows(points, bars)

    def rows_in_space(self, chain: HasAxes) -> OutlineRows:
        """Points and bars of a chain in space.

        Raises:
            InvalidInput: a link that is narrower or shorter than twice the rounding.
        """
        rounding, points, bars = self.rounding, [], []
        reach = chain.hole_radius - rounding
        if reach <= 0.0:
            allowed = f"less than {chain.hole_radius:g}, the distance of the holes from the axis [mm]"
            raise InvalidInput("Bare rounding", rounding, allowed, "Make the rounding smaller.")
        angles = 2.0 * np.pi * np.arange(self.sides) / self.sides
        ends = chain.body_ends
        for k, (low, high) in enumerate(ends, start=1):
            length = float(high - low) - 2.0 * rounding
            if length < _SHORTEST:
                allowed = f"more than {2.0 * rounding:g}, twice the rounding [mm]"
                raise InvalidInput(f"height of link {k}", float(high - low), allowed, "Make the rounding smaller.")
            for x, y in reach * np.stack([np.cos(angles), np.sin(angles)], axis=1):
                bars.append((k, x, y, low + rounding, x, y, high - rounding, rounding))
                for z in np.linspace(low + rounding, high - rounding, self.points):
                    points.append((k, x, y, z, rounding, length / self.points))
        top, last = float(ends[-1, 1]) - rounding, len(ends)
        points.append((last, 0.0, 0.0, top, rounding, 2.0 * reach))
        for x, y in reach * np.stack([np.cos(angles), np.sin(angles)], axis=1):
            bars.append((last, x, y, top, 0.0, 0.0, top, rounding))
        return _rows_in_space(points, bars)


Outline = Sleeve | Bare


def half_width(link: HasSurfaces) -> float:
    """The largest distance of the ends of a link's surfaces from its axis [mm]."""
    axis = np.subtract(link.child.start, link.parent.start)
    across = np.array([-axis[1], axis[0]]) / np.hypot(*axis)
    ends = [surface.point(np.array(surface.limits)) - link.parent.start for surface in (link.parent, link.child)]
    return float(np.abs(np.concatenate(ends) @ across).max())


def _rows(points: list[tuple[float, ...]], bars: list[tuple[float, ...]]) -> OutlineRows:
    return OutlineRows(np.array(points, float).reshape(-1, 5), np.array(bars, float).reshape(-1, 6))


def _rows_in_space(points: Sequence[tuple[float, ...]], bars: Sequence[tuple[float, ...]]) -> OutlineRows:
    return OutlineRows(np.array(points, float).reshape(-1, 6), np.array(bars, float).reshape(-1, 8))
