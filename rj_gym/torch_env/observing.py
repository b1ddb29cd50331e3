"""Observations as tensors: the formulas of rj_gym/tracking/measuring.py."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from rj_gym.core.columns import ERROR, STEP, TARGET, TIP
from rj_gym.core.task import POSITION_BOUND
from rj_gym.torch_env.lanes import Lanes, tendons
from rj_gym.torch_env.sensing import link_entries, load_entries, seen_poses
from rj_gym.tracking.arrays import AGE, LAG_TENSION, NEW, POSITION, TAKEN, TENSION, Rules
from rj_gym.tracking.planar import PlanarTask


@dataclass(frozen=True)
class Observer:
    """The data of observations, on a device."""

    rules: Rules
    neutral_lengths: Tensor
    low: Tensor
    high: Tensor
    lags: Tensor

    @classmethod
    def of(cls, rules: Rules, device: torch.device) -> Observer:
        """The observer of these rules."""
        arrays = rules.neutral_lengths, rules.low, rules.high, rules.hardware.lags
        return cls(rules, *(torch.tensor(array, device=device) for array in arrays))

    def vectors(self, lanes: Lanes) -> Tensor:
        """The observations of all lanes, (B, entries), float32."""
        rules, readings = self.rules, lanes.readings
        poses = seen_poses(rules, lanes)[:, rules.first_seen :]
        tensions, commands = tendons(lanes)
        if rules.hardware.active:
            tensions, commands = lanes.measured[:, TENSION], lanes.measured[:, POSITION]
        parts = [link_entries(rules, poses), (commands - self.neutral_lengths) / rules.command_scale]
        if rules.observe_tensions:
            parts.append(tensions / rules.highest_tension)
        if rules.observe_target:
            target = readings[:, TARGET : TARGET + 2]
            parts.append(target / rules.length)
            if poses.shape[1]:
                parts.append((target - poses[:, -1, :2]) / rules.error_scale)
        if rules.observe_load:
            parts += load_entries(rules, readings, lanes.poses.shape[1] - 1)
        if rules.hardware.late:
            age = (readings[:, STEP] - lanes.picture[:, TAKEN]) / AGE
            parts += [age[:, None], lanes.picture[:, NEW, None]]
        if len(self.lags):
            parts.append(self._past(lanes))
        vectors = torch.cat(parts, -1).float()
        return torch.minimum(torch.maximum(vectors, self.low), self.high)

    def privileged(self, readings: Tensor) -> Tensor:
        """The privileged state, (B, K) float32."""
        first = self.rules.hardware.privileged_at
        return readings[:, first : first + len(self.rules.hardware.privileged_low)].float()

    def _past(self, lanes: Lanes) -> Tensor:
        """Past readings, lag by lag: actions; positions, tensions and errors then minus now, (B, lags x width)."""
        rules, past, m = self.rules, lanes.past, lanes.actions.shape[-1]
        then = past.index_select(1, self.lags)
        actions, positions, tensions, errors = then.split([m, m, m, past.shape[-1] - 3 * m], -1)
        _, position, tension, error = past[:, :1].split([m, m, m, past.shape[-1] - 3 * m], -1)
        changes = [(positions - position) / rules.action_scale, (tensions - tension) / LAG_TENSION]
        return torch.cat([actions, *changes, (errors - error) / rules.error_scale], -1).flatten(1)


def goals(task: PlanarTask, readings: Tensor) -> dict[str, Tensor]:
    """The goals of an observation with goals, (B, 2) float32 each."""
    places = {"achieved_goal": TIP, "desired_goal": TARGET}
    scaled = {name: readings[:, at : at + 2] / task.length for name, at in places.items()}
    return {name: goal.clamp(-POSITION_BOUND, POSITION_BOUND).float() for name, goal in scaled.items()}


def goal_reward(task: PlanarTask, achieved: Tensor, desired: Tensor) -> Tensor:
    """Reward for goals (..., 2), (...)."""
    reward = task.config.reward
    error = task.length * torch.linalg.vector_norm(achieved.double() - desired.double(), dim=-1)
    if reward.goal == "sparse":
        return -(error > reward.goal_tolerance_mm).double()
    return -error / reward.error_scale_mm


def reached(task: PlanarTask, readings: Tensor) -> Tensor:
    """Whether the target is reached within the tolerance, (B,)."""
    return readings[:, ERROR] <= task.config.reward.goal_tolerance_mm
