"""Equilibria of many tabulated chains side by side on a device, in a fixed number of passes, without gradients.

The method follows kernels/lanes.py pass by pass: Newton's method on the energy where it meets no difficulty, by the
iteration that `newton` has for all solvers. A row that leaves this path has not `arrived`; the compiled solver takes it
from its start. No number is read back from the device between the passes: a CUDA graph can hold the whole solve.
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
from rollingjoint.differentiable.newton import LineSearches, Origin, definite, freed, shortened, within
from rollingjoint.differentiable.statics import ChainState, Law
from rollingjoint.differentiable.tabulated import TabulatedChain
from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.arrays import LARGEST_INPUT
from rollingjoint.kernels.lanes import MOST_JOINTS, SHORTEST
from rollingjoint.kernels.rolling import Chain

PASSES = 8
"""Evaluations of all rows in a solve; a warm start takes about five."""

_FEW = 64  # on the CPU a solve ends with one row in _FEW running: other solvers are faster for the remaining rows


class Settled(NamedTuple):
    """Equilibria of B rows; the numbers of a row that has not arrived are meaningless."""

    arrived: Tensor  # (B,)
    held: Tensor  # (B,) whether a joint is held at the end of its surface
    joint_angles: Tensor  # (B, J) rad
    poses: Tensor  # (B, n, 3) mm, mm, rad
    tensions: Tensor  # (B, m) N
    lengths: Tensor  # (B, m) mm
    responses: Tensor  # (B, J, m) d joint angle / d command, rad/mm
    contacts: Tensor  # (B, J, 2) contact points, mm


class SideBySide:
    """A solver of B rows on a device, each with its mechanism, for many solves.

    Args:
        arrays: a stack of designs, the `arrays` of a mechanism or the result of `chain.stacks.stack` for several.
        designs: index of the design of each row, (B,).
        device: of all tensors.
        passes: number of evaluations in a solve; on the CPU it ends when nearly every row is done.
    Raises:
        InvalidInput: chains of more than 15 joints, or with springs.
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
        """Replace the mechanisms of some rows, in a stack with one design per row."""
        self.tables.put(rows, arrays)

    @torch.no_grad()
    def solve(
        self,
        commands: Tensor,
        stiffnesses: Tensor,
        tension_limits: tuple[Tensor, Tensor],
        loads: Tensor,
        starts: Tensor,
        rows: Tensor | None = None,
    ) -> Settled:
        """Equilibria under commanded lengths.

        Args:
            commands: unstretched lengths, (B, m) [mm].
            stiffnesses: of the tendons, (B, m) [N/mm].
            tension_limits: minimum and maximum tendon tension, (m,) or (B, m) each [N].
            loads: load tables, (B, rows, columns), columns load.LOAD_COLUMNS.
            starts: joint angles to start from, (B, J) [rad].
            rows: whether to solve a row, (B,) bool; None: all. Others have not arrived.
        """
        law = Law(commands, stiffnesses, *tension_limits)
        dead_loads, problem = Loads(loads, starts.shape[-1], only_dead=True), _TabulatedProblem(self.tables)
        angles = within(starts.nan_to_num(), *problem.limits)
        solvable = dead_loads.dead_alone() & _resolvable(commands) & _resolvable(starts)
        search = LineSearches.begun(angles, (angles,), solvable if rows is None else solvable & rows)
        for _ in range(self.passes):
            state = self.tables.at(search.x, law, dead_loads)
            search = search.advanced(problem, state, (search.x,))
            if seen(_FEW * search.running.sum() <= len(starts), False):
                break
        responses = problem.factor.solve((state.elastic[..., None] * state.rates).mT * ~search.held[..., None])
        poses = torch.cat([torch.view_as_real(state.positions), state.link_angles[..., None]], -1)
        return Settled(
            search.arrived,
            search.held.any(-1),
            search.x,
            poses,
            state.tensions,
            state.lengths,
            responses,
            torch.view_as_real(state.contacts),
        )


def _resolvable(values: Tensor) -> Tensor:
    """Whether the numbers of a row are finite and in range, (B,)."""
    return (values.abs() <= LARGEST_INPUT).all(-1)


@dataclass
class _TabulatedProblem:
    """The problem of tabulated chains; x are joint angles. A row is left where its stiffness is not definite.

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

    def step(self, state: ChainState, held: Tensor) -> tuple[Tensor, Tensor]:
        """See newton.EnergyProblem."""
        self.factor = _Factor.of(freed(state.stiffness, held))
        step = self.factor.solve(torch.where(held, 0.0, -state.residual)[..., None])[..., 0]
        return shortened(step), definite(state.stiffness, held, torch.stack(self.factor.pivots, -1))

    def trial(self, origin: Origin, step: Tensor) -> Tensor:
        """See newton.EnergyProblem."""
        return within(origin[0] + step, *self.limits)

    def work(self, before: Origin, after: Origin) -> float:
        """See newton.EnergyProblem; zero without friction."""
        return 0.0


class _Factor(NamedTuple):
    """L D Lᵀ of a symmetric matrix (B, J, J)."""

    columns: list[Tensor]  # below the diagonal of L, (B, J - 1 - k) each
    pivots: list[Tensor]  # D, (B,) each

    @classmethod
    def of(cls, matrix: Tensor) -> _Factor:
        """The factor, column by column, without library calls, which report errors to the host."""
        columns, pivots, remainder = [], [], matrix
        for _ in range(matrix.shape[-1]):
            pivot, below = remainder[:, 0, 0], remainder[:, 1:, 0]
            column = below / pivot[:, None]
            remainder = remainder[:, 1:, 1:] - column[:, :, None] * below[:, None, :]
            columns.append(column)
            pivots.append(pivot)
        return cls(columns, pivots)

    def solve(self, right: Tensor) -> Tensor:
        """The solutions for right sides (B, J, k)."""
        forward: list[Tensor] = []
        remainder = right
        for column in self.columns:
            forward.append(remainder[:, 0])
            remainder = remainder[:, 1:] - column[:, :, None] * remainder[:, :1]
        solution = right[:, :0]
        for value, column, pivot in zip(forward[::-1], self.columns[::-1], self.pivots[::-1], strict=True):
            last = value / pivot[:, None] - (column[:, :, None] * solution).sum(1)
            solution = torch.cat([last[:, None], solution], 1)
        return solution
