"""Contact with walls at one pose, in tensors: the kernels' own source runs on the pairs that press, gradients included.

Pairs of an outline's point or bar and a wall are evaluated together, as long as they take the same branches; where
they part, each part is evaluated by itself. Everything is in the frame of the walls. Symbols as in docs/theory.md,
section 12.
"""

from __future__ import annotations

import math
import types
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rollingjoint.differentiable.formulas import of_tensors, root
from rollingjoint.kernels.seen_walls import N_PIECE, see
from rollingjoint.kernels.wall_contacts import (
    GM,
    GX,
    GY,
    N_HOW,
    N_SUMS,
    RUBS,
    SOFTER,
    STIFFER,
    SUM_S,
    X_DOT_G,
    touch_walls,
)
from rollingjoint.kernels.walls import N_LAW

Indices = NDArray[np.int64]

FIRM = 1e5  # times the penalty of rigid walls: their derivatives
_ORIGIN = (0.0, 0.0, 0.0)
_OUTLINE = ("points", "bars")


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


class KernelTable:
    """A table of numbers of several pairs, as kernels index an array."""

    def __init__(self, rows: Sequence[Sequence[Any]], width: int = 0) -> None:
        self.rows = [list(row) for row in rows]
        self.shape = len(self.rows), width

    def __getitem__(self, at: Any) -> Any:
        return self.rows[at[0]][at[1]] if isinstance(at, tuple) else self.rows[at]

    def __setitem__(self, at: tuple[int, int], value: Any) -> None:
        self.rows[at[0]][at[1]] = value


_NO_ROWS = KernelTable([])


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


_MATH = types.SimpleNamespace(
    sqrt=_either(root, math.sqrt), cos=_either(torch.cos, math.cos), sin=_either(torch.sin, math.sin),
    atan2=lambda y, x: torch.atan2(y, x) if isinstance(y, Tensor) else math.atan2(y, x),
    inf=math.inf, pi=math.pi,
)  # fmt: skip
_INSTEAD = {"math": _MATH, "np": _MATH, "where": lambda which, one, other: one if which else other}
_see, _touch_walls = of_tensors(see, _INSTEAD), of_tensors(touch_walls, _INSTEAD)


class WallTables(NamedTuple):
    """The tables of kernels.walls.Walls as tensors (D, rows, columns), of D surroundings; pieces end in their lumen."""

    points: Tensor
    bars: Tensor
    planes: Tensor
    discs: Tensor
    capsules: Tensor
    pieces: Tensor
    lumens: Tensor


class TouchMemory(NamedTuple):
    """What contact remembers from the step before, (B, candidates) each, as kernels.wall_contacts.Touched."""

    states: Tensor
    slips: Tensor
    sides: Tensor
    normals: Tensor


class ContactsAtPose(NamedTuple):
    """Contact of B chains with their walls; zero for pairs that have not been evaluated.

    Attributes:
        forces: on every link, x, y, moment about the origin of the walls, and point · force, (B, n, 4) [N, N·mm].
        rates: minus the derivative of the force and the moment by the motion of the link there, (B, n, 3, 3).
        gaps, normals, states, slips: (B, candidates) [mm, N, 1, mm].
        works: of friction in the step per normal force, (B, candidates) [mm].
    """

    forces: Tensor
    rates: Tensor
    gaps: Tensor
    normals: Tensor
    states: Tensor
    slips: Tensor
    works: Tensor


@dataclass(frozen=True)
class Pairs:
    """Pairs of one wall and several points or bars, which are evaluated together.

    Attributes:
        kind: of the wall, the name of its table. wall: its number. piece: of a lumen, near the points.
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
    def on_points(self) -> bool:
        """Whether the wall meets points of the outline, not bars."""
        return self.kind in ("planes", "lumens")

    def part(self, mask: NDArray[np.bool_]) -> Pairs:
        """Those of a mask."""
        return replace(self, row=self.row[mask], place=self.place[mask], first=self.first[mask])


@dataclass(frozen=True)
class WallProblem:
    """B chains among walls, and what contact remembers.

    Args:
        tables: of the walls. which: surroundings of every chain, (B,).
        rigid: whether walls are rigid. rubs: whether there is friction at walls.
        chosen: the candidates that are evaluated, (B, candidates).
        before: what they remember. multipliers: normal forces of rigid walls, (B, candidates) [N].
    """

    tables: WallTables
    which: Indices
    rigid: bool
    rubs: bool
    chosen: NDArray[np.bool_]
    before: TouchMemory
    multipliers: Tensor

    def at(self, positions: Tensor, angles: Tensor) -> ContactsAtPose:
        """Contact at poses of the links among the walls: origins (B, n, 2) [mm] and angles (B, n) [rad]."""
        shape, like = self.chosen.shape, positions
        n = angles.shape[1]
        forces, rates = like.new_zeros(shape[0], n, 4), like.new_zeros(shape[0], n, 9)
        columns = [like.new_zeros(shape) for _ in range(5)]
        pose = torch.stack([positions[..., 0], positions[..., 1], angles], -1)
        with torch.no_grad():
            groups = list(self._groups(pose.detach()))
        shared: dict[tuple[str, int], Any] = {}  # walls that are the same for all rows, as kernels see them
        for pairs in groups:
            for part, sums, values in self._evaluated(pairs, pose, shared):
                row = torch.as_tensor(part.row)
                link = torch.as_tensor(self._links(part))
                forces = forces.index_put((row, link), -sums[:, [GX, GY, GM, X_DOT_G]], accumulate=True)
                rates = rates.index_put((row, link), sums[:, SUM_S:], accumulate=True)
                for k in range(part.count):
                    at = row, torch.as_tensor(part.first + k)
                    columns = [
                        column.index_put(at, new) for column, new in zip(columns, values[k].unbind(-1), strict=True)
                    ]
        return ContactsAtPose(forces, rates.unflatten(-1, (3, 3)), *columns)

    def _links(self, pairs: Pairs) -> Indices:
        outline = self.tables.points if pairs.on_points else self.tables.bars
        return outline.detach().numpy()[self.which[pairs.row], pairs.place, 0].astype(np.int64)

    def _groups(self, pose: Tensor) -> Iterator[Pairs]:
        """All pairs that are chosen, by wall, and of lumens by piece."""
        tables = self.tables
        found: dict[tuple[str, int, int, int], dict[tuple[int, int, int], None]] = {}
        (planes, discs, capsules), lumens = (t.shape[1] for t in tables[2:5]), tables.lumens.shape[1]
        points = tables.points.shape[1]
        width, start = planes + lumens, points * (planes + lumens)
        near: dict[int, Any] = {}
        for row, c in np.argwhere(self.chosen).tolist():
            if c < start:
                place, wall = divmod(c, width)
                kind, wall = ("planes", wall) if wall < planes else ("lumens", wall - planes)
                first, count, piece = c, 1, -1
                if kind == "lumens":
                    near[row] = self._pieces(row, pose[row]) if row not in near else near[row]
                    piece = near[row][place][wall]
            else:
                place, wall = divmod(c - start, discs + 4 * capsules)
                first, count, kind, piece = c, 1, "discs", -1
                if wall >= discs:
                    wall, way = divmod(wall - discs, 4)
                    first, count, kind = c - way, 4, "capsules"
            found.setdefault((kind, wall, piece, count), {})[(row, place, first)] = None
        for (kind, wall, piece, count), each in found.items():
            row, place, first = np.array(list(each), np.int64).T
            yield Pairs(kind, wall, piece, row, place, first, count)

    def _pieces(self, row: int, pose: Tensor) -> list[list[int]]:
        """The pieces of all lumens that the points of a chain are near, by point and lumen."""
        tables = [table[int(self.which[row])].detach().tolist() for table in self.tables]
        points, lumens = tables[0], tables[-1]
        walls = {"lumens": lumens, "pieces": tables[5]}
        touch = _touch(len(points) * len(lumens), len(pose) - 1, [-1] * len(points) * len(lumens))
        _touch_walls(
            *_chain(_seen(points, [], walls, self.rigid), touch, _nothing(len(touch.gaps)), pose.tolist()), True
        )
        return [touch.pieces[k : k + len(lumens)] for k in range(0, len(touch.pieces), len(lumens))]

    def _evaluated(self, pairs: Pairs, pose: Tensor, shared: Any) -> Iterator[tuple[Pairs, Tensor, list[Tensor]]]:
        """Parts of the pairs that take the same branches: their sums (G, N_SUMS), and values of each candidate."""
        try:
            yield pairs, *self._together(pairs, pose, shared)
        except Parted as parted:
            mask = parted.mask.numpy()
            for part in (mask, ~mask):
                yield from self._evaluated(pairs.part(part), pose, shared)

    def _together(self, pairs: Pairs, pose: Tensor, shared: Any) -> tuple[Tensor, list[Tensor]]:
        outline = (self.tables.points if pairs.on_points else self.tables.bars)[self.which[pairs.row], pairs.place]
        body = KernelTable(
            [[1, *_lanes(outline[:, 1:])]], outline.shape[1]
        )  # all on one link, the first beyond the base
        walls, first = self._walls(pairs, shared)
        seen = types.SimpleNamespace(**vars(walls))
        seen.points, seen.bars = (body, _NO_ROWS) if pairs.on_points else (_NO_ROWS, body)
        touch = _touch(pairs.count, 1, [pairs.piece - first] * pairs.count)
        touch.how[RUBS], touch.how[STIFFER] = float(self.rubs), FIRM if self.rigid else 1.0
        every = [(torch.as_tensor(pairs.row), torch.as_tensor(pairs.first + k)) for k in range(pairs.count)]
        if self.rigid:
            touch.multipliers = [self.multipliers[at].as_subclass(Lane) for at in every]
        before = TouchMemory(*([column[at].as_subclass(Lane) for at in every] for column in self.before))
        place = _lanes(pose[torch.as_tensor(pairs.row), torch.as_tensor(self._links(pairs))])
        _touch_walls(*_chain(seen, touch, before, [place, place]), True)
        count = len(pairs.row)
        sums = torch.stack([_whole(value, count, pose) for value in touch.sums[0]], -1)
        fields = touch.gaps, touch.normals, touch.states, touch.slips, touch.works
        return sums, [torch.stack([_whole(f[k], count, pose) for f in fields], -1) for k in range(pairs.count)]

    def _walls(self, pairs: Pairs, shared: Any) -> tuple[Any, int]:
        """The wall of these pairs as kernels see it, and the first of its pieces."""
        one = len(self.tables.points) == 1
        if one and (pairs.kind, pairs.wall) in shared:
            return shared[pairs.kind, pairs.wall]
        index: Any = 0 if one else self.which[pairs.row]
        table, first = getattr(self.tables, pairs.kind), 0
        walls = {pairs.kind: [_lanes(table[index, pairs.wall])]}
        if pairs.kind == "lumens":
            of = self.tables.pieces[0, :, -1].detach()
            own = torch.nonzero(of == pairs.wall)[:, 0].tolist()  # one after the other
            first = own[0]
            walls["pieces"] = [[*_lanes(self.tables.pieces[index, i, :-1]), 0.0] for i in own]
        shared[pairs.kind, pairs.wall] = found = (_seen([], [], walls, self.rigid), first)
        return found


def _lanes(table: Tensor) -> list[Any]:
    """The columns of a table (G, columns)."""
    return [column.as_subclass(Lane) for column in table.unbind(-1)]


def _whole(value: Any, count: int, like: Tensor) -> Tensor:
    """Numbers of all pairs, (G,)."""
    if not isinstance(value, Tensor):
        return like.new_full((count,), value)
    return value.as_subclass(torch.Tensor).expand(count)  # of a wall alone, without an axis of pairs


def _nothing(count: int) -> TouchMemory:
    """The memory of candidates that have never touched a wall."""
    return TouchMemory(*([0.0] * count for _ in TouchMemory._fields))


def _seen(points: Any, bars: Any, walls: dict[str, Any], rigid: bool) -> Any:
    """kernels.seen_walls.Seen of these rows, as seen from the origin of the walls."""
    tables = {"points": KernelTable(points, 5), "bars": KernelTable(bars, 6)}
    tables |= {name: KernelTable(walls.get(name, [])) for name in ("planes", "discs", "capsules", "pieces", "lumens")}
    widths = {"planes": 4 + N_LAW, "discs": 3 + N_LAW, "capsules": 6 + N_LAW, "pieces": N_PIECE, "lumens": 2 + N_LAW}
    empty = {name: KernelTable([[0.0] * width for _ in tables[name].rows]) for name, width in widths.items()}
    outline = {
        name: KernelTable([[0.0] * len(row) for row in tables[name].rows], tables[name].shape[1]) for name in _OUTLINE
    }
    seen = types.SimpleNamespace(
        **outline, **empty, steepness=[1.0] * len(walls.get("lumens", [])), angle=[0.0], rigid=[0.0]
    )
    stacks = {name: Stack(table) for name, table in tables.items()}
    _see(types.SimpleNamespace(**stacks, rigid=[float(rigid)]), 0, _ORIGIN, seen)
    return seen


def _touch(count: int, links: int, pieces: list[int]) -> Any:
    """kernels.wall_contacts.Touch of so many candidates."""
    names = "gaps", "normals", "states", "slips", "sides", "works", "frozen", "multipliers"
    how = [0.0] * N_HOW
    how[STIFFER] = how[SOFTER] = 1.0
    sums = KernelTable([[0.0] * N_SUMS for _ in range(links)], N_SUMS)
    columns = {name: [0.0] * count for name in names}
    return types.SimpleNamespace(
        **columns, pieces=pieces, clear=KernelTable([[0.0] * 3 for _ in range(count)]), sums=sums, how=how
    )


def _chain(seen: Any, touch: Any, before: TouchMemory, poses: Any) -> tuple[Any, Any]:
    """A chain and its state, as far as contact with walls needs them; poses: x, y, angle of every link."""
    rows = [[x, y, angle, _MATH.cos(angle), _MATH.sin(angle)] for x, y, angle in poses]
    return types.SimpleNamespace(walls=seen, touch=touch, before=before), types.SimpleNamespace(pose=KernelTable(rows))
