"""Contact with walls at one pose in space, in tensors: the kernels' own source runs on the pairs that press.

Poses are rotation matrix row by row and origin, as kernels have them. Symbols as in docs/theory.md, section 12.
"""

from __future__ import annotations

import types
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import torch
from torch import Tensor

from rollingjoint.differentiable.formulas import of_tensors
from rollingjoint.differentiable.pairs import FIRM, MATH, KernelTable, Lane, Pairs, WallProblem, as_seen, joined, lanes
from rollingjoint.kernels.spatial_wall_contacts import (
    FORCE,
    N_CHANGES,
    N_SUMS,
    N_TWIST,
    SUM_S,
    touch_in_space,
)
from rollingjoint.kernels.spatial_walls import N_PIECE, see_in_space
from rollingjoint.kernels.wall_contacts import N_HOW, RUBS, SOFTER, STIFFER
from rollingjoint.kernels.walls import N_LAW

_ORIGIN = (0.0,) * 6
_WIDTHS = {  # of every table, and of the same as seen from the base
    "points": (6, 6), "bars": (8, 8), "planes": (4 + N_LAW, 4 + N_LAW), "capsules": (7 + N_LAW, 8 + N_LAW),
    "pieces": (14, N_PIECE), "tubes": (N_LAW, 2 + N_LAW),
}  # fmt: skip
_INSTEAD: dict[str, Any] = {
    "math": MATH,
    "dot": lambda a, b: a[0] * b[0] + a[1] * b[1] + a[2] * b[2],
    "plus": lambda a, b: tuple(x + y for x, y in zip(a, b, strict=True)),
    "minus": lambda a, b: tuple(x - y for x, y in zip(a, b, strict=True)),
    "times": lambda a, factor: tuple(x * factor for x in a),
    "about": lambda a, b: (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]),
}
_see, _with_rates = of_tensors(see_in_space, _INSTEAD), of_tensors(touch_in_space, _INSTEAD)
_without_rates = of_tensors(touch_in_space, _INSTEAD | {"N_TWIST": 0})
_pieces_alone = of_tensors(touch_in_space, _INSTEAD | dict.fromkeys(("_touch_tube", "_touch_bars"), lambda *_: None))


class SpatialWallTables(NamedTuple):
    """The tables of kernels.spatial_walls.SpatialWalls as tensors (D, rows, columns), of D surroundings."""

    points: Tensor
    bars: Tensor
    planes: Tensor
    capsules: Tensor
    pieces: Tensor
    tubes: Tensor


class SpatialTouchMemory(NamedTuple):
    """What contact remembers from the step before, as kernels.spatial_wall_contacts.SpatialTouched.

    Fields: states (B, candidates, 3), normals (B, candidates) [N], poses of the links among the walls, (B, n, 12).
    """

    states: Tensor
    normals: Tensor
    poses: Tensor


class ContactsInSpace(NamedTuple):
    """Contact of B chains with their walls; zero for pairs that have not been evaluated.

    Attributes:
        forces: on every link: force, and point outer force row by row, (B, n, 12) [N, N·mm].
        gaps, normals: (B, candidates) [mm, N]. states: (B, candidates, 3), tangential, in the frame of the walls.
        works: of friction in the step per normal force, (B, candidates) [mm].
    """

    forces: Tensor
    gaps: Tensor
    normals: Tensor
    states: Tensor
    works: Tensor


@dataclass(frozen=True)
class SpatialWallProblem(WallProblem):
    """As WallProblem, of chains in space; tables: SpatialWallTables, before: SpatialTouchMemory."""

    memory_class: ClassVar[type[SpatialTouchMemory]] = SpatialTouchMemory
    bent: ClassVar[str] = "tubes"

    def at(self, poses: Tensor) -> ContactsInSpace:
        """Contact at poses of the links among the walls, (B, n, 12)."""
        sums, columns = self._evaluated(poses, N_SUMS, _SHAPES, _without_rates)
        return ContactsInSpace(sums[..., FORCE:SUM_S], *columns)

    def rates(self, poses: Tensor) -> Tensor:
        """S of every link, (B, n, 6, 6): what a dead force at the place of contact has not.

        Minus the derivative of force and moment by the velocity of the link's point at the origin of the walls, and by
        its turn.
        """
        return self._evaluated(poses, N_SUMS, _SHAPES, _with_rates)[0][..., SUM_S:].unflatten(-1, (N_TWIST, N_TWIST))

    def _pair(self, candidate: int) -> tuple[str, int, int, int, int]:
        points, _, planes, capsules, _, tubes = (table.shape[1] for table in self.tables)
        start = points * (planes + tubes)
        if candidate < start:
            place, wall = divmod(candidate, planes + tubes)
            kind, wall = ("planes", wall) if wall < planes else ("tubes", wall - planes)
        else:
            kind, (place, wall) = "capsules", divmod(candidate - start, capsules)
        return kind, wall, place, candidate, 1

    def _pieces(self, row: int, pose: Tensor) -> list[list[int]]:
        tables = {name: table[int(self.which[row])].detach().tolist() for name, table in self.tables._asdict().items()}
        count, tubes = len(tables["points"]), len(tables["tubes"])
        touch = _touch([-1] * count * tubes)
        walls = self._seen({name: tables[name] for name in ("points", "pieces", "tubes")})
        chain = types.SimpleNamespace(walls=walls, touch=touch)
        _pieces_alone(chain, types.SimpleNamespace(pose=KernelTable(pose.tolist())), True)
        return [touch.pieces[k : k + tubes] for k in range(0, len(touch.pieces), tubes)]

    def _seen(self, tables: dict[str, Any]) -> Any:
        return as_seen(_see, _ORIGIN, tables, _WIDTHS, base=KernelTable.zeros(1, 12), rigid=[float(self.rigid)])

    def _together(self, pairs: Pairs, pose: Tensor, shared: Any, source: Any) -> tuple[Tensor, list[list[Tensor]]]:
        seen, first = self._around(pairs, shared)
        row, link = torch.as_tensor(pairs.row), torch.as_tensor(self._links(pairs))
        candidate = row, torch.as_tensor(pairs.first)
        touch = _touch([pairs.piece - first])
        touch.how[RUBS], touch.how[STIFFER] = float(self.rubs), FIRM if self.rigid else 1.0
        if self.rigid:
            touch.multipliers = [self.multipliers[candidate].as_subclass(Lane)]
        place, was = (lanes(poses[row, link]) for poses in (pose, self.before.poses))
        states, normals = self.before.states[candidate], self.before.normals[candidate]
        before = SpatialTouchMemory(KernelTable([lanes(states)]), lanes(normals[:, None]), KernelTable([was] * 2))
        chain = types.SimpleNamespace(walls=seen, touch=touch, before=before)
        source(chain, types.SimpleNamespace(pose=KernelTable([place] * 2)), True)
        sums, gaps, normals, works, z = (
            joined(values, len(row), pose)
            for values in (touch.sums[0], touch.gaps, touch.normals, touch.works, touch.states[0])
        )
        return sums, [[gaps[:, 0], normals[:, 0], z, works[:, 0]]]


_SHAPES: list[tuple[int, ...]] = [(), (), (3,), ()]  # of the values of one candidate in ContactsInSpace


def _touch(pieces: list[int]) -> Any:
    """kernels.spatial_wall_contacts.SpatialTouch of one candidate, or of the pieces of many."""
    how = [0.0] * N_HOW
    how[STIFFER] = how[SOFTER] = 1.0
    columns = {name: [0.0] for name in ("gaps", "normals", "works", "frozen", "multipliers")}
    tables = {"states": (1, 3), "sums": (1, N_SUMS), "columns": (N_TWIST, N_CHANGES)}
    return types.SimpleNamespace(
        **columns, **{name: KernelTable.zeros(*size) for name, size in tables.items()}, pieces=pieces, how=how
    )
