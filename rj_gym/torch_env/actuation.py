"""Motors between actions and tendons, in torch: the formulas of rj_gym/tracking/kernels.py for all lanes."""

from __future__ import annotations

import torch
from torch import Tensor

from rj_gym.torch_env.lanes import Lanes
from rj_gym.tracking.arrays import ASKED, GOAL, MOTOR, NEXT_GOAL, NEXT_MOTOR, Rules
from rollingjoint.differentiable.transmission import motor_yield, play_step


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
    position, half = lanes.motors[:, MOTOR], lanes.half_play
    goal = lanes.motors[:, GOAL] - rules.action_scale * due
    motor = position + (goal - position).clamp(-limit, limit)
    demands = play_step(held, motor, half)
    return torch.stack([position, lanes.motors[:, GOAL], motor, goal, demands], 1)


def settled_motors(moved: Tensor, commands: Tensor) -> Tensor:
    """Motors at the end of a step that stands, (B, 5, m) [mm]: where a tension is at a limit, they move along.

    Args:
        moved: by the step, see moved_motors.
        commands: of the tendons after it, (B, m) [mm].
    """
    shift = commands - moved[:, ASKED]
    settled = torch.stack(motor_yield(moved[:, NEXT_MOTOR], moved[:, NEXT_GOAL], shift), 1)
    return torch.cat([settled, moved[:, NEXT_MOTOR:]], 1)
