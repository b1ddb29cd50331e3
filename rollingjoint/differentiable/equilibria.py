"""Differentiable equilibria: what the solvers return."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from rollingjoint.chain.status import Status
from rollingjoint.differentiable.friction import HISTORY, DifferentiableFriction, FrictionStates
from rollingjoint.differentiable.looking import seen
from rollingjoint.differentiable.newton import freed
from rollingjoint.differentiable.slip import FIRM
from rollingjoint.differentiable.statics import ChainState
from rollingjoint.differentiable.surface import as_pairs


@dataclass(frozen=True, eq=False)
class Equilibria:
    """Equilibria of a batch; names, shapes and units as in `rollingjoint.Equilibrium`, with any leading axes.

    Every tensor of numbers can be differentiated once. Where `ok` is False, its gradients are zero and its numbers are
    those of the pose at which the solver gave up: finite but meaningless.
    """

    status: Tensor
    free_joints: Tensor
    _s: Tensor
    _state: ChainState

    def __repr__(self) -> str:
        return f"<Equilibria: {int(self.ok.sum())} of {self.ok.numel()} rows ok>"

    @property
    def ok(self) -> Tensor:
        """(...) True for a stable equilibrium."""
        return self.status <= int(Status.AT_LIMIT)

    @property
    def joint_angles(self) -> Tensor:
        """(..., n - 1) [rad]."""
        return self._shown(self._state.phi)

    @property
    def arc_lengths(self) -> Tensor:
        """(..., n - 1) [mm]."""
        return self._shown(self._s)

    @cached_property
    def poses(self) -> Tensor:
        """(..., n, 3) x, y, angle of every link [mm, rad]."""
        state = self._state
        return self._shown(torch.cat([as_pairs(state.positions), state.link_angles[..., None]], -1))

    @property
    def tip(self) -> Tensor:
        """(..., 2) origin of the last link [mm]."""
        return self.poses[..., -1, :2]

    @property
    def contact_points(self) -> Tensor:
        """(..., n - 1, 2) [mm]."""
        return self._shown(as_pairs(self._state.contacts))

    @property
    def contact_tangents(self) -> Tensor:
        """(..., n - 1, 2) unit tangents."""
        return self._shown(as_pairs(self._state.tangents))

    @property
    def tensions(self) -> Tensor:
        """(..., m) [N]."""
        return self._shown(self._state.tensions.expand_as(self._state.lengths))

    @property
    def gap_tensions(self) -> Tensor:
        """(..., n - 1, m) tension of every tendon in every gap, 0 beyond its end [N]."""
        return self._shown((self._state.gap_tensions * self._state.routes.crosses).mT)

    @property
    def friction_states(self) -> Tensor:
        """(..., n - 1, m) friction state of every tendon in links 0 to n - 2: 1 slips to the motor, -1 to the tip."""
        return self.friction_state.states

    @property
    def sticking(self) -> Tensor:
        """(..., n - 1, m) whether a tendon sticks in a link's holes: its friction state is between -1 and 1."""
        return (self.friction_states.abs() < FIRM) & (self._state.routes.crosses.mT > 0)

    @property
    def slip(self) -> Tensor:
        """(..., n - 1, m) slip of every tendon in links 0 to n - 2 since the history, towards the tip positive [mm]."""
        rubbing, stands = self._state.rubbing, (self.status <= int(Status.INDETERMINATE))[..., None, None]
        return torch.zeros_like(self.tendon_rates) if rubbing is None else self._shown(rubbing.slipped.mT) * stands

    @property
    def dissipated_work(self) -> Tensor:
        """(...) what friction has taken up in the step from the history to here [N·mm]."""
        rubbing = self._state.rubbing
        return torch.zeros_like(self.lengths[..., 0]) if rubbing is None else self._shown(rubbing.work) * self.ok

    @cached_property
    def friction_state(self) -> FrictionStates:
        """What friction remembers, the history of the next step. Gradients flow through it.

        In a row that is not ok it is a constant: what was remembered before; slips and angles are those of the pose if
        that is INDETERMINATE.
        """
        return self.remembered(None)

    def remembered(self, friction: DifferentiableFriction | None) -> FrictionStates:
        """`friction_state`; where nothing has slipped yet, in terms of the friction of the step to come."""
        state, before = self._state, self._state.law.history
        friction = friction or state.law.friction or DifferentiableFriction(0.0)
        friction = friction.where(friction.usable()).each(lambda tensor: tensor.to(state.phi))
        rubbing = state.rubbing or state.rubbing_under(friction)
        found = FrictionStates(rubbing.states.mT, rubbing.slips.mT, rubbing.grips.mT, state.phi).each(
            lambda tensor, _: self._shown(tensor)
        )
        if before is None or seen(self.ok.all(), False):
            return found
        stands = self.status <= int(Status.INDETERMINATE)
        kept = {"states": self.ok, "grips": self.ok, "slips": stands, "angles": stands}
        chosen = {}
        for name, axes in HISTORY.items():
            mask = kept[name][(..., *(None,) * axes)]
            chosen[name] = torch.where(mask, getattr(found, name), getattr(before, name).detach())
        return FrictionStates(**chosen)

    @property
    def lengths(self) -> Tensor:
        """(..., m) [mm]."""
        return self._shown(self._state.lengths)

    @property
    def tendon_rates(self) -> Tensor:
        """(..., n - 1, m) d length / d joint angle [mm/rad]."""
        return self._shown(self._state.rates.mT)

    @property
    def tendon_stiffness(self) -> Tensor:
        """(..., m) d tension / d length [N/mm]."""
        return self._shown(self._state.elastic.expand_as(self._state.lengths))

    @property
    def contact_forces(self) -> Tensor:
        """(..., n - 1, 2) on the distal link, along tangent and normal [N]."""
        return self._shown(self._state.contact_forces)

    @property
    def pressing_margins(self) -> Tensor:
        """(..., n - 1) normal contact force [N]; negative: the links separate."""
        return self.contact_forces[..., 1]

    def slip_margins(self, friction: float = 0.3) -> Tensor:
        """(..., n - 1) friction × normal - |tangential| contact force [N]; negative: the links slip."""
        force = self.contact_forces
        return friction * force[..., 1] - force[..., 0].abs()

    @cached_property
    def stiffness(self) -> Tensor:
        """(..., n - 1, n - 1) d residual / d joint angle [N·mm/rad]."""
        return self._shown(self._state.stiffness)

    @cached_property
    def smallest_eigenvalue(self) -> Tensor:
        """(...) smallest real part of the eigenvalues of the stiffness over the free joints [N·mm/rad]; inf if none is.

        Its gradient means something where the eigenvalue is simple.
        """
        held, H = ~self.free_joints, self.stiffness
        far = 1.0 + H.detach().abs().flatten(-2).sum(-1)  # beyond every eigenvalue
        masked = freed(H, held) + torch.diag_embed(held * far[..., None])
        if self._state.loads.symmetric and self._state.rubbing is None:
            smallest = torch.linalg.eigvalsh(masked)[..., 0]
        else:
            smallest = torch.linalg.eigvals(masked).real.amin(-1)
        return torch.where(held.all(-1), torch.inf, smallest)

    def _shown(self, values: Tensor) -> Tensor:
        """The values, constant and finite in rows that have failed."""
        if seen(self.ok.all(), False):
            return values
        ok = self.ok[(..., *(None,) * (values.ndim - self.ok.ndim))]
        return torch.where(ok, values, torch.nan_to_num(values.detach()))
