"""Observations as tensors: the formulas of rj_gym/planar/measuring.py where nothing comes late."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from rj_gym.core.columns import ERROR, FORCE, LINK, TARGET, TENSIONS, TIP
from rj_gym.core.observation import POSITION_BOUND
from rj_gym.planar.kernels import Rules
from rj_gym.planar.task import PlanarTask
from rj_gym.torch_env.lanes import Lanes
from rj_gym.torch_env.stepping import now


@dataclass(frozen=True)
class Observer:
    """What observations are made with, on a device."""

    rules: Rules
    neutral_lengths: Tensor
    low: Tensor
    high: Tensor

    @classmethod
    def of(cls, rules: Rules, device: torch.device) -> Observer:
        """The observer of these rules."""
        arrays = rules.neutral_lengths, rules.low, rules.high
        return cls(rules, *(torch.tensor(array, device=device) for array in arrays))

    def vectors(self, lanes: Lanes) -> Tensor:
        """The observations of all lanes, (B, entries), float32."""
        rules, readings, m = self.rules, lanes.readings, lanes.actions.shape[-1]
        seen = lanes.poses[:, 1:]
        if lanes.noise.shape[1]:
            seen = seen + now(lanes.noise, readings)
        angles = seen[..., 2]
        links = torch.stack([*(seen[..., :2] / rules.length).unbind(-1), angles.cos(), angles.sin()], -1)
        tensions, commands = readings[:, TENSIONS : TENSIONS + m], readings[:, TENSIONS + m : TENSIONS + 2 * m]
        parts = [links.flatten(1), (commands - self.neutral_lengths) / rules.command_scale]
        if rules.observe_tensions:
            parts.append(tensions / rules.highest_tension)
        if rules.observe_target:
            target = readings[:, TARGET : TARGET + 2]
            parts += [target / rules.length, (target - seen[:, -1, :2]) / rules.error_scale]
        if rules.observe_load:
            moving = torch.arange(1, seen.shape[1] + 1, device=readings.device)
            parts += [readings[:, FORCE : FORCE + 2] / rules.force_scale, (readings[:, LINK, None] == moving).double()]
        vectors = torch.cat(parts, -1).float()
        return torch.minimum(torch.maximum(vectors, self.low), self.high)


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
