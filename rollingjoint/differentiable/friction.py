"""Tendon friction with memory: its numbers, what one step leaves to the next, and both together for one step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import torch
from torch import Tensor

from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.shared.tolerances import LARGEST_INPUT

LARGEST_MU = 0.25
SMALLEST_PRESLIDING = 0.01  # mm


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
class FrictionStep:
    """Friction of one step: five numbers of every tendon, (..., m), and the history, (..., m, J), as all gaps have it.

    A step without history is a start: no hole has slipped, z = 0, as if there were no friction.
    """

    mu: Tensor
    presliding: Tensor
    extra_turn: Tensor
    constant: Tensor
    compliance: Tensor
    states: Tensor | None = None
    slips: Tensor | None = None

    @classmethod
    def of(
        cls, friction: DifferentiableFriction, before: FrictionStates | None, n_tendons: int, like: Tensor
    ) -> FrictionStep:
        """The step of so many tendons, on the device of another tensor.

        Raises:
            InvalidInput: numbers of another shape than the tendons ask for.
        """
        numbers = []
        for name in (field.name for field in fields(friction)):
            number = torch.as_tensor(getattr(friction, name), dtype=torch.float64, device=like.device)
            if number.ndim and number.shape[-1] not in (1, n_tendons):
                allowed = f"a number, (..., 1) or (..., {n_tendons})"
                raise InvalidInput(f"shape of {name}", tuple(number.shape), allowed)
            numbers.append(number.expand(*number.shape[:-1], n_tendons))
        step = cls(*numbers)
        return step if before is None else replace(step, states=before.states.mT, slips=before.slips.mT)

    def each(self, change: Callable[[Tensor, int], Tensor]) -> FrictionStep:
        """The step with every tensor changed, by a function that also gets the number of its own axes."""
        return replace(self, **{name: change(tensor, axes) for name, (tensor, axes) in self.tensors.items()})

    @property
    def tensors(self) -> dict[str, tuple[Tensor, int]]:
        """Every tensor, and the number of its own axes."""
        named = ((field.name, getattr(self, field.name)) for field in fields(self))
        return {name: (each, 2 if name in ("states", "slips") else 1) for name, each in named if each is not None}

    def where(self, good: Tensor) -> FrictionStep:
        """The step; in rows that are not good, (...), a constant that can be solved with."""
        calm = self.each(lambda tensor, axes: torch.where(good[(..., *(None,) * axes)], tensor, 0.0))
        return replace(calm, presliding=torch.where(good[..., None], self.presliding, 1.0))

    def usable(self) -> Tensor:
        """Whether the numbers of a row are finite and within their ranges, (...)."""
        good = (self.mu >= 0) & (self.mu <= LARGEST_MU) & (self.presliding >= SMALLEST_PRESLIDING)
        good = (good & (self.extra_turn >= 0) & (self.constant >= 0) & (self.compliance >= 0)).all(-1)
        for tensor, axes in self.tensors.values():
            good = good & (tensor.detach().abs() <= LARGEST_INPUT).flatten(-axes).all(-1)
        return good
