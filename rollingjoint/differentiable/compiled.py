"""Rows of a differentiable batch through the compiled solver, which builds their mechanisms."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from rollingjoint.chain.batch import solve_batch, step_batch
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.stacks import designs_of
from rollingjoint.chain.status import Status, codes_of
from rollingjoint.differentiable.design import DifferentiableChain
from rollingjoint.differentiable.friction import HISTORY
from rollingjoint.differentiable.statics import Law
from rollingjoint.errors import MechanismError
from rollingjoint.friction import NO_FRICTION, ROLLING_PRESLIDING, FrictionState
from rollingjoint.kernels.arrays import TendonLaw
from rollingjoint.kernels.friction import FrictionLaw


def solve_compiled(
    design: DifferentiableChain, law: Law, loads: Tensor, starts: Tensor, mask: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Equilibria of some rows of a batch.

    Args:
        design: with leading axes that broadcast to those of the mask.
        law: tendon law, (..., m) each.
        loads: load tables, (..., rows, columns).
        starts: joint angles, (..., J) [rad].
        mask: which rows to solve, (...).
    Returns:
        joint angles (..., J) [rad]; whether a joint is held at the end of its surface (..., J); Status (...), that of
        a mechanism that cannot be built being INVALID_INPUT. Other rows keep their starts.
    """
    design = design.replace(friction=None)  # which the law has: mechanisms that differ in nothing else are one
    places = torch.arange(design.batch.numel(), device=mask.device).reshape(design.batch).expand(mask.shape)[mask]
    built = {place: _built(design, place) for place in places.unique().tolist()}
    known = torch.tensor([built[place] is not None for place in places.tolist()], device=mask.device)
    mask = mask.clone()
    mask[mask.clone()] = known
    phi, held = starts.clone(), torch.zeros_like(starts, dtype=torch.bool)
    status = torch.full(mask.shape, int(Status.INVALID_INPUT), device=mask.device)
    if not bool(mask.any()):
        return phi, held, status
    mechanisms = tuple(chain for place in places[known].tolist() if (chain := built[place]) is not None)

    def rows(values: Tensor, axes: int = 1) -> np.ndarray:
        own = values.shape[values.ndim - axes :]
        return np.ascontiguousarray(values.detach().expand(*mask.shape, *own)[mask].cpu().numpy())

    laws = TendonLaw(*(rows(values) for values in law.rows))
    table, begin = rows(loads, 2), rows(starts)
    inputs = RollingChain, mechanisms, *designs_of(mechanisms, len(begin)), laws, table, begin
    if law.friction is None or law.history is None:
        equilibrium = solve_batch(*inputs)
    else:
        before = {name: rows(getattr(law.history, name), axes) for name, axes in HISTORY.items()}
        m = law.command.shape[-1]
        tendons = torch.stack([tensor.expand(*tensor.shape[:-1], m) for tensor in law.friction.tensors], -1)
        rolling = np.tile([NO_FRICTION.rolling, ROLLING_PRESLIDING], (len(begin), 1))
        history = FrictionState(**before, rolling=np.zeros_like(begin))
        equilibrium = step_batch(*inputs, history, FrictionLaw(rows(tendons, 2), rolling))
    phi[mask] = torch.tensor(equilibrium.joint_angles).to(phi)
    held[mask] = torch.tensor(~equilibrium.free_joints).to(held.device)
    status[mask] = torch.tensor(codes_of(equilibrium.status)).to(status)
    return phi, held, status


def _built(design: DifferentiableChain, place: int) -> RollingChain | None:
    try:
        return design.mechanism(place)
    except MechanismError:
        return None
