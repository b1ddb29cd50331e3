"""Episodes in which a teacher gives its action at every step, and drives some of the lanes itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
import torch
from numpy.typing import NDArray

from agents.learners.episodes import CLIP, Normalise
from agents.learners.tape import Taped
from agents.learners.true_state import TrueState, TrueStateFeedback
from rj_gym.core.vector import TaskVectorEnv


class Acting(Protocol):
    """A controller as lessons need it: one of agents.controllers, bound to the task, or TrueStateFeedback.

    Attributes:
        privileged: whether it is given the TrueState in place of observations.
    """

    privileged: bool

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Begin new episodes where the mask (B,) is true."""

    def act(self, observations: Any) -> NDArray[Any]:
        """Actions (B, m) in [-1, 1]."""


@runtime_checkable
class ActingInside(Protocol):
    """A controller that reads the true state of a vector environment: those of agents.controllers.among_walls.

    Attributes:
        reads_environment: true.
    """

    reads_environment: bool

    def begin(self, envs: Any, infos: Mapping[str, Any]) -> None:
        """Begin the episodes that `envs` has just begun, with the infos of that reset."""

    def act(self, envs: Any) -> NDArray[Any]:
        """Actions (B, m) in [-1, 1]."""


@dataclass(frozen=True)
class Demonstrations:
    """B episodes of T steps.

    Args:
        observations: before normalisation, (B, T, entries). actions: of the teacher there, in [-1, 1], (B, T, m).
        running: whether an episode had not ended before the step, (B, T).
    """

    observations: torch.Tensor
    actions: torch.Tensor
    running: torch.Tensor


class TaughtEpisodes:
    """Whole episodes of all lanes of a native vector environment, with a teacher next to the policy.

    Args:
        env: a native vector environment of a tracking task, or of one among walls; its autoreset is disabled.
        normalise: the mean and scale of observations (B, entries); it may learn from them.
        share: the share of lanes that the teacher drives in the next episodes.
        teacher: the controller that drives them, among walls one of ActingInside; None: TrueStateFeedback with its
            default weights.
    """

    def __init__(
        self,
        env: TaskVectorEnv,
        normalise: Normalise,
        share: Callable[[], float],
        teacher: Acting | ActingInside | None = None,
    ) -> None:
        self.env, self.normalise, self.share = env, normalise, share
        self.teacher: Acting | ActingInside = teacher or TrueStateFeedback(env.task)

    @torch.no_grad()
    def play(self, actor: Taped, watch: Callable[[Any], bool] = lambda step: True) -> Demonstrations | None:
        """New episodes to their end; None if `watch`, called with (info, rewards, ended) of every step, says so.

        Which lanes the teacher drives is drawn by torch.
        """
        env, (observation, info) = self.env, self.env.reset()
        self._begin(info)
        taught = torch.rand(env.num_envs).numpy()[:, None] < self.share()
        steps, alive = env.task.config.episode_steps, np.ones(env.num_envs, bool)
        tape = actor.tape(steps, env.num_envs)
        observations, actions, running = [], [], []
        for _ in range(steps):
            right = np.asarray(self._shown(observation, info), np.float32)
            answer = tape.step(normalised(observation, *self.normalise(observation)))
            observations.append(observation.copy())
            actions.append(right)
            running.append(alive.copy())
            taken = np.where(taught, right, answer.clamp(-1.0, 1.0).numpy()).astype(np.float32)
            observation, rewards, terminated, truncated, info = env.step(taken)
            alive &= ~(terminated | truncated)
            if not watch((info, rewards, terminated | truncated)):
                return None
            if terminated.any() and not truncated.all():  # those go on as other episodes, which do not count
                observation, info = env.reset(options={"reset_mask": terminated | truncated})
        return Demonstrations(*(torch.as_tensor(np.stack(values, 1)) for values in (observations, actions, running)))

    def _begin(self, info: dict[str, Any]) -> None:
        """Begin the teacher's episodes with the info of the reset."""
        if isinstance(self.teacher, ActingInside):
            self.teacher.begin(self.env, info)
        else:
            self.teacher.reset(np.ones(self.env.num_envs, bool))

    def _shown(self, observation: NDArray[np.float32], info: dict[str, Any]) -> NDArray[Any]:
        """The teacher's actions, (B, m)."""
        if isinstance(self.teacher, ActingInside):
            return self.teacher.act(self.env)
        privileged = self.teacher.privileged
        return self.teacher.act(TrueState(self.env.tangent(), info["target"]) if privileged else observation)


def normalised(observations: NDArray[Any], mean: NDArray[Any], scale: NDArray[Any]) -> torch.Tensor:
    """Observations (..., entries) as the policy takes them."""
    return torch.as_tensor(np.clip((observations - mean) / scale, -CLIP, CLIP).astype(np.float32))
