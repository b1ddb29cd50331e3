"""Equilibria of many tabulated chains side by side on a device, in a fixed number of passes, without gradients.

The method is that of kernels/shared/lanes.py, pass by pass: Newton's method on the energy where it meets no
difficulty. A row that leaves this path has not `arrived`; the compiled solver takes it from its start.
Between the passes nothing is read back from the device, so that a CUDA graph can hold the whole solve.

Formulas and rules are those of `statics` and `newton`. The loop is another one than there, because its rows have to
take the path of the compiled lanes, and a pass may cost one evaluation: it holds a step instead of a stiffness, its
trials lie at joint angles instead of contacts, and where the stiffness is not definite a row is left instead of helped.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rollingjoint.differentiable.loads import Loads
from rollingjoint.differentiable.looking import seen
from rollingjoint.differentiable.newton import (
    definite,
    freed,
    improves,
    largest_free,
    pressed,
    residual_goal,
    shortened,
    within,
)
from rollingjoint.differentiable.statics import ChainState, Law
from rollingjoint.differentiable.tabulated import TabulatedChain
from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.planar.arrays import Chain
from rollingjoint.kernels.shared.lanes import MOST_JOINTS, SHORTEST
from rollingjoint.kernels.shared.tolerances import LARGEST_INPUT, ROUNDING

PASSES = 8
"""Evaluations of all rows in a solve; a warm start takes about five."""

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
        law = Law(commands, stiffnesses, *tension_limits)
        acting = Loads(loads, starts.shape[-1], only_dead=True)
        search = _Search.begun(self.tables, starts, acting.dead_alone() & _resolvable(commands) & _resolvable(starts))
        for _ in range(self.passes):
            found = self.tables.at(search.angles, law, acting)
            search, factor, free = search.advanced(found, self.tables.limits)
            if seen(_FEW * search.running.sum() <= len(starts), False):
                break
        responses = factor.solve((found.elastic[..., None] * found.rates).mT * free[..., None])
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
        angles = within(starts.nan_to_num(), low, high)
        none, nothing = torch.zeros_like(usual), torch.zeros_like(angles)
        zero, one = torch.zeros_like(angles[:, 0]), torch.ones_like(angles[:, 0])
        return cls(usual, none, none, angles, angles, nothing, nothing, one * torch.inf, zero, zero, one)

    def advanced(self, found: ChainState, limits: tuple[Tensor, Tensor]) -> tuple[_Search, _Factor, Tensor]:
        """The next angles of every row, from what was found at these: another step, a shorter one, or the end.

        Returns also the factor of the stiffness there, and which joints are free, (B, J) of 1 and 0.
        """
        low, high = limits
        r, angles = found.residual, self.angles
        at_end = pressed(angles, low, high, r)
        worst, (energy, magnitude) = largest_free(r, at_end), found.energy
        slope = (self.residual * (angles - self.origin)).sum(-1)
        fall, noise = self.energy - energy, ROUNDING * (self.magnitude + magnitude)
        accepted = improves(fall, slope, noise, worst, self.worst) & self.running
        factor = _Factor.of(freed(found.stiffness, at_end))
        stable = definite(found.stiffness, at_end, torch.stack(factor.pivots, -1))
        goal = residual_goal(found.force_scale)
        at_rest = accepted & (worst <= goal)
        free = (~at_end).to(r.dtype)

        part = torch.where(accepted, 1.0, 0.5 * self.part)
        running = self.running & ~at_rest & (stable | ~accepted) & (part >= SHORTEST)
        whole = shortened(factor.solve((-r * free)[..., None])[..., 0])
        taken = accepted[:, None]
        step, origin = torch.where(taken, whole, self.step), torch.where(taken, angles, self.origin)
        trial = within(origin + part[:, None] * step, low, high)
        search = _Search(
            running,
            self.arrived | at_rest & stable,
            torch.where(accepted, at_end.any(-1), self.held),
            torch.where(running[:, None], trial, angles),
            origin,
            torch.where(taken, r, self.residual),
            step,
            torch.where(accepted, energy, self.energy),
            torch.where(accepted, magnitude, self.magnitude),
            torch.where(accepted, worst, self.worst),
            part,
        )
        return search, factor, free


class _Factor(NamedTuple):
    """L D Lᵀ of a symmetric matrix (B, J, J)."""

    columns: list[Tensor]  # below the diagonal of L, (B, J - 1 - k) each
    pivots: list[Tensor]  # D, (B,) each

    @classmethod
    def of(cls, matrix: Tensor) -> _Factor:
        """The factor, column by column: no library call that would have to report an error to the host."""
        columns, pivots, rest = [], [], matrix
        for _ in range(matrix.shape[-1]):
            pivot, below = rest[:, 0, 0], rest[:, 1:, 0]
            column = below / pivot[:, None]
            rest = rest[:, 1:, 1:] - column[:, :, None] * below[:, None, :]
            columns.append(column)
            pivots.append(pivot)
        return cls(columns, pivots)

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
