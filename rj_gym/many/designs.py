"""Mechanisms by number, and their description in observations."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.task import Entry
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.chain.spatial_joints import RollingContact
from rollingjoint.chain.tendon import OnSurface
from rollingjoint.design import DesignBox, DesignSpace, MechanismSpace, SpatialDesignSpace, space_of_settings
from rollingjoint.errors import ConfigError

Array = NDArray[np.float64]
Mechanism = RollingChain | SpatialChain

MOST_LINKS = 16
"""Links of a mechanism at most: up to there chains are solved several at a time."""

CONVEXITY = 0.1  # 1/mm: unit of relative curvatures in observations
PLACE = {2: 20.0, 3: 5.0}  # mm: unit of places of holes, in the plane and in space
LENGTH = 100.0  # mm: unit of lengths
STIFFNESS = 10.0  # N·mm/rad: unit of torsion springs
_BOUND = 5.0

_KINDS = {2: "plane", 3: "space"}
_SIZES = ("n_links", "n_joints")
_SPACES = {
    2: "fields of a DesignSpace, or with `mechanism` of a MechanismSpace, or one of both: chains in the plane",
    3: "fields of a SpatialDesignSpace, or with `mechanism` of a MechanismSpace, or one of both: chains in space",
}


@dataclass(frozen=True)
class DrawnDesigns:
    """The designs of a space with any number of links.

    Args:
        space: of the most links. links: fewest and most.
    """

    space: DesignBox
    links: tuple[int, int]

    @classmethod
    def of(cls, settings: Mapping[str, Any], dimension: int, links: tuple[int, int]) -> DrawnDesigns:
        """From the plain settings of the space; raises ConfigError for links that its designs cannot have."""
        size = {2: {"n_links": links[1]}, 3: {"n_joints": links[1] - 1}}[dimension]
        around = "mechanism" in settings
        space = space_of_settings(settings if around else {"kind": _KINDS[dimension], **settings, **size})
        if isinstance(space, MechanismSpace) and links != (space.n_links, space.n_links):
            hint = "Designs around a mechanism have as many links as it has."
            raise ConfigError("mechanisms.links", links, f"({space.n_links}, {space.n_links})", hint)
        _sized(space, links[0])  # refuses rings of tendons for which there are too few joints
        return cls(space, links)

    def reference(self, n_links: int) -> Any:
        """The plain chain of the space with this number of links."""
        return _reference(_sized(self.space, n_links))

    def __getitem__(self, number: int) -> DrawnDesign:
        """The design with this number, the same object every time."""
        return _design(self, number)


@dataclass(frozen=True, eq=False)
class DrawnDesign:
    """A mechanism, its number, or -1 if it has none, and what observations tell of it."""

    number: int
    mechanism: Any

    @functools.cached_property
    def n_links(self) -> int:
        """Number of links, the base included."""
        return int(self.mechanism.n_links)

    @functools.cached_property
    def described(self) -> dict[str, float]:
        """The entries of `description_entries` that it fills, in their units; the others are 0."""
        return {entry.name: value for entry, value in _description(self.mechanism)}


def description_entries(longest: Mechanism) -> list[Entry]:
    """The entries that describe the design of an episode, link by link; 0 for links that are not there.

    Args:
        longest: a design with the most links.
    """
    return [entry for entry, _ in _description(longest)]


def _description(chain: Mechanism) -> Iterator[tuple[Entry, float]]:
    """The entries that describe a mechanism, and their values."""
    unit, axes = PLACE[chain.dimension], _hole_axes(chain)
    yield Entry("length", f"{LENGTH:g} mm", 0.0, 2.0 * MOST_LINKS), chain.length / LENGTH
    for k in range(1, chain.n_links):
        yield Entry(f"link {k} is there", "1 if so, else 0", 0.0, 1.0), 1.0
        height = chain.links[k].height if isinstance(chain, RollingChain) else chain.joints[k - 1].spacing()
        yield Entry(f"link {k} height", "L", 0.0, 1.0), height / chain.length
        for side, convexity in zip(("left", "middle", "right"), _convexities(chain, k), strict=True):
            entry = Entry(f"joint {k} {side} convexity", f"{CONVEXITY:g} /mm", -_BOUND, _BOUND)
            yield entry, convexity / CONVEXITY
        if isinstance(chain, SpatialChain):
            joint = chain.joints[k - 1]
            x, y, _ = joint.frame[2].tolist()
            yield Entry(f"joint {k} axis x", "1", -1.0, 1.0), x
            yield Entry(f"joint {k} axis y", "1", -1.0, 1.0), y
            yield Entry(f"joint {k} stiffness", f"{STIFFNESS:g} N mm/rad", 0.0, _BOUND), joint.stiffness / STIFFNESS
        for j, points in enumerate(chain.hole_points):
            for axis, name in enumerate(axes):
                place = float(points[k, 0, axis]) if len(points) > k else 0.0
                yield Entry(f"link {k} hole {j}{name}", f"{unit:g} mm", -_BOUND, _BOUND), place / unit


def _convexities(chain: Mechanism, k: int) -> list[float]:
    """Relative curvatures of the surfaces below link k, at 1/4, 1/2, 3/4 of their range [1/mm]; infinite of a hinge."""
    if isinstance(chain, RollingChain):
        below, above, (low, high) = chain.links[k - 1].child, chain.links[k].parent, chain.joint_limits[k - 1]
    elif isinstance(contact := chain.joints[k - 1], RollingContact):
        below, above, (low, high) = contact.child, contact.parent, contact.limits
    else:
        return [math.inf] * 3
    places = [0.5 * (low + high) + share * (high - low) / 2.0 for share in (-0.5, 0.0, 0.5)]  # of the half width
    return [float(above.curvature(s) - below.curvature(s)) for s in places]


def _hole_axes(chain: Mechanism) -> tuple[str, ...]:
    """Which coordinates of holes describe them, as ends of names: on surfaces x is enough."""
    if isinstance(chain, SpatialChain):
        return (" x", " y", " z")
    holes = (hole for tendon in chain.tendons for pair in tendon.link_holes(chain.n_links) for hole in pair)
    return ("",) if all(isinstance(hole, OnSurface) for hole in holes) else (" x", " y")


def plain_space(space: object, dimension: int) -> dict[str, Any]:
    """The settings of a space that differ from the plainest one's; raises ConfigError for other spaces.

    Args:
        dimension: of the room in which mechanisms move, 2 or 3.
    """
    kept: dict[str, Any] | None = None
    if isinstance(space, Mapping):
        for name in _SIZES:
            if name in space:
                raise ConfigError(f"mechanisms.space.{name}", space[name], "none", "Set mechanisms.links.")
        if "mechanism" in space:
            kept, space = dict(space), space_of_settings(space)
        else:
            ends = space.get("ends")
            joints = {"n_joints": ends[-1]} if isinstance(ends, list | tuple) and ends else {}
            space = space_of_settings({"kind": _KINDS[dimension], **space, **joints})
    if not isinstance(space, DesignBox) or space.dimension != dimension:
        raise ConfigError("mechanisms.space", space, _SPACES[dimension])
    return kept if kept is not None else _changed(space)


def _changed(space: DesignBox) -> dict[str, Any]:
    """The fields of a space that differ from their defaults, without the number of links, as plain values."""
    values = {entry.name: getattr(space, entry.name) for entry in fields(space) if entry.init}  # type: ignore[arg-type]
    defaults = {entry.name: entry.default for entry in fields(space)}  # type: ignore[arg-type]
    if isinstance(space, MechanismSpace):
        values["mechanism"] = values.pop("base")
    elif isinstance(space, SpatialDesignSpace) and space.ends == (space.n_joints,):
        values["ends"] = ()
    changed = {name: value for name, value in values.items() if value != defaults.get(name) and name not in _SIZES}
    return {name: list(value) if isinstance(value, tuple) else value for name, value in changed.items()}


def _sized(space: DesignBox, n_links: int) -> DesignBox:
    """The space with this number of links; rings of tendons end at the same shares of the joints."""
    if isinstance(space, DesignSpace):
        return replace(space, n_links=n_links)
    if isinstance(space, SpatialDesignSpace):
        ends = tuple(round(end * (n_links - 1) / space.n_joints) for end in space.ends)
        return replace(space, n_joints=n_links - 1, ends=ends)
    return space


@functools.lru_cache(maxsize=64)
def _reference(space: DesignBox) -> Any:
    return space.plain.mechanism()


@functools.lru_cache(maxsize=8192)
def _design(designs: DrawnDesigns, number: int) -> DrawnDesign:
    generator, (fewest, most) = np.random.default_rng(number), designs.links
    space = _sized(designs.space, int(generator.integers(fewest, most + 1)))
    vector: Any = space.sample(1, generator)[0]
    chain = space.mechanism(vector) if isinstance(space, MechanismSpace) else space.chain(vector).mechanism()
    return DrawnDesign(number, chain.replace(name=f"design {number}, {chain.n_links} links"))
