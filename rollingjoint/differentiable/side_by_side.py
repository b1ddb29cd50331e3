"""Equilibria of many tabulated chains side by side on a device, in a fixed number of passes, without gradients.

The method is that of kernels/lanes.py, pass by pass: Newton's method on the energy where it meets no
difficulty. A row that leaves this path has not `arrived`; the compiled solver takes it from its start.
Between the passes nothing is read back from the device, so that a CUDA graph can hold the whole solve.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rollingjoint.differentiable.looking import seen
from rollingjoint.differentiable.tabulated import ChainAtAngles, DeadLoads, ElasticLaw, TabulatedChain
from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.arrays import (
    LARGEST_INPUT,
    MAX_STEP,
    NEGLIGIBLE,
    RELATIVE_GOAL,
    RESIDUAL_FLOOR,
    RESIDUAL_GOAL,
    ROUNDING,
    SMALLEST_PIVOT,
)
from rollingjoint.kernels.lanes import MOST_JOINTS, SHORTEST
from rollingjoint.kernels.rolling import Chain

PASSES = 8
"""Evaluations of all rows in a solve; a warm start takes about five."""

_AT_END = 1e-13  # rad
_FEW = 64  # on the CPU a solve ends when one row in so many is still running: alone they are solved faster elsewhere


class Settled(NamedTuple):
    """Equilibria of B rows; where a row has not arrived, numbers that mean nothing."""

    arrived: Tensor  # (B,)
    held: Tensor  # (B,) whether a joint is held at the end of its surface
    joint_angles: Tensor  # (B, J) rad
    poses: Tensor  # (B, n, 3) mm, mm, rad
    tensions: Tensor  # (B, m) N
    lengths: Tensor  # (B, m) mm
    responses: Tensor  # (B, J, m) d joint angle / d command, rad/mm
    contacts: Tensor  # (B, J, 2) where links touch, mm


class SideBySide:
    """A solver of B rows on a device, each with its mechanism, which are solved again and again.

    Args:
        arrays: a stack of designs, the `arrays` of a mechanism or what `chain.stacks.stack` makes of several.
        designs: which of them each row has, (B,).
        device: where everything is.
        passes: how many evaluations a solve has; on the CPU it ends when nearly every row is done.
    Raises:
        InvalidInput: chains of more than 15 joints, or with springs of their own.
    """

    most_joints: ClassVar[int] = MOST_JOINTS

    def __init__(
        self, arrays: Chain, designs: NDArray[np.int64], device: torch.device | str = "cpu", passes: int = PASSES
    ) -> None:
        if arrays.joints.shape[1] > MOST_JOINTS:
            raise InvalidInput("number of joints", arrays.joints.shape[1], f"{MOST_JOINTS} at most")
        if arrays.standing.shape[1] > 0:
            raise InvalidInput("number of springs of the mechanism", arrays.standing.shape[1], "0")
        self.tables = TabulatedChain.of(arrays, designs, device)
        self.passes = passes

    def put(self, rows: NDArray[np.int64], arrays: Chain) -> None:
        """Replace the mechanisms of some rows, of a stack in which every row has a design of its own."""
        self.tables.put(rows, arrays)

    @torch.no_grad()
    def solve(
        self,
        commands: Tensor,
        stiffnesses: Tensor,
        tension_limits: tuple[Tensor, Tensor],
        loads: Tensor,
        starts: Tensor,
    ) -> Settled:
        """Equilibria under commanded lengths.

        Args:
            commands: unstretched lengths, (B, m) [mm].
            stiffnesses: of the tendons, (B, m) [N/mm].
            tension_limits: minimum and maximum tendon tension, (m,) or (B, m) each [N].
            loads: load tables, (B, rows, columns), columns load.LOAD_COLUMNS.
            starts: joint angles to start from, (B, J) [rad].
        """
        law = ElasticLaw(commands, stiffnesses, *tension_limits)
        dead = DeadLoads.of(loads, starts.shape[-1])
        search = _Search.begun(self.tables, starts, dead.usual & _resolvable(commands) & _resolvable(starts))
        for _ in range(self.passes):
            found = self.tables.at(search.angles, law, dead)
            search, factor, free = search.advanced(found, self.tables.limits)
            if seen(_FEW * search.running.sum() <= len(starts), False):
                break
        responses = factor.solve(found.elastic[:, None, :] * found.rates * free[..., None])
        angles = search.angles
        xy = torch.view_as_real(found.positions)
        poses = torch.cat([xy, found.link_angles[..., None]], -1)
        contacts = torch.view_as_real(found.contacts)
        return Settled(search.arrived, search.held, angles, poses, found.tensions, found.lengths, responses, contacts)


def _resolvable(values: Tensor) -> Tensor:
    """Whether the numbers of a row are finite and in range, (B,)."""
    return (values.abs() <= LARGEST_INPUT).all(-1)


@dataclass(frozen=True)
class _Search:
    """Where every row is in its line search: (B,) and (B, J); a row that neither runs nor has arrived is left."""

    running: Tensor
    arrived: Tensor
    held: Tensor
    angles: Tensor  # to be evaluated next
    origin: Tensor  # angles and residual where the line search began, and its step
    residual: Tensor
    step: Tensor
    energy: Tensor
    magnitude: Tensor
    worst: Tensor
    part: Tensor  # of the step that is tried

    @classmethod
    def begun(cls, tables: TabulatedChain, starts: Tensor, usual: Tensor) -> _Search:
        """From these starts; rows that are not usual are left at once. The first evaluation is always accepted."""
        low, high = tables.limits
        angles = torch.minimum(torch.maximum(starts.nan_to_num(), low), high)
        none, nothing = torch.zeros_like(usual), torch.zeros_like(angles)
        zero, one = torch.zeros_like(angles[:, 0]), torch.ones_like(angles[:, 0])
        return cls(usual, none, none, angles, angles, nothing, nothing, one * torch.inf, zero, zero, one)

    def advanced(self, found: ChainAtAngles, limits: tuple[Tensor, Tensor]) -> tuple[_Search, _Factor, Tensor]:
        """The next angles of every row, from what was found at these: another step, a shorter one, or the end.

        Returns also the factor of the stiffness there, and which joints are free, (B, J) of 1 and 0.
        """
        low, high = limits
        r, angles = found.residual, self.angles
        at_end = (angles <= low + _AT_END) & (r > 0.0) | (angles >= high - _AT_END) & (r < 0.0)
        worst = torch.where(at_end, 0.0, r.abs()).amax(-1)
        slope = (self.residual * (angles - self.origin)).sum(-1)
        noise, fall = ROUNDING * (self.magnitude + found.magnitude), self.energy - found.energy
        accepted = (fall > noise) & (fall >= -1e-4 * slope) | (fall >= -noise) & (worst < self.worst)
        accepted = accepted & self.running
        factor = _Factor.of(found.stiffness, at_end)
        stable = factor.stable(at_end)
        goal = (RELATIVE_GOAL * found.scale).clamp(RESIDUAL_FLOOR, RESIDUAL_GOAL)
        at_rest = accepted & (worst <= goal)
        free = (~at_end).to(r.dtype)

        part = torch.where(accepted, 1.0, 0.5 * self.part)
        running = self.running & ~at_rest & (stable | ~accepted) & (part >= SHORTEST)
        whole = factor.solve((-r * free)[..., None])[..., 0]
        whole = whole * (MAX_STEP / whole.abs().amax(-1, keepdim=True).clamp(min=MAX_STEP))
        taken = accepted[:, None]
        step, origin = torch.where(taken, whole, self.step), torch.where(taken, angles, self.origin)
        trial = torch.minimum(torch.maximum(origin + part[:, None] * step, low), high)
        search = _Search(
            running,
            self.arrived | at_rest & stable,
            torch.where(accepted, at_end.any(-1), self.held),
            torch.where(running[:, None], trial, angles),
            origin,
            torch.where(taken, r, self.residual),
            step,
            torch.where(accepted, found.energy, self.energy),
            torch.where(accepted, found.magnitude, self.magnitude),
            torch.where(accepted, worst, self.worst),
            part,
        )
        return search, factor, free


class _Factor(NamedTuple):
    """L D Lᵀ of a stiffness in which rows and columns of held joints are those of the identity."""

    columns: list[Tensor]  # below the diagonal of L, (B, J - 1 - k) each
    pivots: list[Tensor]  # D, (B,) each
    largest: Tensor  # of the diagonal over the free joints, (B,)

    @classmethod
    def of(cls, H: Tensor, held: Tensor) -> _Factor:
        """The factor, column by column: no library call that would have to report an error to the host."""
        either = held[:, :, None] | held[:, None, :]
        rest = torch.where(either, 0.0, H) + torch.diag_embed(held.to(H.dtype))
        largest = torch.where(held, 0.0, H.diagonal(dim1=-2, dim2=-1).abs()).amax(-1)
        columns, pivots = [], []
        for _ in range(H.shape[-1]):
            pivot, below = rest[:, 0, 0], rest[:, 1:, 0]
            column = below / pivot[:, None]
            rest = rest[:, 1:, 1:] - column[:, :, None] * below[:, None, :]
            columns.append(column)
            pivots.append(pivot)
        return cls(columns, pivots, largest)

    def stable(self, held: Tensor) -> Tensor:
        """Whether the stiffness of the free joints is positive definite beyond rounding, (B,)."""
        smallest = torch.where(held, torch.inf, torch.stack(self.pivots, -1)).amin(-1)
        return (smallest > SMALLEST_PIVOT * self.largest) & (self.largest >= NEGLIGIBLE)

    def solve(self, right: Tensor) -> Tensor:
        """The solutions for right sides (B, J, k)."""
        forward: list[Tensor] = []
        rest = right
        for column in self.columns:
            forward.append(rest[:, 0])
            rest = rest[:, 1:] - column[:, :, None] * rest[:, :1]
        found = right[:, :0]
        for value, column, pivot in zip(forward[::-1], self.columns[::-1], self.pivots[::-1], strict=True):
            last = value / pivot[:, None] - (column[:, :, None] * found).sum(1)
            found = torch.cat([last[:, None], found], 1)
        return found
