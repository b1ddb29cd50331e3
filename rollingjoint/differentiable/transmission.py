"""The transmission of motors in torch: the formulas of rollingjoint/transmission, with its symbols, of tensors."""

from __future__ import annotations

import torch
from torch import Tensor

from rollingjoint.transmission.kernels import FREE


def play_step(tendon: Tensor, motor: Tensor, half_width: Tensor) -> Tensor:
    """p after a step of the motor to q [mm]."""
    return torch.minimum(torch.maximum(tendon, motor - half_width), motor + half_width)


def sheath_direction(tendon: Tensor, motor: Tensor, half_width: Tensor) -> Tensor:
    """zeta, along which friction acts on a tendon in its sheath, within [-1, 1]; 0 without play."""
    return torch.where(half_width > 0.0, (tendon - motor) / half_width, 0.0).clamp(-1.0, 1.0)


def sheath_ratio(friction: Tensor, direction: Tensor) -> Tensor:
    """Ratio of the tension at the motor to the tension behind the sheath."""
    return (friction * direction).exp()


def limited_tension(pull: Tensor, low: Tensor, high: Tensor) -> Tensor:
    """T of an elastic tendon, from its pull k (l - p) [N]."""
    return torch.where(pull <= low, low, torch.where(pull >= high, high, pull))


def at_limit(tension: Tensor, low: Tensor, high: Tensor) -> Tensor:
    """Whether a motor holds or gives way at this tension, or at this pull [N]; bool."""
    return (tension <= low) | (tension >= high)


def unstretched_length(length: Tensor, tension: Tensor, stiffness: Tensor) -> Tensor:
    """p of a tendon with this length and tension [mm]."""
    return length - tension / stiffness


def pull_limit(limit: Tensor, friction: Tensor, half_width: Tensor) -> Tensor:
    """T behind the sheath at which a motor that pulls its tendon in stops [N]."""
    return torch.where(half_width > 0.0, limit / sheath_ratio(friction, torch.ones_like(friction)), limit)


def pull_end(
    tendon: Tensor, motor: Tensor, goal: Tensor, tension: Tensor, limit: Tensor, friction: Tensor, half_width: Tensor
) -> Tensor:
    """q where a pull from q to a goal ends while the tendon stays at p [mm]."""
    at_goal, at_start = (
        tension * sheath_ratio(friction, sheath_direction(tendon, q, half_width)) for q in (goal, motor)
    )
    stops = torch.minimum(torch.maximum(tendon - half_width * (limit / tension).log() / friction, goal), motor)
    ends = torch.where(at_start >= limit, motor, stops)
    return torch.where(at_goal < limit, torch.maximum(goal, tendon - half_width), ends)


def paid_out(unstretched: Tensor, held: Tensor) -> Tensor:
    """Whether a tendon at p has been paid out from where it was [mm]; bool."""
    return unstretched > held + FREE


def motor_yield(motor: Tensor, goal: Tensor, shift: Tensor) -> tuple[Tensor, Tensor]:
    """(q, goal of the motor) after a limit of tension has shifted its tendon [mm]."""
    motor, goal = motor + shift, goal + shift
    return motor, torch.where(shift.abs() > FREE, motor, goal)
