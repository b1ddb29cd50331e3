"""The scalar tracking environments: Gymnasium shells around a single lane, of whichever task."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, SupportsFloat

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from numpy.typing import ArrayLike, NDArray

from rj_gym.core.config import TaskConfig, TrackingConfig
from rj_gym.core.info import only_lane
from rj_gym.core.spaces import goal_observation, observation_space
from rj_gym.core.task import Task, task_of
from rj_gym.planar.kernels import AT_LIMIT, REWARD, STATUS, STEP, TIP
from rollingjoint.errors import InvalidInput


class TrackingEnv(gymnasium.Env[Any, NDArray[np.float32]]):
    """What the scalar environments of every task do; a class of them says which settings it takes.

    Args:
        render_mode: None, "human" or "rgb_array".
        config: settings of the environment's class, or a dictionary of their fields.
        overrides: settings on top of that.
    Raises:
        InvalidInput, ConfigError: arguments that cannot be used.
    """

    metadata = {"render_modes": ["human", "rgb_array"], "render_fps": 12}  # noqa: RUF012 (Gymnasium's own form)
    settings: ClassVar[type[TaskConfig]]
    goal: ClassVar[bool] = False

    def __init__(
        self,
        render_mode: str | None = None,
        config: TaskConfig | Mapping[str, Any] | None = None,
        **overrides: Any,
    ) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InvalidInput("render_mode", render_mode, f"None or one of {self.metadata['render_modes']}")
        if not isinstance(config, self.settings):
            config = self.settings.from_dict(config or {})  # type: ignore[arg-type]
        self.task: Task = task_of(config.updated(overrides))
        self.render_mode = render_mode
        self.action_space = spaces.Box(-1.0, 1.0, (self.task.mechanism.n_tendons,), np.float32)
        self.observation_space = observation_space(self.task, self.goal)
        self._lanes = self.task.lanes(1, self.goal)
        self._steps = self.config.episode_steps
        self._begun = False
        self._over = True
        self._trail: list[NDArray[np.float64]] = []
        self._renderer: Any = None

    @property
    def config(self) -> Any:
        """The settings."""
        return self.task.config

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """First observation and info of a new episode.

        Args:
            seed: of the environment's random numbers.
            options: what to hold fixed; see the task's checked_options.
        Raises:
            InvalidInput: options that cannot be used; nothing has changed then.
        """
        fixed = self.task.checked_options(options)
        super().reset(seed=seed)
        episodes, observation = self._lanes.begin([self.np_random], fixed)
        readings = self._lanes.read_alone()
        self._begun, self._over = True, False
        self._trail = []
        if self.render_mode is not None:
            self._show(readings)
        info = self.task.single_info(readings, readings.tolist())
        del info["reward_terms"]
        info["sampled"] = only_lane(self.task.sampled_info(self._lanes, episodes))
        return self._observation(observation[0], readings), info

    def step(self, action: ArrayLike) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Observation, reward, terminated, truncated and info after one step.

        Raises:
            InvalidInput: an action that is not (m,) finite numbers; nothing has changed then.
            gymnasium.error.ResetNeeded: before the first reset, or after the end of an episode.
        """
        if self._over:
            raise ResetNeeded("No episode is running: call reset() before step().")
        lanes = self._lanes
        vector = lanes.step_alone(action)
        readings = lanes.read_alone()
        numbers = readings.tolist()
        terminated, truncated = numbers[STATUS] > AT_LIMIT, numbers[STEP] >= self._steps
        self._over = terminated or truncated
        if self.render_mode is not None:
            self._show(readings)
        return vector, numbers[REWARD], terminated, truncated, self.task.single_info(readings, numbers)

    def render(self) -> NDArray[np.uint8] | None:
        """The picture (H, W, 3) in mode "rgb_array"; in mode "human" it goes to the window."""
        if self.render_mode is None:
            gymnasium.logger.warn('render() needs render_mode "human" or "rgb_array" in gymnasium.make.')
            return None
        if not self._begun:
            raise ResetNeeded("There is nothing to draw yet: call reset() before render().")
        scene = self._lanes.scene(np.array(self._trail))
        if self._renderer is None:
            self._renderer = self.task.renderer()
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
        """Draw the trail on, and the window."""
        self._trail.append(readings[TIP : TIP + self.task.dimension].copy())
        if self.render_mode == "human":
            self.render()

    def _observation(self, vector: NDArray[np.float32], readings: NDArray[np.float64]) -> Any:
        return vector


class GoalSteps(TrackingEnv):
    """What the Goal environments of every task do differently, put before their class."""

    goal: ClassVar[bool] = True

    def compute_reward(self, achieved_goal: ArrayLike, desired_goal: ArrayLike, info: Any) -> Any:
        """Reward for goals (..., d), a float for one pair and (...) for batches; info is not used."""
        reward = self.task.goal_reward(achieved_goal, desired_goal)
        return float(reward) if np.ndim(reward) == 0 else reward

    def step(self, action: ArrayLike) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """As without goals, with is_success in info."""
        vector, _, terminated, truncated, info = super().step(action)
        observation = self._observation(vector, self._lanes.state.readings[0])
        reward = self.compute_reward(observation["achieved_goal"], observation["desired_goal"], None)
        info["reward_terms"] = {"tracking": reward}
        info["is_success"] = bool(self.task.reached(self._lanes.state.readings[0]))
        return observation, reward, terminated, truncated, info

    def _observation(self, vector: NDArray[np.float32], readings: NDArray[np.float64]) -> Any:
        return goal_observation(self.task, vector, readings)


class RollingJointEnv(TrackingEnv):
    """Bring the tip of a tendon-driven rolling-contact chain to a target while an unknown force pulls at it.

    n links (n - 1 of them move), m tendons, length L (sum of the link heights; 100 mm for the default five-link
    mechanism, n = 5, m = 2). Every step is quasi-static: tendons move, the load moves on, the mechanism settles.

    ## Action space
    `Box(-1, 1, (m,), float32)`: how far each tendon is pulled in, in units of `action_scale_mm` (1 mm); negative
    pays out. Values beyond [-1, 1] are clipped. Motors hold at least 0.5 N and give way at 15 N (`tension_range`);
    there the command follows the tendon, so commands do not wind up.

    ## Observation space
    `Box(low, high, (entries,), float32)`; values are clipped to the bounds. `rj_gym.observation_entries` lists them.

    | Entries | Meaning | Unit | Low | High |
    |---|---|---|---|---|
    | link k x, link k y | origin of moving link k, k = 1 ... n - 1 | L | -2 | 2 |
    | link k cos angle, link k sin angle | its angle | 1 | -1 | 1 |
    | tendon j command | commanded length minus neutral length, j = 0 ... m - 1 | `command_scale_mm` (20 mm) | -2 | 2 |
    | tendon j tension (`observe_tensions`, on) | measured tension | largest tension (15 N) | 0 | 1 |
    | target x, target y | where the tip should be now | L | -2 | 2 |
    | tip error x, tip error y | target minus measured tip | `error_scale_mm` (10 mm) | -10 | 10 |
    | load x, load y (`observe_load`, off) | external force | largest `load.magnitude` (1 N) | -1 | 1 |
    | load on link k (`observe_load`, off) | 1 for the link that the force pulls | 1 | 0 | 1 |

    Links' entries come link by link (x, y, cos, sin), all others in the order of the table.

    ## Reward
    The sum of the terms, each in `info["reward_terms"]`:

    | Term | Value |
    |---|---|
    | tracking | - error / `error_scale_mm` (10 mm), error the distance of the true tip from the target after the step |
    | effort | - `effort` (0.01) · mean((tension / largest tension)²) |
    | smoothness | - `smoothness` (0.01) · mean((action - previous action)²) |
    | failure | - `failure_penalty` (100) if the solver gave no usable equilibrium, else 0 |

    ## Start
    Tensions of 3 N (`start_tension`) set the unloaded mechanism; the tendons are locked there and the load applied.
    Drawn per episode: a target that the unloaded mechanism reaches (`target`), and the load: a dead force at the
    origin of a random moving link, uniform in direction and in magnitude from 0 to 1 N (`load`).
    `reset(options=...)` fixes any of "target", "load", "mechanism" and "start"; what was drawn is in
    `info["sampled"]`.

    ## Episode end
    Truncated by the environment itself after `episode_steps` (50); no TimeLimit is registered, because a native
    vector environment has no such wrapper and both must end alike. Reaching the target does not end the episode.
    Terminated only when the solver finds no usable equilibrium: `info["status"]` says why, the penalty applies, and
    the observation is that of the last good pose.

    ## Info
    `error_mm`, `status` (name of a rollingjoint Status), `tip` and `target` (2,) [mm], `load` {"link", "force"},
    `tensions` (m,) [N], `command` (m,) [mm]; from `step` also `reward_terms`, from `reset` also `sampled`.

    ## Arguments
    `RollingJointEnv(render_mode=None, config=None, **overrides)`: `config` is a TrackingConfig or a dictionary of its
    fields; overrides go on top, and nested ones change only what they name:
    `gymnasium.make("rj_gym/RollingJoint-v0", episode_steps=20, load={"magnitude": (0, 1.5)})`.
    See TrackingConfig, LoadConfig, TargetConfig, RewardConfig and RandomizationConfig.

    ## Version history
    * v0: first version.
    """

    settings: ClassVar[type[TaskConfig]] = TrackingConfig


class RollingJointGoalEnv(GoalSteps, RollingJointEnv):
    """The tracking task with goals, for hindsight relabelling: as RollingJointEnv but for what follows.

    ## Observation space
    `Dict`, float32:

    | Key | Meaning | Unit | Low | High |
    |---|---|---|---|---|
    | observation | the entries of RollingJointEnv without target and tip error | | | |
    | achieved_goal | true tip x, y (without sensor noise) | L | -2 | 2 |
    | desired_goal | target x, y | L | -2 | 2 |

    ## Reward
    Exactly `compute_reward(achieved_goal, desired_goal, info)`, which needs nothing from info and takes batches:
    "dense" (default) is - error / `error_scale_mm`; "sparse" (`reward={"goal": "sparse"}`) is 0 where the error is at
    most `goal_tolerance_mm` (2 mm), else -1. There are no effort, smoothness and failure terms.

    ## Info
    As RollingJointEnv, and `is_success`: whether the error is at most `goal_tolerance_mm`.

    ## Version history
    * v0: first version.
    """
