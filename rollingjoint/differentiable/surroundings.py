"""Walls around chains as tensors that can be differentiated."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
import torch
from torch import Tensor

from rollingjoint.differentiable.contact import PlanarWallProblem, WallTables
from rollingjoint.differentiable.geometry import turned
from rollingjoint.differentiable.pairs import WallProblem
from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.spatial_walls import SpatialWalls
from rollingjoint.kernels.walls import N_LAW, Walls
from rollingjoint.surroundings import Lumen, Surroundings

LAW = ("stiffnesses", "toes", "frictions", "preslidings")
"""Columns of the law of every wall that can be differentiated, in the order of kernels.walls."""


class WallTensors(ABC):
    """Walls around a chain and its outline as tensors with any leading axes; its classes are frozen dataclasses.

    Attributes of its class:
        parameters: number of trailing axes of each.
        straight: tables of the walls without a centre line, in the order of kernels, and their columns before the law.
        bent, of_pieces: the class of the walls around a centre line, and the names of the numbers along it.
        base_size: numbers of a pose of the base.
        problem: contact with these walls.
    """

    parameters: ClassVar[dict[str, int]]
    straight: ClassVar[dict[str, int]]
    bent: ClassVar[type[Any]]
    of_pieces: ClassVar[tuple[str, ...]]
    base_size: ClassVar[int]
    problem: ClassVar[type[WallProblem]]

    points: Tensor
    bars: Tensor
    planes: Tensor
    starts: Tensor
    lengths: Tensor
    radii: Tensor
    stiffnesses: Tensor
    toes: Tensor
    frictions: Tensor
    preslidings: Tensor
    pieces: tuple[int, ...]
    per_length: tuple[bool, ...]
    rigid: bool

    @classmethod
    def of(cls, surroundings: Surroundings, chain: Any, requires_grad: Iterable[str] = ()) -> Self:
        """Surroundings of a chain as tensors.

        Args:
            surroundings: to be converted. chain: the mechanism whose links have the outline.
            requires_grad: names of the parameters by which to differentiate.
        Raises:
            InvalidInput: an unknown name, walls of another kind, links that the outline does not fit.
        """
        names = list(requires_grad)
        if unknown := [name for name in names if name not in cls.parameters]:
            raise InvalidInput("requires_grad", unknown, f"names among {', '.join(cls.parameters)}")
        if not isinstance(surroundings, Surroundings):
            raise InvalidInput("surroundings", surroundings, f"Surroundings, or {cls.__name__}")
        arrays = surroundings.arrays(chain)
        bent = [wall for wall in surroundings.walls if isinstance(wall, cls.bent)]
        tables = {name: getattr(arrays, name)[0] for name in (*cls.straight, cls.problem.bent)}
        law = np.concatenate([table[:, -N_LAW:] for table in tables.values()])
        numbers = {
            "points": arrays.points[0], "bars": arrays.bars[0],
            **{name: tables[name][:, :width] for name, width in cls.straight.items()},
            "starts": np.array([cls._start(wall) for wall in bent]).reshape(-1, cls.base_size),
            **{name: np.array([x for wall in bent for x in getattr(wall, name)]) for name in cls.of_pieces},
            "radii": np.array([radius for wall in bent for radius in wall.border_radii]),
            **dict(zip(LAW, law.T, strict=False)),
        }  # fmt: skip
        tensors = {
            name: torch.tensor(np.array(values, float), requires_grad=name in names) for name, values in numbers.items()
        }
        pieces = tuple(len(wall.lengths) for wall in bent)
        per_length = tuple((law[:, -1] > 0.0).tolist())
        structure = {"pieces": pieces, "per_length": per_length, "rigid": surroundings.rigid, **cls._kept(arrays)}
        build: Any = cls
        walls: Self = build(**tensors, **structure)
        return walls

    @staticmethod
    @abstractmethod
    def _start(wall: Any) -> tuple[float, ...]:
        """Where the centre line of a wall starts: a row of `starts`."""

    @classmethod
    def _kept(cls, arrays: Any) -> dict[str, Any]:
        """Further fields, from the arrays of kernels."""
        return {}

    def replace(self, **changes: Any) -> Self:
        """The same walls with other tensors."""
        return replace(self, **changes)  # type: ignore[type-var]

    def each(self, change: Callable[[Tensor, int], Tensor]) -> Self:
        """The walls with every tensor changed, by a function of the tensor and its number of trailing axes."""
        return self.replace(**{name: change(getattr(self, name), axes) for name, axes in self.parameters.items()})

    @property
    def leading(self) -> list[torch.Size]:
        """The leading axes of every tensor."""
        return [getattr(self, name).shape[: getattr(self, name).ndim - axes] for name, axes in self.parameters.items()]

    @property
    def rubs(self) -> bool:
        """Whether any wall has friction."""
        return bool((self.frictions.detach() > 0.0).any())

    @abstractmethod
    def _sizes(self) -> tuple[Tensor, ...]:
        """Sizes of walls and outline that have to be positive, apart from those of pieces."""

    def usable(self) -> Tensor:
        """Whether the numbers of a row are finite, and sizes and laws in their ranges, (...)."""
        finite = [torch.isfinite(getattr(self, name)).flatten(-axes).all(-1) for name, axes in self.parameters.items()]
        sizes = *self._sizes(), self.radii, self.lengths, self.stiffnesses, self.preslidings
        positive = [(size > 0.0).all(-1) for size in sizes]
        others = [(size >= 0.0).all(-1) for size in (self.toes, self.frictions)]
        return torch.stack(torch.broadcast_tensors(*finite, *positive, *others)).all(0)

    @abstractmethod
    def tables(self) -> Any:
        """The tables of kernels, with one leading axis, (D, rows, columns)."""

    def _flat(self) -> tuple[Self, dict[str, Tensor]]:
        """The walls with one leading axis, and the laws of the rows of every table."""
        rows = max(axes.numel() for axes in self.leading)
        flat = self.each(lambda tensor, axes: tensor.reshape(rows, *tensor.shape[tensor.ndim - axes :]))
        law = torch.stack([getattr(flat, name) for name in LAW], -1)
        per_length = law.new_tensor(self.per_length).expand(law.shape[:-1])
        law = torch.cat([law, per_length[..., None]], -1)
        sizes = [*(getattr(flat, name).shape[1] for name in self.straight), len(self.pieces)]
        return flat, dict(zip((*self.straight, self.problem.bent), law.split(sizes, 1), strict=True))

    def _planes(self) -> Tensor:
        """Planes with unit normals, (D, H, 3 or 4)."""
        normals = self.planes[..., :-1]
        return torch.cat([normals / normals.norm(dim=-1, keepdim=True), self.planes[..., -1:]], -1)

    def _centre_lines(self) -> Iterator[list[Tensor]]:
        """Numbers along the centre line of every wall around one, in the order of `of_pieces`, and radii, (D, ...)."""
        along = [getattr(self, name).split(self.pieces, 1) for name in self.of_pieces]
        radii = self.radii.split([count + 1 for count in self.pieces], 1)
        yield from map(list, zip(*along, radii, strict=True))


@dataclass(frozen=True, eq=False)
class DifferentiableSurroundings(WallTensors):
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

    parameters: ClassVar[dict[str, int]] = {
        **{name: 2 for name in ("points", "bars", "planes", "discs", "capsules", "starts")},
        **{name: 1 for name in ("lengths", "curvatures", "radii", *LAW)},
    }
    straight: ClassVar[dict[str, int]] = {"planes": 3, "discs": 3, "capsules": 5}
    bent: ClassVar[type[Lumen]] = Lumen
    of_pieces: ClassVar[tuple[str, ...]] = ("lengths", "curvatures")
    base_size: ClassVar[int] = 3
    problem: ClassVar[type[PlanarWallProblem]] = PlanarWallProblem

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

    @staticmethod
    def _start(wall: Lumen) -> tuple[float, ...]:
        return tuple(wall.start)

    def _sizes(self) -> tuple[Tensor, ...]:
        return self.discs[..., 2], self.capsules[..., 4] + 1e-300, self.points[..., 3]

    def tables(self) -> WallTables:
        """The tables of kernels, with one leading axis, (D, rows, columns)."""
        flat, law = self._flat()
        numbers = {"planes": flat._planes(), "discs": flat.discs, "capsules": flat.capsules}
        tables = {name: torch.cat([table, law[name]], -1) for name, table in numbers.items()}
        return WallTables(flat.points, flat.bars, **tables, pieces=flat._pieces(), lumens=law["lumens"])

    def _pieces(self) -> Tensor:
        """Rows of Walls.pieces, (D, N, 9)."""
        rows: list[Tensor] = []
        for number, (lengths, curvatures, radii) in enumerate(self._centre_lines()):
            x, y, angle = self.starts[:, number].unbind(-1)
            place, arc = torch.complex(x, y), torch.zeros_like(x)
            for k in range(lengths.shape[1]):
                length, half = lengths[:, k], 0.5 * curvatures[:, k] * lengths[:, k]
                row = place.real, place.imag, angle, curvatures[:, k], length, arc, radii[:, k], radii[:, k + 1]
                rows.append(torch.stack([*row, torch.full_like(x, number)], -1))
                place = place + length * torch.sinc(half / torch.pi) * turned(angle + half)
                angle, arc = angle + 2.0 * half, arc + length
        return torch.stack(rows, 1) if rows else self.starts.new_zeros(len(self.starts), 0, 9)


def numeric(tables: Any, rigid: bool) -> Walls | SpatialWalls:
    """The arrays of kernels, by their tables as tensors."""
    kind: Any = SpatialWalls if hasattr(tables, "tubes") else Walls
    arrays = {name: np.ascontiguousarray(table.detach().numpy()) for name, table in tables._asdict().items()}
    walls: Walls | SpatialWalls = kind(**arrays, rigid=np.full(len(tables.points), float(rigid)))
    return walls
