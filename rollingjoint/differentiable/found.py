"""Equilibria that compiled batches have found, as functions of the design and of the commands.

A rollout in compiled code, then one adjoint solve for all of its steps at once: contact with walls comes as a linear
law of the links' motion from the kernels, which is exact for first derivatives. docs/theory.md, section 13.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import torch
from torch import Tensor

from rollingjoint.chain.solution import Solution
from rollingjoint.chain.wall_sums import link_contact
from rollingjoint.differentiable.design import DifferentiableChain
from rollingjoint.differentiable.equilibria import Equilibria
from rollingjoint.differentiable.solve import acting, tied
from rollingjoint.differentiable.statics import Law
from rollingjoint.differentiable.walled import LinearContact, PinnedWalls
from rollingjoint.errors import InvalidInput


def of_solutions(
    design: DifferentiableChain,
    solutions: Sequence[Solution],
    lengths: Tensor,
    tension_limits: tuple[float, float] = (0.0, np.inf),
) -> Equilibria:
    """The equilibria of batches that `solve_lengths_batch` has found, with derivatives by design and commands.

    The pose of the base, walls, and what friction at walls remembers are constants: where contacts slide or there is no
    friction, the derivatives are exact; where they stick, they hold for a contact that is pinned to the wall.

    Args:
        design: the mechanism of all rows, without leading axes, or with one axis of their number, (B,).
        solutions: batches, one after the other B rows, without friction in holes.
        lengths: the unstretched lengths under which they were found, (B, m) [mm].
        tension_limits: minimum and maximum tendon tension then [N].
    Returns:
        Equilibria, among walls WalledEquilibria without a memory, in the order of the batches.
    Raises:
        InvalidInput: another number of rows, friction in holes, rigid walls, loads of different numbers.
    """
    angles = _joined(solution.joint_angles for solution in solutions)
    if angles.ndim != 2 or tuple(lengths.shape) != (len(angles), design.n_tendons):
        expected = f"({len(angles)}, {design.n_tendons}), as in the solutions"
        raise InvalidInput("shape of lengths", tuple(lengths.shape), expected)
    if design.friction is not None:
        raise InvalidInput("friction in holes", design.friction, "None")
    count = len(angles)
    command = torch.as_tensor(lengths, dtype=torch.float64)
    low, high = (torch.full_like(command, float(limit)) for limit in tension_limits)
    law = Law(command, design.stiffnesses.expand(count, -1), low, high)
    expanded = design.over(1)
    geometry = expanded.geometry()
    with torch.no_grad():
        s = geometry.detach().contacts(angles, torch.zeros_like(angles))
    pinned = None
    if any(solution.walls is not None for solution in solutions):
        forces, rates = zip(*map(link_contact, solutions), strict=True)
        at = LinearContact(_joined(forces), _joined(rates), _joined(solution.poses for solution in solutions))
        pinned = PinnedWalls(torch.zeros(count, 3, dtype=torch.float64), at)
    loads = acting(expanded, _joined(solution.loads for solution in solutions))
    held = ~_joined(solution.free_joints for solution in solutions)
    status = _joined(np.asarray(solution.status, np.int64) for solution in solutions)
    return tied(geometry, law, loads, s, held, status, pinned)


def _joined(arrays: Iterable[np.ndarray]) -> Tensor:
    return torch.tensor(np.concatenate(list(arrays)))
