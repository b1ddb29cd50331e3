"""Rollouts of many lanes in compiled code that torch differentiates by the policy and by the design.

The policy is differentiated step by step, with the derivatives of the equilibria by the commands in NumPy. What the
outputs of all steps weigh in the loss then goes back to the design by one adjoint solve of one batch
(`rollingjoint.differentiable.of_solutions`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd.function import once_differentiable

from rollingjoint.chain.solution import stacked
from rollingjoint.differentiable import Equilibria, WalledEquilibria, link_contact, of_solutions
from rollingjoint.statics.sensitivity import dposes_dlengths

Array = NDArray[np.float64]


class RolloutState(NamedTuple):
    """What a step of B lanes leaves, and later observations and the loss may depend on.

    Fields: joint angles (B, J) [rad]; tensions, commands (B, m) [N, mm]; the tip in the frame of the base, (B, 2) [mm];
    forces of the walls on the links (B, n, 2) [N], zeros without walls.
    """

    angles: Tensor
    tensions: Tensor
    commands: Tensor
    tip: Tensor
    forces: Tensor


class RolloutStep:
    """A step of B lanes: its equilibria, its commands (B, m), and the weights of its outputs that `backward` leaves."""

    def __init__(self, solution: Any, commands: Tensor, stiffnesses: Array) -> None:
        self.solution, self.commands, self._stiffnesses = solution, commands.detach(), stiffnesses
        self.weights: Tensor | None = None

    def outputs(self) -> Tensor:
        """The state, flat, (B, outputs)."""
        found = self.solution
        commands = found.lengths - found.tensions / self._stiffnesses
        forces = found.wall_forces[..., :2].reshape(len(commands), -1)
        parts = found.joint_angles, found.tensions, commands, found.tip, forces
        return torch.tensor(np.concatenate(parts, axis=-1))

    def rates(self) -> Tensor:
        """d outputs / d commands, (B, outputs, m)."""
        found, poses = self.solution, dposes_dlengths(self.solution)
        angles = np.diff(poses[:, :, 2], axis=1)
        lengths = np.swapaxes(found.tendon_rates, -1, -2) @ angles
        tensions = found.tendon_stiffness[..., None] * (lengths - np.eye(lengths.shape[-1]))
        commands = lengths - tensions / self._stiffnesses[:, None]
        x, y = found.poses[..., 0, None], found.poses[..., 1, None]
        turn = poses[:, :, 2]
        motion = np.stack([poses[:, :, 0] + turn * y, poses[:, :, 1] - turn * x, turn], axis=2)
        forces = -(link_contact(found).rates[:, :, :2] @ motion)
        parts = angles, tensions, commands, poses[:, -1, :2], forces.reshape(len(x), -1, tensions.shape[-1])
        return torch.tensor(np.concatenate(parts, axis=1))


class _Taken(torch.autograd.Function):
    """A step as a function of its commands; backwards it leaves the weights of its outputs in the step."""

    @staticmethod
    def forward(ctx: Any, commands: Tensor, step: RolloutStep) -> Tensor:
        """The outputs, (B, outputs)."""
        ctx.step = step
        return step.outputs()

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, weights: Tensor) -> tuple[Tensor, None]:
        """The gradient by the commands."""
        ctx.step.weights = weights
        return (weights[:, None] @ ctx.step.rates())[:, 0], None


class Rollout:
    """A rollout of B lanes with one mechanism.

    Args:
        mechanism: of all lanes.
        solve: the equilibria of a step from its commands (B, m), its number, and the equilibria before it or None.
    Attributes:
        steps: taken so far. ok: lanes that have found a pose in all of them, (B,).
    """

    def __init__(self, mechanism: Any, solve: Callable[[Array, int, Any], Any]) -> None:
        self._solve, self._stiffnesses = solve, mechanism.stiffnesses
        joints, m, n = mechanism.n_joints, mechanism.n_tendons, mechanism.n_links
        self._sizes = [joints, m, m, 2, 2 * n]
        self.steps: list[RolloutStep] = []
        self.ok: NDArray[np.bool_] = np.array(True)

    def step(self, commands: Tensor) -> RolloutState:
        """The state after a step; a lane without a pose stays where it was."""
        before = self.steps[-1].solution if self.steps else None
        solution = self._solve(commands.detach().numpy(), len(self.steps), before)
        good = np.asarray(solution.ok)
        if before is not None and not good.all():
            each = [(solution if good[lane] else before).row(lane) for lane in range(len(good))]
            solution = _with_walls_of(stacked(each), solution)
        self.ok = self.ok & good
        self.steps.append(RolloutStep(solution, commands, self._stiffnesses))
        angles, tensions, left, tip, forces = _Taken.apply(commands, self.steps[-1]).split(self._sizes, -1)
        return RolloutState(angles, tensions, left, tip, forces.unflatten(-1, (-1, 2)))

    def leave_to(self, chain: Any, limits: tuple[float, float]) -> None:
        """Add the gradient by the design to the leaves behind a chain of tensors, after `backward` of the loss."""
        taken = [step for step in self.steps if step.weights is not None]
        if not taken:
            return
        found = of_solutions(
            chain, [step.solution for step in taken], torch.cat([step.commands for step in taken]), limits
        )
        weights = torch.cat([step.weights for step in taken if step.weights is not None])
        (_outputs(found, torch.tensor(self._stiffnesses)) * weights).sum().backward()


def _outputs(found: Equilibria, stiffnesses: Tensor) -> Tensor:
    """The states that these equilibria leave, flat, (B, outputs)."""
    commands = found.lengths - found.tensions / stiffnesses
    none = torch.zeros_like(found.poses[..., :2])
    forces = found.wall_forces[..., :2] if isinstance(found, WalledEquilibria) else none
    return torch.cat([found.joint_angles, found.tensions, commands, found.tip, forces.flatten(-2)], -1)


def _with_walls_of(joined: Any, solution: Any) -> Any:
    """Equilibria of single lanes, joined, among the walls of the batch that they come from."""
    if solution.walls is None:
        return joined
    return replace(joined, walls=replace(joined.walls, walls=solution.walls.walls, which=solution.walls.which))
