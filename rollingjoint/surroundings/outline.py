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


class OutlineRows(NamedTuple):
    """What of a chain touches walls, in the frames of its links; link 0 carries none.

    Attributes:
        points: discs, which meet half planes and lumens: link, x, y, radius, length of outline that the point stands
            for, (P, 5) [mm].
        bars: capsules, which meet discs, capsules and polygons: link, first end x, y, second end x, y, radius, (Q, 6).
    """

    points: Array
    bars: Array


@dataclass(frozen=True)
class Sleeve:
    """A chain in a skin: the axes of its links, from surface to surface at s = 0, swept by a disc.

    Args:
        radius: of the disc [mm]; None: half the width of each link.
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


@dataclass(frozen=True)
class Bare:
    """Naked links: their two sides, moved inwards and rounded by as much, and the face of the last link.

    Args:
        rounding: radius of edges [mm].
        points: per side that meet half planes and lumens, evenly spaced from end to end; 2 to 100.
    Raises:
        InvalidInput: a rounding that is not positive, another number of points.
    """

    rounding: float = 1.0
    points: int = 3

    def __post_init__(self) -> None:
        object.__setattr__(self, "rounding", as_positive("Bare rounding", self.rounding, "a number above 0 [mm]"))
        object.__setattr__(self, "points", as_integer("Bare points", self.points, 2, _MOST_POINTS))

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


Outline = Sleeve | Bare


def half_width(link: HasSurfaces) -> float:
    """The largest distance of the ends of a link's surfaces from its axis [mm]."""
    axis = np.subtract(link.child.start, link.parent.start)
    across = np.array([-axis[1], axis[0]]) / np.hypot(*axis)
    ends = [surface.point(np.array(surface.limits)) - link.parent.start for surface in (link.parent, link.child)]
    return float(np.abs(np.concatenate(ends) @ across).max())


def _rows(points: list[tuple[float, ...]], bars: list[tuple[float, ...]]) -> OutlineRows:
    return OutlineRows(np.array(points, float).reshape(-1, 5), np.array(bars, float).reshape(-1, 6))
