"""Steps of motors, tendons, tensions and tip, and their derivative, written by hand.

Values are the environment's; derivatives follow from the play operator and from the rates of the equilibrium
(`rj_gym.tracking.tangent.Tangent`). A step is linear in its derivative, and all its coefficients but the rates are one
number per tendon, computed for all steps at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rj_gym.tracking.tangent import Tangent
from rollingjoint.transmission import play_contact, play_place, play_step, sheath_direction, sheath_ratio

Array = NDArray[np.float32]

NO_PLAY = 1e-9  # mm: half a play below which derivatives by the place in it grow no more


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


@dataclass(frozen=True)
class Readings:
    """What B lanes show after a step, or the gradient by it.

    Args:
        motor: position q of the motors (B, m) [mm]. tension: measured (B, m) [N].
        tip: (B, d) [mm]. pose: (B, k) [mm, 1].
    """

    motor: Any
    tension: Any
    tip: Any
    pose: Any


class MotionTape:
    """T steps of motors and tendons, recorded by `add`, and then, last step first, their gradients.

    Args:
        motors: their response to actions. start: where episodes begin.
    Attributes:
        states: where they began, and after every step.
    """

    def __init__(self, motors: Motors, start: Tangent) -> None:
        self._motors, self.states, self._due = motors, [start], list[NDArray[Any]]()

    def add(self, due: NDArray[Any], tangent: Tangent) -> None:
        """A step of the environment in which the actions `due` (B, m), before clipping, reached the motors."""
        self._due.append(due)
        self.states.append(tangent)

    def begin_back(self) -> None:
        """Before the gradients by the last step."""
        self._now = len(self._due)
        self._coefficients = _coefficients(self._motors, self.states, np.stack(self._due))
        self._by_motor, self._by_goal, self._by_command = np.zeros((3, *self._due[0].shape), np.float32)

    def back(self, by: Readings, by_command: Any = 0.0) -> Array:
        """Gradient by the actions that reached the motors, (B, m), of the last step of which there is none yet.

        Args:
            by: gradient by what shows after the step. by_command: gradient by the tendons' commands (B, m).
        """
        self._now -= 1
        given, shown, shift, in_play, slip, held, rates, length_rates, taken_along, moves, heard = (
            coefficients[self._now] for coefficients in self._coefficients
        )
        by_motor = self._by_motor + by.motor + given * self._by_goal
        by_goal = self._by_goal - given * self._by_goal
        by_command = self._by_command + by_command
        by_shift, by_tension = shift * by.tension, shown * by.tension
        by_motor = by_motor - by_shift
        if in_play.any():  # such a motor is where tension and limit have it
            stopped = in_play * by_motor
            by_tension, by_motor, by_command = by_tension + slip * stopped, by_motor - stopped, by_command + stopped
        answers = _transposed(rates, np.concatenate([by.tip, by_tension, by.pose], 1))
        by_command = by_command + by_shift + (1.0 - held) * answers
        if held.any():  # at a tension limit motors and commands move with the lengths
            answers = _transposed(length_rates, held * (by_command + by_motor))
            by_command = np.where(held > 0.0, -by_motor, by_command + answers)
        dragged = taken_along * by_command
        by_motor, self._by_command = by_motor + dragged, by_command - dragged
        by_way = moves * by_motor
        self._by_motor, self._by_goal = by_motor - by_way, by_goal + by_way
        return heard * self._by_goal


class _Coefficients(NamedTuple):
    """Of the derivatives of T steps of B lanes by motors, goals and commands: (T, B, m) each but for rates."""

    given: NDArray[Any]  # 1 where the goal is where the motor is
    shown: NDArray[Any]  # d measured tension / d tension
    shift: NDArray[Any]  # d measured tension / d command, by the place in the play [N/mm]
    in_play: NDArray[Any]  # 1 where a limit stopped the motor in the play
    slip: NDArray[Any]  # d motor / d tension there [mm/N]
    held: NDArray[Any]  # 1 where the tension is at a limit
    rates: NDArray[Any]  # d tip, tension and pose / d command, (T, B, d + m + k, m)
    length_rates: NDArray[Any]  # (T, B, m, m)
    taken_along: NDArray[Any]  # 1 where the motor moved the tendon
    moves: NDArray[Any]  # 1 where the motor follows its goal
    heard: NDArray[Any]  # d goal / d action [mm]


def _coefficients(motors: Motors, tangents: list[Tangent], due: NDArray[Any]) -> _Coefficients:
    """The coefficients of steps with the actions `due` (T, B, m) between these T + 1 states."""
    after = Tangent(*(np.stack(arrays) for arrays in zip(*tangents[1:], strict=True)))
    motor, command = (
        np.stack([getattr(tangents[0], name), *getattr(after, name)[:-1]]) for name in ("motors", "commands")
    )
    half, held, stays, in_play = after.half_play, after.held, after.stays, after.in_play
    stopped = stays | in_play
    given = np.full(held.shape, True) if motors.follow_at_once else held | stopped
    goal = _goals(tangents[0].motors, after.motors, given, motors.scale * np.clip(due, -1.0, 1.0))
    way = goal - motor if motors.dead_band == 0.0 else play_step(motor, goal, motors.dead_band) - motor
    reached = motor + (way if motors.limit is None else np.clip(way, -motors.limit, motors.limit))
    free = ~stays if motors.limit is None else ~stays & (np.abs(way) <= motors.limit)
    place = play_place(after.commands, after.motors, half)
    shown = after.cell_gains * sheath_ratio(after.cell_sheath, sheath_direction(after.commands, after.motors, half))
    shifts, slips = (np.abs(place) <= 1.0) & (half > 0.0), np.maximum(after.sheath, NO_PLAY) * after.tensions
    values = _Coefficients(
        given=given,
        shown=shown,
        shift=np.where(shifts, after.tensions * shown * after.cell_sheath / np.maximum(half, NO_PLAY), 0.0),
        in_play=in_play,
        slip=np.divide(half, slips, out=np.zeros_like(half), where=in_play),
        held=held,
        rates=np.concatenate([after.tip_rates, after.tension_rates, after.pose_rates], 2),
        length_rates=after.length_rates,
        taken_along=(play_contact(command, reached, half) != 0.0) & ~stopped,
        moves=free & (way != 0.0) if motors.dead_band > 0.0 else free,
        heard=np.where(np.abs(due) <= 1.0, -motors.scale, 0.0),
    )
    return _Coefficients(*(array.astype(np.float32) for array in values))


def _goals(start: NDArray[Any], motors: NDArray[Any], given: NDArray[np.bool_], moves: NDArray[Any]) -> NDArray[Any]:
    """Where motors are asked to go in every step, (T, B, m) [mm]: from where they went before, by the moves.

    Args:
        start: where they go before the first step. motors: where they are after each.
        given: where they go on from there, and not from where they were to go.
    """
    goals, goal = np.empty_like(motors), start
    for step, (motor, stands, move) in enumerate(zip(motors, given, moves, strict=True)):
        goals[step] = goal - move
        goal = np.where(stands, motor, goals[step])
    return goals


def _transposed(rates: Array, by: Array) -> Array:
    """Gradients by the factors of the rates (B, k, m), from the gradients by the products (B, k)."""
    return np.einsum("bkm,bk->bm", rates, by)
