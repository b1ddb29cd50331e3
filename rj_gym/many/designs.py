"""Mechanisms by number, and their description in observations."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.task import Entry
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.design import DesignSpace, space_of_settings
from rollingjoint.errors import ConfigError

Array = NDArray[np.float64]

MOST_LINKS = 16
"""Links of a mechanism at most: up to there chains are solved several at a time."""

CONVEXITY = 0.1  # 1/mm: unit of relative curvatures in observations
PLACE = 20.0  # mm: unit of places of holes
LENGTH = 100.0  # mm: unit of lengths
_SHARES = (-0.5, 0.0, 0.5)  # of the half width: where relative curvatures are described
_BOUND = 5.0


@dataclass(frozen=True)
class DrawnDesigns:
    """The designs of a space with any number of links.

    Args:
        space: with any number of links. links: fewest and most.
    """

    space: DesignSpace
    links: tuple[int, int]

    @classmethod
    def of(cls, settings: Mapping[str, Any], links: tuple[int, int]) -> DrawnDesigns:
        """From the plain settings of the space."""
        return cls(_space(settings), links)

    def reference(self, n_links: int) -> RollingChain:
        """The plain chain of the space with this number of links."""
        return _reference(replace(self.space, n_links=n_links))

    def __getitem__(self, number: int) -> DrawnDesign:
        """The design with this number, the same object every time."""
        return _design(self, number)


@dataclass(frozen=True, eq=False)
class DrawnDesign:
    """A mechanism, its number, or -1 if it has none, and what observations tell of it."""

    number: int
    mechanism: RollingChain

    @functools.cached_property
    def n_links(self) -> int:
        """Number of links, the base included."""
        return self.mechanism.n_links

    @functools.cached_property
    def described(self) -> dict[str, float]:
        """The entries of `description_entries` that it fills, in their units; the others are 0."""
        chain, values = self.mechanism, {"length": self.mechanism.length / LENGTH}
        for k in range(1, chain.n_links):
            below, link = chain.links[k - 1], chain.links[k]
            values |= {f"link {k} is there": 1.0, f"link {k} height": link.height / chain.length}
            low, high = chain.joint_limits[k - 1]
            for share, side in zip(_SHARES, ("left", "middle", "right"), strict=True):
                s = 0.5 * (low + high) + share * (high - low) / 2.0
                relative = float(link.parent.curvature(s) - below.child.curvature(s))
                values[f"joint {k} {side} convexity"] = relative / CONVEXITY
            for j, points in enumerate(chain.hole_points):
                if len(points) > k:
                    values[f"link {k} hole {j}"] = points[k, 0, 0] / PLACE
        return values


def description_entries(most_links: int, n_tendons: int) -> list[Entry]:
    """The entries that describe the design of an episode, link by link up to the most links; 0 for absent links."""
    entries = [Entry("length", f"{LENGTH:g} mm", 0.0, 2.0 * MOST_LINKS)]
    for k in range(1, most_links):
        entries.append(Entry(f"link {k} is there", "1 if so, else 0", 0.0, 1.0))
        entries.append(Entry(f"link {k} height", "L", 0.0, 1.0))
        for side in ("left", "middle", "right"):
            entries.append(Entry(f"joint {k} {side} convexity", f"{CONVEXITY:g} /mm", -_BOUND, _BOUND))
        entries += [Entry(f"link {k} hole {j}", f"{PLACE:g} mm", -_BOUND, _BOUND) for j in range(n_tendons)]
    return entries


def plain_space(space: object) -> dict[str, Any]:
    """The settings of a space that differ from DesignSpace's, plain values; raises ConfigError for other spaces."""
    if isinstance(space, Mapping):
        if "n_links" in space:
            raise ConfigError("mechanisms.space.n_links", space["n_links"], "none", "Set mechanisms.links.")
        space = space_of_settings(space, DesignSpace())
    if not isinstance(space, DesignSpace):
        allowed = "fields of a DesignSpace, or a DesignSpace: chains in the plane with two tendons"
        raise ConfigError("mechanisms.space", space, allowed)
    values = {entry.name: (getattr(space, entry.name), entry.default) for entry in fields(space)}
    changed = {name: value for name, (value, default) in values.items() if value != default and name != "n_links"}
    return {name: list(value) if isinstance(value, tuple) else value for name, value in changed.items()}


def _space(settings: Mapping[str, Any]) -> DesignSpace:
    space = space_of_settings(settings, DesignSpace())
    assert isinstance(space, DesignSpace)
    return space


@functools.lru_cache(maxsize=64)
def _reference(space: DesignSpace) -> RollingChain:
    reference: Any = space.reference()
    return space.chain(reference).mechanism()


@functools.lru_cache(maxsize=8192)
def _design(designs: DrawnDesigns, number: int) -> DrawnDesign:
    generator, (fewest, most) = np.random.default_rng(number), designs.links
    space = replace(designs.space, n_links=int(generator.integers(fewest, most + 1)))
    vector: Any = space.sample(1, generator)[0]
    chain = space.chain(vector).mechanism()
    return DrawnDesign(number, chain.replace(name=f"design {number}, {chain.n_links} links"))
