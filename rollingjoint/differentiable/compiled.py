"""Rows of a differentiable batch in the compiled solver, which builds their mechanisms."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from rollingjoint.chain.batch import solve_batch, step_batch
from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.friction_step import no_friction
from rollingjoint.chain.stacks import designs_of
from rollingjoint.chain.status import Status, codes_of
from rollingjoint.differentiable.friction import HISTORY
from rollingjoint.differentiable.parameters import ChainTensors
from rollingjoint.differentiable.statics import Law
from rollingjoint.differentiable.walled import Among
from rollingjoint.errors import MechanismError
from rollingjoint.friction import NO_FRICTION, ROLLING_PRESLIDING, FrictionState
from rollingjoint.kernels.arrays import TendonLaw
from rollingjoint.kernels.friction import FrictionLaw


def solve_compiled(
    design: ChainTensors, law: Law, loads: Tensor, starts: Tensor, mask: Tensor, among: Among | None = None
) -> tuple[Tensor, Tensor, Tensor, Among | None]:
    """Equilibria of some rows of a batch.

    Args:
        design: mechanisms, with leading axes that broadcast to the shape of the mask.
        law: tendon law, tensors (..., m).
        loads: load tables, (..., rows, columns).
        starts: joint angles, (..., J) [rad].
        mask: True for the rows to solve, (...).
        among: the walls around them.
    Returns:
        joint angles (..., J) [rad]; whether a joint is held at the end of its surface (..., J); Status (...),
        INVALID_INPUT for a mechanism that cannot be built; the walls with the contacts. Other rows keep their starts.
    """
    design = design.replace(friction=None)  # part of the law: mechanisms that differ by friction alone are built once
    places = torch.arange(design.batch.numel(), device=mask.device).reshape(design.batch).expand(mask.shape)[mask]
    built = {place: _built(design, place) for place in places.unique().tolist()}
    buildable = torch.tensor([built[place] is not None for place in places.tolist()], device=mask.device)
    mask = mask.clone()
    mask[mask.clone()] = buildable
    phi, held = starts.clone(), torch.zeros_like(starts, dtype=torch.bool)
    status = torch.full(mask.shape, int(Status.INVALID_INPUT), device=mask.device)
    if not bool(mask.any()):
        none = np.zeros(mask.numel(), bool)
        return phi, held, status, None if among is None else among.solved(starts.shape[-1], np.flatnonzero(none), none)
    mechanisms = tuple(chain for place in places[buildable].tolist() if (chain := built[place]) is not None)

    def rows(values: Tensor, axes: int = 1) -> np.ndarray:
        trailing = values.shape[values.ndim - axes :]
        return np.ascontiguousarray(values.detach().expand(*mask.shape, *trailing)[mask].cpu().numpy())

    laws = TendonLaw(*(rows(values) for values in law.rows))
    table, begin = rows(loads, 2), rows(starts)
    inputs = type(mechanisms[0]), mechanisms, *designs_of(mechanisms, len(begin)), laws, table, begin
    places = np.flatnonzero(mask.reshape(-1).cpu().numpy())
    walls = None if among is None else among.arrays(places, begin.shape[1])
    if law.friction is not None and law.history is not None:
        before = {name: rows(getattr(law.history, name), axes) for name, axes in HISTORY.items()}
        m = law.command.shape[-1]
        tendons = torch.stack([tensor.expand(*tensor.shape[:-1], m) for tensor in law.friction.tensors], -1)
        rolling = np.tile([NO_FRICTION.rolling, ROLLING_PRESLIDING], (len(begin), 1))
        history = FrictionState(**before, rolling=np.zeros_like(begin))
        equilibrium = step_batch(*inputs, history, FrictionLaw(rows(tendons, 2), rolling), walls)
    elif among is not None and among.before is not None:
        coefficients, past = no_friction(begin, law.command.shape[-1])
        equilibrium = step_batch(*inputs, FrictionState(*past), coefficients, walls)
    else:
        equilibrium = solve_batch(*inputs, walls)
    codes = codes_of(equilibrium.status)
    phi[mask] = torch.tensor(equilibrium.joint_angles).to(phi)
    held[mask] = torch.tensor(~equilibrium.free_joints).to(held.device)
    status[mask] = torch.tensor(codes).to(status)
    if among is not None:
        step, good = equilibrium.walls, (status <= int(Status.AT_LIMIT)).reshape(-1).numpy()
        touched = step.memory or step.touched(inputs[2:4], equilibrium.joint_angles)[0].after
        among = among.solved(begin.shape[1], places, good, step, touched)
    return phi, held, status, among


def _built(design: ChainTensors, place: int) -> AnyChain | None:
    try:
        chain: AnyChain = design.mechanism(place)
        return chain
    except MechanismError:
        return None
