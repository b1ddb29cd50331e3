"""Mechanisms as tensors, for derivatives of equilibria by their parameters."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from rollingjoint.chain.rolling import Link, RollingChain, planar
from rollingjoint.chain.tendon import Hole, OnSurface, Tendon
from rollingjoint.differentiable.friction import DifferentiableFriction
from rollingjoint.differentiable.geometry import Geometry, Routes
from rollingjoint.differentiable.loads import Loads
from rollingjoint.differentiable.looking import seen
from rollingjoint.differentiable.parameters import (
    Array,
    Axes,
    ChainTensors,
    drawable,
    largest_table,
    rolling,
    surface_of,
    tables_of,
)
from rollingjoint.differentiable.surface import Surfaces, as_complex
from rollingjoint.friction import CapstanFriction
from rollingjoint.load import Load, load_table

PARAMETERS: dict[str, Axes] = {  # 2 for (parent, child)
    "breaks": ("n", 2, "p + 1"),
    "coefficients": ("n", 2, "p", "k"),
    "starts": ("n", 2, 2),
    "angles": ("n", 2),
    "holes": ("m", "n", 2, 2),
    "hole_arcs": ("m", "n", 2),
    "stiffnesses": ("m",),
}
_OF_SURFACES = ("breaks", "coefficients", "starts", "angles")
_SIDES = (slice(None, -1), 1), (slice(1, None), 0)  # links and sides of the surfaces below and above all joints


@dataclass(frozen=True, eq=False)
class DifferentiableChain(ChainTensors):
    """Mechanisms with equal numbers of links, tendons and crossed joints, as tensors of double precision.

    Every field may have leading axes; together they broadcast to `batch`. Links count from the base, surfaces are
    (parent, child). Padding (pieces of zero length at the end, numbers of a hole of the other kind) has no
    effect.

    Args:
        breaks: borders of the pieces of every curvature, (..., n, 2, p + 1) [mm].
        coefficients: ascending powers of the arc length from the beginning of the piece, (..., n, 2, p, k) [1/mm, ...].
        starts: point of every surface at s = 0, (..., n, 2, 2) [mm].
        angles: tangent angle of every surface at s = 0, (..., n, 2) [rad].
        holes: parent and child hole of every tendon in every link, (..., m, n, 2, 2) [mm].
        hole_arcs: arc length of the holes that lie on a surface, (..., m, n, 2) [mm].
        stiffnesses: of the tendons, (..., m) [N/mm].
        on_surface: True for holes that lie on a surface, (m, n, 2).
        crossed: number of joints that each tendon crosses, (m,).
        springs: loads that belong to every mechanism, constant.
        friction: of the tendons.
    Raises:
        InvalidInput: shapes that disagree.
    """

    parameters: ClassVar[dict[str, Axes]] = PARAMETERS
    structure: ClassVar[tuple[str, ...]] = ("on_surface", "crossed")
    loads: ClassVar[type[Loads]] = Loads

    breaks: Tensor
    coefficients: Tensor
    starts: Tensor
    angles: Tensor
    holes: Tensor
    hole_arcs: Tensor
    stiffnesses: Tensor
    on_surface: Tensor
    crossed: Tensor
    springs: tuple[Load, ...] = ()
    friction: DifferentiableFriction | None = None

    @classmethod
    def _checked(cls, mechanism: object) -> RollingChain:
        return planar(mechanism, "A SpatialChain: see DifferentiableSpatialChain.")

    @classmethod
    def _rows(cls, chains: Sequence[RollingChain]) -> list[dict[str, Array]]:
        pairs = [[(link.parent, link.child) for link in chain.links] for chain in chains]
        size = largest_table([pair for surfaces in pairs for pair in surfaces])
        return [tables_of(surfaces, *size) | _routes(chain) for surfaces, chain in zip(pairs, chains, strict=True)]

    def _fill_plain(self, plain: dict[str, Tensor]) -> None:
        plain["coefficients"][..., 1, :, 0].fill_(-0.05)
        plain["starts"][..., 0, 1].fill_(-10.0)
        plain["starts"][..., 1, 1].fill_(10.0)

    def geometry(self) -> Geometry:
        """All that does not depend on the pose, with derivatives by the parameters."""
        surfaces = self.surfaces()
        holes = self._placed_holes(surfaces)
        links = torch.arange(self.n_links, device=self.device)
        passed = (links <= self.crossed[:, None]).to(torch.float64)
        through = holes[..., 1] - holes[..., 0]
        channels = (through.abs() * passed).sum(-1)
        crosses = (links[:-1] < self.crossed[:, None]).to(torch.float64)
        drilled = (passed > 0) & (through.detach().abs() > 0)
        safe = torch.where(drilled, through, 1j)
        routes = Routes(holes[..., :-1, 1], holes[..., 1:, 0], crosses, channels, safe / safe.abs())
        return Geometry(surfaces.joints(), routes)

    def _placed_holes(self, surfaces: Surfaces) -> Tensor:
        """Every hole in its link's frame, complex (..., m, n, 2) [mm]."""
        points = as_complex(self.holes)
        if not seen(self.on_surface.any(), True):
            return points
        arcs = torch.where(self.on_surface, self.hole_arcs, 0.0)
        return torch.where(self.on_surface, surfaces.several().at(arcs).point(), points)

    def surfaces(self) -> Surfaces:
        """Every surface, (..., n, 2); where one link was expanded to n, they are computed once."""
        tables = [(getattr(self, name), len(axes)) for name, axes in PARAMETERS.items() if name in _OF_SURFACES]
        if any(tensor.stride(tensor.ndim - axes) for tensor, axes in tables):
            return Surfaces.of(*(tensor for tensor, _ in tables))
        return Surfaces.of(*(tensor.narrow(tensor.ndim - axes, 0, 1) for tensor, axes in tables)).repeated(self.n_links)

    def valid(self) -> Tensor:
        """Whether links can roll on each other, (batch): a relative curvature below 0 at 9 places of every piece.

        False also for numbers that are not finite, beyond 1e12, out of order, or no surface.
        """
        with torch.no_grad():
            good = self.finite()
            design = self.where(good)
            tables = design.breaks, design.coefficients
            below, above = (
                (tables[0][..., links, side, :], tables[1][..., links, side, :, :]) for links, side in _SIDES
            )
            return good & rolling(below, above, lambda: design.surfaces().joints())

    def finite(self) -> Tensor:
        """Whether the numbers are finite, in range and in order, (batch): necessary for a mechanism."""
        good = self._finite() & drawable(self.breaks, self.coefficients).flatten(-2).all(-1)
        first, last = self.breaks[..., None, :, :, 0], self.breaks[..., None, :, :, -1]
        drilled = ~self.on_surface | (self.hole_arcs >= first) & (self.hole_arcs <= last)
        return good & drilled.flatten(-3).all(-1)

    def load_table(self, loads: Sequence[Load]) -> Array:
        """The load table of external loads, (rows, columns); InvalidInput for loads that it cannot have."""
        return load_table(loads, self.n_links)

    def mechanism(self, place: int = 0) -> RollingChain:
        """One design as a mechanism, by its place in the flattened batch. The latest ones are cached.

        Raises:
            MechanismError: it cannot be built.
        """
        shapes, raw, frictions = self._numbers(place)
        structure = self.on_surface.cpu().numpy().tobytes(), tuple(self.crossed.tolist()), frictions
        return _mechanism(self.springs, *structure, shapes, *raw)


def _routes(chain: RollingChain) -> dict[str, Array]:
    """Parameters of the tendons of one mechanism, and its structure."""
    n, m = chain.n_links, chain.n_tendons
    holes, hole_arcs = np.zeros((m, n, 2, 2)), np.zeros((m, n, 2))
    on_surface = np.zeros((m, n, 2), bool)
    for j, tendon in enumerate(chain.tendons):
        for i, ends in enumerate(tendon.link_holes(n)):
            for side, hole in enumerate(ends):
                if isinstance(hole, OnSurface):
                    on_surface[j, i, side], hole_arcs[j, i, side] = True, hole.s
                else:
                    holes[j, i, side] = hole
    return {
        "holes": holes,
        "hole_arcs": hole_arcs,
        "stiffnesses": chain.stiffnesses.copy(),
        "on_surface": on_surface,
        "crossed": np.array(chain.last_links),
    }


@functools.lru_cache(maxsize=256)
def _mechanism(
    springs: tuple[Load, ...],
    on_surface: bytes,
    crossed: tuple[int, ...],
    frictions: tuple[CapstanFriction | None, ...],
    shapes: tuple[tuple[int, ...], ...],
    *raw: bytes,
) -> RollingChain:
    """The mechanism with these numbers."""
    arrays = (np.frombuffer(row).reshape(shape) for row, shape in zip(raw, shapes, strict=True))
    breaks, coefficients, starts, angles, holes, hole_arcs, stiffnesses = arrays
    on = np.frombuffer(on_surface, bool).reshape(hole_arcs.shape)

    def hole(j: int, i: int, side: int) -> Hole:
        if on[j, i, side]:
            return OnSurface(float(hole_arcs[j, i, side]))
        x, y = holes[j, i, side]
        return float(x), float(y)

    tables = breaks, coefficients, starts, angles
    sides = [[surface_of(*(table[i, side] for table in tables)) for side in (0, 1)] for i in range(len(starts))]
    links = [Link(parent, child) for parent, child in sides]
    tendons = [
        Tendon([(hole(j, i, 0), hole(j, i, 1)) for i in range(end + 1)], end, stiffnesses[j], frictions[j])
        for j, end in enumerate(crossed)
    ]
    return RollingChain(links, tendons, "design", springs)
