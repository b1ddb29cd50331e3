"""Thickness, channels and tolerance of bodies."""

from __future__ import annotations

from dataclasses import dataclass

from rollingjoint.checks import as_floats
from rollingjoint.errors import InvalidInput


@dataclass(frozen=True)
class Fabrication:
    """Thickness, channels and tolerance of bodies, all in mm.

    Args:
        thickness: of every body, perpendicular to the plane of motion.
        channel_diameter: of the round tendon channels; 0 leaves them out.
        tolerance: largest distance between a drawn curve and the exact curve.
        wall: thinnest wall around a channel.
        bore: diameter of a hole along z through the middle of every link in space, as for a backbone or wires; 0 leaves
            it out.
        depths: of the channels of all tendons in a planar body, from z = 0 to their middle, one number or one for each
            tendon; none: half the thickness.
    Raises:
        InvalidInput: a number beyond its range, or a channel wider than the body is thick.
    """

    thickness: float = 6.0
    channel_diameter: float = 0.8
    tolerance: float = 1e-3
    wall: float = 0.4
    bore: float = 0.0
    depths: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name, low, high in (
            ("thickness", 0.1, 1000.0),
            ("channel_diameter", 0.0, 100.0),
            ("tolerance", 1e-5, 0.1),
            ("wall", 0.0, 100.0),
            ("bore", 0.0, 100.0),
        ):
            value, allowed = getattr(self, name), f"{low:g} to {high:g} mm"
            number = as_floats(name.replace("_", " "), value, allowed)
            if number.ndim or not low <= number <= high:
                raise InvalidInput(name.replace("_", " "), value, allowed)
            object.__setattr__(self, name, float(number))
        if 0 < self.channel_diameter < 20 * self.tolerance:
            allowed = f"0 for no channels, or at least 20 times the tolerance, {20 * self.tolerance:g} mm"
            raise InvalidInput("channel diameter", self.channel_diameter, allowed)
        smallest = self.channel_diameter + 2 * self.wall
        if self.channel_diameter and self.thickness < smallest:
            needed = (
                f"at least {smallest:g} mm: the channel, {self.channel_diameter:g}, and twice the wall, {self.wall:g}"
            )
            raise InvalidInput("thickness", self.thickness, needed, "Make the body thicker or the channel narrower.")
        self._check_depths(0.5 * smallest)

    def _check_depths(self, least: float) -> None:
        allowed = (
            f"numbers from {least:g} to {self.thickness - least:g} mm, inside the body with walls of {self.wall:g}"
        )
        depths = as_floats("depths", self.depths, allowed).ravel()
        if not ((depths >= least) & (depths <= self.thickness - least)).all():
            raise InvalidInput("depths", self.depths, allowed, "Make the body thicker or the channel narrower.")
        object.__setattr__(self, "depths", tuple(depths.tolist()))

    def depth(self, tendon: int, tendons: int) -> float:
        """Depth of the channels of a tendon of so many [mm]; InvalidInput for another number of depths."""
        if len(self.depths) not in (0, 1, tendons):
            raise InvalidInput("depths", self.depths, f"one number, or {tendons}, one for each tendon")
        return (self.depths * tendons)[tendon] if self.depths else 0.5 * self.thickness
