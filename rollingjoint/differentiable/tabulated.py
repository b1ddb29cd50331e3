"""Joints as the compiled solver's tables on a device, evaluated at joint angles: its numbers to rounding.

The plane is the complex plane: x + iy. Symbols as in docs/theory.md. All tensors have one leading axis, rows (B, ...),
without gradients, and no number is read back from the device.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rollingjoint.differentiable.geometry import Joints, Routes
from rollingjoint.differentiable.loads import Loads
from rollingjoint.differentiable.statics import ChainState, Law
from rollingjoint.kernels.joints import BUCKETS, N_COEFFICIENTS
from rollingjoint.kernels.rolling import Chain

_OF_DESIGNS = ("joints", "buckets", "holes", "channels")


@dataclass
class TabulatedChain:
    """Tables of the mechanisms of B rows.

    Attributes:
        joints: smallest and largest angle, buckets per radian, (B or 1, J, 3).
        buckets: first and last cell of every bucket in turn, (B or 1, J, 2 BUCKETS).
        cells: smallest and largest angle, middle, 2 / width, (cells, 4).
        coefficients: of the joint's numbers in powers of a cell's coordinate, (powers, cells, 8).
        routes: of the tendons, leading axis B or 1.
        depth: largest number of cells of a bucket after its first one.
    """

    joints: Tensor
    buckets: Tensor
    cells: Tensor
    coefficients: Tensor
    routes: Routes
    depth: int

    @classmethod
    def of(cls, arrays: Chain, designs: NDArray[np.int64], device: torch.device | str) -> TabulatedChain:
        """The tables of a stack of designs, one design per row."""
        selection = slice(None) if len(arrays.joints) == 1 else designs
        joints, buckets, holes, channels = (getattr(arrays, name)[selection] for name in _OF_DESIGNS)
        crosses = np.arange(joints.shape[1]) < arrays.tendon_joints[:, None]
        low_high, first_cells, cells = (
            torch.tensor(values, device=device) for values in (joints, buckets, arrays.cells)
        )
        return cls(
            low_high,
            first_cells,
            cells,
            torch.tensor(np.moveaxis(arrays.coefficients, 1, 0), device=device).contiguous(),
            Routes(
                *_below_and_above(holes, device),
                torch.tensor(crosses, dtype=torch.float64, device=device),
                torch.tensor(channels, device=device),
            ),
            int((arrays.buckets[..., 1::2] - arrays.buckets[..., ::2]).max(initial=0)),
        )

    def put(self, rows: NDArray[np.int64], arrays: Chain) -> None:
        """Replace the tables of some rows, in a stack with one design per row."""
        device, count = self.cells.device, len(arrays.joints)
        at = torch.as_tensor(rows, device=device)
        per_design = len(arrays.cells) // count
        for name in ("joints", "buckets"):
            getattr(self, name)[at] = torch.tensor(getattr(arrays, name)[rows], device=device)
        self.routes.channels[at] = torch.tensor(arrays.channels[rows], device=device)
        self.routes.below[at], self.routes.above[at] = _below_and_above(arrays.holes[rows], device)
        cells = arrays.cells.reshape(count, per_design, -1)[rows]
        self.cells.view(count, per_design, -1)[at] = torch.tensor(cells, device=device)
        coefficients = arrays.coefficients.reshape(count, per_design, N_COEFFICIENTS, 8)[rows]
        table = self.coefficients.view(N_COEFFICIENTS, count, per_design, 8)
        table[:, at] = torch.tensor(np.moveaxis(coefficients, 2, 0), device=device)

    @property
    def limits(self) -> tuple[Tensor, Tensor]:
        """Smallest and largest angle of every joint, (B or 1, J) each [rad]."""
        return self.joints[..., 0], self.joints[..., 1]

    def at(self, angles: Tensor, law: Law, loads: Loads) -> ChainState:
        """The chains at joint angles (B, J) [rad]."""
        return ChainState(self.routes, law, loads, angles, self._joints(angles))

    def _joints(self, angles: Tensor) -> Joints:
        low, per_radian = self.joints[..., 0], self.joints[..., 2]
        bucket = ((angles - low) * per_radian).nan_to_num(0.0).clamp(0.0, BUCKETS - 1.0).long()[..., None]
        buckets = self.buckets.expand(len(angles), -1, -1)
        first, last = buckets.gather(-1, 2 * bucket)[..., 0], buckets.gather(-1, 2 * bucket + 1)[..., 0]
        for _ in range(self.depth.bit_length()):  # halves the cells of the bucket that are still possible
            middle = (first + last + 1) // 2
            upper = angles >= self.cells[middle, 0]
            first, last = torch.where(upper, middle, first), torch.where(upper, last, middle - 1)
            last = torch.maximum(first, last)
        flat = first.flatten()
        place = self.cells.index_select(0, flat)
        u = ((angles.flatten() - place[:, 2]) * place[:, 3])[:, None]
        values = self.coefficients[-1].index_select(0, flat)
        for power in range(len(self.coefficients) - 2, -1, -1):
            values = torch.addcmul(self.coefficients[power].index_select(0, flat), values, u)
        turn, touching, origin, pole = torch.view_as_complex(values.view(*angles.shape, 4, 2)).unbind(-1)
        return Joints(turn, touching, origin, pole / -pole.abs(), pole)  # the contact moves against the tangent


def _below_and_above(holes: NDArray[np.float64], device: torch.device | str) -> tuple[Tensor, Tensor]:
    """Holes (B or 1, J, m, 4) as two complex tensors, (B or 1, m, J) each [mm]."""
    pairs = torch.tensor(np.swapaxes(holes, 1, 2), device=device)
    below, above = torch.view_as_complex(pairs.view(*pairs.shape[:-1], 2, 2)).unbind(-1)
    return below.contiguous(), above.contiguous()
