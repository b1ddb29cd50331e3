"""Motors between actions and tendons, in torch: the formulas of rj_gym/tracking/motors.py for all lanes."""

from __future__ import annotations

import torch
from torch import Tensor

from rj_gym.torch_env.lanes import Lanes, tendons
from rj_gym.tracking.arrays import (
    ASKED,
    BOUND,
    GOAL,
    IN_PLAY,
    LIMIT,
    MOTOR,
    MOVES,
    NEXT_GOAL,
    NEXT_MOTOR,
    STAYS,
    STOP,
    Rules,
)
from rollingjoint.differentiable.formulas import (
    motor_yield,
    paid_out,
    play_step,
    pull_end,
    pull_limit,
    unstretched_length,
)


def moved_motors(rules: Rules, lanes: Lanes, taken: Tensor, held: Tensor) -> Tensor:
    """Motors after a step that stands, and the positions that it asks of the tendons: rows MOTOR_ROWS, (B, 5, m) [mm].

    Args:
        rules: of the task.
        lanes: before the step.
        taken: its actions within [-1, 1], (B, m).
        held: commands of the tendons before it, (B, m) [mm].
    """
    delay, limit, m = rules.hardware.action_delay, rules.hardware.rate_limit, taken.shape[-1]
    due = lanes.past[:, delay, :m] if delay else taken
    position, band = lanes.motors[:, MOTOR], rules.hardware.dead_band
    goal = lanes.motors[:, GOAL] - rules.action_scale * due
    rest = play_step(position, goal, torch.full_like(goal, band)) if band > 0.0 else goal
    motor = position + (rest - position).clamp(-limit, limit)
    demands = play_step(held, motor, lanes.half_play)
    return torch.stack([position, lanes.motors[:, GOAL], motor, goal, demands], 1)


def bounded_pulls(lanes: Lanes, moved: Tensor) -> tuple[Tensor, Tensor]:
    """Motors and limits of tension of a step by a guess of how its pulls end, (B, 5, m) [mm] and (B, 3, m).

    For limits at motors; others stay as they are.

    Args:
        lanes: before the step.
        moved: see moved_motors.
    """
    tensions, held = tendons(lanes)
    pulls, bound = _pulls(lanes, moved), _bounds(lanes)
    ends_at_limit = pulls & (tensions <= bound)
    limits = lanes.limits.clone()
    limits[:, BOUND] = torch.where(ends_at_limit, bound, torch.inf)
    limits[:, STOP] = MOVES
    moved = moved.clone()
    moved[:, ASKED] = torch.where(pulls & ~ends_at_limit, held, moved[:, ASKED])
    return moved, limits


def revised_pulls(
    lanes: Lanes, moved: Tensor, limits: Tensor, valid: Tensor, tensions: Tensor, lengths: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Motors and limits where pulls end in another way than the equilibrium was solved for, and in which lanes, (B,).

    Args:
        lanes: before the step.
        moved, limits: that it was solved for, see bounded_pulls.
        valid: whether the equilibrium is a usable one, (B,).
        tensions, lengths: of the tendons there, (B, m) [N], [mm].
    """
    _, held = tendons(lanes)
    bound, stays = _bounds(lanes), limits[:, BOUND].isinf()
    free = unstretched_length(lengths, tensions, lanes.stiffnesses) - lanes.actuator_offsets
    pulls = _pulls(lanes, moved) & valid[:, None]
    to_limit = pulls & stays & (tensions < bound)
    to_rest = pulls & ~stays & (tensions >= bound) & paid_out(free, held)
    limits, moved = limits.clone(), moved.clone()
    limits[:, BOUND] = torch.where(to_limit, bound, torch.where(to_rest, torch.inf, limits[:, BOUND]))
    asked = torch.where(to_limit, moved[:, NEXT_MOTOR] + lanes.half_play, torch.where(to_rest, held, moved[:, ASKED]))
    wrong = (asked != moved[:, ASKED]).any(-1)
    moved[:, ASKED] = asked
    return moved, limits, wrong


def stopped_motors(lanes: Lanes, moved: Tensor, limits: Tensor, tensions: Tensor) -> tuple[Tensor, Tensor]:
    """Motors and limits where pulls have ended while their tendons stay: in the play, or at once.

    Args:
        lanes: before the step.
        moved, limits: at the end of the revisions.
        tensions: after the step, (B, m) [N].
    """
    motor, goal = moved[:, MOTOR], moved[:, NEXT_MOTOR]
    end = pull_end(moved[:, ASKED], motor, goal, tensions, limits[:, LIMIT], lanes.sheath, lanes.half_play)
    stopped = (goal < motor) & limits[:, BOUND].isinf() & (end > goal)
    moved, limits = moved.clone(), limits.clone()
    for row in (NEXT_MOTOR, NEXT_GOAL):
        moved[:, row] = torch.where(stopped, end, moved[:, row])
    where = torch.where(end == motor, float(STAYS), float(IN_PLAY))
    limits[:, STOP] = torch.where(stopped, where, limits[:, STOP])
    return moved, limits


def settled_motors(moved: Tensor, commands: Tensor) -> Tensor:
    """Motors at the end of a step that stands, (B, 5, m) [mm]: where a tension is at a limit, they move along.

    Args:
        moved: by the step, see moved_motors.
        commands: of the tendons after it, (B, m) [mm].
    """
    shift = commands - moved[:, ASKED]
    settled = torch.stack(motor_yield(moved[:, NEXT_MOTOR], moved[:, NEXT_GOAL], shift), 1)
    return torch.cat([settled, moved[:, NEXT_MOTOR:]], 1)


def _pulls(lanes: Lanes, moved: Tensor) -> Tensor:
    """Whether motors would pull their tendons in, beyond the play, (B, m)."""
    motor, held = moved[:, NEXT_MOTOR], tendons(lanes)[1]
    return (motor < moved[:, MOTOR]) & (motor + lanes.half_play < held)


def _bounds(lanes: Lanes) -> Tensor:
    """Tensions behind the sheath at which motors that pull stop, (B, m) [N]."""
    return pull_limit(lanes.limits[:, LIMIT], lanes.sheath, lanes.half_play)
