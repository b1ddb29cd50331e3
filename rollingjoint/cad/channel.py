"""Tendon channels: straight round holes through links, checked for drilling."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint.cad.fabrication import Fabrication
from rollingjoint.cad.packages import package
from rollingjoint.errors import MechanismError

Array = NDArray[np.float64]

_BEYOND = 0.05  # mm that a drill extends past the mouths of its channel


@dataclass(frozen=True, eq=False)
class Channel:
    """A round hole through a link, along the line from a tendon's parent hole to its child hole.

    Attributes:
        tendon: index of the tendon.
        holes: parent and child hole of the tendon, (2, 2) [mm].
        mouths: of the channel's centre line on the parent and the child surface, (2, 2) [mm].
        edges: the same for the two lines a radius to either side of it, (2, 2, 2): edge, mouth, point [mm].
        drill: begin and end of the cylinder that cuts it, beyond both surfaces, (2, 2) [mm].
        diameter: [mm].
        depth: of its centre line above z = 0 [mm].
    """

    tendon: int
    holes: Array
    mouths: Array
    edges: Array
    drill: Array
    diameter: float
    depth: float


class Blank(NamedTuple):
    """A link before drilling: its index and its two surfaces, (k, 2) [mm]."""

    link: int
    parent: Array
    child: Array


def drill_channel(blank: Blank, tendon: int, holes: Array, making: Fabrication, depth: float) -> Channel:
    """The channel of a tendon through a link at a depth, holes (2, 2) [mm].

    Raises:
        MechanismError: holes without a direction, a channel that leaves the body or has too thin a wall.
    """
    return _Drilling(blank, tendon, holes, making).channel(depth)


@dataclass(frozen=True, eq=False)
class _Drilling:
    """One channel of one link, in coordinates (x along it, y to its left) from the middle between the holes."""

    blank: Blank
    tendon: int
    holes: Array
    making: Fabrication

    def channel(self, depth: float) -> Channel:
        """The channel; MechanismError if it cannot be drilled."""
        span, diameter = float(np.hypot(*np.subtract(*self.holes))), self.making.channel_diameter
        if span < diameter:
            allowed = f"at least the diameter, {diameter:g} mm: their line is the channel"
            raise self._error("distance of the holes", round(span, 4), allowed)
        self._check_inside(span)
        radius, wall = 0.5 * diameter, self.making.wall
        mouths, *edges = (self._crossing(offset, "channel") for offset in (0.0, -radius, radius))
        for offset in (-radius - wall, radius + wall):
            self._crossing(offset, f"wall of {wall:g} mm")
        return Channel(self.tendon, self.holes, mouths, np.array(edges), self._drill(radius), diameter, depth)

    def _check_inside(self, span: float) -> None:
        shapely = package("shapely")
        line = shapely.LineString([(-0.5 * span, 0.0), (0.5 * span, 0.0)])
        outside = line.difference(self._polygon.buffer(2 * self.making.tolerance)).length
        if outside:
            raise self._error("length outside the body", round(outside, 4), "a channel inside the body")

    def _crossing(self, offset: float, name: str) -> Array:
        """Ends of the line at an offset on the parent and on the child surface, (2, 2) [mm]."""
        shapely = package("shapely")
        line = shapely.LineString([(-self._reach, offset), (self._reach, offset)])
        common = self._polygon.intersection(line)
        middle = shapely.Point(0.0, offset)
        pieces = [piece for piece in getattr(common, "geoms", [common]) if piece.distance(middle) < 1e-9]
        if pieces and pieces[0].geom_type == "LineString":
            ends = np.array(sorted(pieces[0].coords))
            surfaces = zip((self.blank.parent, self.blank.child), ends, strict=True)
            if all(shapely.LineString(self._local(s)).distance(shapely.Point(end)) < 1e-9 for s, end in surfaces):
                return self._middle + ends @ self._axes
        raise self._error(name, self.holes.round(4).tolist(), "one that runs inside the body from surface to surface")

    def _drill(self, radius: float) -> Array:
        """Begin and end of the cylinder that opens both mouths without other cuts, (2, 2) [mm]."""
        shapely = package("shapely")
        common = self._polygon.intersection(shapely.box(-self._reach, -radius, self._reach, radius))
        core = min(getattr(common, "geoms", [common]), key=lambda piece: piece.distance(shapely.Point(0.0, 0.0)))
        low, _, high, _ = core.bounds
        low, high = low - _BEYOND, high + _BEYOND
        if self._polygon.intersection(shapely.box(low, -radius, high, radius)).geom_type != "Polygon":
            raise self._error("channel", self.holes.round(4).tolist(), "one whose mouths open into free space")
        return self._middle + np.array([[low, 0.0], [high, 0.0]]) @ self._axes

    def _error(self, name: str, value: object, allowed: str) -> MechanismError:
        place = f"{name} (channel of tendon {self.tendon} in link {self.blank.link})"
        return MechanismError(place, value, allowed, "Move the parent and the child hole, or narrow the channel.")

    @property
    def _middle(self) -> Array:
        return 0.5 * (self.holes[0] + self.holes[1])

    @property
    def _axes(self) -> Array:
        """Rows: unit vectors along the channel and to its left, (2, 2)."""
        x, y = (self.holes[1] - self.holes[0]) / np.hypot(*np.subtract(*self.holes))
        return np.array([[x, y], [-y, x]])

    def _local(self, points: Array) -> Array:
        return (points - self._middle) @ self._axes.T

    @cached_property
    def _polygon(self) -> Any:
        return package("shapely").Polygon(self._local(np.concatenate([self.blank.parent, self.blank.child[::-1]])))

    @cached_property
    def _reach(self) -> float:
        """Longer than the body [mm]."""
        return float(2.0 * np.abs(self._polygon.bounds).max() + 1.0)
