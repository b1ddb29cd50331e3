"""Design spaces around one mechanism of any kind: vectors in a box to changes of its dimensions, differentiable."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.hinge import HingeChain
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.checked_yaml import mapping
from rollingjoint.checks import as_boolean, as_choice, as_integer, as_number, as_range
from rollingjoint.design.box import Array, DesignBox, NumberGroup, Range
from rollingjoint.design.chain_margins import CHAIN_MARGINS, Kept, OwnLimits, Sampling
from rollingjoint.design.faults import LEAST_CURVATURE, faults, spatial_faults
from rollingjoint.design.numbering import CHANGES, Numbering
from rollingjoint.design.refined import Profiles, profiles_of, refined
from rollingjoint.differentiable import DifferentiableChain, DifferentiableSpatialChain
from rollingjoint.differentiable.parameters import ChainTensors
from rollingjoint.errors import ConfigError
from rollingjoint.io.mechanism_file import load_mechanism, mechanism_to_dict

_LARGEST = {  # of a change, and its unit
    "convexity": (2.0, "1/mm"),
    "height": (1000.0, "mm"),
    "hole_radius": (1000.0, "mm"),
    "hole_depth": (1000.0, "mm"),
    "azimuth": (math.pi, "rad"),
    "half_width": (1000.0, "mm"),
    "joint_stiffness": (1e9, "N·mm/rad"),
}
_SHARE = 0.25  # of the least curvature or height: the changes by default
_WALL = {2: 2.0, 3: 0.5}  # mm, and at most half of what the mechanism has
_RADIUS = {2: 5.0, 3: 1.0}
_NONE = (0.0, 0.0)
_MOST_LESS = 0.95  # of a half width or a stiffness: how much less it may become
_SMALLEST = 1e-6  # mm, of a limit


@dataclass(frozen=True)
class MechanismSpace(DesignBox):
    """Mechanisms that differ from a given one by changes of its dimensions, as vectors in the box [-1, 1]^d.

    Planar chains, chains in space with rolling joints, hinges or both, and arms, whose designs are chains in space.
    Tendons, where they end, springs, friction and weights are the mechanism's. A range (low, high) with low == high is
    the same change for all designs and adds no dimension. With ranges around 0 the vector of the mechanism itself is
    `reference()`. Coordinates beyond the box count as its border.

    Args:
        base: the mechanism: any chain, the name of a preset or the path of a mechanism file.
        convexity: of surfaces that roll on each other, at knots [1/mm]: a child surface has its curvature less this, a
            parent surface its curvature plus this. By default up to a quarter of the mean relative curvature.
        height: of a link: its surfaces, hinges and holes move along its axis by half of it each [mm]. By default 0;
            without rolling joints up to a quarter of the least height.
        hole_radius: of the holes, outwards from the axis of the link, those on surfaces along them [mm].
        hole_depth: of the holes, into the link [mm]; holes on surfaces stay there.
        azimuth: of the plane of every joint in space, about the axis of the link [rad].
        half_width: of contact lines in space [mm].
        joint_stiffness: of the torsion springs of joints in space [N·mm/rad].
        knots: of the change of a surface's convexity, at equal distances from end to end; odd.
        curve: straight lines or a natural cubic spline through them.
        symmetric: changes are even in s, and the same for holes at both sides.
        alike: what is equal in the mechanism stays equal: surfaces, heights, holes, contact lines and springs.
        smallest_radius: smallest radius of curvature that can be machined [mm]. By default 5 mm in the plane and 1 mm
            in space, or half of the mechanism's where that is less.
        wall: least material between the surfaces of a link, or the holes of both its ends in space, and beside a hole
            [mm]. By default 2 mm in the plane and 0.5 mm in space, or half of the mechanism's.
        least_curvature: least relative curvature of a joint [1/mm]. By default 0.003 /mm, or half of the mechanism's.
        tube_radius: outer radius of a chain in space [mm]. By default what the mechanism and `wall` need, with the
            largest changes of hole_radius and half_width.
    Raises:
        ConfigError: a value out of its range, or limits that the mechanism itself does not keep.
    """

    base: AnyChain = field(compare=False)
    convexity: Range | None = None
    height: Range | None = None
    hole_radius: Range = _NONE
    hole_depth: Range = _NONE
    azimuth: Range = _NONE
    half_width: Range = _NONE
    joint_stiffness: Range = _NONE
    knots: int = 3
    curve: Literal["linear", "cubic"] = "cubic"
    symmetric: bool = False
    alike: bool = True
    smallest_radius: float | None = None
    wall: float | None = None
    least_curvature: float | None = None
    tube_radius: float | None = None
    content: str = field(init=False, repr=False)

    @classmethod
    def of_settings(cls, settings: Mapping[str, Any]) -> MechanismSpace:
        """The space with these fields; ConfigError for a name that is none of them, or a value out of its range."""
        names = [entry.name for entry in dataclasses.fields(cls) if entry.init and entry.name != "base"]
        values = dict(mapping("design space", settings, ["mechanism", *names], ["mechanism"]))
        return cls(values.pop("mechanism"), **values)

    def __post_init__(self) -> None:
        given = self.base
        mechanism = load_mechanism(given) if isinstance(given, str | Path) else given
        if isinstance(mechanism, HingeChain):
            mechanism = SpatialChain.from_arm(mechanism)
        if not isinstance(mechanism, RollingChain | SpatialChain):
            raise ConfigError("mechanism", given, "a mechanism, the name of a preset or the path of a mechanism file")
        self._set(base=mechanism, content=repr(mechanism_to_dict(mechanism)))
        knots = as_integer("knots", self.knots, 3, 201, error=ConfigError)
        if knots % 2 == 0:
            raise ConfigError("knots", knots, "an odd number", f"Take {knots + 1}: one knot lies in the middle.")
        as_choice("curve", self.curve, ("linear", "cubic"), ConfigError)
        for name in ("symmetric", "alike"):
            as_boolean(name, getattr(self, name), ConfigError)
        self._set(knots=knots, **self._ranges())
        self._set(**self._limits())
        if not self.dimensions:
            given_ranges = {name: getattr(self, name) for name in CHANGES}
            raise ConfigError(
                "ranges", given_ranges, "one or more with low < high", "A design space needs a dimension."
            )
        own = self._margins(self._origin[None])[0]
        worst = int(own.argmin())
        if own[worst] < 0.0:
            what = f"margin {self.margin_names[worst]!r} of the mechanism itself"
            hint = "Choose smaller limits, or a larger tube_radius."
            raise ConfigError(what, float(own[worst]), "0 or more", hint)

    def _set(self, **values: Any) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def _ranges(self) -> dict[str, Range]:
        """The ranges of changes, checked, with their defaults."""
        by_curvature, by_height = (
            round(_SHARE * value, 4) if value < math.inf else 0.0
            for value in (self._own.mean_curvature, self._numbering.least_height)
        )
        ranges = {name: getattr(self, name) for name in CHANGES}
        if ranges["convexity"] is None:
            ranges["convexity"] = (-by_curvature, by_curvature) if by_curvature else _NONE
        if ranges["height"] is None:
            ranges["height"] = _NONE if by_curvature else (-by_height, by_height)
        for name, (largest, unit) in _LARGEST.items():
            ranges[name] = as_range(name, ranges[name], -largest, largest, unit=unit, error=ConfigError)
            if ranges[name] != _NONE and not self._numbering.indices[name].size:
                allowed = f"(0, 0): {self.base.title} such as this one has no {name.replace('_', ' ')} to change"
                raise ConfigError(name, ranges[name], allowed)
        for name, least in self._numbering.least_sizes.items():
            if ranges[name][0] < -_MOST_LESS * least:
                allowed = f"changes of {-_MOST_LESS * least:g} or more: the least of the mechanism is {least:g}"
                raise ConfigError(name, ranges[name], allowed)
        return ranges

    def _limits(self) -> dict[str, float]:
        """Radius, wall and tube, checked, with their defaults."""
        dimension = self.base.dimension
        own = self._own
        if own.curvature <= 0.0:
            allowed = "above 0 everywhere, also between samples"
            hint = "Make the child surface more convex there, or narrow the limits."
            raise ConfigError(
                "least relative curvature of a joint of the mechanism [1/mm]", own.curvature, allowed, hint
            )
        defaults = {
            "smallest_radius": min(_RADIUS[dimension], 0.5 * own.radius),
            "wall": max(min(_WALL[dimension], 0.5 * own.wall), _SMALLEST),
            "least_curvature": min(LEAST_CURVATURE, 0.5 * own.curvature),
        }
        limits = {}
        for name, default in defaults.items():
            value = default if getattr(self, name) is None else getattr(self, name)
            unit = "/mm" if name == "least_curvature" else " mm"
            allowed = f"a number from 1e-6 to 1000{unit}"
            limits[name] = as_number(name, value, 1e-6, 1000.0, allowed=allowed, error=ConfigError)
        tube = self.tube_radius
        if tube is None:
            wider = max(self.half_width[1], 0.0)
            tube = max(own.hole_radius + max(self.hole_radius[1], 0.0) + limits["wall"], own.corner + wider, 1e-6)
        allowed = "a number from 1e-6 to 10000 mm"
        limits["tube_radius"] = as_number("tube_radius", tube, 1e-6, 10000.0, allowed=allowed, error=ConfigError)
        return limits

    @property
    def margin_names(self) -> tuple[str, ...]:
        """Names of the margins of a design."""
        return CHAIN_MARGINS

    @property
    def tensors(self) -> type[ChainTensors]:
        """The class of its designs."""
        return type(self._tensors)

    @property
    def n_links(self) -> int:
        """Number of links, the base included."""
        return int(self.base.n_links)

    @cached_property
    def groups(self) -> Mapping[str, NumberGroup]:
        """The changes, in the order of the vector."""
        groups = {}
        for name in CHANGES:
            labels = self._numbering.labels[name]
            if name == "convexity":
                labels = tuple(f"{label} convexity at {place}" for label in labels for place in self._places)
            groups[name] = NumberGroup(tuple(f"{label} [{_LARGEST[name][1]}]" for label in labels), getattr(self, name))
        return groups

    def chain(self, x: Tensor) -> ChainTensors:
        """The designs (..., d) as mechanisms that can be differentiated; a row that is not finite is the reference.

        Raises:
            InvalidInput: a wrong length of the last axis.
        """
        x = self._vectors(x)
        tables = self._tables(x.reshape(-1, self.dimensions))
        return self._chain({name: table.reshape(*x.shape[:-1], *table.shape[1:]) for name, table in tables.items()})

    def mechanism(self, x: ArrayLike) -> Any:
        """The design (d,) as a mechanism, its links with the weights of the mechanism's.

        Raises:
            MechanismError: the design is not valid.
            InvalidInput: a vector outside the box.
        """
        design = super().mechanism(x)
        if not isinstance(self.base, RollingChain) or not any(link.weight for link in self.base.links):
            return design
        pairs = zip(design.links, self.base.links, strict=True)
        weighed = [dataclasses.replace(link, weight=own.weight, centre=own.centre) for link, own in pairs]
        return dataclasses.replace(design, links=weighed)

    def reference(self) -> Array:
        """The vector of the mechanism, (d,): no changes, or the smallest that are in range."""
        return self.unit(np.clip(0.0, self.low, self.high))

    def vector(self, **values: float | Array) -> Array:
        """The vector with these changes by the names of the ranges, all else as in the reference, (d,).

        Raises:
            InvalidInput: a name without a range that is free, numbers outside it.
        """
        return self._with_values(values)

    def faults(self, mechanism: AnyChain) -> list[str]:
        """Faults of a mechanism, checked without the margins and without torch; empty for one that can be made.

        That surfaces roll and gaps stay open is checked by the chain itself when it is built.
        """
        limits = self._kept
        if isinstance(mechanism, RollingChain):
            return faults(mechanism, limits.smallest_radius, limits.wall, limits.least_curvature)
        assert isinstance(mechanism, SpatialChain)
        return spatial_faults(mechanism, limits.smallest_radius, limits.wall, limits.tube_radius)

    def _margins(self, x: Tensor) -> Tensor:
        return self._sampling.margins(self._chain(self._tables(x)), self._kept)

    @property
    def _kept(self) -> Kept:
        """The limits of designs."""
        radius, wall, least, tube = self.smallest_radius, self.wall, self.least_curvature, self.tube_radius
        assert radius is not None and wall is not None and least is not None and tube is not None  # since it is built
        return Kept(radius, wall, least, tube)

    @cached_property
    def _tensors(self) -> ChainTensors:
        """The mechanism, its curvatures in pieces that end at the knots, too."""
        plane = isinstance(self.base, RollingChain)
        kind: type[ChainTensors] = DifferentiableChain if plane else DifferentiableSpatialChain
        base = kind.from_mechanism(self.base)
        breaks, coefficients, _ = self._refined
        links = {"links": tuple(self.base.links)} if isinstance(self.base, SpatialChain) else {}
        return dataclasses.replace(base, breaks=breaks, coefficients=coefficients, **links)  # type: ignore[type-var]  # a dataclass

    @cached_property
    def _origin(self) -> Tensor:
        return torch.as_tensor(self.reference())

    @cached_property
    def _profiles(self) -> Profiles:
        return profiles_of(self.base)

    @cached_property
    def _refined(self) -> tuple[Tensor, Tensor, Tensor]:
        return refined(self._profiles, self.knots, self.curve, self.symmetric)

    @cached_property
    def _numbering(self) -> Numbering:
        return Numbering(self.base, self._tensors, self._profiles, self.alike, self.symmetric)

    @cached_property
    def _sampling(self) -> Sampling:
        return Sampling.of(self._tensors, self._numbering.distinct_joints, self._numbering.distinct_links)

    @cached_property
    def _own(self) -> OwnLimits:
        return self._sampling.own_limits(self._tensors)

    @property
    def _places(self) -> list[str]:
        """Places of the knots, in words."""
        half = self.knots // 2
        shares = np.linspace(-1.0, 1.0, self.knots)[half if self.symmetric else 0 :]
        return ["the middle" if share == 0.0 else f"{share:g} of the half range" for share in shares.tolist()]

    def _change(self, blocks: dict[str, Tensor], name: str) -> Tensor | float:
        """The change of every entry of a table, (B, ...); 0 where there is none."""
        index = self._numbering.indices[name]
        if not index.size or getattr(self, name) == _NONE:
            return 0.0
        values = blocks[name]
        if name == "convexity":
            values = values.unflatten(-1, (-1, len(self._places)))
        values = torch.cat([values, torch.zeros_like(values[:, :1])], 1)
        return values[:, torch.as_tensor(index)]  # -1 is the zero at the end

    def _tables(self, x: Tensor) -> dict[str, Tensor]:
        """The parameters of the designs (B, d), each with the leading axis."""
        blocks, base, count = self._blocks(x), self._tensors, len(x)
        tables = {name: getattr(base, name) for name in base.parameters}
        convexity = self._change(blocks, "convexity")
        if isinstance(convexity, Tensor):
            signs = torch.tensor([1.0, -1.0], dtype=torch.float64)[:, None, None]
            moved = torch.einsum("rspkf,brsf->brspk", self._refined[2], convexity)
            tables["coefficients"] = base.coefficients + signs * moved
        height = self._change(blocks, "height")
        if isinstance(height, Tensor):
            half = 0.5 * torch.stack([-height, height], -1)  # (B, n, 2) of parent and child ends
            of_surfaces = half
            if isinstance(base, DifferentiableSpatialChain):
                of_surfaces = torch.stack([half[:, 1:, 0], half[:, :-1, 1]], -1)
                tables["hinge_points"] = base.hinge_points + _along(of_surfaces, 3)
            tables["starts"] = base.starts + _along(of_surfaces, 2)
            tables["holes"] = base.holes + _along(half, base.holes.shape[-1])[:, None]
        self._move_holes(tables, blocks)
        if isinstance(base, DifferentiableSpatialChain):
            turn = self._change(blocks, "azimuth")
            tables["azimuths"] = base.azimuths + turn
            if isinstance(turn, Tensor):
                tables["hinge_axes"] = _turned_about_z(base.hinge_axes, turn)
            tables["half_widths"] = base.half_widths + self._change(blocks, "half_width")
            tables["joint_stiffnesses"] = base.joint_stiffnesses + self._change(blocks, "joint_stiffness")
        return {
            name: table.expand(count, *table.shape[-len(base.parameters[name]) :]) for name, table in tables.items()
        }

    def _move_holes(self, tables: dict[str, Tensor], blocks: dict[str, Tensor]) -> None:
        """Move the holes outwards and into their links."""
        base = self._tensors
        depth, radius = self._change(blocks, "hole_depth"), self._change(blocks, "hole_radius")
        if isinstance(depth, Tensor):
            signs = torch.tensor([1.0, -1.0], dtype=torch.float64)
            tables["holes"] = tables["holes"] + _along(signs * depth, base.holes.shape[-1])
        if isinstance(radius, Tensor):
            across = base.holes[..., :-1]
            size = across.norm(dim=-1, keepdim=True)
            outwards = torch.where(size > 0.0, across / torch.where(size > 0.0, size, 1.0), 0.0)
            tables["holes"] = tables["holes"] + torch.nn.functional.pad(outwards * radius[..., None], (0, 1))
            if isinstance(base, DifferentiableChain):
                tables["hole_arcs"] = base.hole_arcs + base.hole_arcs.sign() * radius
        moved = tables["holes"] - base.holes
        if moved.ndim > base.holes.ndim:  # ends of tendons move with their holes at the other end of the link
            outer = torch.zeros_like(base.holes, dtype=torch.bool)
            outer[:, 0, 0] = True
            outer[torch.arange(base.n_tendons), base.crossed, 1] = True
            tables["holes"] = base.holes + torch.where(outer, moved.flip(-2), moved)

    def _chain(self, tables: dict[str, Tensor]) -> ChainTensors:
        return dataclasses.replace(self._tensors, **tables)  # type: ignore[type-var]  # a dataclass


def _along(ends: Tensor, size: int) -> Tensor:
    """Vectors of this size with these last entries, (..., size)."""
    return torch.nn.functional.pad(ends[..., None], (size - 1, 0))


def _turned_about_z(axes: Tensor, angle: Tensor) -> Tensor:
    """Vectors (J, 3) turned about z by angles (B, J), (B, J, 3)."""
    cos, sin, (x, y, z) = angle.cos(), angle.sin(), axes.unbind(-1)
    return torch.stack([cos * x - sin * y, sin * x + cos * y, z.expand_as(cos)], -1)
