"""Episodes among walls with gradients: errors and wall forces as functions of the policy's parameters.

The environment computes, and its steps are recorded: values are its own, and only derivatives are ours. In a step
commands and feed move by the action, and the equilibrium answers with its rates. What contacts remember of earlier
steps is a constant, as are the errors of sensors; contacts that stick go on sticking.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch.autograd.function import once_differentiable

from agents.learners.episodes import CLIP, SMOOTH, Normalise, single
from rj_gym.core.vector import TaskVectorEnv
from rj_gym.surroundings.config import POSES
from rj_gym.surroundings.observation import COMMAND_MM, FORCE_N, observed_links
from rj_gym.surroundings.task import LumenTask, SurroundingsTask
from rollingjoint.differentiable import link_contact
from rollingjoint.errors import ConfigError
from rollingjoint.statics.sensitivity import dinsertion_dbase, dinsertion_dlengths, dposes_dbase, dposes_dlengths

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PlayedAmongWalls:
    """B episodes of T steps.

    Args:
        errors: tip errors after every step, (T, B) [mm], with gradients.
        forces: size of the force of the walls on every link then, (T, B, n) [N], with gradients.
        running: whether an episode had not ended before the step, (T, B).
    """

    errors: torch.Tensor
    forces: torch.Tensor
    running: torch.Tensor


class WallsState(NamedTuple):
    """What a step of B lanes leaves, as tensors with gradients; places are in the frame of the base."""

    poses: torch.Tensor  # (B, n, 3) mm, rad
    tensions: torch.Tensor  # (B, m) N
    commands: torch.Tensor  # (B, m) mm
    push: torch.Tensor  # the insertion force, (B, 1) N
    forces: torch.Tensor  # of the walls on the links, (B, n, 2) N
    feed: torch.Tensor  # (B, 1) mm
    target: torch.Tensor  # (B, 2) mm

    @property
    def away(self) -> torch.Tensor:
        """Way from the tip to the target, (B, 2) [mm]."""
        return self.target - self.poses[:, -1, :2]


class WalledEpisodes:
    """Whole episodes of all lanes of a native vector environment of the task in lumens.

    Args:
        env: its autoreset is disabled.
        normalise: the mean and scale of observations (B, entries); it may learn from them.
        lane_gradient: largest norm of the gradient of B times the loss by one lane's action in one step; longer ones
            are scaled down. None: any.
    """

    def __init__(self, env: TaskVectorEnv, normalise: Normalise, lane_gradient: float | None = None) -> None:
        self.env, self.normalise, self.lane_gradient = env, normalise, lane_gradient
        self.task: LumenTask = env.task

    def play(self, actor: Any, watch: Callable[[Any], bool] = lambda step: True) -> PlayedAmongWalls | None:
        """New episodes to their end; None if `watch`, called with (info, rewards, ended) of every step, says so."""
        env, steps, memory = self.env, self.task.config.episode_steps, None
        observation, info = env.reset()
        response = env.tangent()
        state = self._state(single(response.commands), single(response.feed[:, None]))
        alive = np.ones(env.num_envs, bool)
        errors, forces, running = [], [], []
        for _ in range(steps):
            entries = self._seen(observation, state)
            mean, scale = self.normalise(observation)
            x = ((entries - single(mean)) / single(scale)).clamp(-CLIP, CLIP)
            answer, memory = actor(x, memory)
            if answer.requires_grad and self.lane_gradient is not None:
                answer.register_hook(self._bounded)
            action = answer.clamp(-1.0, 1.0)
            running.append(alive.copy())
            observation, rewards, terminated, truncated, info = env.step(action.detach().numpy())
            state = self._state(*self._moved(state, action))
            errors.append((state.away.square().sum(-1) + SMOOTH).sqrt())
            forces.append((state.forces.square().sum(-1) + SMOOTH).sqrt())
            alive &= ~(terminated | truncated)
            if not watch((info, rewards, terminated | truncated)):
                return None
            if terminated.any() and not truncated.all():  # those go on as other episodes, which do not count
                observation, info = env.reset(options={"reset_mask": terminated | truncated})
        return PlayedAmongWalls(torch.stack(errors), torch.stack(forces), torch.as_tensor(np.stack(running)))

    def _moved(self, state: WallsState, action: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Commands and feed after an action, as equilibria are asked for."""
        config, m = self.task.config, self.task.m
        commands = state.commands - config.action_scale_mm * action[:, :m]
        return commands, (state.feed + config.feed_scale_mm * action[:, m:]).clamp(*config.feed_range)

    def _state(self, commands: torch.Tensor, feed: torch.Tensor) -> WallsState:
        """The state of the environment, as a function of the commands and the feed that have led to it."""
        response = self.env.tangent()
        outputs = _Answered.apply(torch.cat([commands, feed], -1), response.solution, self.task.mechanism.stiffnesses)
        n, m = response.poses.shape[1], self.task.m
        poses, tensions, left, push, forces = outputs.split([3 * n, m, m, 1, 2 * n], -1)
        feed = single(response.feed[:, None]) + feed - feed.detach()
        target = single(response.target) - torch.cat([torch.zeros_like(feed), feed], -1)
        return WallsState(poses.unflatten(-1, (n, 3)), tensions, left, push, forces.unflatten(-1, (n, 2)), feed, target)

    def _seen(self, observation: NDArray[np.float32], state: WallsState) -> torch.Tensor:
        """The observation, with the derivative of what sensors without errors would show."""
        shown = observed(self.task, state)
        return single(observation) + shown - shown.detach()

    def _bounded(self, by_action: torch.Tensor) -> torch.Tensor:
        """Gradients of all lanes, (B, a), those that are too long scaled down."""
        limit = float(self.lane_gradient or np.inf) / len(by_action)
        return by_action * (limit / (by_action.norm(dim=-1, keepdim=True) + 1e-12)).clamp(max=1.0)


def check_lumen(task: SurroundingsTask) -> None:
    """Raise ConfigError unless WalledEpisodes has gradients of this task."""
    if not isinstance(task, LumenTask):
        allowed = "rj_gym/Lumen-v0 among the tasks among walls"
        hint = "apg has no gradients of the others; distill takes them."
        raise ConfigError("env", type(task).__name__, allowed, hint)
    if task.config.walls != "none":
        raise ConfigError("env.settings.walls", task.config.walls, "none with apg")


def observed(task: LumenTask, state: WallsState) -> torch.Tensor:
    """The observation of sensors without errors where no wall is seen, (B, entries), as a function of the state."""
    config, mechanism = task.config, task.mechanism
    length, links = float(mechanism.length), observed_links(config, mechanism)
    x, y, turn = state.poses.unbind(-1)
    cos, sin = turn.cos(), turn.sin()
    pose_entries = torch.stack([x / length, y / length, cos, sin], -1)[:, links].flatten(1)
    parts = [pose_entries, (state.commands - single(mechanism.neutral_lengths)) / COMMAND_MM]
    parts.append(state.tensions / config.tension_range[1])
    parts += [state.feed / config.feed_range[1], state.push / FORCE_N, state.target / length]
    if config.poses != POSES[-1]:
        away = state.away
        ahead = cos[:, -1:] * away[:, 1:] - sin[:, -1:] * away[:, :1]
        across = cos[:, -1:] * away[:, :1] + sin[:, -1:] * away[:, 1:]
        parts += [away / length, ahead / length, across / length]
    return torch.cat(parts, -1)


class _Answered(torch.autograd.Function):
    """Outputs of equilibria as functions of commands and feed, (B, m + 1): the parts of a WallsState but the feed."""

    @staticmethod
    def forward(ctx: Any, inputs: torch.Tensor, solution: Any, stiffnesses: Array) -> torch.Tensor:
        ctx.found, ctx.stiffnesses = solution, stiffnesses
        commands = solution.lengths - solution.tensions / stiffnesses
        push, count = np.asarray(solution.insertion_force), len(commands)
        poses, forces = solution.poses.reshape(count, -1), solution.wall_forces[..., :2].reshape(count, -1)
        return single(np.concatenate([poses, solution.tensions, commands, push[:, None], forces], -1))

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, by_outputs: torch.Tensor) -> Any:
        rates = single(_rates(ctx.found, ctx.stiffnesses))
        return (by_outputs[:, None] @ rates)[:, 0], None, None


def _rates(found: Any, stiffnesses: Array) -> Array:
    """d outputs / d commands and feed, (B, outputs, m + 1)."""
    poses = np.concatenate([dposes_dlengths(found), dposes_dbase(found)[..., 1:2]], -1)
    angles = np.diff(poses[:, :, 2], axis=1)
    lengths = np.swapaxes(found.tendon_rates, -1, -2) @ angles
    m = lengths.shape[1]
    tensions = found.tendon_stiffness[..., None] * (lengths - np.eye(m, m + 1))
    commands = lengths - tensions / stiffnesses[:, None]
    push = np.concatenate([dinsertion_dlengths(found), dinsertion_dbase(found)[..., 1:2]], -1)
    x, y, turn = found.poses[..., 0, None], found.poses[..., 1, None], poses[:, :, 2]
    motion = np.stack([poses[:, :, 0] + turn * y, poses[:, :, 1] - turn * x, turn], axis=2)
    motion[:, :, 1, -1] += 1.0  # the base moves along y
    forces = -(link_contact(found).rates[:, :, :2] @ motion)
    flat = poses.reshape(len(x), -1, m + 1), forces.reshape(len(x), -1, m + 1)
    return np.concatenate([flat[0], tensions, commands, push[:, None], flat[1]], axis=1)
