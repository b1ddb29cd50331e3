"""Walls around chains in space as tensors that can be differentiated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor

from rollingjoint.differentiable.spatial_contact import SpatialWallProblem, SpatialWallTables
from rollingjoint.differentiable.surroundings import LAW, WallTensors
from rollingjoint.surroundings import Tube

_ALONG_X = 0.999999  # cosine beyond which the frame of a tube begins with the y axis


@dataclass(frozen=True, eq=False)
class DifferentiableSpatialSurroundings(WallTensors):
    """Walls around a chain in space and its outline, as tensors with any leading axes.

    Walls are in the order of the kernels: planes, capsules with spheres among them, tubes.

    Attributes:
        points: balls of the outline, (..., P, 6): link, x, y, z, radius, length. bars: its capsules, (..., Q, 8): link,
            first end x, y, z, second end x, y, z, radius [mm].
        planes: normal, of any length, and offset, (..., H, 4).
        capsules: first end, second end, radius, (..., K, 7) [mm]; of a sphere the second end is without effect.
        starts: x, y, z and tangent, of any length, at the start of every tube, (..., T, 6). lengths, curvatures,
            directions: of the pieces of all tubes, one tube after the other, (..., N). radii: at the borders of the
            pieces, (..., N + T).
        stiffnesses, toes, frictions, preslidings: of every wall, (..., H + K + T).
        pieces: number of pieces of every tube. per_length: whether a stiffness is per length, of every wall.
        rigid: whether the walls are rigid. spheres: whether a capsule is a sphere, of every one.
    """

    parameters: ClassVar[dict[str, int]] = {
        **{name: 2 for name in ("points", "bars", "planes", "capsules", "starts")},
        **{name: 1 for name in ("lengths", "curvatures", "directions", "radii", *LAW)},
    }
    straight: ClassVar[dict[str, int]] = {"planes": 4, "capsules": 7}
    bent: ClassVar[type[Tube]] = Tube
    of_pieces: ClassVar[tuple[str, ...]] = ("lengths", "curvatures", "directions")
    base_size: ClassVar[int] = 6
    problem: ClassVar[type[SpatialWallProblem]] = SpatialWallProblem

    points: Tensor
    bars: Tensor
    planes: Tensor
    capsules: Tensor
    starts: Tensor
    lengths: Tensor
    curvatures: Tensor
    directions: Tensor
    radii: Tensor
    stiffnesses: Tensor
    toes: Tensor
    frictions: Tensor
    preslidings: Tensor
    pieces: tuple[int, ...] = ()
    per_length: tuple[bool, ...] = ()
    rigid: bool = False
    spheres: tuple[bool, ...] = ()

    @staticmethod
    def _start(wall: Tube) -> tuple[float, ...]:
        return *wall.start, *wall.tangent

    @classmethod
    def _kept(cls, arrays: Any) -> dict[str, Any]:
        ends = arrays.capsules[0]
        return {"spheres": tuple((ends[:, :3] == ends[:, 3:6]).all(axis=1).tolist())}

    def _sizes(self) -> tuple[Tensor, ...]:
        return self.capsules[..., 6] + 1e-300, self.points[..., 4]

    def tables(self) -> SpatialWallTables:
        """The tables of kernels, with one leading axis, (D, rows, columns)."""
        flat, law = self._flat()
        first, second, radius = flat.capsules.split([3, 3, 1], -1)
        round_ones = torch.tensor(self.spheres, dtype=torch.bool).reshape(-1, 1)
        capsules = torch.cat([first, torch.where(round_ones, first, second), radius, law["capsules"]], -1)
        planes = torch.cat([flat._planes(), law["planes"]], -1)
        return SpatialWallTables(flat.points, flat.bars, planes, capsules, flat._pieces(), law["tubes"])

    def _pieces(self) -> Tensor:
        """Rows of SpatialWalls.pieces, (D, N, 14); as surroundings.tube.carried."""
        rows: list[Tensor] = []
        for number, (lengths, curvatures, directions, radii) in enumerate(self._centre_lines()):
            place, tangent = self.starts[:, number].split(3, -1)
            tangent = tangent / tangent.norm(dim=-1, keepdim=True)
            sideways = _first_side(tangent)
            for k in range(lengths.shape[1]):
                length, curvature, angle = lengths[:, k, None], curvatures[:, k, None], directions[:, k, None]
                normal = torch.cos(angle) * sideways + torch.sin(angle) * torch.linalg.cross(tangent, sideways)
                row = place, tangent, normal, curvature, length, radii[:, k : k + 2], torch.full_like(length, number)
                rows.append(torch.cat(row, -1))
                half = 0.5 * curvature * length
                middle = torch.cos(half) * tangent + torch.sin(half) * normal
                place = place + length * torch.sinc(half / torch.pi) * middle
                cos, sin = torch.cos(2.0 * half), torch.sin(2.0 * half)
                share = (sideways * normal).sum(-1, keepdim=True)  # turns with the tangent; the rest stays
                sideways = sideways + share * ((cos - 1.0) * normal - sin * tangent)
                tangent = cos * tangent + sin * normal
        return torch.stack(rows, 1) if rows else self.starts.new_zeros(len(self.starts), 0, 14)


def _first_side(tangent: Tensor) -> Tensor:
    """The first axis of the frame at the start of a centre line, as surroundings.tube.first_frame, (D, 3)."""
    x, y, _ = torch.eye(3, dtype=tangent.dtype)
    axis = torch.where(tangent.detach()[:, :1].abs() > _ALONG_X, y, x)
    side = axis - (axis * tangent).sum(-1, keepdim=True) * tangent
    return side / side.norm(dim=-1, keepdim=True)
