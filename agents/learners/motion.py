"""One step of motors, tendons, tensions and tip, as a node with a derivative written by hand.

Values are the environment's; derivatives follow from the play operator and from the rates of the equilibrium
(`rj_gym.tracking.tangent.Tangent`). One node takes the place of some forty of torch's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from rj_gym.tracking.tangent import Tangent
from rollingjoint.transmission import play_contact, play_place, sheath_direction, sheath_ratio

Array = NDArray[np.float32]

NO_PLAY = 1e-9  # mm: half a play below which derivatives by the place in it grow no more


class Motion(NamedTuple):
    """B lanes after a step, with gradients.

    Position q of the motors, where they are going, and tendon commands p, (B, m) [mm]; measured tensions (B, m) [N];
    tips (B, d) [mm] and poses (B, k) [mm, 1].
    """

    motor: torch.Tensor
    goal: torch.Tensor
    command: torch.Tensor
    tension: torch.Tensor
    tip: torch.Tensor
    pose: torch.Tensor


@dataclass(frozen=True)
class Motors:
    """The motors' response to actions.

    Args:
        scale: of actions [mm]. limit: the largest move of a step [mm]; None: any.
    """

    scale: float
    limit: float | None


def at_rest(tangent: Tangent) -> Motion:
    """Where episodes begin."""
    return Motion(*_found(tangent, tangent.motors))


def moved(before: Motion, due: torch.Tensor, tangent: Tangent, motors: Motors) -> Motion:
    """The environment's motion after a step in which the actions `due` (B, m) reached the motors."""
    return Motion(*_MotorStep.apply(tangent, motors, due, before.motor, before.goal, before.command))


class _MotorStep(torch.autograd.Function):
    """Gradients by actions, motors, goals and commands before the step. Names: `by_x` is the gradient by x."""

    @staticmethod
    def forward(ctx: Any, tangent: Tangent, motors: Motors, *before: torch.Tensor) -> Any:
        due, motor, goal, command = (tensor.numpy() for tensor in before)
        ctx.tangent, ctx.motors = tangent, motors
        goal = goal - motors.scale * np.clip(due, -1.0, 1.0)
        way = goal - motor
        after = goal if motors.limit is None else motor + np.clip(way, -motors.limit, motors.limit)
        ctx.heard = np.abs(due) <= 1.0
        ctx.free = True if motors.limit is None else np.abs(way) <= motors.limit
        ctx.taken_along = play_contact(command, after, tangent.half_play) != 0.0
        goal = tangent.motors if motors.limit is None else np.where(tangent.held, tangent.motors, goal)
        return _found(tangent, goal)

    @staticmethod
    def backward(ctx: Any, *by: torch.Tensor) -> Any:
        by_motor, by_goal, by_command, *by_read = (tensor.numpy() for tensor in by)
        tangent, held = ctx.tangent, ctx.tangent.held
        by_command, by_motor = _through_readings(tangent, by_motor, by_command, *by_read)
        if ctx.motors.limit is None:
            by_motor, by_goal = by_motor + by_goal, 0.0
        else:
            by_motor, by_goal = by_motor + np.where(held, by_goal, 0.0), np.where(held, 0.0, by_goal)
        if held.any():
            by_command = _through_limits(tangent, by_motor, by_command)
        by_motor = by_motor + np.where(ctx.taken_along, by_command, 0.0)
        by_command = np.where(ctx.taken_along, 0.0, by_command)
        by_goal, by_motor = by_goal + np.where(ctx.free, by_motor, 0.0), np.where(ctx.free, 0.0, by_motor)
        by_due = np.where(ctx.heard, -ctx.motors.scale * by_goal, 0.0)
        return None, None, *(single(tensor) for tensor in (by_due, by_motor, by_goal, by_command))


def _found(tangent: Tangent, goal: NDArray[Any]) -> tuple[torch.Tensor, ...]:
    """The fields of Motion."""
    measured = tangent.tensions * _ratio(tangent)
    results = tangent.motors, goal, tangent.commands, measured, tangent.tips, tangent.poses
    return tuple(single(values) for values in results)


def _ratio(tangent: Tangent) -> NDArray[np.float64]:
    """Measured tensions over true ones, (B, m)."""
    return sheath_ratio(tangent.sheath, sheath_direction(tangent.commands, tangent.motors, tangent.half_play))


def _through_readings(
    tangent: Tangent, by_motor: Array, by_command: Array, by_measured: Array, by_tip: Array, by_pose: Array
) -> tuple[Any, Any]:
    """Gradients by commands and motors, through the readings too."""
    half, rubbed = tangent.half_play, _ratio(tangent)
    shifts = (np.abs(play_place(tangent.commands, tangent.motors, half)) <= 1.0) & (half > 0.0)
    by_shift = np.where(
        shifts, by_measured * tangent.tensions * rubbed * tangent.sheath / np.maximum(half, NO_PLAY), 0.0
    )
    rates = tangent.tip_rates, tangent.tension_rates, tangent.pose_rates
    answers = sum(map(_transposed, rates, (by_tip, by_measured * rubbed, by_pose)))
    return by_command + by_shift + np.where(tangent.held, 0.0, answers), by_motor - by_shift


def _through_limits(tangent: Tangent, by_motor: Any, by_command: Any) -> Any:
    """By commands before tendons at a tension limit gave way: there motors and commands move with the lengths."""
    held, by_length = tangent.held, by_command + by_motor
    answers = _transposed(tangent.length_rates, np.where(held, by_length, 0.0))
    return np.where(held, -by_motor, by_command + answers)


def _transposed(rates: NDArray[np.float64], by: Any) -> Any:
    """Gradients by the factors of the rates (B, k, m), from the gradients by the products (B, k)."""
    return np.einsum("bkm,bk->bm", rates, by)


def single(array: Any) -> torch.Tensor:
    """An array as a tensor of single precision."""
    return torch.as_tensor(np.ascontiguousarray(array, np.float32))
