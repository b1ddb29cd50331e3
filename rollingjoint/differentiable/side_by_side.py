"""Equilibria of many tabulated chains side by side on a device, in a fixed number of passes, without gradients.

The method follows kernels/lanes.py pass by pass: Newton's method on the energy where it meets no difficulty, by the
iteration that `newton` has for all solvers. A row that leaves this path has not `arrived`; the compiled solver takes it
from its start. Joints come from the compiled solver's tables. Between passes no number is read back from the device.

The plane is the complex plane: x + iy. All tensors have one leading axis, rows (B, ...).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rollingjoint.differentiable.geometry import Joints, Routes
from rollingjoint.differentiable.loads import Loads
from rollingjoint.differentiable.looking import seen
from rollingjoint.differentiable.newton import LineSearches, Origin, factored, freed, shortened, within
from rollingjoint.differentiable.statics import ChainState, Law
from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.arrays import LARGEST_INPUT
from rollingjoint.kernels.joints import BUCKETS, N_COEFFICIENTS
from rollingjoint.kernels.lanes import MOST_JOINTS, SHORTEST
from rollingjoint.kernels.rolling import Chain

PASSES = 8
"""Evaluations of all rows in a solve; a warm start takes about five."""

_OF_DESIGNS = ("joints", "buckets", "holes", "channels")

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
        dead_loads, tables = Loads(loads, starts.shape[-1], only_dead=True), self.tables
        angles = within(starts.nan_to_num(), *tables.limits)
        solvable = dead_loads.dead_alone() & _resolvable(commands) & _resolvable(starts)
        search = LineSearches.begun(angles, (angles,), solvable if rows is None else solvable & rows)
        for _ in range(self.passes):
            state = tables.at(search.x, law, dead_loads)
            search = search.advanced(tables, state, (search.x,))
            if seen(_FEW * search.running.sum() <= len(starts), False):
                break
        pulls = (state.elastic[..., None] * state.rates).mT * ~search.held[..., None]
        poses = torch.cat([torch.view_as_real(state.positions), state.link_angles[..., None]], -1)
        return Settled(
            search.arrived,
            search.held.any(-1),
            search.x,
            poses,
            state.tensions,
            state.lengths,
            tables.solved(pulls),
            torch.view_as_real(state.contacts),
        )


def _resolvable(values: Tensor) -> Tensor:
    """Whether the numbers of a row are finite and in range, (B,)."""
    return (values.abs() <= LARGEST_INPUT).all(-1)


@dataclass
class TabulatedChain:
    """Tables of the mechanisms of B rows, a newton.EnergyProblem; x are joint angles.

    A row is left where its stiffness is not definite.

    Attributes:
        joints: smallest and largest angle, buckets per radian, (B or 1, J, 3).
        buckets: first and last cell of every bucket in turn, (B or 1, J, 2 BUCKETS).
        cells: smallest and largest angle, middle, 2 / width, (cells, 4).
        coefficients: of the joint's numbers in powers of a cell's coordinate, (powers, cells, 8).
        routes: of the tendons, leading axis B or 1.
        depth: largest number of cells of a bucket after its first one.
        factor: of the stiffness from which the latest step was taken.
    """

    shortest: ClassVar[float] = SHORTEST
    helps: ClassVar[bool] = False
    joints: Tensor
    buckets: Tensor
    cells: Tensor
    coefficients: Tensor
    routes: Routes
    depth: int
    factor: Tensor = field(init=False)

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

    def step(self, state: ChainState, held: Tensor) -> tuple[Tensor, Tensor]:
        """See newton.EnergyProblem."""
        self.factor, _, definite = factored(freed(state.stiffness, held), held)
        return shortened(self.solved(torch.where(held, 0.0, -state.residual)[..., None])[..., 0]), definite

    def solved(self, right: Tensor) -> Tensor:
        """Solutions for right sides (B, J, k) by the factor; torch.cholesky_solve goes row by row on CUDA if k > 1."""
        below = torch.linalg.solve_triangular(self.factor, right, upper=False)
        return torch.linalg.solve_triangular(self.factor.mT, below, upper=True)

    def trial(self, origin: Origin, step: Tensor) -> Tensor:
        """See newton.EnergyProblem."""
        return within(origin[0] + step, *self.limits)

    def work(self, before: Origin, after: Origin) -> float:
        """See newton.EnergyProblem; zero without friction."""
        return 0.0

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
