"""Tendons: which holes they pass, where they end, how stiff they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rollingjoint.checks import Triple, as_floats, as_integer, as_number, as_positive
from rollingjoint.errors import MechanismError
from rollingjoint.friction import CapstanFriction, checked_friction

DEFAULT_STIFFNESS = 5.0
"""Tendon stiffness [N/mm]: E A / L of a 0.28 mm polyethylene braid (E about 20 GPa along the braid, A = 0.062 mm²)
over a quarter of a metre between the motor and the tip."""


@dataclass(frozen=True)
class OnSurface:
    """A hole where its contact surface is at arc length s [mm]."""

    s: float


Hole = tuple[float, float] | OnSurface
"""A hole in a link: a point (x, y) of the link frame [mm], or a point of the contact surface."""


@dataclass(frozen=True)
class AnyTendon:
    """Base class of the tendons of all chains; fields as in the subclasses."""

    holes: Sequence[Any]
    end: int = -1
    stiffness: float = DEFAULT_STIFFNESS
    friction: CapstanFriction | None = None

    def _check(self) -> None:
        """Raise MechanismError for a wrong end, stiffness or friction; hold plain numbers."""
        end = as_integer("tendon end", self.end, allowed="the number of a link", error=MechanismError)
        stiffness = as_positive("tendon stiffness", self.stiffness, "a positive number [N/mm]", MechanismError)
        friction = checked_friction(self.friction, "tendon friction")
        if friction is not None and friction.rolling > 0.0:
            allowed = "0: links roll, tendons do not"
            hint = "Give it to the mechanism."
            raise MechanismError("rolling of a tendon's friction", friction.rolling, allowed, hint)
        object.__setattr__(self, "end", end)
        object.__setattr__(self, "stiffness", stiffness)

    def last_link(self, n_links: int) -> int:
        """Index of the link where the tendon ends, counted from 0."""
        last = self.end + n_links if self.end < 0 else self.end
        if not 1 <= last < n_links:
            raise MechanismError("tendon end", self.end, f"a moving link, 1 to {n_links - 1} or -1 to {1 - n_links}")
        return last

    def _per_link(self, what: str, n_links: int) -> Sequence[Any]:
        """The entry of `holes` for every link that the tendon passes."""
        passed = self.last_link(n_links) + 1
        if len(self.holes) == 1:
            return tuple(self.holes) * passed
        if len(self.holes) != passed:
            raise MechanismError(what, len(self.holes), f"{passed}, links 0 to {passed - 1}")
        return self.holes


@dataclass(frozen=True)
class Tendon(AnyTendon):
    """A tendon that runs from the base to link `end`.

    Args:
        holes: (parent hole, child hole) of every link from 0 to `end`; the tendon enters a link at its parent side and
            leaves it at its child side. A single pair stands for the same pair on every link.
        end: the link where it is fixed; -1 is the tip.
        stiffness: tension per mm of stretch [N/mm].
        friction: in its holes; None: the mechanism's. Rolling resistance belongs to the mechanism alone.
    Raises:
        MechanismError: a hole that is neither a point nor OnSurface; an end that is not an integer; a stiffness
            that is not positive.
    """

    holes: Sequence[tuple[Hole, Hole]]

    def __post_init__(self) -> None:
        try:
            holes = tuple((_hole(parent), _hole(child)) for parent, child in self.holes)
        except (TypeError, ValueError, OverflowError) as error:
            if isinstance(error, MechanismError):
                raise
            raise MechanismError("tendon holes", self.holes, "(parent hole, child hole) for every link") from None
        if not holes:
            raise MechanismError("tendon holes", self.holes, "at least one (parent hole, child hole)")
        object.__setattr__(self, "holes", holes)
        self._check()

    @classmethod
    def on_surfaces(
        cls, s: float, end: int = -1, stiffness: float = DEFAULT_STIFFNESS, friction: CapstanFriction | None = None
    ) -> Tendon:
        """A tendon through the surface point s of every surface it passes."""
        return cls(((OnSurface(s), OnSurface(s)),), end, stiffness, friction)

    def link_holes(self, n_links: int) -> Sequence[tuple[Hole, Hole]]:
        """(parent hole, child hole) for every link that the tendon passes."""
        return self._per_link("number of tendon hole pairs", n_links)


@dataclass(frozen=True)
class BeadTendon(AnyTendon):
    """A tendon of a spatial hinge chain, from the base to link `end`, straight through every bead.

    Args:
        holes: (x, y) of every link from 0 to `end` in its frame [mm]. A single one stands for the same on every link.
        end: the link where it is fixed; -1 is the tip.
        stiffness: tension per mm of stretch [N/mm].
        friction: in its holes; None: the mechanism's. Rolling resistance belongs to the mechanism alone.
    Raises:
        MechanismError: a hole that is not a point; an end that is not an integer; a stiffness that is not positive.
    """

    holes: Sequence[tuple[float, float]]

    def __post_init__(self) -> None:
        allowed = "at least one finite point (x, y) [mm]"
        holes = as_floats("tendon holes", self.holes, allowed, MechanismError)
        if holes.ndim != 2 or holes.shape[1] != 2 or not len(holes) or not np.all(np.isfinite(holes)):
            raise MechanismError("tendon holes", self.holes, allowed)
        object.__setattr__(self, "holes", tuple((float(x), float(y)) for x, y in holes))
        self._check()

    def link_holes(self, n_links: int) -> Sequence[tuple[float, float]]:
        """The hole of every link that the tendon passes."""
        return self._per_link("number of tendon holes", n_links)


@dataclass(frozen=True)
class SpaceTendon(AnyTendon):
    """A tendon of a chain in space, from the base to link `end`.

    Args:
        holes: (parent hole, child hole) of every link from 0 to `end`, points (x, y, z) in its frame [mm]; the tendon
            enters a link at its parent side and leaves it at its child side. A single pair stands for the same pair on
            every link.
        end: the link where it is fixed; -1 is the tip.
        stiffness: tension per mm of stretch [N/mm].
        friction: in its holes; None: the mechanism's. Rolling resistance belongs to the mechanism alone.
    Raises:
        MechanismError: a hole that is not a point; an end that is not an integer; a stiffness that is not positive.
    """

    holes: Sequence[tuple[Triple, Triple]]

    def __post_init__(self) -> None:
        allowed = "(parent hole, child hole) of every link, finite points (x, y, z) [mm]"
        holes = as_floats("tendon holes", self.holes, allowed, MechanismError)
        if holes.ndim != 3 or holes.shape[1:] != (2, 3) or not len(holes) or not np.all(np.isfinite(holes)):
            raise MechanismError("tendon holes", self.holes, allowed)
        object.__setattr__(self, "holes", tuple(tuple(map(tuple, pair)) for pair in holes.tolist()))
        self._check()

    def link_holes(self, n_links: int) -> Sequence[tuple[Triple, Triple]]:
        """The (parent hole, child hole) of every link that the tendon passes."""
        return self._per_link("number of tendon hole pairs", n_links)


def _hole(hole: Hole) -> Hole:
    if isinstance(hole, OnSurface):
        as_number("hole on the surface at s", hole.s, allowed="a finite arc length [mm]", error=MechanismError)
        return hole
    x, y = hole
    allowed = "a finite point (x, y) [mm]"
    return (
        as_number("tendon hole", x, allowed=allowed, error=MechanismError),
        as_number("tendon hole", y, allowed=allowed, error=MechanismError),
    )
