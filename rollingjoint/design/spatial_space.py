"""Design spaces of chains in space: vectors in a box to tubes of rolling joints, differentiable, many at a time."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import torch
from numpy.typing import ArrayLike
from torch import Tensor

from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.checks import as_boolean, as_integer, as_number, as_range
from rollingjoint.design.box import Array, DesignBox, NumberGroup, Range
from rollingjoint.design.curve import Curve, curve
from rollingjoint.design.faults import spatial_faults
from rollingjoint.differentiable import DifferentiableSpatialChain
from rollingjoint.differentiable.spatial_statics import gap_heights
from rollingjoint.errors import ConfigError

SPATIAL_MARGINS = ("rolling", "radius", "gaps", "thickness", "tube")
"""Margins of a tube, in the order of `SpatialDesignSpace.margins`."""

_FLATTEST = 0.003  # 1/mm: smallest sum of the convexities of two surfaces that roll on each other
_ROUND = 0.2  # 1/mm, convexity of the reference
_SAMPLES = 13  # contacts from end to end at which gaps are measured
_RANGES = {  # name: smallest, largest, unit
    "convexity": (-2.0, 2.0, "1/mm"),
    "azimuth": (-math.pi, math.pi, "rad"),
    "height": (0.1, 1000.0, "mm"),
    "reach": (0.05, 1000.0, "mm"),
    "half_width": (0.05, 1000.0, "mm"),
    "hole_radius": (0.05, 1000.0, "mm"),
    "hole_depth": (0.0, 1000.0, "mm"),
    "joint_stiffness": (0.0, 1e9, "N·mm/rad"),
}
_NUMBERS = {
    "stiffness": (1e-6, 1e6, "N/mm"),
    "smallest_radius": (0.01, 1000.0, "mm"),
    "wall": (0.01, 1000.0, "mm"),
    "tube_radius": (0.1, 1000.0, "mm"),
}


@dataclass(frozen=True)
class SpatialDesignSpace(DesignBox):
    """Tubes of links that roll on each other about pitch and yaw axes in turn, as vectors in the box [-1, 1]^d.

    A range (low, high) with low == high is a constant and adds no dimension. In the vector, -1 is low and 1 is high.
    Coordinates beyond the box count as its border. Surfaces are even: they are symmetric to the axis of the tube. The
    preset `pitch_yaw` is a point of the default space.

    Args:
        n_joints: number of joints.
        ends: numbers of joints that the rings of tendons cross; none: one ring, to the tip. Every ring has four
            tendons, and is turned by 45° from the ring before it.
        knots: curvature values of a surface, at equal distances from end to end, on a cubic spline; odd.
        convexity: of the knots [1/mm]: a child surface has curvature -value, a parent surface +value.
        azimuth: turn of every joint's plane from pitch (joints 0, 2, ...) or yaw (joints 1, 3, ...) [rad].
        height: of a link, from apex to apex [mm].
        reach: surfaces run from s = -reach to reach [mm].
        half_width: of the contact lines [mm].
        hole_radius: distance of the holes from the axis of the tube [mm].
        hole_depth: of the holes below the apex of their surface [mm].
        joint_stiffness: of the torsion springs of the joints [N·mm/rad].
        alike: all joints have the same surfaces; else each has its own. The plane of every joint is always its own.
        stiffness: of the tendons [N/mm].
        smallest_radius: smallest radius of curvature that can be machined [mm].
        wall: least material between a hole and the outside, and between the holes of both ends of a link [mm].
        tube_radius: outer radius [mm].
    Raises:
        ConfigError: a value out of its range.
    """

    n_joints: int = 12
    ends: tuple[int, ...] = ()
    knots: int = 3
    convexity: Range = (0.05, 0.35)
    azimuth: Range = (0.0, 0.0)
    height: Range = (4.0, 7.0)
    reach: Range = (1.25, 1.25)
    half_width: Range = (2.0, 4.0)
    hole_radius: Range = (2.0, 3.5)
    hole_depth: Range = (0.3, 1.5)
    joint_stiffness: Range = (2.0, 2.0)
    alike: bool = True
    stiffness: float = 10.0
    smallest_radius: float = 1.0
    wall: float = 0.5
    tube_radius: float = 4.25

    def __post_init__(self) -> None:
        for name, value in _checked({field.name: getattr(self, field.name) for field in fields(self)}).items():
            object.__setattr__(self, name, value)

    @property
    def margin_names(self) -> tuple[str, ...]:
        """Names of the margins of a design."""
        return SPATIAL_MARGINS

    @property
    def tensors(self) -> type[DifferentiableSpatialChain]:
        """The class of its designs."""
        return DifferentiableSpatialChain

    @property
    def groups(self) -> Mapping[str, NumberGroup]:
        """The numbers of a design, in the order of the vector."""
        return _groups(self)

    def chain(self, x: Tensor) -> DifferentiableSpatialChain:
        """The designs (..., d) as chains that can be differentiated; a row that is not finite is the reference.

        Raises:
            InvalidInput: a wrong length of the last axis.
        """
        x = self._vectors(x)
        tables = self._tables(self._blocks(x.reshape(-1, self.dimensions)))
        return self._chain({name: table.reshape(*x.shape[:-1], *table.shape[1:]) for name, table in tables.items()})

    def mechanism(self, x: ArrayLike) -> SpatialChain:
        """The design (d,) as a chain.

        Raises:
            MechanismError: the design is not valid.
            InvalidInput: a vector outside the box.
        """
        mechanism: SpatialChain = super().mechanism(x)
        return mechanism

    def faults(self, mechanism: SpatialChain) -> list[str]:
        """Faults of a chain, checked without the margins and without torch; empty for one that can be made.

        That surfaces roll and gaps stay open is checked by the chain itself when it is built.
        """
        return spatial_faults(mechanism, self.smallest_radius, self.wall, self.tube_radius)

    def reference(self) -> Array:
        """The vector of plain links, (d,): convexities of 0.2 /mm if that is in range, all else in the middle."""
        low, high = self.convexity
        middle = 0.5 * (self.low + self.high)
        if low < _ROUND < high:
            middle[: self.groups["convexity"].free] = _ROUND
        return self.unit(middle)

    def vector(self, **values: float | Array) -> Array:
        """The vector with these numbers by the names of the ranges, all else as in the reference, (d,).

        Raises:
            InvalidInput: a name without a range that is free, numbers outside it.
        """
        return self._with_values(values)

    @property
    def _curve(self) -> Curve:
        return curve(self.knots, "cubic", True)

    def _convexity(self, blocks: dict[str, Tensor]) -> Tensor:
        """Knot values of every joint, (B, J, 2 for parent and child, f) [1/mm]."""
        values = blocks["convexity"].unflatten(-1, (-1, 2, len(self._curve.places)))
        return values.expand(-1, self.n_joints, -1, -1)

    def _chain(self, tables: dict[str, Tensor]) -> DifferentiableSpatialChain:
        """The chain with these parameters; none of its joints is a hinge."""
        joints = self.n_joints
        return DifferentiableSpatialChain(
            **tables,
            hinges=torch.zeros(joints, dtype=torch.bool),
            hinge_limits=torch.tensor([[-1.0, 1.0]], dtype=torch.float64).expand(joints, 2),
            crossed=torch.tensor(self.ends).repeat_interleave(4),
        )

    def _tables(self, blocks: dict[str, Tensor]) -> dict[str, Tensor]:
        """The parameters of the chain, each with the leading axis."""
        joints, shape = self.n_joints, self._curve
        convexity, count = self._convexity(blocks), len(blocks["azimuth"])
        signs = torch.tensor([1.0, -1.0], dtype=torch.float64)  # of parent and child surfaces
        height, reach = blocks["height"], blocks["reach"]
        powers = reach[..., None] ** -torch.arange(shape.pieces.shape[1])
        pieces = torch.einsum("pkf,bjsf->bjspk", shape.pieces, convexity) * powers[:, :, None, None]
        starts = -0.5 * signs * height[..., None].expand(-1, joints, -1)
        turns = 0.5 * math.pi * (torch.arange(joints, dtype=torch.float64) % 2)

        def each(name: str) -> Tensor:
            return blocks[name].expand(count, joints)

        zeros = torch.zeros(count, joints, dtype=torch.float64)
        return {
            "breaks": (reach[..., None, None] * shape.breaks).expand(count, joints, 2, -1),
            "coefficients": pieces * signs[:, None, None],
            "starts": torch.stack([torch.zeros_like(starts), starts], -1),
            "angles": zeros[..., None].expand(-1, -1, 2),
            "azimuths": each("azimuth") + turns,
            "half_widths": each("half_width"),
            "middles": zeros,
            "hinge_axes": torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64).expand(count, joints, 3),
            "hinge_points": zeros[..., None, None].expand(-1, -1, 2, 3),
            "joint_stiffnesses": each("joint_stiffness"),
            "rest_angles": zeros,
            "holes": self._holes(blocks),
            "stiffnesses": torch.full((count, 4 * len(self.ends)), self.stiffness, dtype=torch.float64),
        }

    def _holes(self, blocks: dict[str, Tensor]) -> Tensor:
        """Holes of every tendon, (B, m, n, 2, 3) [mm]."""
        angles = _ring_angles(len(self.ends))
        circle = torch.stack([angles.cos(), angles.sin()], -1)
        side = blocks["hole_radius"][..., None] * circle  # (B, m, 2)
        signs = torch.tensor([-1.0, 1.0], dtype=torch.float64)
        along = signs * (0.5 * blocks["height"] - blocks["hole_depth"])  # (B, 2)
        count, m = side.shape[:2]
        parts = side[:, :, None].expand(-1, -1, 2, -1), along[:, None, :, None].expand(-1, m, -1, -1)
        return torch.cat(parts, -1)[:, :, None].expand(count, m, self.n_joints + 1, 2, 3)

    def _margins(self, x: Tensor) -> Tensor:
        """Margins of the designs (B, d), (B, 5)."""
        blocks = self._blocks(x)
        convexity, reach = self._convexity(blocks), blocks["reach"][:, 0]
        bounds = convexity @ self._curve.control.T  # enclose the curvature, (B, J, 2, r)
        rolling = reach * (bounds.sum(-2).flatten(1).amin(-1) - _FLATTEST)
        radius = 1.0 - self.smallest_radius * bounds.abs().flatten(1).amax(-1)
        height, depth, holes = (blocks[name][:, 0] for name in ("height", "hole_depth", "hole_radius"))
        corner = (reach.square() + blocks["half_width"][:, 0].square()).sqrt()
        outermost = torch.maximum(holes + self.wall, corner)
        rolls = rolling.detach() > 0.0
        heights = torch.where(rolls, self._lowest_gap(blocks, rolls) / height, rolling)
        margins = [
            rolling,
            radius,
            heights,
            (height - 2.0 * depth - self.wall) / height,
            1.0 - outermost / self.tube_radius,
        ]
        return torch.stack(margins, -1)

    def _lowest_gap(self, blocks: dict[str, Tensor], rolls: Tensor) -> Tensor:
        """Lowest height of a hole over its partner, over gaps and contacts, (B,) [mm]; only where designs roll."""
        geometry = self._chain(self._tables(blocks)).where(rolls)[:, None].geometry()
        first, last = geometry.limits
        fractions = torch.linspace(0.0, 1.0, _SAMPLES, dtype=torch.float64)[:, None]
        return gap_heights(geometry, first + (last - first) * fractions).amin(-1)


@functools.lru_cache
def _groups(space: SpatialDesignSpace) -> dict[str, NumberGroup]:
    """The numbers of a design, in the order of the vector."""
    joints = range(space.n_joints)
    owners = [""] if space.alike else [f"joint {i} " for i in joints]
    reach = space.reach[0] if space.reach[0] == space.reach[1] else None
    places = [f"s = {p:g} reaches" if reach is None else f"s = {p * reach:g} mm" for p in space._curve.places.tolist()]
    knots = tuple(f"{o}{side} convexity at {p} [1/mm]" for o in owners for side in ("parent", "child") for p in places)
    single = {
        name: NumberGroup((f"{name.replace('_', ' ')} [{unit}]",), getattr(space, name))
        for name, (*_, unit) in _RANGES.items()
    }
    azimuths = NumberGroup(tuple(f"joint {i} azimuth [rad]" for i in joints), space.azimuth)
    return single | {"convexity": NumberGroup(knots, space.convexity), "azimuth": azimuths}


def _ring_angles(rings: int) -> Tensor:
    """Angles of the tendons of all rings about the axis, (4 rings,) [rad]."""
    ring = 0.5 * math.pi * torch.arange(4, dtype=torch.float64)
    return torch.cat([ring + 0.25 * math.pi * k for k in range(rings)])


def _checked(settings: dict[str, Any]) -> dict[str, Any]:
    """The fields of a design space, ranges as pairs of floats; ConfigError for a value that cannot be used."""
    values = dict(settings)
    joints = as_integer("n_joints", settings["n_joints"], 1, 1000, error=ConfigError)
    allowed = f"one or more increasing numbers of joints, the last one {joints}"
    ends = settings["ends"]
    if not isinstance(ends, list | tuple):
        raise ConfigError("ends", ends, allowed)
    ends = ends or (joints,)
    ends = tuple(as_integer("ends", end, 1, joints, allowed=allowed, error=ConfigError) for end in ends)
    if list(ends) != sorted(set(ends)) or ends[-1] != joints:
        raise ConfigError("ends", ends, allowed)
    knots = as_integer("knots", settings["knots"], 3, 201, error=ConfigError)
    if knots % 2 == 0:
        raise ConfigError("knots", knots, "an odd number", f"Take {knots + 1}: one knot lies at s = 0.")
    as_boolean("alike", settings["alike"], ConfigError)
    for name, (smallest, largest, unit) in _RANGES.items():
        values[name] = as_range(name, settings[name], smallest, largest, unit=unit, error=ConfigError)
    for name, (smallest, largest, unit) in _NUMBERS.items():
        allowed = f"a number from {smallest:g} to {largest:g} {unit}"
        values[name] = as_number(name, settings[name], smallest, largest, allowed=allowed, error=ConfigError)
    ranges = [values[name] for name in _RANGES]
    if all(low == high for low, high in ranges):
        raise ConfigError("ranges", ranges, "one or more with low < high", "A design space needs a dimension.")
    return values | {"n_joints": joints, "ends": ends, "knots": knots}
