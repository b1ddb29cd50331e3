"""Contact with walls at one pose in the plane, in tensors: the kernels' own source runs on the pairs that press.

Symbols as in docs/theory.md, section 12.
"""

from __future__ import annotations

import types
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import torch
from torch import Tensor

from rollingjoint.differentiable.formulas import of_tensors
from rollingjoint.differentiable.pairs import FIRM, MATH, KernelTable, Lane, Pairs, WallProblem, as_seen, joined, lanes
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

_ORIGIN = (0.0, 0.0, 0.0)
_WIDTHS = {  # of every table, and of the same as seen from the base
    "points": (5, 5), "bars": (6, 6), "planes": (3 + N_LAW, 4 + N_LAW), "discs": (3 + N_LAW, 3 + N_LAW),
    "capsules": (5 + N_LAW, 6 + N_LAW), "pieces": (9, N_PIECE), "lumens": (N_LAW, 2 + N_LAW),
}  # fmt: skip
_INSTEAD: dict[str, Any] = {"math": MATH, "np": MATH, "where": lambda which, one, other: one if which else other}
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
class PlanarWallProblem(WallProblem):
    """As WallProblem, of planar chains; tables: WallTables, before: TouchMemory."""

    memory_class: ClassVar[type[TouchMemory]] = TouchMemory
    bent: ClassVar[str] = "lumens"

    def at(self, positions: Tensor, angles: Tensor) -> ContactsAtPose:
        """Contact at poses of the links among the walls: origins (B, n, 2) [mm] and angles (B, n) [rad]."""
        pose = torch.cat([positions, angles[..., None]], -1)
        sums, columns = self._evaluated(pose, N_SUMS, [()] * 5, _touch_walls)
        return ContactsAtPose(-sums[..., [GX, GY, GM, X_DOT_G]], sums[..., SUM_S:].unflatten(-1, (3, 3)), *columns)

    def _pair(self, candidate: int) -> tuple[str, int, int, int, int]:
        points, _, planes, discs, capsules, _, lumens = (table.shape[1] for table in self.tables)
        start = points * (planes + lumens)
        if candidate < start:
            place, wall = divmod(candidate, planes + lumens)
            kind, wall = ("planes", wall) if wall < planes else ("lumens", wall - planes)
            return kind, wall, place, candidate, 1
        place, wall = divmod(candidate - start, discs + 4 * capsules)
        if wall < discs:
            return "discs", wall, place, candidate, 1
        wall, way = divmod(wall - discs, 4)
        return "capsules", wall, place, candidate - way, 4

    def _pieces(self, row: int, pose: Tensor) -> list[list[int]]:
        tables = {name: table[int(self.which[row])].detach().tolist() for name, table in self.tables._asdict().items()}
        count, lumens = len(tables["points"]), len(tables["lumens"])
        touch = _touch(count * lumens, len(pose) - 1, [-1] * count * lumens)
        seen = self._seen({name: tables[name] for name in ("points", "pieces", "lumens")})
        nothing = TouchMemory(*([0.0] * count * lumens for _ in TouchMemory._fields))
        _touch_walls(*_chain(seen, touch, nothing, pose.tolist()), True)
        return [touch.pieces[k : k + lumens] for k in range(0, len(touch.pieces), lumens)]

    def _seen(self, tables: dict[str, Any]) -> Any:
        steepness = [1.0] * len(tables.get("lumens", []))
        return as_seen(_see, _ORIGIN, tables, _WIDTHS, steepness=steepness, angle=[0.0], rigid=[float(self.rigid)])

    def _together(self, pairs: Pairs, pose: Tensor, shared: Any, source: Any) -> tuple[Tensor, list[list[Tensor]]]:
        seen, first = self._around(pairs, shared)
        touch = _touch(pairs.count, 1, [pairs.piece - first] * pairs.count)
        touch.how[RUBS], touch.how[STIFFER] = float(self.rubs), FIRM if self.rigid else 1.0
        every = [(torch.as_tensor(pairs.row), torch.as_tensor(pairs.first + k)) for k in range(pairs.count)]
        if self.rigid:
            touch.multipliers = [self.multipliers[at].as_subclass(Lane) for at in every]
        before = TouchMemory(*([column[at].as_subclass(Lane) for at in every] for column in self.before))
        place = lanes(pose[torch.as_tensor(pairs.row), torch.as_tensor(self._links(pairs))])
        source(*_chain(seen, touch, before, [place, place]), True)
        count = len(pairs.row)
        fields = touch.gaps, touch.normals, touch.states, touch.slips, touch.works
        values = [[joined([field[k]], count, pose)[:, 0] for field in fields] for k in range(pairs.count)]
        return joined(touch.sums[0], count, pose), values


def _touch(count: int, links: int, pieces: list[int]) -> Any:
    """kernels.wall_contacts.Touch of so many candidates."""
    names = "gaps", "normals", "states", "slips", "sides", "works", "frozen", "multipliers"
    how = [0.0] * N_HOW
    how[STIFFER] = how[SOFTER] = 1.0
    columns = {name: [0.0] * count for name in names}
    sums = KernelTable.zeros(links, N_SUMS)
    return types.SimpleNamespace(**columns, pieces=pieces, clear=KernelTable.zeros(count, 3), sums=sums, how=how)


def _chain(seen: Any, touch: Any, before: TouchMemory, poses: Any) -> tuple[Any, Any]:
    """A chain and its state, as far as contact with walls needs them; poses: x, y, angle of every link."""
    rows = [[x, y, angle, MATH.cos(angle), MATH.sin(angle)] for x, y, angle in poses]
    return types.SimpleNamespace(walls=seen, touch=touch, before=before), types.SimpleNamespace(pose=KernelTable(rows))
