"""Chains as the compiled solver's tables on a device, evaluated at joint angles: its numbers to rounding.

The plane is the complex plane: x + iy. Symbols as in docs/theory.md. Everything has one leading axis, rows (B, ...),
without gradients, and nothing here reads a number back from the device.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rollingjoint.differentiable.loads import cross, dot
from rollingjoint.differentiable.transmission import at_limit, limited_tension
from rollingjoint.kernels.arrays import LARGEST_INPUT
from rollingjoint.kernels.rolling import BUCKETS, CLOSED_GAP, N_COEFFICIENTS, Chain
from rollingjoint.load import LOAD_COLUMNS

_COLUMN = {name: i for i, name in enumerate(LOAD_COLUMNS)}
_OTHER_KINDS = [_COLUMN[name] for name in ("bx", "by", "k", "torsion")]  # that only the solver for all cases takes
_OF_DESIGNS = ("joints", "buckets", "holes", "channels")


class DeadLoads(NamedTuple):
    """Dead forces and moments of every row: (B, rows), points and forces complex; beyond (B, rows, J) is 1 or 0."""

    links: Tensor
    points: Tensor  # in the frame of the link, mm
    forces: Tensor  # N
    moments: Tensor  # N·mm
    beyond: Tensor
    usual: Tensor  # (B,) whether nothing else acts

    @classmethod
    def of(cls, table: Tensor, n_joints: int) -> DeadLoads:
        """The loads of tables (B, rows, columns), columns load.LOAD_COLUMNS."""
        points, forces = (torch.complex(table[..., _COLUMN[f"{c}x"]], table[..., _COLUMN[f"{c}y"]]) for c in "pf")
        links = table[..., _COLUMN["link"]].long()
        beyond = (links[..., None] > torch.arange(n_joints, device=table.device)).to(table.dtype)
        plain = torch.stack([table[..., column] == 0.0 for column in _OTHER_KINDS]).all(0)
        usual = (plain & (table.abs() <= LARGEST_INPUT).all(-1)).all(-1)
        return cls(links, points, forces, table[..., _COLUMN["moment"]], beyond, usual)


class ElasticLaw(NamedTuple):
    """Tendon law, (B, m) or (m,) each: tension = clip(stiffness × (length - command), low, high)."""

    command: Tensor
    stiffness: Tensor
    low: Tensor
    high: Tensor


class ChainAtAngles(NamedTuple):
    """Everything evaluated at joint angles (B, J)."""

    link_angles: Tensor  # (B, n) rad
    positions: Tensor  # (B, n) complex, mm
    contacts: Tensor  # (B, J) complex, mm
    lengths: Tensor  # (B, m) mm
    rates: Tensor  # (B, J, m) d length / d angle, mm/rad
    tensions: Tensor  # (B, m) N
    elastic: Tensor  # (B, m) d tension / d length, N/mm
    residual: Tensor  # (B, J) N·mm
    stiffness: Tensor  # (B, J, J) N·mm/rad
    energy: Tensor  # (B,) N·mm
    magnitude: Tensor  # (B,) of the terms of the energy
    scale: Tensor  # (B,) largest sum of the magnitudes of a joint's moments


@dataclass
class TabulatedChain:
    """Tables of the mechanisms of B rows.

    Attributes:
        joints: smallest and largest angle, buckets per radian, (B or 1, J, 3).
        buckets: first and last cell of every bucket in turn, (B or 1, J, 2 BUCKETS).
        cells: smallest and largest angle, middle, 2 / width, (cells, 4).
        coefficients: of the joint's numbers in powers of a cell's coordinate, (powers, cells, 8).
        holes: on the link below and on the link above every gap, complex (B or 1, J, m, 2) [mm].
        channels: constant length inside the links, (B or 1, m) [mm].
        crosses: whether tendon j crosses joint i, (J, m), 1 or 0.
        most: how many cells a bucket reaches beyond its first one.
    """

    joints: Tensor
    buckets: Tensor
    cells: Tensor
    coefficients: Tensor
    holes: Tensor
    channels: Tensor
    crosses: Tensor
    most: int

    @classmethod
    def of(cls, arrays: Chain, designs: NDArray[np.int64], device: torch.device | str) -> TabulatedChain:
        """The tables of a stack of designs, of which every row has one."""
        chosen = slice(None) if len(arrays.joints) == 1 else designs
        joints, buckets, holes, channels = (getattr(arrays, name)[chosen] for name in _OF_DESIGNS)
        crosses = np.arange(joints.shape[1])[:, None] < arrays.tendon_joints
        low_high, first_cells, cells = (
            torch.tensor(values, device=device) for values in (joints, buckets, arrays.cells)
        )
        return cls(
            low_high,
            first_cells,
            cells,
            torch.tensor(np.moveaxis(arrays.coefficients, 1, 0), device=device).contiguous(),
            _complex_pairs(holes, device),
            torch.tensor(channels, device=device),
            torch.tensor(crosses, dtype=torch.float64, device=device),
            int((arrays.buckets[..., 1::2] - arrays.buckets[..., ::2]).max(initial=0)),
        )

    def put(self, rows: NDArray[np.int64], arrays: Chain) -> None:
        """Replace the tables of some rows, of a stack in which every row has a design of its own."""
        device, count = self.cells.device, len(arrays.joints)
        at = torch.as_tensor(rows, device=device)
        per_design = len(arrays.cells) // count
        for name in ("joints", "buckets", "channels"):
            getattr(self, name)[at] = torch.tensor(getattr(arrays, name)[rows], device=device)
        self.holes[at] = _complex_pairs(arrays.holes[rows], device)
        cells = arrays.cells.reshape(count, per_design, -1)[rows]
        self.cells.view(count, per_design, -1)[at] = torch.tensor(cells, device=device)
        coefficients = arrays.coefficients.reshape(count, per_design, N_COEFFICIENTS, 8)[rows]
        mine = self.coefficients.view(N_COEFFICIENTS, count, per_design, 8)
        mine[:, at] = torch.tensor(np.moveaxis(coefficients, 2, 0), device=device)

    @property
    def limits(self) -> tuple[Tensor, Tensor]:
        """Smallest and largest angle of every joint, (B or 1, J) each [rad]."""
        return self.joints[..., 0], self.joints[..., 1]

    def at(self, angles: Tensor, law: ElasticLaw, loads: DeadLoads) -> ChainAtAngles:
        """Everything at joint angles (B, J) [rad]."""
        turn, touching, origin, pole = self._joints(angles)
        link_angles = torch.nn.functional.pad(torch.cumsum(angles, -1), (1, 0))
        rotations = torch.polar(torch.ones_like(link_angles), link_angles)
        below = rotations[:, :-1]
        positions = torch.nn.functional.pad(torch.cumsum(below * origin, -1), (1, 0))
        contacts, pole_rates = positions[:, :-1] + below * touching, below * pole
        gap, rates, bends = self._gaps(turn, touching, origin, pole)
        lengths = self.channels + gap.sum(-2)
        tensions, elastic, energy, magnitude = _pulled(law, lengths)
        work, forces, moments, levers = _loaded(loads, positions, rotations, link_angles)
        moment = moments - cross(contacts, forces)
        torques = tensions[:, None, :] * rates
        own = cross(pole_rates, forces) + (tensions[:, None, :] * bends).sum(-1)
        sizes = torch.maximum(torques.abs(), tensions[:, None, :] * self.crosses).sum(-1) + moment.abs()
        return ChainAtAngles(
            link_angles,
            positions,
            contacts,
            lengths.expand_as(tensions),
            rates,
            tensions,
            elastic,
            torques.sum(-1) - moment,
            _stiffness(levers - dot(contacts, forces), rates, elastic, own),
            energy + work.sum(-1),
            magnitude + work.abs().sum(-1),
            sizes.amax(-1),
        )

    def _joints(self, angles: Tensor) -> tuple[Tensor, ...]:
        """Turn, contact point, origin of the next link and rate of the contact of every joint, complex (B, J) each."""
        low, per_radian = self.joints[..., 0], self.joints[..., 2]
        bucket = ((angles - low) * per_radian).nan_to_num(0.0).clamp(0.0, BUCKETS - 1.0).long()[..., None]
        buckets = self.buckets.expand(len(angles), -1, -1)
        first, last = buckets.gather(-1, 2 * bucket)[..., 0], buckets.gather(-1, 2 * bucket + 1)[..., 0]
        for _ in range(self.most.bit_length()):  # halves the cells of the bucket that are still possible
            middle = (first + last + 1) // 2
            beyond = angles >= self.cells[middle, 0]
            first, last = torch.where(beyond, middle, first), torch.where(beyond, last, middle - 1)
            last = torch.maximum(first, last)
        flat = first.flatten()
        place = self.cells.index_select(0, flat)
        u = ((angles.flatten() - place[:, 2]) * place[:, 3])[:, None]
        values = self.coefficients[-1].index_select(0, flat)
        for power in range(len(self.coefficients) - 2, -1, -1):
            values = torch.addcmul(self.coefficients[power].index_select(0, flat), values, u)
        return torch.view_as_complex(values.view(*angles.shape, 4, 2)).unbind(-1)

    def _gaps(self, turn: Tensor, touching: Tensor, origin: Tensor, pole: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Length of every gap and its first two derivatives in the joint's angle, (B, J, m), 0 where none is."""
        below, above = self.holes.unbind(-1)
        v = origin[..., None] + turn[..., None] * above - below
        length = v.abs()
        closed = length <= CLOSED_GAP
        per_length = torch.where(closed, 0.0, 1.0 / torch.where(closed, 1.0, length))
        normal = (-1j * pole / pole.abs())[..., None]  # the contact moves against the tangent
        direction = torch.where(closed, normal, v * per_length)
        moves = 1j * (below + length * direction - touching[..., None])
        along = dot(direction, moves)
        turned = (moves.real.square() + moves.imag.square() - along.square()) * per_length
        bends = turned - cross(direction, moves - pole[..., None])
        return length * self.crosses, along * self.crosses, bends * self.crosses


def _pulled(law: ElasticLaw, lengths: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Tensions, d tension / d length, (B, m) each; their energy and the magnitude of its terms, (B,)."""
    stretch = lengths - law.command
    pull = law.stiffness * stretch
    tensions = limited_tension(pull, law.low, law.high)
    terms = tensions * stretch - 0.5 * tensions * tensions / law.stiffness
    elastic = torch.where(at_limit(pull, law.low, law.high), 0.0, law.stiffness)
    return tensions, elastic, terms.sum(-1), (terms.abs() + (tensions * lengths).abs()).sum(-1)


def _loaded(loads: DeadLoads, positions: Tensor, rotations: Tensor, link_angles: Tensor) -> tuple[Tensor, ...]:
    """Energy of every load, (B, rows); of the loads beyond every joint, (B, J): force, moment about 0, sum of x · F."""
    x = positions.gather(-1, loads.links) + rotations.gather(-1, loads.links) * loads.points
    energies = -dot(loads.forces, x) - loads.moments * link_angles.gather(-1, loads.links)
    columns = torch.stack([loads.forces.real, loads.forces.imag, cross(x, loads.forces) + loads.moments], -2)
    columns = torch.cat([columns, dot(x, loads.forces)[:, None]], -2)
    fx, fy, moments, levers = (columns[..., None] * loads.beyond[:, None]).sum(-2).unbind(-2)
    return energies, torch.complex(fx, fy), moments, levers


def _stiffness(levers: Tensor, rates: Tensor, elastic: Tensor, own: Tensor) -> Tensor:
    """H, (B, J, J): levers of the dead forces, the elastic tendons, and what every joint has of its own, (B, J)."""
    joints = torch.arange(levers.shape[-1], device=levers.device)
    later = torch.maximum(joints[:, None], joints)
    H = levers[:, later] + (elastic[:, None, None, :] * rates[:, :, None, :] * rates[:, None, :, :]).sum(-1)
    return H + torch.diag_embed(own)


def _complex_pairs(holes: NDArray[np.float64], device: torch.device | str) -> Tensor:
    pairs = torch.tensor(holes, device=device)
    return torch.view_as_complex(pairs.view(*holes.shape[:-1], 2, 2))
