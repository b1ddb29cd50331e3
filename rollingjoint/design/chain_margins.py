"""Validity of designs of any chain as margins: six numbers that are 0 or more for a design that can be made.

Each is the least over samples of every joint, link and hole. docs/design.md explains them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from rollingjoint.chain.joint_table import CROSSING
from rollingjoint.design.margins import CHORD, CLEARANCE
from rollingjoint.differentiable import DifferentiableChain, DifferentiableSpatialChain
from rollingjoint.differentiable.parameters import ChainTensors
from rollingjoint.differentiable.spatial_statics import gap_heights
from rollingjoint.differentiable.surface import Surfaces, as_complex

CHAIN_MARGINS = ("rolling", "clearance", "radius", "gaps", "thickness", "holes")
"""Margins of a design of a `MechanismSpace`, in order."""

_BLOCK = 128  # designs whose samples are held at a time
_CELLS = 32  # over the range of a joint
_CONTACT_STEP, _FAR_CONTACT_STEP, _FAR_STEP = 4, 8, 2  # cells
_NEAREST = 1.5 / _CELLS  # of the range: nearer points are not compared
_JOINT_AXES = ("limits", -3), ("borders", -3), ("pieces", -4)  # of the tables of surfaces
_IN_PIECE = 33  # samples of a piece of the curvature
_BESIDE = 1e-9  # of a piece: how far before its end it is sampled
_BETWEEN = 1.1 / 8.0  # of the second differences: what a cubic may differ between its samples


class OwnLimits(NamedTuple):
    """What a mechanism has itself, infinite where it has no such part.

    Fields: least and mean relative curvature of joints [1/mm], least radius of surfaces that roll, least wall, largest
    distance of a hole and of a corner of a contact from the axis, in space [mm].
    """

    curvature: float
    mean_curvature: float
    radius: float
    wall: float
    hole_radius: float
    corner: float


class Kept(NamedTuple):
    """Limits of designs: smallest radius, least wall [mm], least relative curvature [1/mm], radius of the tube [mm]."""

    smallest_radius: float
    wall: float
    least_curvature: float
    tube_radius: float


@dataclass(frozen=True, eq=False)
class Sampling:
    """Where designs of one mechanism are sampled: changes leave the arc lengths of its surfaces as they are.

    Attributes:
        joints: rolling joints that differ, (D,).
        grid: arc lengths of their contacts at equal distances, (S, D) [mm].
        pieces: arc lengths within the pieces that both their surfaces share, (P, 33, D) [mm].
        contacts: of all joints, for gaps, (C, J) [mm].
        links: in the plane, links that differ, (L,).
        outlines: arc lengths of their surfaces, (G, L, 2) [mm].
        height: mean height of a link, which normalises [mm].
    """

    joints: Tensor
    grid: Tensor
    pieces: Tensor
    contacts: Tensor
    links: Tensor
    outlines: Tensor
    height: float

    @classmethod
    def of(cls, base: ChainTensors, distinct: Sequence[int], links: Sequence[int]) -> Sampling:
        """Samples of a chain; `distinct`, `links`: joints, and links in the plane, which stand for equal ones."""
        with torch.no_grad():
            geometry = base.geometry()
            low, high = (end.numpy() for end in geometry.limits)
            cells = np.linspace(0.0, 1.0, _CELLS + 1)[:, None]
            begins = geometry.joints.pieces[..., 0].numpy()  # of the pieces of both surfaces, (J, 2, p)
            borders = [np.unique([*begins[j].ravel(), high[j]]) for j in distinct]
            borders = [row[(row >= low[j]) & (row <= high[j])] for j, row in zip(distinct, borders, strict=True)]
            most = max((len(row) for row in borders), default=1)
            table = np.array([np.pad(row, (0, most - len(row)), "edge") for row in borders]).reshape(-1, most).T
            within = np.linspace(0.0, 1.0 - _BESIDE, _IN_PIECE)[:, None]
            pieces = table[:-1, None] + np.diff(table, axis=0)[:, None] * within
            grid = (low + (high - low) * cells)[:, list(distinct)]
            contacts = low + (high - low) * cells[::_CONTACT_STEP]
            outlines = torch.empty(0, 0, 2, dtype=torch.float64)
            if isinstance(base, DifferentiableChain):
                ends = base.surfaces().limits.numpy()[list(links)]
                outlines = torch.as_tensor(ends[..., 0] + (ends[..., 1] - ends[..., 0]) * cells[::_FAR_STEP, :, None])
            heights = _heights(base)
        joints, others = (torch.tensor(list(places), dtype=torch.int64) for places in (distinct, links))
        height = float(heights.mean()) if heights.numel() else 1.0
        return cls(
            joints, torch.as_tensor(grid), torch.as_tensor(pieces), torch.as_tensor(contacts), others, outlines, height
        )

    def own_limits(self, base: ChainTensors) -> OwnLimits:
        """What the mechanism has itself."""
        with torch.no_grad():
            chain = base[None]
            curvature = mean = radius = math.inf
            if len(self.joints):
                relative, sharpest = self._curvatures(chain)
                curvature, radius = float(relative), 1.0 / max(float(sharpest), 1e-9)
                u = self._places(chain).curvature
                mean = float((u[..., 1] - u[..., 0]).mean())
            walls = self._thickness(chain, radius), self._edge(chain)
            holes = corner = 0.0
            if isinstance(chain, DifferentiableSpatialChain):
                holes, corner = float(_hole_radius(chain)), float(self._corner(chain))
            return OwnLimits(curvature, mean, radius, min(float(wall) for wall in walls), holes, corner)

    def margins(self, chain: ChainTensors, kept: Kept) -> Tensor:
        """Margins of designs with one leading axis, (B, 6), in blocks that fit into the cache."""
        count = int(chain.batch[0])
        blocks = [self._block(chain[first : first + _BLOCK], kept) for first in range(0, count, _BLOCK)]
        return torch.cat(blocks) if blocks else torch.empty(0, len(CHAIN_MARGINS), dtype=torch.float64)

    def _block(self, chain: ChainTensors, kept: Kept) -> Tensor:
        rolling = clearance = radius = torch.ones(chain.batch, dtype=torch.float64)
        if len(self.joints):
            places = self._places(chain)
            relative, sharpest = self._curvatures(chain)
            rolling = self._half_range.mean() * (relative - kept.least_curvature)
            radius = 1.0 - kept.smallest_radius * sharpest
            clearance = torch.minimum(self._near(places, kept.least_curvature), self._far(places))
        rolls = rolling.detach() > 0.0
        gaps = gap_heights(chain.where(rolls)[:, None].geometry(), self.contacts).amin(-1)
        gaps = (gaps + CROSSING) / self.height
        thickness = (self._thickness(chain, kept.smallest_radius) - kept.wall) / self.height
        holes = (self._edge(chain) - kept.wall) / self.height
        if isinstance(chain, DifferentiableSpatialChain):
            outermost = torch.maximum(_hole_radius(chain) + kept.wall, self._corner(chain))
            holes = 1.0 - outermost / kept.tube_radius
        margins = [rolling, clearance, radius, torch.where(rolls, gaps, rolling), thickness, holes]
        finite = [
            torch.where(margin.isinf(), 1.0, margin).nan_to_num(nan=-1.0).expand(chain.batch) for margin in margins
        ]
        return torch.stack(finite, -1)

    @cached_property
    def _half_range(self) -> Tensor:
        """Half the range of every distinct joint, (D,) [mm]."""
        return 0.5 * (self.grid[_CELLS] - self.grid[0])

    def _surfaces(self, chain: ChainTensors) -> Surfaces:
        """The surfaces of the distinct joints, with an axis for places on them."""
        surfaces: Surfaces = chain.surfaces()  # type: ignore[attr-defined]  # every class of chains has them
        if isinstance(chain, DifferentiableChain):
            surfaces = surfaces.joints()
        return _some(surfaces, self.joints).several()

    def _curvatures(self, chain: ChainTensors) -> tuple[Tensor, Tensor]:
        """Bounds of the least relative curvature, and of the largest curvature of a surface, (B,) each [1/mm]."""
        at = self.pieces.flatten(0, 1)
        u = self._surfaces(chain).at(at[..., None].expand(*at.shape, 2)).curvature()
        u = u.expand(*chain.batch, *at.shape, 2).unflatten(1, self.pieces.shape[:2])  # (B, P, 33, D, 2)
        relative, sharpest = u[..., 1] - u[..., 0], u.abs()
        least = relative - _BETWEEN * relative.diff(n=2, dim=2).abs().amax(2, keepdim=True)
        most = sharpest + _BETWEEN * u.diff(n=2, dim=2).abs().amax(2, keepdim=True)
        return least.flatten(1).amin(-1), most.flatten(1).amax(-1)

    def _places(self, chain: ChainTensors) -> _Places:
        """The surfaces of the distinct joints on the grid."""
        place = self._surfaces(chain).at(self.grid[..., None].expand(*self.grid.shape, 2))
        shape = *chain.batch, *self.grid.shape, 2
        return _Places(*(part.expand(shape) for part in (place.point(), place.tangent_angle(), place.curvature())))

    def _near(self, places: _Places, least_curvature: float) -> Tensor:
        """Clearance at equal arc lengths away from the contact, over that near a least curvature, (B,).

        From the child's point to the parent's, along the normal of the mean of both tangents, over half the squared
        distance from the contact; near the contact this is the relative curvature.
        """
        at = slice(0, _CELLS + 1, _CONTACT_STEP)
        turn, shift = places.frames(at)  # (B, C, D)
        below, above = places.point[..., None, :, :, 0], places.point[..., None, :, :, 1]
        moved = turn[..., None, :] * above + shift[..., None, :]  # (B, C, S, D)
        angles = places.angle
        phi = (angles[..., at, :, 0] - angles[..., at, :, 1])[..., None, :]
        mean = 0.5 * (angles[..., None, :, :, 0] + angles[..., None, :, :, 1] + phi)
        normal = torch.complex(-mean.sin(), mean.cos())
        offset = moved - below
        distance = offset.real * normal.real + offset.imag * normal.imag
        along = self.grid - self.grid[at][:, None]  # (C, S, D)
        apart = along.abs() > _NEAREST * 2.0 * self._half_range
        curvature = 2.0 * distance / torch.where(apart, along, 1.0).square()
        clear = self._half_range * (curvature - CLEARANCE * least_curvature)
        return torch.where(apart, clear, torch.inf).flatten(1).amin(-1)

    def _far(self, places: _Places) -> Tensor:
        """Squared distance of points at two arc lengths over that along the surfaces, less the least, (B,)."""
        at, points = slice(0, _CELLS + 1, _FAR_CONTACT_STEP), slice(0, _CELLS + 1, _FAR_STEP)
        turn, shift = places.frames(at)
        below, above = places.point[..., points, :, 0], places.point[..., points, :, 1]  # (B, P, D)
        moved = turn[..., None, :] * above[..., None, :, :] + shift[..., None, :]  # (B, C, P, D)
        offset = moved[..., None, :] - below[..., None, None, :, :]  # (B, C, P, P, D)
        square = offset.real.square() + offset.imag.square()
        s = self.grid[points]
        along = (s[:, None] - s).square()  # (P, P, D)
        missed = 0.5 * (s[1] - s[0]).square()  # curves that cross have samples nearer than that
        apart = along > 0.0
        ratio = (square - missed) / torch.where(apart, along, 1.0) - CHORD**2
        return torch.where(apart, ratio, torch.inf).flatten(1).amin(-1)

    def _thickness(self, chain: ChainTensors, smallest_radius: float) -> Tensor:
        """Least material between both ends of a link, (B,) [mm]: surfaces in the plane; apexes and holes in space."""
        if isinstance(chain, DifferentiableChain):
            place = _some(chain.surfaces(), self.links).several().at(self.outlines)
            points, angles = (
                part.expand(*chain.batch, *self.outlines.shape) for part in (place.point(), place.tangent_angle())
            )
            step = (self.outlines[1] - self.outlines[0]).amax(-1)  # (L,)
            missed = step.square() / 8.0 * 3.0 / smallest_radius
            offset = points[..., :, None, :, 1] - points[..., None, :, :, 0]  # from the parent's points to the child's
            distance, nearest = offset.abs().min(-2)  # (B, G, L)
            at, tangent = offset.gather(-2, nearest[..., None, :])[..., 0, :], angles[..., 0].gather(-2, nearest)
            below = at.imag * tangent.cos() < at.real * tangent.sin()  # surfaces that cross
            inside = (nearest > 0) & (nearest < len(self.outlines) - 1)
            return (torch.where(below & inside, -distance, distance) - missed).flatten(1).amin(-1)
        links = torch.arange(chain.n_links)
        through = chain.holes[..., 1, 2] - chain.holes[..., 0, 2]  # (B, m, n)
        inner = (links > 0) & (links < chain.crossed[:, None])
        channels = torch.where(inner, through, torch.inf).expand(*chain.batch, *inner.shape).flatten(1).amin(-1)
        heights = _heights(chain)
        return torch.minimum(channels, heights.amin(-1)) if heights.shape[-1] else channels

    def _edge(self, chain: ChainTensors) -> Tensor:
        """Least distance of a hole on a surface from its ends, (B,) [mm]; infinite without one."""
        if not isinstance(chain, DifferentiableChain):
            return torch.full(chain.batch, torch.inf, dtype=torch.float64)
        passed = torch.arange(chain.n_links) <= chain.crossed[:, None]
        bored = chain.on_surface & passed[..., None]
        first, last = chain.breaks[..., None, :, :, 0], chain.breaks[..., None, :, :, -1]
        edge = torch.minimum(chain.hole_arcs - first, last - chain.hole_arcs)
        return torch.where(bored, edge, torch.inf).expand(*chain.batch, *bored.shape).flatten(1).amin(-1)

    def _corner(self, chain: DifferentiableSpatialChain) -> Tensor:
        """Largest distance of a corner of a contact from the axis, (B,) [mm]."""
        ends = torch.maximum(self.contacts[0].abs(), self.contacts[-1].abs())
        sides = chain.half_widths.abs() + chain.middles.abs()
        corner = torch.where(chain.hinges, 0.0, (ends.square() + sides.square()).sqrt())
        return corner.expand(*chain.batch, len(ends)).amax(-1)


class _Places(NamedTuple):
    """Surfaces of joints, (child, parent), on a grid: complex points, tangent angles, curvatures, (B, S, D, 2)."""

    point: Tensor
    angle: Tensor
    curvature: Tensor

    def frames(self, at: slice) -> tuple[Tensor, Tensor]:
        """Turn and place of the link above for contacts at some of the grid, complex (B, C, D) each."""
        phi = self.angle[..., at, :, 0] - self.angle[..., at, :, 1]
        turn = torch.complex(phi.cos(), phi.sin())
        return turn, self.point[..., at, :, 0] - turn * self.point[..., at, :, 1]


def _some(surfaces: Surfaces, places: Tensor) -> Surfaces:
    """The surfaces (..., J, 2) of some of the joints or links."""
    tables = {name: getattr(surfaces, name).index_select(axis, places) for name, axis in _JOINT_AXES}
    return replace(surfaces, **tables)


def _heights(chain: ChainTensors) -> Tensor:
    """Heights of the links between their surfaces or hinges, (..., links) [mm]; in space those of inner links."""
    if isinstance(chain, DifferentiableChain):
        return as_complex(chain.starts[..., 1, :] - chain.starts[..., 0, :]).abs()
    assert isinstance(chain, DifferentiableSpatialChain)
    ends = torch.where(chain.hinges[:, None], chain.hinge_points[..., 2], chain.starts[..., 1])  # (..., J, 2)
    if ends.shape[-2] == 1:
        return (ends[..., 1] - ends[..., 0]).abs()
    return ends[..., 1:, 1] - ends[..., :-1, 0]


def _hole_radius(chain: DifferentiableSpatialChain) -> Tensor:
    """Largest distance of a hole from the axis, (B,) [mm]."""
    passed = torch.arange(chain.n_links) <= chain.crossed[:, None]
    radii = torch.where(passed[..., None], chain.holes[..., :2].norm(dim=-1), 0.0)
    return radii.expand(*chain.batch, *radii.shape[-3:]).flatten(1).amax(-1)
