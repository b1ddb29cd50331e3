"""Design spaces: vectors in a box to mechanisms and back, differentiable, many at a time."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.tendon import DEFAULT_STIFFNESS
from rollingjoint.design.box import Array, DesignBox, NumberGroup, Range
from rollingjoint.design.curve import Curve, curve
from rollingjoint.design.faults import faults
from rollingjoint.design.inverse import compare, read
from rollingjoint.design.margins import MARGINS, margins
from rollingjoint.design.mechanism_space import MechanismSpace
from rollingjoint.design.numbers import Numbers, Structure, structure
from rollingjoint.design.ranges import checked
from rollingjoint.differentiable import DifferentiableChain
from rollingjoint.errors import InvalidInput

_ROUND = 0.05  # 1/mm, convexity of the reference
_ROUNDING = 1e-9


@dataclass(frozen=True)
class DesignSpace(DesignBox):
    """Chains of links with two tendons, left and right from base to tip, as vectors in the box [-1, 1]^d.

    A range (low, high) with low == high is a constant and adds no dimension. In the vector, -1 is low and 1 is high.
    Coordinates beyond the box count as its border. Links and surfaces count from the base, 0. Where links are not
    alike, the surfaces without a partner (parent of the base, child of the tip) mirror the other surface of their link.

    Args:
        n_links: links, the base included.
        knots: curvature values of a surface, at equal distances from end to end; odd.
        curve: straight lines or a natural cubic spline through them.
        convexity: of the knots [1/mm]: a child surface has curvature -value, a parent surface +value.
        angle: tangent angle of a child surface at s = 0; a parent surface has -value; (0, 0) if symmetric [rad].
        height: of a link: its surfaces start at (0, ±height / 2) [mm].
        half_width: surfaces run over s in [-half_width, half_width], one number for the whole chain [mm].
        hole: arc length |s| of the holes, the same on every surface, left and right separate if not symmetric [mm].
        stiffness: of the tendons [N/mm].
        symmetric: curvature even in s, angles 0, holes mirrored.
        alike: all links alike; else each rolling surface and the height of each link are separate.
        smallest_radius: smallest radius of curvature that can be machined [mm].
        wall: minimum material next to a hole and between the surfaces of a link [mm].
    Raises:
        ConfigError: a value out of its range.
    """

    n_links: int = 5
    knots: int = 5
    curve: Literal["linear", "cubic"] = "cubic"
    convexity: Range = (-0.03, 0.08)
    angle: Range = (0.0, 0.0)
    height: Range = (20.0, 20.0)
    half_width: Range = (15.0, 15.0)
    hole: Range = (10.0, 10.0)
    stiffness: float = DEFAULT_STIFFNESS
    symmetric: bool = True
    alike: bool = True
    smallest_radius: float = 5.0
    wall: float = 2.0

    def __post_init__(self) -> None:
        for name, value in checked({field.name: getattr(self, field.name) for field in fields(self)}).items():
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        changed = [
            f"{field.name}={getattr(self, field.name)!r}"
            for field in fields(self)
            if getattr(self, field.name) != field.default
        ]
        return f"DesignSpace({', '.join(changed)})"

    @staticmethod
    def of(mechanism: AnyChain | str | Path, **ranges: Any) -> MechanismSpace:
        """The designs around any mechanism: a chain, the name of a preset or the path of a mechanism file.

        Args:
            mechanism: of any kind.
            ranges: the fields of `MechanismSpace`, which has their meaning and defaults.
        Raises:
            ConfigError: a value out of its range, a name that is none of these fields.
        """
        return MechanismSpace.of_settings({"mechanism": mechanism, **ranges})

    @property
    def margin_names(self) -> tuple[str, ...]:
        """Names of the margins of a design."""
        return MARGINS

    @property
    def tensors(self) -> type[DifferentiableChain]:
        """The class of its designs."""
        return DifferentiableChain

    @property
    def length(self) -> float:
        """Length of a design with links of the middle height [mm]."""
        return self.n_links * 0.5 * sum(self.height)

    @property
    def groups(self) -> Mapping[str, NumberGroup]:
        """The numbers of a design, in the order of the vector."""
        return _parts(self)

    def chain(self, x: Tensor) -> DifferentiableChain:
        """The designs (..., d) as mechanisms that can be differentiated; a row that is not finite is the reference.

        Raises:
            InvalidInput: a wrong length of the last axis.
        """
        x = self._vectors(x)
        numbers = self._numbers(x.reshape(-1, self.dimensions))
        tensors = {name: part.reshape(*x.shape[:-1], *part.shape[1:]) for name, part in self._tables(numbers).items()}
        on_surface = torch.ones(2, self.n_links, 2, dtype=torch.bool)
        holes = torch.zeros(2, self.n_links, 2, 2, dtype=torch.float64)
        return DifferentiableChain(
            **tensors, holes=holes, on_surface=on_surface, crossed=torch.full((2,), self.n_links - 1)
        )

    def _margins(self, x: Tensor) -> Tensor:
        return margins(self._numbers(x), self.smallest_radius, self.wall)

    def mechanism(self, x: ArrayLike) -> RollingChain:
        """The design (d,) as a mechanism.

        Raises:
            MechanismError: the design is not valid.
            InvalidInput: a vector outside the box.
        """
        mechanism: RollingChain = super().mechanism(x)
        return mechanism

    def faults(self, mechanism: RollingChain) -> list[str]:
        """Faults of a mechanism, checked without the margins and without torch; empty for a valid mechanism."""
        return faults(mechanism, self.smallest_radius, self.wall)

    def reference(self) -> Array:
        """The vector of plain links, (d,): convexities of 0.05 /mm if that is in range, all else in the middle."""
        low, high = self.convexity
        middle = 0.5 * (self.low + self.high)
        if low < _ROUND < high:
            middle[: _parts(self)["convexity"].free] = _ROUND
        return self.unit(middle)

    def vector(self, mechanism: RollingChain) -> Array:
        """The vector of a mechanism, (d,): the inverse of `mechanism`.

        Raises:
            InvalidInput: a mechanism that is not in the space, to 1e-9 mm, rad, and of curvatures × half width.
        """
        numbers = read(mechanism, self.n_links, self.alike, self._curve.places.numpy())
        parts = _parts(self)
        for name, part in parts.items():
            low, high = part.range
            outside = (numbers[name] < low - _ROUNDING) | (numbers[name] > high + _ROUNDING)
            if outside.any():
                worst = int(outside.argmax())
                allowed = f"a number in [{low:g}, {high:g}], the range of the space"
                raise InvalidInput(part.labels[min(worst, len(part.labels) - 1)], float(numbers[name][worst]), allowed)
        free = [numbers[name][: part.free] for name, part in parts.items()]
        vector = np.clip(self.unit(np.concatenate(free)), -1.0, 1.0)
        compare(mechanism, self.chain(torch.as_tensor(vector)))
        return vector

    @property
    def _curve(self) -> Curve:
        return curve(self.knots, self.curve, self.symmetric)

    @property
    def _structure(self) -> Structure:
        return structure(self.n_links, self.alike, self.symmetric)

    def _numbers(self, x: Tensor) -> Numbers:
        """The physical numbers of vectors (B, d)."""
        blocks = self._blocks(x)
        surfaces = 2 if self.alike else 2 * (self.n_links - 1)
        return Numbers(
            self._structure,
            self._curve,
            blocks["convexity"].reshape(len(x), surfaces, len(self._curve.places)),
            blocks["angle"],
            blocks["height"],
            blocks["half_width"][:, 0],
            blocks["hole"].expand(-1, 2),
        )

    def _tables(self, numbers: Numbers) -> dict[str, Tensor]:
        """The parameters of the chain that depend on the design, each with the leading axis."""
        count, n = len(numbers.convexity), self.n_links
        surfaces, signs = numbers.structure.links, torch.tensor([1.0, -1.0], dtype=torch.float64)
        pieces = torch.einsum("pkf,bsf->bspk", numbers.curve.pieces, numbers.convexity)
        powers = numbers.half_width[:, None] ** -torch.arange(pieces.shape[-1])
        coefficients = (pieces * powers[:, None, None])[:, surfaces] * signs[:, None, None]
        starts = -0.5 * signs * numbers.height[..., None]
        arcs = numbers.hole * torch.tensor([-1.0, 1.0])
        breaks = numbers.half_width[:, None] * numbers.curve.breaks
        return {
            "breaks": breaks[:, None, None].expand(count, n, 2, -1),
            "coefficients": coefficients.expand(count, n, *coefficients.shape[2:]),
            "starts": torch.stack([torch.zeros_like(starts), starts], -1).expand(count, n, 2, 2),
            "angles": (-signs * numbers.angle[:, surfaces]).expand(count, n, 2),
            "hole_arcs": arcs[:, :, None, None].expand(count, 2, n, 2),
            "stiffnesses": torch.full((count, 2), self.stiffness, dtype=torch.float64),
        }


@functools.lru_cache
def _parts(space: DesignSpace) -> dict[str, NumberGroup]:
    """The numbers of a design, in the order of the vector."""
    n = space.n_links
    if space.alike:
        surfaces = ["child ", "parent "]
    else:
        surfaces = [
            f"link {joint + side} {name} " for joint in range(n - 1) for side, name in enumerate(("child", "parent"))
        ]
    width = space.half_width[0] if space.half_width[0] == space.half_width[1] else None
    places = [
        f"s = {place * width:g} mm" if width is not None else f"s = {place:g} half widths"
        for place in space._curve.places.tolist()
    ]
    heights = ("height [mm]",) if space.alike else tuple(f"link {i} height [mm]" for i in range(n))
    holes = ("hole [mm]",) if space.symmetric else ("left hole [mm]", "right hole [mm]")
    return {
        "convexity": NumberGroup(
            tuple(f"{s}convexity at {p} [1/mm]" for s in surfaces for p in places), space.convexity
        ),
        "angle": NumberGroup(tuple(f"{surface}angle [rad]" for surface in surfaces), space.angle),
        "height": NumberGroup(heights, space.height),
        "half_width": NumberGroup(("half width [mm]",), space.half_width),
        "hole": NumberGroup(holes, space.hole),
    }
