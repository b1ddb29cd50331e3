"""An environment for Stable-Baselines3 whose steps cost nothing: the bound that a real one is measured against."""

from __future__ import annotations

from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv


class FreeVecEnv(VecEnv):
    """The spaces, lanes and first observations of another environment, over and over.

    Every `episode` steps all lanes end, truncated, with the infos that Stable-Baselines3 looks at.
    """

    def __init__(self, like: VecEnv, episode: int) -> None:
        self.render_mode = None
        super().__init__(like.num_envs, like.observation_space, like.action_space)
        lanes = like.num_envs
        self._observations, self._rewards = like.reset(), np.zeros(lanes, np.float32)
        nothing: list[dict[str, Any]] = [{} for _ in range(lanes)]
        self._going_on = np.zeros(lanes, bool), nothing
        last = [{"terminal_observation": row, "TimeLimit.truncated": True} for row in self._observations]
        self._ended = np.ones(lanes, bool), last
        self._step, self._episode = 0, episode

    def reset(self) -> Any:
        """The observations."""
        self._step = 0
        return self._observations

    def step_async(self, actions: np.ndarray) -> None:
        """Count the step."""
        self._step += 1

    def step_wait(self) -> Any:
        """The observations, no reward, and what belongs to the step."""
        dones, infos = self._going_on if self._step % self._episode else self._ended
        return self._observations, self._rewards, dones, infos

    def close(self) -> None:
        """Nothing to close."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """One attribute of this object, once per lane."""
        return [getattr(self, attr_name)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Lanes have no attributes."""
        raise AttributeError(attr_name)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Lanes have no methods."""
        raise AttributeError(method_name)

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Lanes are not wrapped."""
        return [False] * self.num_envs
