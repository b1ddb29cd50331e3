"""Tendon friction with memory: capstan friction at every hole, presliding, and what one step leaves to the next.

Inside the package the axes are (..., m, J), as of all gaps; what users see is (..., J, m). Symbols: z friction state,
s slip coordinate, theta turn at the holes of a link, T0 tension at the motor, T in a gap, g gap, C compliance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property

import torch
from torch import Tensor

from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.shared.tolerances import LARGEST_INPUT

LARGEST_MU = 0.25
SMALLEST_PRESLIDING = 0.01  # mm
_SMALL_STATE = 1e-8  # below it a hole's amplitude is its limit at z = 0


@dataclass(frozen=True, eq=False)
class DifferentiableFriction:
    """Capstan friction of the tendons, as `rollingjoint.CapstanFriction`, in tensors.

    Args:
        mu: coefficient of friction, 0 to 0.25; like every other number a float, or a tensor (..., m): one per tendon,
            or (..., 1): the same for all, with leading axes that broadcast to the batch.
        presliding: slip that turns a hole from stuck to sliding, at least 0.01 mm.
        extra_turn: angle-independent turn of every link [rad].
        constant: friction of every link that no tension changes [N].
        compliance: stretch of the tendon inside the mechanism [mm/N].
    """

    mu: Tensor | float
    presliding: Tensor | float = 0.02
    extra_turn: Tensor | float = 0.0
    constant: Tensor | float = 0.0
    compliance: Tensor | float = 0.0


@dataclass(frozen=True, eq=False)
class FrictionStates:
    """What a step leaves to the next, (..., n - 1, m) by link and tendon unless said otherwise; differentiable.

    Attributes:
        states: friction state z, -1 (drawn out) to 1 (pulled in).
        slips: slip coordinate s [mm].
        angles: joint angles, (..., n - 1) [rad]; the next step starts there.
    """

    states: Tensor
    slips: Tensor
    angles: Tensor

    def detach(self) -> FrictionStates:
        """The same as constants: gradients stop here."""
        return FrictionStates(*(getattr(self, field.name).detach() for field in fields(self)))


@dataclass(frozen=True)
class FrictionLaw:
    """Friction of one step: five numbers of every tendon, (..., m), and the history, (..., m, J), None at a start.

    A step without history is a start: no hole has slipped, z = 0, as if there were no friction.
    """

    mu: Tensor
    presliding: Tensor
    extra_turn: Tensor
    constant: Tensor
    compliance: Tensor
    states: Tensor | None = None
    slips: Tensor | None = None

    def each(self, change: Callable[[Tensor, int], Tensor]) -> FrictionLaw:
        """The law with every tensor changed, by a function that also gets the number of its own axes."""
        return replace(self, **{name: change(tensor, axes) for name, (tensor, axes) in self.tensors.items()})

    @property
    def tensors(self) -> dict[str, tuple[Tensor, int]]:
        """Every tensor, and the number of its own axes."""
        named = ((field.name, getattr(self, field.name)) for field in fields(self))
        return {name: (each, 2 if name in ("states", "slips") else 1) for name, each in named if each is not None}

    @property
    def leading(self) -> list[torch.Size]:
        """The leading axes of every tensor."""
        return [tensor.shape[: tensor.ndim - axes] for tensor, axes in self.tensors.values()]

    def where(self, good: Tensor) -> FrictionLaw:
        """The law; in rows that are not good, (...), a constant that can be solved with."""
        if bool(good.all()):
            return self
        calm = self.each(lambda tensor, axes: torch.where(good[(..., *(None,) * axes)], tensor, 0.0))
        return replace(calm, presliding=torch.where(good[..., None], self.presliding, 1.0))

    def usable(self) -> Tensor:
        """Whether the numbers of a row are finite and within their ranges, (...)."""
        good = (self.mu >= 0) & (self.mu <= LARGEST_MU) & (self.presliding >= SMALLEST_PRESLIDING)
        good = (good & (self.extra_turn >= 0) & (self.constant >= 0) & (self.compliance >= 0)).all(-1)
        for tensor, axes in self.tensors.values():
            good = good & (tensor.detach().abs() <= LARGEST_INPUT).flatten(-axes).all(-1)
        return good


def friction_law(
    friction: DifferentiableFriction, before: FrictionStates | None, n_tendons: int, n_joints: int, device: torch.device
) -> FrictionLaw:
    """The friction of a step.

    Raises:
        InvalidInput: numbers or a history of another shape than the tendons and joints ask for.
    """
    numbers = []
    for field in fields(friction):
        number = torch.as_tensor(getattr(friction, field.name), dtype=torch.float64, device=device)
        if number.ndim and number.shape[-1] not in (1, n_tendons):
            raise InvalidInput(
                f"shape of {field.name}", tuple(number.shape), f"a number, (..., 1) or (..., {n_tendons})"
            )
        numbers.append(number.expand(*number.shape[:-1], n_tendons))
    if before is None:
        return FrictionLaw(*numbers)
    history = []
    for name in ("states", "slips"):
        values = torch.as_tensor(getattr(before, name), dtype=torch.float64, device=device)
        if values.shape[-2:] != (n_joints, n_tendons):
            allowed = f"(..., {n_joints}, {n_tendons}): the history of this mechanism"
            raise InvalidInput(f"shape of the history's {name}", tuple(values.shape), allowed)
        history.append(values.mT)
    return FrictionLaw(*numbers, *history)


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

    law: FrictionLaw
    gaps: GapsAtPose

    @cached_property
    def distal(self) -> Tensor:
        """L: length of the gaps from a link on [mm]."""
        return _beyond(self.gaps.lengths)

    @cached_property
    def _compliance(self) -> Tensor:
        """C of every link, the stretch of the tendon beyond it [mm/N]."""
        left = _beyond(self.gaps.crosses)
        return self.law.compliance[..., None] * left / left[..., :1].clamp(min=1.0)

    @cached_property
    def slips(self) -> Tensor:
        """s [mm]; grows where the tendon runs towards the tip."""
        return self.distal - self._compliance * self.gaps.tensions[..., None]

    @cached_property
    def reached(self) -> Tensor:
        """z before it is limited to -1 to 1."""
        if self.law.states is None or self.law.slips is None:
            return torch.zeros_like(self.slips)
        return self.law.states - (self.slips - self.law.slips) / self.law.presliding[..., None]

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
        return (self.law.extra_turn[..., None] + self.gaps.turns_below.abs() + entered) * self.gaps.crosses

    @cached_property
    def _decay(self) -> Tensor:
        """E = exp(-mu Σ z theta)."""
        return torch.exp(-self.law.mu[..., None] * torch.cumsum(self.states * self.turns, -1))

    @cached_property
    def tensions(self) -> Tensor:
        """T in every gap [N]; 0 in those that a tendon does not cross."""
        lost = self.law.constant[..., None] * torch.cumsum(self.states, -1)
        return (self.gaps.tensions[..., None] * self._decay - lost).clamp(min=0.0) * self.gaps.crosses

    @cached_property
    def amplitudes(self) -> Tensor:
        """Q: what the holes of a link take from the tension, by z [N]."""
        below = torch.cat([self.gaps.tensions[..., None].expand_as(self.states)[..., :1], self.tensions[..., :-1]], -1)
        moved = self.states.abs() > _SMALL_STATE
        stuck = (below * self.law.mu[..., None] * self.turns + self.law.constant[..., None]) * self.gaps.crosses
        return torch.where(moved, (below - self.tensions) / torch.where(moved, self.states, 1.0), stuck)

    @cached_property
    def slopes(self) -> Tensor:
        """dT/dphi, (..., m, J, J): of the tension in every gap by every joint angle, one-sided where holes turn."""
        law, gaps = self.law, self.gaps
        sticks = self.sticking / law.presliding[..., None]  # -dz/ds
        if law.states is None:
            sticks = torch.zeros_like(sticks)
        joints = torch.arange(gaps.lengths.shape[-1], device=gaps.lengths.device)
        first = torch.minimum(joints[:, None], joints)
        rates, elastic = gaps.rates[..., None, :], (gaps.elastic[..., None] * gaps.rates)[..., None, :]

        def slipped(weights: Tensor) -> Tensor:
            """-d/dphi of the sum of weights times z over the links up to every gap."""
            moving, stretched = (torch.cumsum(weights * sticks * c, -1) for c in (1.0, self._compliance))
            return moving[..., first] * rates - stretched[..., :, None] * elastic

        left = self.states * torch.sign(gaps.turns_below) * gaps.rates_below
        entered = _previous(self.states) * torch.sign(gaps.turns_above) * gaps.rates_above
        turned = left[..., None, :] * (joints[:, None] >= joints) + entered[..., None, :] * (joints[:, None] > joints)
        exponent = law.mu[..., None, None] * (slipped(self.turns) - turned)
        decay, tensions = self._decay[..., None], gaps.tensions[..., None, None]
        slopes = decay * (elastic + tensions * exponent)
        slopes = slopes + law.constant[..., None, None] * slipped(torch.ones_like(self.turns))
        pulled = (self.tensions > 0) & (gaps.crosses > 0)
        return torch.where(pulled[..., None], slopes, 0.0)


def frozen_work(law: FrictionLaw, amplitudes: Tensor, reached: Tensor, moved: Tensor) -> Tensor:
    """Work against friction while the distal lengths move, its amplitudes those at the beginning, (...) [N·mm].

    Args:
        law: of the friction.
        amplitudes, reached: at the beginning, (..., m, J).
        moved: by how much the distal lengths grow, (..., m, J) [mm].
    """
    if law.states is None:
        return torch.zeros_like(moved[..., 0, 0])
    presliding = law.presliding[..., None]
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
