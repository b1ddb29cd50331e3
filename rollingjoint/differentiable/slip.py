"""Friction at one pose: how far the holes have slipped, the tension in every gap and its slopes.

The axes are (..., m, J), as of all gaps. Symbols: z friction state, s slip coordinate, theta turn at the holes of a
link, T0 tension at the motor, T in a gap, g gap, C compliance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from rollingjoint.differentiable.friction import FrictionStep

_SMALL_STATE = 1e-8  # below it a hole's amplitude is its limit at z = 0


@dataclass(frozen=True)
class GapsAtPose:
    """What friction sees of the gaps, (..., m, J) where not said otherwise.

    Args:
        lengths, rates: g [mm] and g' [mm/rad], 0 where a tendon does not cross.
        turns_below, turns_above: signed turns a and b at the holes below and above a gap [rad].
        rates_below, rates_above: a' and b'.
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
    """Friction at one pose: states, tensions and their slopes, (..., m, J) where not said otherwise."""

    step: FrictionStep
    gaps: GapsAtPose

    @cached_property
    def distal(self) -> Tensor:
        """L: length of the gaps from a link on [mm]."""
        return _beyond(self.gaps.lengths)

    @cached_property
    def _compliance(self) -> Tensor:
        """C of every link, the stretch of the tendon beyond it [mm/N]."""
        left = _beyond(self.gaps.crosses)
        return self.step.compliance[..., None] * left / left[..., :1].clamp(min=1.0)

    @cached_property
    def slips(self) -> Tensor:
        """s [mm]; grows where the tendon runs towards the tip."""
        return self.distal - self._compliance * self.gaps.tensions[..., None]

    @cached_property
    def slipped(self) -> Tensor:
        """By how much s has grown in this step [mm]."""
        return torch.zeros_like(self.slips) if self.step.slips is None else self.slips - self.step.slips

    @cached_property
    def reached(self) -> Tensor:
        """z before it is limited to -1 to 1."""
        if self.step.states is None:
            return torch.zeros_like(self.slips)
        return self.step.states - self.slipped / self.step.presliding[..., None]

    @cached_property
    def states(self) -> Tensor:
        """z."""
        z = self.reached
        return torch.where(z >= 1.0, 1.0, torch.where(z <= -1.0, -1.0, z)) * self.gaps.crosses

    @cached_property
    def sticking(self) -> Tensor:
        """Which holes stick: their states are not at an end."""
        return (self.reached.abs() < 1.0) & (self.gaps.crosses > 0)

    @cached_property
    def turns(self) -> Tensor:
        """theta of every link, at the hole where the tendon leaves it and that where it has entered [rad]."""
        entered = _next(self.gaps.turns_above.abs())
        return (self.step.extra_turn[..., None] + self.gaps.turns_below.abs() + entered) * self.gaps.crosses

    @cached_property
    def _decay(self) -> Tensor:
        """E = exp(-mu Σ z theta)."""
        return torch.exp(-self.step.mu[..., None] * torch.cumsum(self.states * self.turns, -1))

    @cached_property
    def tensions(self) -> Tensor:
        """T in every gap [N]; 0 in those that a tendon does not cross."""
        lost = self.step.constant[..., None] * torch.cumsum(self.states, -1)
        return (self.gaps.tensions[..., None] * self._decay - lost).clamp(min=0.0) * self.gaps.crosses

    @cached_property
    def amplitudes(self) -> Tensor:
        """Q: what the holes of a link take from the tension, by z [N]."""
        below = torch.cat([self.gaps.tensions[..., None].expand_as(self.states)[..., :1], self.tensions[..., :-1]], -1)
        moved = self.states.abs() > _SMALL_STATE
        stuck = (below * self.step.mu[..., None] * self.turns + self.step.constant[..., None]) * self.gaps.crosses
        return torch.where(moved, (below - self.tensions) / torch.where(moved, self.states, 1.0), stuck)

    @property
    def work(self) -> Tensor:
        """Work that the holes take in this step, (...) [N·mm]: presliding may return a little of it."""
        return -(self.states * self.amplitudes * self.slipped).sum((-2, -1))

    @cached_property
    def slopes(self) -> Tensor:
        """dT/dphi, (..., m, J, J): of the tension in every gap by every joint angle, one-sided where holes turn."""
        step, gaps = self.step, self.gaps
        sticks = self.sticking / step.presliding[..., None]  # -dz/ds
        if step.states is None:
            sticks = torch.zeros_like(sticks)
        joints = torch.arange(gaps.lengths.shape[-1], device=gaps.lengths.device)
        first = torch.minimum(joints[:, None], joints)
        rates, elastic = gaps.rates[..., None, :], (gaps.elastic[..., None] * gaps.rates)[..., None, :]

        def passed(weights: Tensor) -> Tensor:
            """-d/dphi of the sum of weights times z over the links up to every gap."""
            moving, stretched = (torch.cumsum(weights * sticks * c, -1) for c in (1.0, self._compliance))
            return moving[..., first] * rates - stretched[..., :, None] * elastic

        left = self.states * torch.sign(gaps.turns_below) * gaps.rates_below
        entered = _previous(self.states) * torch.sign(gaps.turns_above) * gaps.rates_above
        turned = left[..., None, :] * (joints[:, None] >= joints) + entered[..., None, :] * (joints[:, None] > joints)
        exponent = step.mu[..., None, None] * (passed(self.turns) - turned)
        decay, tensions = self._decay[..., None], gaps.tensions[..., None, None]
        slopes = decay * (elastic + tensions * exponent)
        slopes = slopes + step.constant[..., None, None] * passed(torch.ones_like(self.turns))
        pulled = (self.tensions > 0) & (gaps.crosses > 0)
        return torch.where(pulled[..., None], slopes, 0.0)


def frozen_work(step: FrictionStep, amplitudes: Tensor, reached: Tensor, moved: Tensor) -> Tensor:
    """Work against friction while the distal lengths move, its amplitudes those at the beginning, (...) [N·mm].

    Args:
        step: of the friction.
        amplitudes, reached: at the beginning, (..., m, J).
        moved: by how much the distal lengths grow, (..., m, J) [mm].
    """
    if step.states is None:
        return torch.zeros_like(moved[..., 0, 0])
    presliding = step.presliding[..., None]
    return (amplitudes * presliding * (_well(reached - moved / presliding) - _well(reached))).sum((-2, -1))


def _well(z: Tensor) -> Tensor:
    """Integral of z limited to -1 to 1."""
    size = z.abs()
    return torch.where(size <= 1.0, 0.5 * z.square(), size - 0.5)


def _beyond(values: Tensor) -> Tensor:
    """Sums from every place of the last axis to its end."""
    return values.flip(-1).cumsum(-1).flip(-1)


def _next(values: Tensor) -> Tensor:
    """The values one place later on the last axis, 0 first."""
    return torch.nn.functional.pad(values[..., :-1], (1, 0))


def _previous(values: Tensor) -> Tensor:
    """The values one place earlier on the last axis, 0 last."""
    return torch.nn.functional.pad(values[..., 1:], (0, 1))
