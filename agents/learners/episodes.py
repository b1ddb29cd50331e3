"""Episodes of a tracking environment with gradients: errors and actions as functions of the policy's parameters.

The environment computes, and its steps are recorded. In a step motors move by the actions, tendons follow through play,
and tip and tensions answer with the rates of the equilibrium (`TaskVectorEnv.tangent`). Values are always the
environment's own, so they do not drift; only derivatives are ours. They go back through a whole episode in one node of
torch: from errors through motors, observations and the actor, step by step, to its parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from agents.learners.motion import MotionTape, Motors
from agents.learners.observing import Observing
from agents.learners.tape import Tape, Taped
from rj_gym.core.vector import TaskVectorEnv

SMOOTH = 1e-4  # mm²: under the root of the error, so that its gradient is bounded at the target

Normalise = Callable[[NDArray[np.float32]], tuple[NDArray[Any], NDArray[Any]]]

CLIP = 10.0  # of normalised observations


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
        shortened_to: says after how many steps the next episodes end; None for all of them.
    """

    def __init__(
        self,
        env: TaskVectorEnv,
        normalise: Normalise,
        lane_gradient: float | None = None,
        base: ResidualBase | None = None,
        shortened_to: Callable[[], int | None] = lambda: None,
    ) -> None:
        self.env, self.normalise, self.lane_gradient, self.base = env, normalise, lane_gradient, base
        self.shortened_to = shortened_to
        self.observing, config = Observing(env.task), env.task.config
        actuation = config.actuation
        self.delay = actuation.delay
        self.motors = Motors(config.action_scale_mm, actuation.rate_limit_mm, actuation.dead_band_mm)

    def play(self, actor: Taped, watch: Callable[[Any], bool] = lambda step: True) -> Played | None:
        """New episodes to their end; None if `watch`, called with (info, rewards, ended) of every step, says so."""
        env, steps = self.env, self.env.task.config.episode_steps
        steps = min(steps, self.shortened_to() or steps)
        observation, info = env.reset()
        if self.base is not None:
            self.base.reset(np.ones(env.num_envs, bool))
        episode = _EpisodeTape(self, actor.tape(steps, env.num_envs), steps)
        alive, states = np.ones(env.num_envs, bool), []
        for step in range(1, steps + 1):
            action = episode.act(observation, self._outputs(observation))
            states.append((alive.copy(), info["target"], info["load"]["force"]))
            observation, rewards, terminated, truncated, info = env.step(np.clip(action, -1.0, 1.0))
            episode.moved(info["target"])
            ended = terminated | truncated
            alive &= ~ended
            if not watch((info, rewards, ended | (step == steps))):
                return None
            if terminated.any() and step < steps:  # those go on as other episodes, which do not count
                observation, info = env.reset(options={"reset_mask": ended})
        running, targets, forces = (np.stack(values) for values in zip(*states, strict=True))
        errors, actions, memories = _Gradients.apply(episode, *episode.actor.parameters)
        hidden = single(episode.hidden(targets, forces))
        return Played(errors, actions, torch.as_tensor(running), memories, hidden)

    def _outputs(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """The outputs of the base controller, (B, m + k); (B, 0) without one."""
        if self.base is None:
            return np.zeros((len(observation), 0), np.float32)
        return np.asarray(self.base.outputs(observation), np.float32)


class _EpisodeTape:
    """The steps of an episode of all lanes, and the way back through them."""

    def __init__(self, player: DifferentiableEpisodes, actor: Tape, steps: int) -> None:
        self.actor, self._player, self._steps, self._lanes = actor, player, steps, player.env.num_envs
        self._motion = MotionTape(player.motors, player.env.tangent())
        self._observing = player.observing.tape(steps, self._lanes)
        self._slopes: list[NDArray[np.float32]] = []  # of what the actor sees, by observations
        self._actions: list[NDArray[np.float32]] = []
        self._targets: list[NDArray[Any]] = []

    def act(self, observation: NDArray[np.float32], outputs: NDArray[np.float32]) -> NDArray[np.float32]:
        """Actions before clipping (B, m), the base controller's included."""
        self._observing.add(observation)
        shown = np.concatenate([observation, outputs], 1)
        mean, scale = self._player.normalise(shown)
        seen = ((shown - mean) / scale).astype(np.float32)
        entries = observation.shape[1]
        self._slopes.append(np.where(np.abs(seen[:, :entries]) <= CLIP, 1.0 / scale[:entries], 0.0).astype(np.float32))
        answer = self.actor.step(torch.as_tensor(seen).clamp(-CLIP, CLIP)).numpy()
        self._actions.append(answer if self._player.base is None else answer + outputs[:, : answer.shape[1]])
        return self._actions[-1]

    def moved(self, targets: NDArray[Any]) -> None:
        """The environment's step with these actions, after which the targets (B, d) are these."""
        late = len(self._actions) - 1 - self._player.delay
        due = self._actions[late] if late >= 0 else np.zeros_like(self._actions[0])
        self._motion.add(due, self._player.env.tangent())
        self._targets.append(targets)

    def results(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Errors (T, B), actions (T, B, m) and memories (T, B, width), without gradients."""
        self._ways = np.stack([state.tips for state in self._motion.states[1:]]) - np.stack(self._targets)
        self._errors = np.sqrt((self._ways**2).sum(-1) + SMOOTH)
        return single(self._errors), single(np.stack(self._actions)), self.actor.memories

    def hidden(self, targets: NDArray[Any], forces: NDArray[Any]) -> NDArray[np.float64]:
        """The state hidden from a policy without the pose, before every step, (T, B, k)."""
        states = self._motion.states[:-1]
        parts = ("tips", "commands", "motors", "half_play", "sheath")
        tips, commands, motors, half, sheath = (np.stack([getattr(state, part) for state in states]) for part in parts)
        return np.concatenate([targets - tips, commands - motors, half, sheath, forces], -1)

    def gradients(
        self, by_errors: torch.Tensor | None, by_actions: torch.Tensor | None, by_memories: torch.Tensor | None
    ) -> tuple[torch.Tensor, ...]:
        """Gradients by the parameters of the actor, from the gradients by the results; None: 0."""
        actor, motion, observing, delay = self.actor, self._motion, self._observing, self._player.delay
        for tape in (actor, motion, observing):
            tape.begin_back()
        by_all = np.zeros_like(self._actions) if by_actions is None else by_actions.numpy().copy()
        by_tips = np.zeros_like(self._ways, np.float32)
        if by_errors is not None:
            by_tips[:] = self._ways * (by_errors.numpy() / self._errors)[..., None]
        by_taken, by_readings = observing.zeros()
        for step in reversed(range(self._steps)):
            by_due = motion.back(replace(by_readings, tip=by_readings.tip + by_tips[step]))
            if step >= delay:
                by_all[step - delay] += by_due
            by_action = by_all[step] + np.where(np.abs(self._actions[step]) <= 1.0, by_taken, 0.0)
            by_memory = None if by_memories is None else by_memories[step]
            by_seen = actor.back(torch.as_tensor(self._bounded(by_action)), by_memory).numpy()
            slopes = self._slopes[step]
            by_taken, by_readings = observing.back(by_seen[:, : slopes.shape[1]] * slopes)
        return actor.gradients()

    def _bounded(self, by_action: NDArray[np.float32]) -> NDArray[np.float32]:
        """Gradients of all lanes, (B, m), those that are too long scaled down."""
        if self._player.lane_gradient is None:
            return by_action
        limit = self._player.lane_gradient / len(by_action)
        norms = np.sqrt((by_action**2).sum(1, keepdims=True))
        return by_action * np.minimum(limit / (norms + 1e-12), 1.0)


class _Gradients(torch.autograd.Function):
    """The results of an episode, as functions of the parameters of its actor."""

    @staticmethod
    def forward(ctx: Any, episode: _EpisodeTape, *parameters: torch.Tensor) -> Any:
        ctx.episode = episode
        ctx.set_materialize_grads(False)
        return episode.results()

    @staticmethod
    def backward(ctx: Any, *by_results: torch.Tensor | None) -> Any:
        return None, *ctx.episode.gradients(*by_results)


def single(array: Any) -> torch.Tensor:
    """An array as a tensor of single precision."""
    return torch.as_tensor(np.ascontiguousarray(array, np.float32))
