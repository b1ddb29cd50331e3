"""Episodes of a tracking environment with gradients: errors and actions as functions of the policy's parameters.

The environment computes; torch connects its steps. In a step motors move by the actions, tendons follow through play,
and tip and tensions answer with the rates of the equilibrium (`TaskVectorEnv.tangent`). Values are always the
environment's own, so they do not drift; only derivatives are ours.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from agents.learners.motion import Motion, Motors, at_rest, moved, single
from agents.learners.observing import Observing
from rj_gym.core.vector import TaskVectorEnv
from rj_gym.tracking.tangent import Tangent

SMOOTH = 1e-4  # mm²: under the root of the error, so that its gradient is bounded at the target

Normalise = Callable[[NDArray[np.float32]], tuple[NDArray[Any], NDArray[Any]]]
Act = Callable[[torch.Tensor, torch.Tensor | None], tuple[torch.Tensor, torch.Tensor]]


class ResidualBase(Protocol):
    """A controller with actions to which a residual policy adds its own."""

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Begin new episodes where the mask (B,) is true."""

    def outputs(self, observations: NDArray[np.float32]) -> NDArray[Any]:
        """Its actions in [-1, 1], and behind them its estimates, (B, m + k)."""


@dataclass(frozen=True)
class Played:
    """B episodes of T steps.

    Args:
        errors: tip errors after every step, (T, B) [mm], with gradients. actions: before clipping, (T, B, m), with
            gradients.
        running: whether an episode had not ended before the step, (T, B).
        memories: of the policy at every step, (T, B, width), with gradients.
        hidden: the hidden state then, (T, B, k) [mm, N]: way of the tip to the target, commands minus motors,
            half widths of the play, sheath friction, load.
    """

    errors: torch.Tensor
    actions: torch.Tensor
    running: torch.Tensor
    memories: torch.Tensor
    hidden: torch.Tensor


class DifferentiableEpisodes:
    """Whole episodes of all lanes of a native vector environment.

    Args:
        env: a native vector environment of a tracking task; its autoreset is disabled.
        normalise: the mean and scale of observations (B, entries); it may learn from them.
        lane_gradient: largest norm of the gradient of B times the loss by one lane's action in one step; longer ones
            are scaled down. None: any.
        base: of a residual policy, which sees its outputs behind the observation. Gradients take outputs as given:
            their response to the policy is left out. None: the policy acts alone.
    """

    def __init__(
        self,
        env: TaskVectorEnv,
        normalise: Normalise,
        lane_gradient: float | None = None,
        base: ResidualBase | None = None,
    ) -> None:
        self.env, self.normalise, self.lane_gradient, self.base = env, normalise, lane_gradient, base
        self.observing, config = Observing(env.task), env.task.config
        actuation = config.actuation
        self.motors = Motors(config.action_scale_mm, actuation.rate_limit_mm, actuation.dead_band_mm)

    def play(self, act: Act, watch: Callable[[Any], bool] = lambda step: True) -> Played | None:
        """New episodes to their end; None if `watch`, called with (info, rewards, ended) of every step, says so."""
        env, task = self.env, self.env.task
        observation, info = env.reset()
        if self.base is not None:
            self.base.reset(np.ones(env.num_envs, bool))
        tangent, memory = env.tangent(), None
        motion, taken = at_rest(tangent), torch.zeros(env.num_envs, task.action_size)
        self.observing.begin()
        actions: list[torch.Tensor] = []
        errors, running, alive = [], [], np.ones(env.num_envs, bool)
        memories, hidden = [], []
        for _ in range(task.config.episode_steps):
            outputs = self._outputs(observation)
            answer, memory = act(self._seen(observation, outputs, taken, motion), memory)
            self._bound_gradient(answer)
            action = answer if self.base is None else answer + single(outputs[:, : task.action_size])
            actions.append(action)
            memories.append(memory)
            hidden.append(_hidden(tangent, info))
            taken = action.clamp(-1.0, 1.0)
            observation, rewards, terminated, truncated, info = env.step(taken.detach().numpy())
            tangent = env.tangent()
            motion = moved(motion, self._due(actions), tangent, self.motors)
            errors.append(_errors(motion.tip, info["target"]))
            running.append(alive.copy())
            alive &= ~(terminated | truncated)
            if not watch((info, rewards, terminated | truncated)):
                return None
            if terminated.any() and not truncated.all():  # those go on as other episodes, which do not count
                observation, info = env.reset(options={"reset_mask": terminated | truncated})
        series = (torch.stack(steps) for steps in (errors, actions, memories, hidden))
        all_errors, all_actions, all_memories, all_hidden = series
        return Played(all_errors, all_actions, torch.as_tensor(np.array(running)), all_memories, all_hidden)

    def _outputs(self, observation: NDArray[np.float32]) -> NDArray[Any]:
        """The outputs of the base controller, (B, m + k); (B, 0) without one."""
        if self.base is None:
            return np.zeros((len(observation), 0))
        return self.base.outputs(observation)

    def _seen(
        self, observation: NDArray[np.float32], outputs: NDArray[Any], taken: torch.Tensor, motion: Motion
    ) -> torch.Tensor:
        """The normalised observation with the gradients of the last actions and the motion, the outputs behind it."""
        shown = torch.cat([self.observing(single(observation), taken, motion), single(outputs)], 1)
        mean, scale = (single(values) for values in self.normalise(shown.detach().numpy()))
        return ((shown - mean) / scale).clamp(-10.0, 10.0)

    def _due(self, actions: list[torch.Tensor]) -> torch.Tensor:
        """The actions so far that reach the motors now."""
        late = len(actions) - 1 - self.env.task.config.actuation.delay
        return actions[late] if late >= 0 else torch.zeros_like(actions[0])

    def _bound_gradient(self, action: torch.Tensor) -> None:
        if self.lane_gradient is not None and action.requires_grad:
            limit = self.lane_gradient / len(action)
            action.register_hook(lambda g: g * (limit / (g.norm(dim=1, keepdim=True) + 1e-12)).clamp(max=1.0))


def _hidden(tangent: Tangent, info: Mapping[str, Any]) -> torch.Tensor:
    """The state hidden from a policy without the pose, (B, k)."""
    way, behind = info["target"] - tangent.tips, tangent.commands - tangent.motors
    return single(np.hstack([way, behind, tangent.half_play, tangent.sheath, info["load"]["force"]]))


def _errors(tips: torch.Tensor, targets: NDArray[Any]) -> torch.Tensor:
    return torch.sqrt(((tips - single(targets)) ** 2).sum(1) + SMOOTH)
