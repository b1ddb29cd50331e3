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
from rollingjoint.transmission import play_contact, play_place, play_step, sheath_direction, sheath_ratio

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
        dead_band: within which a motor is at rest about where it is going [mm].
    """

    scale: float
    limit: float | None
    dead_band: float = 0.0

    @property
    def follow_at_once(self) -> bool:
        """Whether motors are where they are going after every step."""
        return self.limit is None and self.dead_band == 0.0


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
        way = goal - motor if motors.dead_band == 0.0 else play_step(motor, goal, motors.dead_band) - motor
        after = motor + (way if motors.limit is None else np.clip(way, -motors.limit, motors.limit))
        stopped = tangent.stays | tangent.in_play
        ctx.heard = np.abs(due) <= 1.0
        ctx.free = np.full(way.shape, True) if motors.limit is None else np.abs(way) <= motors.limit
        if motors.dead_band > 0.0:
            ctx.free = ctx.free & (way != 0.0)
        ctx.taken_along = (play_contact(command, after, tangent.half_play) != 0.0) & ~stopped
        goal = tangent.motors if motors.follow_at_once else np.where(tangent.held | stopped, tangent.motors, goal)
        return _found(tangent, goal)

    @staticmethod
    def backward(ctx: Any, *by: torch.Tensor) -> Any:
        by_motor, by_goal, by_command, *by_read = (tensor.numpy() for tensor in by)
        tangent, held = ctx.tangent, ctx.tangent.held
        given = np.full(held.shape, True) if ctx.motors.follow_at_once else held | tangent.stays | tangent.in_play
        by_goal, by_motor = np.where(given, 0.0, by_goal), by_motor + np.where(given, by_goal, 0.0)
        by_command, by_motor = _through_readings(tangent, by_motor, by_command, *by_read)
        if held.any():
            by_command = _through_limits(tangent, by_motor, by_command)
        by_motor = by_motor + np.where(ctx.taken_along, by_command, 0.0)
        by_command = np.where(ctx.taken_along, 0.0, by_command)
        moves = ctx.free & ~tangent.stays
        by_goal, by_motor = by_goal + np.where(moves, by_motor, 0.0), np.where(moves, 0.0, by_motor)
        by_due = np.where(ctx.heard, -ctx.motors.scale * by_goal, 0.0)
        return None, None, *(single(tensor) for tensor in (by_due, by_motor, by_goal, by_command))


def _found(tangent: Tangent, goal: NDArray[Any]) -> tuple[torch.Tensor, ...]:
    """The fields of Motion."""
    measured = tangent.tensions * _shown(tangent)
    results = tangent.motors, goal, tangent.commands, measured, tangent.tips, tangent.poses
    return tuple(single(values) for values in results)


def _shown(tangent: Tangent) -> NDArray[np.float64]:
    """Measured tensions over true ones, (B, m), but for offsets of load cells."""
    place = sheath_direction(tangent.commands, tangent.motors, tangent.half_play)
    return tangent.cell_gains * sheath_ratio(tangent.cell_sheath, place)


def _through_readings(
    tangent: Tangent, by_motor: Array, by_command: Array, by_measured: Array, by_tip: Array, by_pose: Array
) -> tuple[Any, Any]:
    """Gradients by commands and motors, through the readings too."""
    half, shown = tangent.half_play, _shown(tangent)
    shifts = (np.abs(play_place(tangent.commands, tangent.motors, half)) <= 1.0) & (half > 0.0)
    by_shift = np.where(
        shifts, by_measured * tangent.tensions * shown * tangent.cell_sheath / np.maximum(half, NO_PLAY), 0.0
    )
    by_motor, by_tension = by_motor - by_shift, by_measured * shown
    if tangent.in_play.any():  # such a motor is where tension and limit have it
        stopped = np.where(tangent.in_play, by_motor, 0.0)
        by_tension = by_tension + stopped * half / (np.maximum(tangent.sheath, NO_PLAY) * tangent.tensions)
        by_motor, by_command = by_motor - stopped, by_command + stopped
    rates = tangent.tip_rates, tangent.tension_rates, tangent.pose_rates
    answers = sum(map(_transposed, rates, (by_tip, by_tension, by_pose)))
    return by_command + by_shift + np.where(tangent.held, 0.0, answers), by_motor


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
