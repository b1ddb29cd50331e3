"""The bodies of a mechanism's links: closed outlines with drilled channels."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rollingjoint.cad.channel import Blank, Channel, drill_channel
from rollingjoint.cad.fabrication import Fabrication
from rollingjoint.cad.packages import package
from rollingjoint.cad.sampling import surface_polyline
from rollingjoint.chain.rolling import Link, RollingChain, planar
from rollingjoint.errors import MechanismError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Body:
    """A link as manufactured, in its frame.

    Attributes:
        parent, child: its surfaces from first to last arc length, (k, 2) [mm].
        channels: one per tendon that passes.
        thickness: [mm].
    """

    parent: Array
    child: Array
    channels: tuple[Channel, ...]
    thickness: float

    @property
    def outline(self) -> Array:
        """Corners of the closed outline, counter-clockwise, the first not repeated, (k, 2) [mm]."""
        return np.concatenate([self.parent, self.child[::-1]])

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest (x, y) [mm]."""
        return self.outline.min(axis=0), self.outline.max(axis=0)

    @cached_property
    def area(self) -> float:
        """Area of the outline, channels not subtracted [mm²]."""
        x, y = self.outline.T
        return float(0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum())

    def alike(self, other: Body) -> bool:
        """Whether both are identical to 1e-9 mm."""
        pairs = [(self.outline, other.outline), (self._mouths, other._mouths)]
        return all(a.shape == b.shape and bool(np.allclose(a, b, rtol=0.0, atol=1e-9)) for a, b in pairs)

    @property
    def _mouths(self) -> Array:
        return np.array([[*channel.mouths, (channel.depth, 0.0)] for channel in self.channels])


def bodies(mechanism: RollingChain, fabrication: Fabrication | None = None) -> list[Body]:
    """The body of every link, base first.

    Raises:
        MechanismError: an outline that crosses itself, a channel that leaves its body or has too thin a wall.
        InvalidInput: no planar chain; shapely is not installed.
    """
    making = fabrication or Fabrication()
    return [_body(mechanism, i, link, making) for i, link in enumerate(planar(mechanism).links)]


def _body(mechanism: RollingChain, i: int, link: Link, making: Fabrication) -> Body:
    parent, child = (surface_polyline(surface, making.tolerance) for surface in (link.parent, link.child))
    blank = Body(parent, child, (), making.thickness)
    _check_outline(i, blank)
    if not making.channel_diameter:
        return blank
    passing = [(j, holes[i]) for j, holes in enumerate(mechanism.hole_points) if i < len(holes)]
    depths = [making.depth(j, mechanism.n_tendons) for j in range(mechanism.n_tendons)]
    channels = tuple(drill_channel(Blank(i, parent, child), j, holes, making, depths[j]) for j, holes in passing)
    _check_spacing(i, channels, making.wall)
    return Body(parent, child, channels, making.thickness)


def _check_outline(i: int, body: Body) -> None:
    shapely = package("shapely")
    polygon = shapely.Polygon(body.outline)
    hint = "Narrow the surface limits, or move the surfaces apart."
    if not polygon.is_valid:
        reason, allowed = shapely.is_valid_reason(polygon), "an outline that does not cross itself"
        raise MechanismError(f"outline of link {i}", reason, allowed, hint)
    if body.area <= 0:
        allowed = "a child surface that lies above the parent surface, and x that grows with s"
        raise MechanismError(f"signed area of link {i}", round(body.area, 4), allowed, hint)


def _check_spacing(i: int, channels: tuple[Channel, ...], wall: float) -> None:
    shapely = package("shapely")
    for first, second in itertools.combinations(channels, 2):
        apart = shapely.LineString(first.mouths).distance(shapely.LineString(second.mouths))
        thickness = float(np.hypot(apart, first.depth - second.depth)) - first.diameter
        if thickness < wall:
            raise MechanismError(
                f"wall between the channels of tendons {first.tendon} and {second.tendon} in link {i}",
                round(thickness, 4),
                f"at least {wall:g} mm",
                "Move the holes apart, give the channels depths, or make them narrower.",
            )
