"""Tendon friction with memory, in tensors: its coefficients, and what one step leaves to the next."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from rollingjoint.errors import InvalidInput
from rollingjoint.friction import NO_FRICTION, RANGES, CapstanFriction
from rollingjoint.kernels.arrays import LARGEST_INPUT

COEFFICIENTS = ("mu", "presliding", "extra_turn", "constant", "compliance")  # order: that of friction_coefficients
HISTORY = {"states": 2, "slips": 2, "grips": 2, "angles": 1}  # axes after those of the batch


def _number(value: Any) -> Tensor:
    """A number as a tensor with one axis, a tensor as it is; double precision."""
    tensor = torch.as_tensor(value, dtype=torch.float64)
    return tensor if tensor.ndim else tensor[None]


@dataclass(frozen=True, eq=False)
class DifferentiableFriction:
    """Friction of the tendons as `rollingjoint.CapstanFriction` has it, by tensors that can be differentiated.

    Each is a number, or a tensor: (..., m) with one value per tendon, (..., 1) with one for all, leading axes as of
    designs. A row whose numbers are not in the ranges of CapstanFriction is INVALID_INPUT. Rolling resistance is not
    covered.

    Args:
        mu: coefficient of friction.
        presliding: slip over which friction builds up [mm].
        extra_turn: turn that every link adds [rad].
        constant: friction force that every link adds [N].
        compliance: stretch of the tendon between the base and its end per newton [mm/N].
    """

    mu: Tensor
    presliding: Tensor = _number(NO_FRICTION.presliding)  # noqa: RUF009 - constant
    extra_turn: Tensor = _number(0.0)  # noqa: RUF009
    constant: Tensor = _number(0.0)  # noqa: RUF009
    compliance: Tensor = _number(0.0)  # noqa: RUF009

    def __post_init__(self) -> None:
        for name in COEFFICIENTS:
            object.__setattr__(self, name, _number(getattr(self, name)))

    @property
    def tensors(self) -> tuple[Tensor, ...]:
        """Its coefficients, (..., 1) or (..., m)."""
        return tuple(getattr(self, name) for name in COEFFICIENTS)

    def each(self, change: Callable[[Tensor], Tensor]) -> DifferentiableFriction:
        """The friction with every coefficient changed."""
        return DifferentiableFriction(*map(change, self.tensors))

    def usable(self) -> Tensor:
        """Whether the coefficients of a row are in their ranges, (...)."""
        named = zip(COEFFICIENTS, self.tensors, strict=True)
        good = [((t >= RANGES[name][0]) & (t <= RANGES[name][1])).all(-1) for name, t in named]
        return torch.stack(torch.broadcast_tensors(*good)).all(0)

    def where(self, good: Tensor) -> DifferentiableFriction:
        """The friction; in rows that are not good, (...), a constant that can be solved with."""
        calm = (0.0, NO_FRICTION.presliding, 0.0, 0.0, 0.0)
        pairs = zip(self.tensors, calm, strict=True)
        return DifferentiableFriction(*(torch.where(good[..., None], tensor, value) for tensor, value in pairs))


def as_friction(
    friction: DifferentiableFriction | CapstanFriction, n_tendons: int, like: Tensor
) -> DifferentiableFriction:
    """The friction of so many tendons, on the device of another tensor.

    Raises:
        InvalidInput: it is none, has rolling resistance, or numbers for another number of tendons.
    """
    if isinstance(friction, CapstanFriction):
        without_rolling(friction.rolling)
        friction = DifferentiableFriction(*(getattr(friction, name) for name in COEFFICIENTS))
    if not isinstance(friction, DifferentiableFriction):
        raise InvalidInput("friction", friction, "a DifferentiableFriction or a CapstanFriction")
    for name, tensor in zip(COEFFICIENTS, friction.tensors, strict=True):
        if tensor.shape[-1] not in (1, n_tendons):
            raise InvalidInput(f"shape of {name}", tuple(tensor.shape), f"a number, (..., 1) or (..., {n_tendons})")
    return friction.each(lambda tensor: tensor.to(like.device))


def without_rolling(arm: float) -> None:
    """Refuse rolling resistance: InvalidInput."""
    if arm > 0.0:
        raise InvalidInput("rolling of the friction", arm, "0: gradients do not cover rolling resistance")


@dataclass(frozen=True, eq=False)
class FrictionStates:
    """What friction remembers of the steps of a batch, as `rollingjoint.FrictionState`: the history of the next ones.

    Gradients flow through it.

    Attributes:
        states: (..., n - 1, m) friction state of every tendon in links 0 to n - 2, -1 to 1.
        slips: (..., n - 1, m) slip coordinate [mm].
        grips: (..., n - 1, m) friction force of the link's holes where the tendon slips [N].
        angles: (..., n - 1) joint angles [rad].
    """

    states: Tensor
    slips: Tensor
    grips: Tensor
    angles: Tensor

    def each(self, change: Callable[[Tensor, int], Tensor]) -> FrictionStates:
        """The same with every tensor changed, by a function that also gets the number of its own axes."""
        return FrictionStates(**{name: change(getattr(self, name), axes) for name, axes in HISTORY.items()})

    @property
    def leading(self) -> list[torch.Size]:
        """The leading axes of every tensor."""
        return [getattr(self, name).shape[:-axes] for name, axes in HISTORY.items()]

    def detach(self) -> FrictionStates:
        """The same as a constant: no gradients flow to earlier steps."""
        return self.each(lambda tensor, _: tensor.detach())

    def usable(self) -> Tensor:
        """Whether a row is finite, and its friction states from -1 to 1, (...)."""
        good = (self.states.abs() <= 1.0).flatten(-2).all(-1)
        for name, axes in HISTORY.items():
            good = good & (getattr(self, name).detach().abs() <= LARGEST_INPUT).flatten(-axes).all(-1)
        return good

    def where(self, good: Tensor) -> FrictionStates:
        """The same; zeros in rows that are not good, (...)."""
        return self.each(lambda tensor, axes: torch.where(good[(..., *(None,) * axes)], tensor, 0.0))
