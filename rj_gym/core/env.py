"""Base of the scalar environments: a Gymnasium shell around a single lane, plain and with goals."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, ClassVar, SupportsFloat

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from numpy.typing import ArrayLike, NDArray

from rj_gym.core.arguments import checked_render_mode, checked_seed
from rj_gym.core.columns import REWARD, STATUS, STEP, TIP
from rj_gym.core.episodes import EpisodeBuffer
from rj_gym.core.info import only_lane
from rj_gym.core.settings import Settings, made_settings
from rj_gym.core.spaces import goal_observation, observation_space, observed
from rj_gym.core.task import ObservedError, Task
from rollingjoint.errors import InvalidInput

_ALONE = np.zeros(1, np.int64)


class EpisodeSpec:
    """The attribute `spec` of environments: as Gymnasium sets it, but with the length of an episode.

    Episodes are ended by the environments themselves, so that ids are registered without a TimeLimit.
    """

    def __get__(self, env: Any, owner: type | None = None) -> EnvSpec | None:
        return None if env is None else env.__dict__.get("spec")

    def __set__(self, env: Any, spec: EnvSpec | None) -> None:
        if spec is not None and spec.max_episode_steps is None:
            spec = replace(spec, max_episode_steps=env.config.episode_steps)
        env.__dict__["spec"] = spec


class TaskEnv(gymnasium.Env[Any, NDArray[np.float32]]):
    """Base of the scalar environments; a class names its settings, task and episode buffer.

    Args:
        render_mode: None, "human" or "rgb_array"; the latter two need pygame, which the extra `plot` brings.
        config: settings of the environment's class, or a dictionary of their fields.
        overrides: settings on top of that.
    Raises:
        InvalidInput, ConfigError: arguments that cannot be used.
        MissingPackage: pictures are asked for, and pygame is not installed.
    """

    metadata = {"render_modes": ["human", "rgb_array"], "render_fps": 12}  # noqa: RUF012 (Gymnasium's own form)
    settings: ClassVar[type[Settings]]
    task_class: ClassVar[Callable[[Any], Task]]
    buffer: ClassVar[type[EpisodeBuffer]]
    goal: ClassVar[bool] = False
    spec = EpisodeSpec()

    def __init__(
        self,
        render_mode: str | None = None,
        config: Settings | Mapping[str, Any] | None = None,
        **overrides: Any,
    ) -> None:
        self.task: Any = type(self).task_class(made_settings(self.settings, config, overrides, self.goal))
        self.render_mode = checked_render_mode(render_mode, self.metadata["render_modes"])
        self.action_space = spaces.Box(-1.0, 1.0, (self.task.action_size,), np.float32)
        self.observation_space = observation_space(self.task, self.goal)
        self._buffer = self.buffer(self.task, 1, self.goal)
        self._steps, self._last_status = self.config.episode_steps, self.task.last_status
        self._own_ends = self.task.own_ends
        self._plain = not self.goal and not self.task.observes_truth
        self._begun = False
        self._over = True
        self._trail: list[NDArray[np.float64]] = []
        self._renderer: Any = None

    @property
    def config(self) -> Any:
        """The settings."""
        return self.task.config

    @property
    def observed_error(self) -> ObservedError:
        """Where the observation vector has the tip error, in mm.

        Raises:
            ConfigError: an environment whose observation vector has no tip error: the tip is not seen, goals are
                apart, or no tip is tracked.
        """
        error: ObservedError = self.task.observed_error(self.goal)
        return error

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """First observation and info of a new episode.

        Args:
            seed: of the environment's random numbers.
            options: values to fix; see the task's checked_options.
        Raises:
            InvalidInput: a seed or options that cannot be used; the state is unchanged then.
        """
        fixed, before = self.task.checked_options(options), (self._np_random, self._np_random_seed)
        super().reset(seed=checked_seed(seed))
        try:
            sampled, observation = self._buffer.restart(_ALONE, [self.np_random], fixed)
        except InvalidInput:
            self._np_random, self._np_random_seed = before
            raise
        readings = self._buffer.readings[0].copy()
        self._begun, self._over = True, False
        self._trail = []
        if self.render_mode is not None:
            self._show(readings)
        info = self.task.single_info(readings, readings.tolist())
        del info["reward_terms"]
        info["sampled"] = only_lane(sampled)
        return self._observation(observation[0], readings), info

    def step(self, action: ArrayLike) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Observation, reward, terminated, truncated and info after one step.

        Raises:
            InvalidInput: an action that is not of the space's shape or not finite; the state is unchanged then.
            gymnasium.error.ResetNeeded: before the first reset, or after the end of an episode.
        """
        if self._over:
            raise ResetNeeded("No episode is running: call reset() before step().")
        vector, readings = self._buffer.step_alone(action)
        numbers = readings.tolist()
        terminated, truncated = numbers[STATUS] > self._last_status, numbers[STEP] >= self._steps
        if self._own_ends and not terminated:
            terminated = bool(self.task.terminated(readings[None])[0])
        self._over = terminated or truncated
        if self.render_mode is not None:
            self._show(readings)
        observation = vector if self._plain else self._observation(vector, readings)
        return observation, numbers[REWARD], terminated, truncated, self.task.single_info(readings, numbers)

    def render(self) -> NDArray[np.uint8] | None:
        """The picture (H, W, 3) in mode "rgb_array"; in mode "human" it goes to the window."""
        if self.render_mode is None:
            gymnasium.logger.warn('render() needs render_mode "human" or "rgb_array" in gymnasium.make.')
            return None
        if not self._begun:
            raise ResetNeeded("There is nothing to draw yet: call reset() before render().")
        scene = self._buffer.scene(np.array(self._trail))
        if self._renderer is None:
            self._renderer = self._buffer.renderer()
        if self.render_mode == "rgb_array":
            picture: NDArray[np.uint8] = self._renderer.picture(scene)
            return picture
        self._renderer.show(scene, self.metadata["render_fps"])
        return None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_renderer": None}

    def _show(self, readings: NDArray[np.float64]) -> None:
        """Extend the trail and update the window."""
        self._trail.append(readings[TIP : TIP + self.task.dimension].copy())
        if self.render_mode == "human":
            self.render()

    def _observation(self, vector: NDArray[np.float32], readings: NDArray[np.float64]) -> Any:
        return observed(self.task, vector, readings)


class GoalTaskEnv(TaskEnv):
    """Base of the Goal environments; a task's class lists it before its plain environment."""

    goal: ClassVar[bool] = True

    def compute_reward(self, achieved_goal: ArrayLike, desired_goal: ArrayLike, info: Any) -> Any:
        """Reward for goals (..., d), a float for one pair and (...) for batches; info is not used.

        Raises:
            InvalidInput: goals that are not finite numbers of such shapes.
        """
        reward = self.task.goal_reward(*self.task.checked_goals(achieved_goal, desired_goal))
        return float(reward) if np.ndim(reward) == 0 else reward

    def step(self, action: ArrayLike) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """As without goals, with is_success in info."""
        observation, _, terminated, truncated, info = super().step(action)
        reward = self.compute_reward(observation["achieved_goal"], observation["desired_goal"], None)
        info["reward_terms"] = {"tracking": reward}
        info["is_success"] = bool(self.task.reached(self._buffer.readings[0]))
        return observation, reward, terminated, truncated, info

    def _observation(self, vector: NDArray[np.float32], readings: NDArray[np.float64]) -> Any:
        return goal_observation(self.task, vector, readings)
