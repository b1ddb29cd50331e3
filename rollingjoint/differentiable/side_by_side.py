"""Equilibria of many tabulated chains side by side on a device, in a fixed number of passes, without gradients.

The method is that of kernels/lanes.py, pass by pass: Newton's method on the energy where it meets no
difficulty, by the iteration that `newton` has for all solvers. A row that leaves this path has not `arrived`; the
compiled solver takes it from its start. Between the passes nothing is read back from the device, so that a CUDA graph
can hold the whole solve.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rollingjoint.differentiable.loads import Loads
from rollingjoint.differentiable.looking import seen
from rollingjoint.differentiable.newton import Origin, Search, definite, freed, shortened, within
from rollingjoint.differentiable.statics import ChainState, Law
from rollingjoint.differentiable.tabulated import TabulatedChain
from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.arrays import LARGEST_INPUT
from rollingjoint.kernels.lanes import MOST_JOINTS, SHORTEST
from rollingjoint.kernels.rolling import Chain

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
        acting, problem = Loads(loads, starts.shape[-1], only_dead=True), _Tabulated(self.tables)
        angles = within(starts.nan_to_num(), *problem.limits)
        search = Search.begun(angles, (angles,), acting.dead_alone() & _resolvable(commands) & _resolvable(starts))
        for _ in range(self.passes):
            found = self.tables.at(search.x, law, acting)
            search = search.advanced(problem, found, (search.x,))
            if seen(_FEW * search.running.sum() <= len(starts), False):
                break
        responses = problem.factor.solve((found.elastic[..., None] * found.rates).mT * ~search.held[..., None])
        poses = torch.cat([torch.view_as_real(found.positions), found.link_angles[..., None]], -1)
        return Settled(
            search.arrived,
            search.held.any(-1),
            search.x,
            poses,
            found.tensions,
            found.lengths,
            responses,
            torch.view_as_real(found.contacts),
        )


def _resolvable(values: Tensor) -> Tensor:
    """Whether the numbers of a row are finite and in range, (B,)."""
    return (values.abs() <= LARGEST_INPUT).all(-1)


@dataclass
class _Tabulated:
    """The problem of tabulated chains; x are joint angles. Where a stiffness is not definite, its row is left.

    Attributes:
        factor: of the stiffness from which the latest step was taken.
    """

    shortest: ClassVar[float] = SHORTEST
    helps: ClassVar[bool] = False
    tables: TabulatedChain
    factor: _Factor = field(init=False)

    @property
    def limits(self) -> tuple[Tensor, Tensor]:
        """Smallest and largest angle of every joint, (B or 1, J) each [rad]."""
        return self.tables.limits

    def step(self, found: ChainState, held: Tensor) -> tuple[Tensor, Tensor]:
        """See newton.Problem."""
        self.factor = _Factor.of(freed(found.stiffness, held))
        step = self.factor.solve(torch.where(held, 0.0, -found.residual)[..., None])[..., 0]
        return shortened(step), definite(found.stiffness, held, torch.stack(self.factor.pivots, -1))

    def trial(self, origin: Origin, step: Tensor) -> Tensor:
        """See newton.Problem."""
        return within(origin[0] + step, *self.limits)

    def work(self, before: Origin, after: Origin) -> float:
        """See newton.Problem: there is no friction."""
        return 0.0


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
