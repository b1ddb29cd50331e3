"""Pairs of an outline's part and a wall, for which the kernels' own source of contact runs on tensors.

Pairs are evaluated together, as long as they take the same branches; where they part, each part is evaluated by
itself. Everything is in the frame of the walls.
"""

from __future__ import annotations

import math
import types
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rollingjoint.differentiable.formulas import root

Indices = NDArray[np.int64]

FIRM = 1e5  # times the penalty of rigid walls: their derivatives


class Parted(Exception):
    """Pairs take different branches: `mask` is True for those of the first."""

    def __init__(self, mask: Tensor) -> None:
        self.mask = mask


class Lane(torch.Tensor):
    """Numbers of several pairs, where the source of a kernel has one; a branch is taken by all of them."""

    def __bool__(self) -> bool:
        values = self.detach().as_subclass(torch.Tensor).reshape(-1).bool()
        if not bool((values == values[0]).all()):
            raise Parted(values)
        return bool(values[0])

    def __iadd__(self, other: Any) -> Any:  # a sum of a wall alone has no axis of pairs, and is in the graph
        return self + other


class KernelTable:
    """A table of numbers of several pairs, as kernels index an array."""

    def __init__(self, rows: Sequence[Sequence[Any]], width: int = 0) -> None:
        self.rows = [list(row) for row in rows]
        self.shape = len(self.rows), width

    @classmethod
    def zeros(cls, count: int, width: int) -> KernelTable:
        """A table of zeros."""
        return cls([[0.0] * width for _ in range(count)], width)

    def __getitem__(self, at: Any) -> Any:
        return self.rows[at[0]][at[1]] if isinstance(at, tuple) else self.rows[at]

    def __setitem__(self, at: tuple[int, int], value: Any) -> None:
        self.rows[at[0]][at[1]] = value


class Stack:
    """A table as the only one of a stack."""

    def __init__(self, rows: KernelTable) -> None:
        self.rows = rows

    def __getitem__(self, at: Any) -> Any:
        if not isinstance(at, tuple):
            return self.rows
        return self.rows[at[1:] if len(at) > 2 else at[1]]


def _either(tensors: Any, numbers: Any) -> Any:
    return lambda value: tensors(value) if isinstance(value, Tensor) else numbers(value)


MATH = types.SimpleNamespace(
    sqrt=_either(root, math.sqrt), cos=_either(torch.cos, math.cos), sin=_either(torch.sin, math.sin),
    atan2=lambda y, x: torch.atan2(y, x) if isinstance(y, Tensor) else math.atan2(y, x),
    inf=math.inf, pi=math.pi,
)  # fmt: skip
"""The module math of a kernel, for tensors and numbers."""


@dataclass(frozen=True)
class Pairs:
    """Pairs of one wall and several points or bars, which are evaluated together.

    Attributes:
        kind: of the wall, the name of its table. wall: its number. piece: of a lumen or tube, near the points.
        row, place: of the batch, and of the outline, (G,). first: candidate number of the pair, (G,).
        count: candidates of each.
    """

    kind: str
    wall: int
    piece: int
    row: Indices
    place: Indices
    first: Indices
    count: int

    @property
    def outline(self) -> str:
        """Which parts of the outline the wall meets: points or bars."""
        return "points" if self.kind in ("planes", "lumens", "tubes") else "bars"

    def part(self, mask: NDArray[np.bool_]) -> Pairs:
        """Those of a mask."""
        return replace(self, row=self.row[mask], place=self.place[mask], first=self.first[mask])


@dataclass(frozen=True)
class WallProblem(ABC):
    """B chains among walls, and what contact remembers.

    Args:
        tables: of the walls. which: surroundings of every chain, (B,).
        rigid: whether walls are rigid. rubs: whether there is friction at walls.
        chosen: the candidates that are evaluated, (B, candidates).
        before: what they remember. multipliers: normal forces of rigid walls, (B, candidates) [N].
    Attributes of its class:
        memory_class: of what contact remembers. bent: kind of the walls around a centre line.
    """

    memory_class: ClassVar[type[Any]]
    bent: ClassVar[str]

    tables: Any
    which: Indices
    rigid: bool
    rubs: bool
    chosen: NDArray[np.bool_]
    before: Any
    multipliers: Tensor

    @abstractmethod
    def _pair(self, candidate: int) -> tuple[str, int, int, int, int]:
        """Kind and number of the wall, place in the outline, first candidate of the pair, and their count."""

    @abstractmethod
    def _pieces(self, row: int, pose: Tensor) -> list[list[int]]:
        """The pieces of all lumens or tubes that the points of a chain are near, by point and wall."""

    @abstractmethod
    def _seen(self, tables: dict[str, Any]) -> Any:
        """The walls or the outline of these rows as kernels see them from the origin of the walls."""

    @abstractmethod
    def _together(self, pairs: Pairs, pose: Tensor, shared: Any, source: Any) -> tuple[Tensor, list[list[Tensor]]]:
        """Sums of the pairs, (G, columns), and the values of each of their candidates, (G, ...), by the source."""

    def _evaluated(
        self, pose: Tensor, width: int, shapes: Sequence[tuple[int, ...]], source: Any
    ) -> tuple[Tensor, list[Tensor]]:
        """Sums over the contacts of every link, (B, n, width), and values of the candidates, (B, candidates, ...).

        pose: of every link, (B, n, numbers). shapes: of the values of one candidate; zero where not evaluated.
        """
        total = pose.new_zeros(*pose.shape[:2], width)
        columns = [pose.new_zeros(*self.chosen.shape, *shape) for shape in shapes]
        with torch.no_grad():
            groups = list(self._groups(pose.detach()))
        shared: dict[tuple[str, int], Any] = {}  # walls that are the same for all rows, as kernels see them
        for pairs in groups:
            for part, sums, values in self._parts(pairs, pose, shared, source):
                row, link = torch.as_tensor(part.row), torch.as_tensor(self._links(part))
                total = total.index_put((row, link), sums, accumulate=True)
                for k in range(part.count):
                    at = row, torch.as_tensor(part.first + k)
                    columns = [column.index_put(at, new) for column, new in zip(columns, values[k], strict=True)]
        return total, columns

    def _links(self, pairs: Pairs) -> Indices:
        outline = getattr(self.tables, pairs.outline)
        links: Indices = outline.detach().numpy()[self.which[pairs.row], pairs.place, 0].astype(np.int64)
        return links

    def _groups(self, pose: Tensor) -> Iterator[Pairs]:
        """All pairs that are chosen, by wall, and of lumens and tubes by piece."""
        found: dict[tuple[str, int, int, int], dict[tuple[int, int, int], None]] = {}
        near: dict[int, Any] = {}
        for row, c in np.argwhere(self.chosen).tolist():
            kind, wall, place, first, count = self._pair(c)
            piece = -1
            if kind == self.bent:
                near[row] = self._pieces(row, pose[row]) if row not in near else near[row]
                piece = near[row][place][wall]
            found.setdefault((kind, wall, piece, count), {})[(row, place, first)] = None
        for (kind, wall, piece, count), each in found.items():
            row, place, first = np.array(list(each), np.int64).T
            yield Pairs(kind, wall, piece, row, place, first, count)

    def _parts(self, pairs: Pairs, pose: Tensor, shared: Any, source: Any) -> Iterator[Any]:
        """Parts of the pairs that take the same branches, each with the results of `_together`."""
        try:
            yield pairs, *self._together(pairs, pose, shared, source)
        except Parted as parted:
            mask = parted.mask.numpy()
            for part in (mask, ~mask):
                yield from self._parts(pairs.part(part), pose, shared, source)

    def _around(self, pairs: Pairs, shared: Any) -> tuple[Any, int]:
        """The outline and the wall of these pairs as kernels see them, and the first piece of the wall."""
        outline = getattr(self.tables, pairs.outline)[self.which[pairs.row], pairs.place]
        body = self._seen({pairs.outline: [[1, *lanes(outline[:, 1:])]]})  # on the first link beyond the base
        walls, first = self._walls(pairs, shared)
        return types.SimpleNamespace(
            **(vars(walls) | {name: getattr(body, name) for name in ("points", "bars")})
        ), first

    def _walls(self, pairs: Pairs, shared: Any) -> tuple[Any, int]:
        """The wall of these pairs as kernels see it, and the first of its pieces."""
        one = len(self.tables.points) == 1
        if one and (pairs.kind, pairs.wall) in shared:
            return shared[pairs.kind, pairs.wall]
        index: Any = 0 if one else self.which[pairs.row]
        table, first = getattr(self.tables, pairs.kind), 0
        walls = {pairs.kind: [lanes(table[index, pairs.wall])]}
        if pairs.kind == self.bent:
            of = self.tables.pieces[0, :, -1].detach()
            own = torch.nonzero(of == pairs.wall)[:, 0].tolist()  # one after the other
            first = own[0]
            walls["pieces"] = [[*lanes(self.tables.pieces[index, i, :-1]), 0.0] for i in own]
        shared[pairs.kind, pairs.wall] = found = (self._seen(walls), first)
        return found


def lanes(table: Tensor) -> list[Any]:
    """The columns of a table (G, columns)."""
    return [column.as_subclass(Lane) for column in table.unbind(-1)]


def joined(values: Sequence[Any], count: int, like: Tensor) -> Tensor:
    """Numbers of all pairs as the columns of a table, (G, columns)."""
    return torch.stack([whole(value, count, like) for value in values], -1)


def whole(value: Any, count: int, like: Tensor) -> Tensor:
    """A number of all pairs, (G,)."""
    if not isinstance(value, Tensor):
        return like.new_full((count,), value)
    return value.as_subclass(torch.Tensor).expand(count)  # of a wall alone, without an axis of pairs


def as_seen(
    see: Any, origin: Sequence[float], tables: dict[str, Any], widths: dict[str, tuple[int, int]], **more: Any
) -> Any:
    """Walls and outline as a kernel sees them from the origin.

    Args:
        see: the kernel, on tensors. origin: pose of the base.
        tables: rows by name. widths: by name, of the table and of what is seen of it. more: fields of the walls seen.
    """
    given = {name: KernelTable(tables.get(name, []), width) for name, (width, _) in widths.items()}
    seen = {name: KernelTable.zeros(len(given[name].rows), width) for name, (_, width) in widths.items()}
    result = types.SimpleNamespace(**seen, **more)
    stacks = {name: Stack(table) for name, table in given.items()}
    see(types.SimpleNamespace(**stacks, rigid=[result.rigid[0]]), 0, origin, result)
    return result
