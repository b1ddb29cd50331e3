"""Episodes of a tracking environment with gradients: errors and actions as functions of the policy's parameters.

The environment computes; torch repeats what connects its steps. In a step motors move by the actions, tendons follow
through play, and tip and tensions answer with the rates of the equilibrium (`TaskVectorEnv.tangent`). Values are always
the environment's own, so nothing drifts; only derivatives are torch's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from agents.learners.observing import Observing, Readings
from rj_gym.core.tangent import Tangent
from rj_gym.core.vector import TaskVectorEnv

SMOOTH = 1e-4  # mm²: under the root of the error, so that its gradient is bounded at the target

Normalise = Callable[[NDArray[np.float32]], tuple[NDArray[Any], NDArray[Any]]]
Act = Callable[[torch.Tensor, torch.Tensor | None], tuple[torch.Tensor, torch.Tensor]]


class Advisor(Protocol):
    """A controller to whose actions a residual policy adds its own."""

    def begin(self, episodes: int) -> None:
        """This many episodes begin together."""

    def advise(self, observation: NDArray[np.float32]) -> NDArray[Any]:
        """Its actions in [-1, 1], and behind them what it lets the policy know, (B, m + k)."""


@dataclass(frozen=True)
class Played:
    """B episodes of T steps.

    Args:
        errors: tip errors after every step, (T, B) [mm], with gradients. actions: before clipping, (T, B, m), with
            gradients.
        running: whether an episode had not ended before the step, (T, B).
        memories: of the policy at every step, (T, B, width), with gradients.
        hidden: what could not be seen then, (T, B, k) [mm, N]: way of the tip to the target, commands minus motors,
            half widths of the play, sheath friction, load.
    """

    errors: torch.Tensor
    actions: torch.Tensor
    running: torch.Tensor
    memories: torch.Tensor
    hidden: torch.Tensor


@dataclass(frozen=True)
class Motion:
    """Motors of B lanes with gradients: position q, where they are going, tendon command p, (B, m) [mm]."""

    motor: torch.Tensor
    goal: torch.Tensor
    command: torch.Tensor


class DifferentiableEpisodes:
    """Whole episodes of all lanes of a native vector environment.

    Args:
        env: a native vector environment of a tracking task; its autoreset is disabled.
        normalise: what observations (B, entries) go through: their mean and scale; it may learn from them.
        lane_gradient: largest norm of the gradient of B times the loss by one lane's action in one step; longer ones
            are scaled down. None: any.
        advisor: of a residual policy, which sees the advice behind the observation. Gradients take advice as given:
            how it answers what the policy does is left out. None: the policy acts alone.
    """

    def __init__(
        self,
        env: TaskVectorEnv,
        normalise: Normalise,
        lane_gradient: float | None = None,
        advisor: Advisor | None = None,
    ) -> None:
        self.env, self.normalise, self.lane_gradient, self.advisor = env, normalise, lane_gradient, advisor
        self.observing = Observing(env.task)

    def play(self, act: Act, watch: Callable[[Any], bool] = lambda step: True) -> Played | None:
        """New episodes to their end; None if `watch`, called with (info, rewards, ended) of every step, says so."""
        env, task = self.env, self.env.task
        observation, info = env.reset()
        self.observing.begin()
        if self.advisor is not None:
            self.advisor.begin(env.num_envs)
        tangent, memory = env.tangent(), None
        motion = Motion(*(_values(x) for x in (tangent.motors, tangent.motors, tangent.commands)))
        actions: list[torch.Tensor] = []
        readings = [_readings(torch.zeros_like(motion.motor), motion, tangent)]
        errors, running, alive = [], [], np.ones(env.num_envs, bool)
        memories, hidden = [], []
        for _ in range(task.config.episode_steps):
            advice = self._advice(observation)
            own, memory = act(self._seen(observation, advice, readings), memory)
            self._bound_gradient(own)
            action = own if self.advisor is None else own + _values(advice[:, : task.action_size])
            actions.append(action)
            memories.append(memory)
            hidden.append(_hidden(tangent, info))
            taken = action.clamp(-1.0, 1.0)
            observation, rewards, terminated, truncated, info = env.step(taken.detach().numpy())
            tangent = env.tangent()
            motion = self._moved(motion, actions, tangent)
            readings.append(_readings(taken, motion, tangent))
            errors.append(_errors(readings[-1].tip, info["target"]))
            running.append(alive.copy())
            alive &= ~(terminated | truncated)
            if not watch((info, rewards, terminated | truncated)):
                return None
            if terminated.any() and not truncated.all():  # those go on as other episodes, which do not count
                observation, info = env.reset(options={"reset_mask": terminated | truncated})
        series = (torch.stack(each) for each in (errors, actions, memories, hidden))
        all_errors, all_actions, all_memories, all_hidden = series
        return Played(all_errors, all_actions, torch.as_tensor(np.array(running)), all_memories, all_hidden)

    def _advice(self, observation: NDArray[np.float32]) -> NDArray[Any]:
        """What the advisor says to this observation; nothing without one."""
        if self.advisor is None:
            return np.zeros((len(observation), 0))
        return self.advisor.advise(observation)

    def _seen(self, observation: NDArray[np.float32], advice: NDArray[Any], readings: list[Readings]) -> torch.Tensor:
        """The normalised observation with gradients, the advice behind it."""
        shown = torch.cat([self.observing(_values(observation), readings), _values(advice)], 1)
        mean, scale = (_values(each) for each in self.normalise(shown.detach().numpy()))
        return ((shown - mean) / scale).clamp(-10.0, 10.0)

    def _moved(self, before: Motion, actions: list[torch.Tensor], tangent: Tangent) -> Motion:
        """Motors and tendons after a step with the actions so far: the values are the environment's."""
        config = self.env.task.config
        late = len(actions) - 1 - config.actuation.delay
        due = actions[late].clamp(-1.0, 1.0) if late >= 0 else torch.zeros_like(before.motor)
        goal = before.goal - config.action_scale_mm * due
        way, limit = goal - before.motor, config.actuation.rate_limit_mm
        motor = before.motor + (way if limit is None else way.clamp(-limit, limit))
        half, held = _values(tangent.half_play), torch.as_tensor(tangent.held)
        command = torch.minimum(torch.maximum(before.command, motor - half), motor + half)
        motor, command = _given_way(motor, command, held, tangent)
        motor, command = _anchored(motor, tangent.motors), _anchored(command, tangent.commands)
        goal = motor if limit is None else torch.where(held, motor, goal)
        return Motion(motor, goal, command)

    def _bound_gradient(self, action: torch.Tensor) -> None:
        if self.lane_gradient is not None and action.requires_grad:
            most = self.lane_gradient / len(action)
            action.register_hook(lambda g: g * (most / (g.norm(dim=1, keepdim=True) + 1e-12)).clamp(max=1.0))


def _given_way(
    motor: torch.Tensor, command: torch.Tensor, held: torch.Tensor, tangent: Tangent
) -> tuple[torch.Tensor, torch.Tensor]:
    """Motors and commands up to constants: at a tension limit they move with the tendon's length."""
    moved = torch.where(held, 0.0, command - command.detach())
    follows = torch.where(held, _times(_values(tangent.length_rates), moved), command)
    return torch.where(held, motor - command + follows, motor), follows


def _readings(action: torch.Tensor, motion: Motion, tangent: Tangent) -> Readings:
    """What follows from the motion, with the rates of the equilibrium."""
    change = torch.where(torch.as_tensor(tangent.held), 0.0, motion.command - motion.command.detach())
    tip = _values(tangent.tips) + _times(_values(tangent.tip_rates), change)
    tension = _values(tangent.tensions) + _times(_values(tangent.tension_rates), change)
    half, sheath = _values(tangent.half_play), _values(tangent.sheath)
    place = torch.where(half > 0, (motion.command - motion.motor) / half.clamp(min=1e-9), 0.0).clamp(-1.0, 1.0)
    return Readings(action, motion.motor, tension * torch.exp(sheath * place), tip)


def _hidden(tangent: Tangent, info: Mapping[str, Any]) -> torch.Tensor:
    """What a policy without the pose cannot see, (B, k)."""
    way, behind = info["target"] - tangent.tips, tangent.commands - tangent.motors
    return _values(np.hstack([way, behind, tangent.half_play, tangent.sheath, info["load"]["force"]]))


def _errors(tips: torch.Tensor, targets: NDArray[Any]) -> torch.Tensor:
    return torch.sqrt(((tips - _values(targets)) ** 2).sum(1) + SMOOTH)


def _anchored(tracked: torch.Tensor, values: NDArray[Any]) -> torch.Tensor:
    """These values with the gradient of what was computed for them."""
    return _values(values) + (tracked - tracked.detach())


def _times(matrices: torch.Tensor, vectors: torch.Tensor) -> torch.Tensor:
    return (matrices @ vectors[..., None])[..., 0]


def _values(array: NDArray[Any]) -> torch.Tensor:
    return torch.as_tensor(np.ascontiguousarray(array, np.float32))
