"""Friction at one pose: how far the holes have slipped, the tension in every gap and its slopes.

The axes are (..., m, J), as of all gaps. Symbols: z friction state, sigma slip coordinate, gamma turn at the holes of a
link, T0 tension at the motor, T in a gap, g gap, C compliance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from rollingjoint.differentiable.friction import DifferentiableFriction, FrictionStates

FIRM = 1.0 - 1e-7  # a hole sticks if its friction state is smaller; the rest is rounding
_STILL = 1e-8  # a friction state below it is zero


@dataclass(frozen=True)
class GapsAtPose:
    """What friction sees of the gaps, (..., m, J) where not said otherwise.

    Args:
        lengths, rates: g [mm] and g' [mm/rad], 0 where a tendon does not cross.
        turns_below, turns_above: signed turns alpha and beta at the holes below and above a gap [rad].
        rates_below, rates_above: alpha' and beta'.
        crosses: (m, J), 1 or 0.
        tensions, elastic: T0 [N] and d T0 / d length [N/mm], (..., m).
    """

    lengths: Tensor
    rates: Tensor
    turns_below: Tensor
    turns_above: Tensor
    rates_below: Tensor
    rates_above: Tensor
    crosses: Tensor
    tensions: Tensor
    elastic: Tensor


@dataclass(frozen=True)
class FrictionAtPose:
    """Friction at one pose: states, tensions and their slopes, (..., m, J) where not said otherwise.

    Args:
        friction: of the tendons.
        history: what the step to this pose starts from; None at a start: no hole has slipped, z = 0.
        gaps: at this pose.
    """

    friction: DifferentiableFriction
    history: FrictionStates | None
    gaps: GapsAtPose

    @cached_property
    def distal(self) -> Tensor:
        """L: length of the gaps from a link on [mm]."""
        return _beyond(self.gaps.lengths)

    @cached_property
    def _compliance(self) -> Tensor:
        """C of every link, the stretch of the tendon beyond it [mm/N]."""
        left = _beyond(self.gaps.crosses)
        return self.friction.compliance[..., None] * left / left[..., :1].clamp(min=1.0)

    @cached_property
    def slips(self) -> Tensor:
        """sigma [mm]; grows where the tendon runs towards the tip."""
        return self.distal - self._compliance * self.gaps.tensions[..., None]

    @cached_property
    def slipped(self) -> Tensor:
        """By how much sigma has grown in this step [mm]."""
        return torch.zeros_like(self.slips) if self.history is None else self.slips - self.history.slips.mT

    @cached_property
    def reached(self) -> Tensor:
        """z before it is limited to -1 to 1."""
        if self.history is None:
            return torch.zeros_like(self.slips)
        return self.history.states.mT - self.slipped / self.friction.presliding[..., None]

    @cached_property
    def _follows(self) -> Tensor:
        """Whether z follows the slip: where it is at an end, up to rounding, it has the derivatives of sliding on."""
        return (self.reached.abs() < FIRM) & (self.history is not None)

    @cached_property
    def states(self) -> Tensor:
        """z."""
        return torch.where(self._follows, self.reached, self.reached.detach().clamp(-1.0, 1.0)) * self.gaps.crosses

    @cached_property
    def turns(self) -> Tensor:
        """gamma of every link, at the hole where the tendon leaves it and that where it has entered [rad]."""
        left, entered = (_sign(turn) * turn for turn in (self.gaps.turns_below, self.gaps.turns_above))
        return (self.friction.extra_turn[..., None] + left + _later(entered)) * self.gaps.crosses

    @cached_property
    def _decay(self) -> Tensor:
        """exp(-mu Σ z gamma)."""
        return torch.exp(-self.friction.mu[..., None] * torch.cumsum(self.states * self.turns, -1))

    @cached_property
    def _unlimited(self) -> Tensor:
        """T before it is limited to pulling [N]."""
        lost = self.friction.constant[..., None] * torch.cumsum(self.states, -1)
        return self.gaps.tensions[..., None] * self._decay - lost

    @cached_property
    def _pulls(self) -> Tensor:
        return (self._unlimited >= 0.0) & (self.gaps.crosses > 0)

    @cached_property
    def tensions(self) -> Tensor:
        """T in every gap [N]; 0 in those that a tendon does not cross."""
        return torch.where(self._pulls, self._unlimited, 0.0)

    @cached_property
    def grips(self) -> Tensor:
        """Q: what the holes of a link take from the tension at z = 1 [N]."""
        motor, z = self.gaps.tensions[..., None], self.states
        below = torch.cat([motor.expand_as(z)[..., :1], self.tensions[..., :-1]], -1)
        carried = motor * torch.cat([torch.ones_like(z[..., :1]), self._decay[..., :-1]], -1)
        slope = self.friction.mu[..., None] * self.turns
        pulling = carried * slope * _relative_loss(slope * z) + self.friction.constant[..., None]
        slack = ~self._pulls & (z.detach().abs() > _STILL)
        left = below / torch.where(slack, z, 1.0)  # what is left below is all that the holes can take
        return torch.where(self._pulls, pulling, left) * self.gaps.crosses

    @property
    def work(self) -> Tensor:
        """Work that the holes take in this step, with the mean of the grips before and after it, (...) [N·mm]."""
        if self.history is None:
            return torch.zeros_like(self.slips[..., 0, 0])
        per_grip = self.friction.presliding[..., None] * (_well(self.reached) - _well(self.history.states.mT))
        return (0.5 * (self.history.grips.mT + self.grips) * per_grip).sum((-2, -1))

    @cached_property
    def slopes(self) -> Tensor:
        """dT/dphi, (..., m, J, J): of the tension in every gap by every joint angle, one-sided where holes turn."""
        friction, gaps = self.friction, self.gaps
        sticks = self._follows / friction.presliding[..., None]  # -dz/ds
        joints = torch.arange(gaps.lengths.shape[-1], device=gaps.lengths.device)
        first = torch.minimum(joints[:, None], joints)
        rates, elastic = gaps.rates[..., None, :], (gaps.elastic[..., None] * gaps.rates)[..., None, :]

        def passed(weights: Tensor) -> Tensor:
            """-d/dphi of the sum of weights times z over the links up to every gap."""
            moving, stretched = (torch.cumsum(weights * sticks * c, -1) for c in (1.0, self._compliance))
            return moving[..., first] * rates - stretched[..., :, None] * elastic

        left = self.states * _sign(gaps.turns_below) * gaps.rates_below
        entered = _earlier(self.states) * _sign(gaps.turns_above) * gaps.rates_above
        turned = left[..., None, :] * (joints[:, None] >= joints) + entered[..., None, :] * (joints[:, None] > joints)
        exponent = friction.mu[..., None, None] * (passed(self.turns) - turned)
        decay, tensions = self._decay[..., None], gaps.tensions[..., None, None]
        slopes = decay * (elastic + tensions * exponent)
        slopes = slopes + friction.constant[..., None, None] * passed(torch.ones_like(self.turns))
        return torch.where(self._pulls[..., None], slopes, 0.0)


def frozen_work(presliding: Tensor, grips: Tensor, reached: Tensor, moved: Tensor) -> Tensor:
    """Work against friction while the distal lengths move and the grips are those at the beginning, (...) [N·mm].

    Args:
        presliding: of the tendons, (..., m or 1) [mm].
        grips, reached: at the beginning, (..., m, J).
        moved: by how much the distal lengths grow, (..., m, J) [mm].
    """
    per_slip = 1.0 / presliding[..., None]
    return (grips / per_slip * (_well(reached - moved * per_slip) - _well(reached))).sum((-2, -1))


def _well(z: Tensor) -> Tensor:
    """Integral of z limited to -1 to 1."""
    size = z.abs()
    return torch.where(size <= 1.0, 0.5 * z.square(), size - 0.5)


def _relative_loss(x: Tensor) -> Tensor:
    """(1 - exp(-x)) / x, 1 at 0."""
    small = x.detach().abs() < 1e-2
    near = 1.0 - x / 2.0 * (1.0 - x / 3.0 * (1.0 - x / 4.0 * (1.0 - x / 5.0 * (1.0 - x / 6.0))))
    return torch.where(small, near, -torch.expm1(-x) / torch.where(small, 1.0, x))


def _beyond(values: Tensor) -> Tensor:
    """Sums from every place of the last axis to its end."""
    return values.flip(-1).cumsum(-1).flip(-1)


def _sign(turn: Tensor) -> Tensor:
    """1 or -1; 1 at 0, as in the compiled solver."""
    return torch.where(turn.detach() < 0.0, -1.0, 1.0).to(turn.dtype)


def _later(values: Tensor) -> Tensor:
    """The values one place later on the last axis, 0 first."""
    return torch.nn.functional.pad(values[..., :-1], (1, 0))


def _earlier(values: Tensor) -> Tensor:
    """The values one place earlier on the last axis, 0 last."""
    return torch.nn.functional.pad(values[..., 1:], (0, 1))
