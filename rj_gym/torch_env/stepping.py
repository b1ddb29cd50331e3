"""The formulas of a step in torch, for all lanes, as in rj_gym/tracking/kernels.py."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import torch
from torch import Tensor

from rj_gym.core.columns import (
    EFFORT,
    ERROR,
    FAILURE,
    FORCE,
    REWARD,
    SMOOTHNESS,
    STATUS,
    STEP,
    TARGET,
    TENSIONS,
    TIP,
    TRACKING,
)
from rj_gym.torch_env.actuation import bounded_pulls, moved_motors, revised_pulls, settled_motors, stopped_motors
from rj_gym.torch_env.lanes import Lanes, at_step, tendons
from rj_gym.tracking.arrays import ASKED, BOUND, Rules
from rj_gym.tracking.kernels import PREDICTABLE
from rollingjoint.chain.status import Status
from rollingjoint.differentiable import Settled
from rollingjoint.differentiable.formulas import unstretched_length


class Prepared(NamedTuple):
    """The inputs of the solve of a step."""

    actions: Tensor  # the last ones, within [-1, 1], and those before, (B, 2, m)
    motors: Tensor  # see moved_motors; where they are not active, (0, 5, m)
    limits: Tensor  # see bounded_pulls; where every motor has the same, (0, 3, m)
    commands: Tensor  # (B, m) mm
    starts: Tensor  # (B, J) rad
    loads: Tensor  # (B, 1, columns)
    readings: Tensor  # with steps and forces of this step

    def highest(self, limit: Tensor) -> Tensor:
        """The highest tensions that tendons can have; `limit`, (), where every motor has the same [N]."""
        return self.limits[:, BOUND] if len(self.limits) else limit


@dataclass(frozen=True)
class Solved:
    """The results of the solve of a step; names, shapes and units of rj_gym/tracking/arrays.py."""

    joint_angles: Tensor
    responses: Tensor
    poses: Tensor
    tensions: Tensor
    lengths: Tensor
    status: Tensor
    contacts: Tensor  # (B, J, 2) mm

    @classmethod
    def of(cls, settled: Settled) -> Solved:
        """The equilibria that a device has found."""
        status = torch.where(settled.held, int(Status.AT_LIMIT), int(Status.CONVERGED))
        parts = settled.joint_angles, settled.responses, settled.poses, settled.tensions, settled.lengths
        return cls(*parts, status, settled.contacts)

    def with_lanes(self, where: Tensor, other: Solved) -> Solved:
        """These results, and others in some lanes, (B,)."""
        return Solved(*(_taken(where, getattr(other, part.name), getattr(self, part.name)) for part in fields(self)))


def prepare(rules: Rules, lanes: Lanes, actions: Tensor) -> Prepared:
    """Begin a step with actions (B, m): tendons are pulled, the load moves on, starts lie on the last tangent."""
    readings = lanes.readings.clone()
    readings[:, STEP] += 1.0
    taken = actions.clamp(-1.0, 1.0)
    _, held = tendons(lanes)
    motors, limits = moved_motors(rules, lanes, taken, held) if rules.hardware.active else lanes.motors, lanes.limits
    if rules.hardware.limits_pulls:
        motors, limits = bounded_pulls(lanes, motors)
    demands = motors[:, ASKED] if rules.hardware.active else held - rules.action_scale * taken
    commands = demands + lanes.actuator_offsets
    turns = (lanes.responses * (commands - (held + lanes.actuator_offsets))[:, None]).sum(-1)
    near = turns.abs().amax(-1, keepdim=True) < PREDICTABLE
    forces = at_step(lanes.forces, readings[:, STEP])
    loads = lanes.loads.clone()
    loads[:, 0, rules.force_column : rules.force_column + 2] = readings[:, FORCE : FORCE + 2] = forces
    starts = torch.where(near, lanes.angles + turns, lanes.angles)
    return Prepared(torch.stack([taken, lanes.actions[:, 0]], 1), motors, limits, commands, starts, loads, readings)


def revised(lanes: Lanes, prepared: Prepared, solved: Solved) -> tuple[Prepared, Tensor]:
    """The inputs of the solve where pulls end in another way than was solved for, and in which lanes, (B,)."""
    valid = _usable(solved)
    parts = revised_pulls(lanes, prepared.motors, prepared.limits, valid, solved.tensions, solved.lengths)
    motors, limits, wrong = parts
    commands = torch.where(wrong[:, None], motors[:, ASKED] + lanes.actuator_offsets, prepared.commands)
    return prepared._replace(motors=motors, limits=limits, commands=commands), wrong


def finished(rules: Rules, lanes: Lanes, prepared: Prepared, solved: Solved) -> Lanes:
    """The lanes after the solve. A lane without a usable equilibrium keeps its pose, tensions and commands."""
    readings, m = prepared.readings, solved.tensions.shape[-1]
    readings[:, STATUS] = solved.status.to(readings.dtype)
    valid = _usable(solved)
    unstretched = unstretched_length(solved.lengths, solved.tensions, lanes.stiffnesses) - lanes.actuator_offsets
    pulled = torch.cat([solved.tensions, unstretched], -1)
    readings[:, TENSIONS : TENSIONS + 2 * m] = _taken(valid, pulled, readings[:, TENSIONS : TENSIONS + 2 * m])
    after = replace(
        lanes,
        angles=_taken(valid, solved.joint_angles, lanes.angles),
        responses=_taken(valid, solved.responses, lanes.responses),
        poses=_taken(valid, solved.poses, lanes.poses),
        actions=prepared.actions,
        readings=readings,
    )
    if rules.hardware.active:
        motors, limits = prepared.motors, prepared.limits
        if rules.hardware.limits_pulls:
            motors, limits = stopped_motors(lanes, motors, limits, solved.tensions)
        motors = _taken(valid, settled_motors(motors, unstretched), lanes.motors)
        after = replace(after, motors=motors, limits=_taken(valid, limits, prepared.limits) if len(limits) else limits)
    if len(lanes.tip_rates):
        after = replace(after, tip_rates=_taken(valid, _tip_rates(solved), lanes.tip_rates))
    _measure_error(after)
    _fill_rewards(rules, after, valid)
    return after


def _usable(solved: Solved) -> Tensor:
    return solved.status <= int(Status.AT_LIMIT)


def _tip_rates(solved: Solved) -> Tensor:
    """How the tip moves with the commands, (B, 2, m): every joint turns the links beyond it about its contact."""
    x, y = (solved.poses[:, -1:, :2] - solved.contacts)[..., None].unbind(2)
    return torch.stack([-(y * solved.responses).sum(1), (x * solved.responses).sum(1)], 1)


def _measure_error(lanes: Lanes) -> None:
    """Tips, targets and the distances between them."""
    readings = lanes.readings
    readings[:, TIP : TIP + 2] = lanes.poses[:, -1, :2]
    readings[:, TARGET : TARGET + 2] = at_step(lanes.targets, readings[:, STEP])
    offset = readings[:, TIP : TIP + 2] - readings[:, TARGET : TARGET + 2]
    readings[:, ERROR] = offset.square().sum(-1).sqrt()


def _fill_rewards(rules: Rules, lanes: Lanes, valid: Tensor) -> None:
    """The terms of the reward, and their sum."""
    readings, m = lanes.readings, lanes.actions.shape[-1]
    error, tensions = readings[:, ERROR], readings[:, TENSIONS : TENSIONS + m]
    tracking = -error / rules.error_scale
    if rules.precision > 0.0:
        tracking = tracking - rules.precision * error / (error + 1.0)
    effort = (tensions / rules.highest_tension).square().sum(-1) * (-rules.effort / m)
    smoothness = (lanes.actions[:, 0] - lanes.actions[:, 1]).square().sum(-1) * (-rules.smoothness / m)
    failure = torch.where(valid, torch.zeros_like(error), -rules.failure_penalty)
    columns = {TRACKING: tracking, EFFORT: effort, SMOOTHNESS: smoothness, FAILURE: failure}
    for column, values in columns.items():
        readings[:, column] = values
    readings[:, REWARD] = tracking + effort + smoothness + failure


def _taken(where: Tensor, new: Tensor, old: Tensor) -> Tensor:
    return torch.where(where[(..., *(None,) * (new.ndim - 1))], new, old)
