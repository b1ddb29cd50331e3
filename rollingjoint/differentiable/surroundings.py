"""Walls around planar chains as tensors that can be differentiated."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from rollingjoint.differentiable.contact import WallTables
from rollingjoint.differentiable.geometry import turned
from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.walls import Walls
from rollingjoint.surroundings import Lumen, Surroundings

LAW = ("stiffnesses", "toes", "frictions", "preslidings")
"""Columns of the law of every wall that can be differentiated, in the order of kernels.walls."""
PARAMETERS = {
    **{name: 2 for name in ("points", "bars", "planes", "discs", "capsules", "starts")},
    **{name: 1 for name in ("lengths", "curvatures", "radii", *LAW)},
}
"""Number of trailing axes of every parameter."""


@dataclass(frozen=True, eq=False)
class DifferentiableSurroundings:
    """Walls around a planar chain and its outline, as tensors with any leading axes.

    Walls are in the order of the kernels: half planes, discs, capsules (those of polygons, too), lumens.

    Attributes:
        points: discs of the outline, (..., P, 5): link, x, y, radius, length. bars: its capsules, (..., Q, 6): link,
            first end x, y, second end x, y, radius [mm].
        planes: normal, of any length, and offset, (..., H, 3). discs: x, y, radius, (..., D, 3).
        capsules: first end, second end, radius, (..., K, 5) [mm].
        starts: x, y, angle at the start of every lumen, (..., L, 3). lengths, curvatures: of the pieces of all lumens,
            one lumen after the other, (..., N). radii: at the borders of the pieces, (..., N + L).
        stiffnesses, toes, frictions, preslidings: of every wall, (..., H + D + K + L).
        pieces: number of pieces of every lumen. per_length: whether a stiffness is per length, of every wall.
        rigid: whether the walls are rigid.
    """

    points: Tensor
    bars: Tensor
    planes: Tensor
    discs: Tensor
    capsules: Tensor
    starts: Tensor
    lengths: Tensor
    curvatures: Tensor
    radii: Tensor
    stiffnesses: Tensor
    toes: Tensor
    frictions: Tensor
    preslidings: Tensor
    pieces: tuple[int, ...] = ()
    per_length: tuple[bool, ...] = ()
    rigid: bool = False

    @classmethod
    def of(
        cls, surroundings: Surroundings, chain: Any, requires_grad: Iterable[str] = ()
    ) -> DifferentiableSurroundings:
        """Surroundings of a planar chain as tensors.

        Args:
            surroundings: to be converted. chain: the RollingChain, whose links have the outline.
            requires_grad: names of the parameters by which to differentiate.
        Raises:
            InvalidInput: an unknown name, links that the outline does not fit.
        """
        names = list(requires_grad)
        if unknown := [name for name in names if name not in PARAMETERS]:
            raise InvalidInput("requires_grad", unknown, f"names among {', '.join(PARAMETERS)}")
        if not isinstance(surroundings, Surroundings):
            raise InvalidInput("surroundings", surroundings, "Surroundings, or DifferentiableSurroundings")
        arrays = surroundings.arrays(chain)
        lumens = [wall for wall in surroundings.walls if isinstance(wall, Lumen)]
        tables = arrays.planes[0], arrays.discs[0], arrays.capsules[0], arrays.lumens[0]
        law = np.concatenate([table[:, -5:] for table in tables])
        numbers = {
            "points": arrays.points[0], "bars": arrays.bars[0],
            "planes": tables[0][:, :3], "discs": tables[1][:, :3], "capsules": tables[2][:, :5],
            "starts": np.array([lumen.start for lumen in lumens]).reshape(-1, 3),
            **{name: np.array([x for lumen in lumens for x in getattr(lumen, name)]) for name in _OF_LUMENS},
            **dict(zip(LAW, law.T, strict=False)),
        }  # fmt: skip
        tensors = {
            name: torch.tensor(np.array(values, float), requires_grad=name in names) for name, values in numbers.items()
        }
        pieces = tuple(len(lumen.lengths) for lumen in lumens)
        return cls(**tensors, pieces=pieces, per_length=tuple((law[:, -1] > 0.0).tolist()), rigid=surroundings.rigid)

    def replace(self, **changes: Any) -> DifferentiableSurroundings:
        """The same walls with other tensors."""
        return replace(self, **changes)

    def each(self, change: Callable[[Tensor, int], Tensor]) -> DifferentiableSurroundings:
        """The walls with every tensor changed, by a function of the tensor and its number of trailing axes."""
        return replace(self, **{name: change(getattr(self, name), axes) for name, axes in PARAMETERS.items()})

    @property
    def leading(self) -> list[torch.Size]:
        """The leading axes of every tensor."""
        return [getattr(self, name).shape[: getattr(self, name).ndim - axes] for name, axes in PARAMETERS.items()]

    @property
    def rubs(self) -> bool:
        """Whether any wall has friction."""
        return bool((self.frictions.detach() > 0.0).any())

    def usable(self) -> Tensor:
        """Whether the numbers of a row are finite, and sizes and laws in their ranges, (...)."""
        finite = [torch.isfinite(getattr(self, name)).flatten(-axes).all(-1) for name, axes in PARAMETERS.items()]
        radii = self.discs[..., 2], self.capsules[..., 4] + 1e-300, self.radii, self.lengths, self.points[..., 3]
        positive = [(size > 0.0).all(-1) for size in (*radii, self.stiffnesses, self.preslidings)]
        others = [(size >= 0.0).all(-1) for size in (self.toes, self.frictions)]
        return torch.stack(torch.broadcast_tensors(*finite, *positive, *others)).all(0)

    def tables(self) -> WallTables:
        """The tables of kernels, with one leading axis, (D, rows, columns)."""
        rows = max(axes.numel() for axes in self.leading)
        flat = self.each(lambda tensor, axes: tensor.reshape(rows, *tensor.shape[tensor.ndim - axes :]))
        law = torch.stack([getattr(flat, name) for name in LAW], -1)
        per_length = law.new_tensor(self.per_length).expand(law.shape[:-1])
        law = torch.cat([law, per_length[..., None]], -1)
        sizes = [flat.planes.shape[1], flat.discs.shape[1], flat.capsules.shape[1], len(self.pieces)]
        of_planes, of_discs, of_capsules, of_lumens = law.split(sizes, 1)
        normals = flat.planes[..., :2] / flat.planes[..., :2].norm(dim=-1, keepdim=True)
        planes = torch.cat([normals, flat.planes[..., 2:], of_planes], -1)
        discs, capsules = torch.cat([flat.discs, of_discs], -1), torch.cat([flat.capsules, of_capsules], -1)
        return WallTables(flat.points, flat.bars, planes, discs, capsules, flat._pieces(), of_lumens)

    def _pieces(self) -> Tensor:
        """Rows of Walls.pieces, (D, N, 9)."""
        rows: list[Tensor] = []
        borders = [count + 1 for count in self.pieces]
        parts = zip(
            self.lengths.split(self.pieces, 1),
            self.curvatures.split(self.pieces, 1),
            self.radii.split(borders, 1),
            strict=True,
        )
        for number, (lengths, curvatures, radii) in enumerate(parts):
            x, y, angle = self.starts[:, number].unbind(-1)
            place, arc = torch.complex(x, y), torch.zeros_like(x)
            for k in range(lengths.shape[1]):
                length, half = lengths[:, k], 0.5 * curvatures[:, k] * lengths[:, k]
                row = place.real, place.imag, angle, curvatures[:, k], length, arc, radii[:, k], radii[:, k + 1]
                rows.append(torch.stack([*row, torch.full_like(x, number)], -1))
                place = place + length * torch.sinc(half / torch.pi) * turned(angle + half)
                angle, arc = angle + 2.0 * half, arc + length
        return torch.stack(rows, 1) if rows else self.starts.new_zeros(len(self.starts), 0, 9)


_OF_LUMENS = ("lengths", "curvatures", "radii")


def numeric(tables: WallTables, rigid: bool) -> Walls:
    """The arrays of kernels."""
    arrays = {name: np.ascontiguousarray(table.detach().numpy()) for name, table in tables._asdict().items()}
    return Walls(**arrays, rigid=np.full(len(tables.points), float(rigid)))
