"""The native vector environments: one batched solve for all lanes, and the same task as the scalar ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, ClassVar, TypeVar

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from rj_gym.config import TrackingConfig
from rj_gym.render import Renderer
from rj_gym.tracking.info import lane_scene, masked_info, sampled_info, state_info
from rj_gym.tracking.options import checked_options
from rj_gym.tracking.sampling import NOTHING_FIXED, Episodes, Fixed
from rj_gym.tracking.spaces import batch_observation, observation_space
from rj_gym.tracking.task import State, TrackingTask
from rollingjoint.errors import InvalidInput, as_floats, as_integer

Mask = NDArray[np.bool_]
Lanes = TypeVar("Lanes", State, Episodes)


class RollingJointVectorEnv(VectorEnv[Any, NDArray[np.float32], NDArray[Any]]):
    """`num_envs` independent RollingJointEnv in one batch: the same task, spaces, infos and, for equal seeds, numbers.

    Lane i is seeded with `seed + i` and equals a RollingJointEnv with that seed step by step.

    Args:
        num_envs: number of lanes, at least 1.
        render_mode: None or "rgb_array"; `render` then returns one picture per lane in `render_lanes`.
        config, overrides: as for RollingJointEnv.
        autoreset_mode: an AutoresetMode or its value ("NextStep", "SameStep", "Disabled").
        render_lanes: lanes to draw; None is all of them.
    """

    metadata = {  # noqa: RUF012 (Gymnasium's own form)
        "render_modes": ["rgb_array"],
        "render_fps": 12,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }
    goal: ClassVar[bool] = False

    def __init__(
        self,
        num_envs: int = 1,
        render_mode: str | None = None,
        config: TrackingConfig | Mapping[str, Any] | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_lanes: Sequence[int] | None = None,
        **overrides: Any,
    ) -> None:
        self.num_envs = as_integer("num_envs", num_envs, "a whole number of lanes, 1 or more", low=1)
        if render_mode not in (None, "rgb_array"):
            raise InvalidInput("render_mode", render_mode, 'None or "rgb_array"')
        if not isinstance(config, TrackingConfig):
            config = TrackingConfig.from_dict(config or {})
        self.task = TrackingTask(config.updated(overrides))
        self.render_mode = render_mode
        self.render_lanes = range(self.num_envs) if render_lanes is None else tuple(render_lanes)
        self.autoreset_mode = _autoreset_mode(autoreset_mode)
        self.metadata = self.metadata | {"autoreset_mode": self.autoreset_mode}
        self.single_action_space = spaces.Box(-1.0, 1.0, (self.task.mechanism.n_tendons,), np.float32)
        self.single_observation_space = observation_space(self.task, self.goal)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self._generators: list[np.random.Generator | None] = [None] * self.num_envs
        self._episodes: Episodes | None = None
        self._state: State | None = None
        self._over: Mask = np.ones(self.num_envs, bool)
        self._trail: list[NDArray[np.float64]] = []
        self._renderer: Renderer | None = None

    @property
    def config(self) -> TrackingConfig:
        """The settings."""
        return self.task.config

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Observations and infos of new episodes.

        Args:
            seed: lane i gets seed + i; or one seed per lane, None leaving a lane's random numbers as they are.
            options: as for RollingJointEnv, for every lane; and "reset_mask": (num_envs,) booleans, the lanes to reset.
        Raises:
            InvalidInput: seeds or options that cannot be used; nothing has changed then.
        """
        fixed_options = dict(options or {})
        mask = self._checked_mask(fixed_options.pop("reset_mask", None))
        fixed = checked_options(fixed_options, self.config, self.task.mechanism)
        for lane, lane_seed in enumerate(self._checked_seeds(seed)):
            if mask[lane] and (lane_seed is not None or self._generators[lane] is None):
                self._generators[lane] = seeding.np_random(lane_seed)[0]
        episodes, state = self._begin(mask, fixed)
        self._trail = [state.tips]
        info = state_info(episodes, state) | {"sampled": sampled_info(episodes)}
        return self._observation(episodes, state), masked_info(info, mask)

    def step(self, actions: ArrayLike) -> tuple[Any, NDArray[np.float64], Mask, Mask, dict[str, Any]]:
        """Observations, rewards, terminations, truncations and infos after one step of every lane.

        Raises:
            InvalidInput: actions that are not (num_envs, m) finite numbers; nothing has changed then.
            gymnasium.error.ResetNeeded: before the first reset; with autoreset disabled, while an ended lane waits.
        """
        if self._episodes is None or self._state is None:
            raise ResetNeeded("No episode is running: call reset() before step().")
        checked = self._checked_actions(actions)
        fresh = self._over.copy()
        if fresh.any() and self.autoreset_mode is AutoresetMode.DISABLED:
            lanes = np.flatnonzero(fresh).tolist()
            raise ResetNeeded(f"Lanes {lanes} have ended: reset them with options={{'reset_mask': ...}}.")
        self._state = self.task.advance(self._episodes, _wound_back(self._state, fresh), checked)
        if fresh.any():
            self._begin(fresh, NOTHING_FIXED)
        episodes, state = self._episodes, self._state
        terms = self._reward_terms(episodes, state)
        rewards = np.where(fresh, 0.0, sum(terms.values()))
        terminated, truncated = (np.where(fresh, False, ended) for ended in self.task.end(state))
        self._over = terminated | truncated
        self._trail = [*self._trail[-self.config.episode_steps :], state.tips]
        infos = self._infos(episodes, state, terms, fresh)
        observations = self._observation(episodes, state)
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._over.any():
            observations, infos = self._restart(observations, infos)
        return observations, rewards, terminated, truncated, infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """One picture (H, W, 3) per lane in `render_lanes`."""
        if self.render_mode is None:
            return None
        if self._episodes is None or self._state is None:
            raise ResetNeeded("There is nothing to draw yet: call reset() before render().")
        if self._renderer is None:
            self._renderer = Renderer(self.task.length)
        return tuple(self._picture(self._renderer, self._episodes, self._state, lane) for lane in self.render_lanes)

    def close_extras(self, **kwargs: Any) -> None:
        """Free the renderer."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_renderer": None}

    def _begin(self, mask: Mask, fixed: Fixed) -> tuple[Episodes, State]:
        """New episodes in the masked lanes; the whole batch afterwards."""
        rngs = [rng for rng, chosen in zip(self._generators, mask, strict=True) if chosen and rng is not None]
        episodes = self.task.sample(rngs, fixed)
        state = self.task.begin(episodes)
        if not mask.all() and self._episodes is not None and self._state is not None:
            episodes, state = _merged(self._episodes, episodes, mask), _merged(self._state, state, mask)
        self._episodes, self._state = episodes, state
        self._over = self._over & ~mask
        return episodes, state

    def _restart(self, observations: Any, infos: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
        """Same-step autoreset: ended lanes begin anew; what they ended with goes into final_obs and final_info."""
        ended = self._over.copy()
        final = np.full(self.num_envs, None, dtype=object)
        for lane in np.flatnonzero(ended):
            final[lane] = _row(observations, int(lane))
        episodes, state = self._begin(ended, NOTHING_FIXED)
        base = state_info(episodes, state)
        restarted = masked_info(base, np.ones(self.num_envs, bool))
        restarted |= masked_info({"sampled": sampled_info(episodes)}, ended)
        if not ended.all():
            restarted |= masked_info({k: v for k, v in _unmasked(infos).items() if k not in base}, ~ended)
        restarted |= masked_info({"final_info": _unmasked(infos)}, ended)
        restarted |= {"final_obs": final, "_final_obs": ended.copy()}
        return self._observation(episodes, state), restarted

    def _infos(self, episodes: Episodes, state: State, terms: dict[str, Any], fresh: Mask) -> dict[str, Any]:
        infos = masked_info(state_info(episodes, state), np.ones(self.num_envs, bool))
        if not fresh.all():
            infos |= masked_info({"reward_terms": terms}, ~fresh)
        if fresh.any():
            infos |= masked_info({"sampled": sampled_info(episodes)}, fresh)
        return infos

    def _reward_terms(self, episodes: Episodes, state: State) -> dict[str, Any]:
        return dict(self.task.reward_terms(state))

    def _observation(self, episodes: Episodes, state: State) -> Any:
        return batch_observation(self.task, episodes, state, self.goal)

    def _picture(self, renderer: Renderer, episodes: Episodes, state: State, lane: int) -> NDArray[np.uint8]:
        trail = np.array(self._trail)[-(int(state.step[lane]) + 1) :, lane]
        return renderer.picture(lane_scene(self.task, episodes, state, trail, lane))

    def _checked_mask(self, mask: object) -> Mask:
        if mask is None:
            return np.ones(self.num_envs, bool)
        chosen = np.asarray(mask)
        if chosen.shape != (self.num_envs,) or chosen.dtype != bool or not chosen.any():
            raise InvalidInput(
                "options['reset_mask']", mask, f"{self.num_envs} booleans, one per lane, at least one of them True"
            )
        if self._episodes is None and not chosen.all():
            raise InvalidInput("options['reset_mask']", mask, "all True: no lane has begun yet")
        return chosen.copy()

    def _checked_seeds(self, seed: int | Sequence[int | None] | None) -> Sequence[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, int | np.integer):
            return [int(seed) + lane for lane in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise InvalidInput("seed", seed, f"a number, or {self.num_envs} numbers, one per lane")
        return seed

    def _checked_actions(self, actions: ArrayLike) -> NDArray[np.float64]:
        shape = (self.num_envs, self.task.mechanism.n_tendons)
        allowed = f"finite numbers in [-1, 1] of shape {shape}"
        values = as_floats("actions", actions, allowed)
        if values.shape != shape or not np.isfinite(values).all():
            raise InvalidInput("actions", actions, allowed)
        return values


class RollingJointGoalVectorEnv(RollingJointVectorEnv):
    """`num_envs` independent RollingJointGoalEnv in one batch; everything else as RollingJointVectorEnv."""

    goal: ClassVar[bool] = True

    def compute_reward(self, achieved_goal: ArrayLike, desired_goal: ArrayLike, info: Any) -> NDArray[np.float64]:
        """Reward for goals (..., 2), (...); info is not used."""
        return self.task.goal_reward(achieved_goal, desired_goal)

    def _reward_terms(self, episodes: Episodes, state: State) -> dict[str, Any]:
        return {"tracking": self.task.goal_reward(self.task.goals(state.tips), self.task.goals(state.targets))}

    def _infos(self, episodes: Episodes, state: State, terms: dict[str, Any], fresh: Mask) -> dict[str, Any]:
        infos = super()._infos(episodes, state, terms, fresh)
        if not fresh.all():
            success = state.errors <= self.config.reward.goal_tolerance_mm
            infos |= masked_info({"is_success": success}, ~fresh)
        return infos


def _autoreset_mode(mode: AutoresetMode | str) -> AutoresetMode:
    try:
        return AutoresetMode(mode)
    except ValueError:
        allowed = f"an AutoresetMode or one of {', '.join(repr(known.value) for known in AutoresetMode)}"
        raise InvalidInput("autoreset_mode", mode, allowed) from None


def _wound_back(state: State, mask: Mask) -> State:
    """The state with masked lanes at step 0: lanes that have ended take a step that is thrown away."""
    return replace(state, step=np.where(mask, 0, state.step)) if mask.any() else state


def _merged(old: Lanes, new: Lanes, mask: Mask) -> Lanes:
    """A batch whose masked lanes are those of `new`, in order, and whose others are those of `old`."""
    rows = np.flatnonzero(mask)
    changes: dict[str, Any] = {}
    for field in fields(old):
        before, after = getattr(old, field.name), getattr(new, field.name)
        if isinstance(before, tuple):
            merged = list(before)
            for row, value in zip(rows, after, strict=True):
                merged[row] = value
            changes[field.name] = tuple(merged)
        elif before is not None:
            changes[field.name] = before.copy()
            changes[field.name][rows] = after
    return replace(old, **changes)


def _row(observations: Any, lane: int) -> Any:
    if isinstance(observations, dict):
        return {key: value[lane].copy() for key, value in observations.items()}
    return observations[lane].copy()


def _unmasked(infos: dict[str, Any]) -> dict[str, Any]:
    """Infos without their `_key` masks, copied."""
    return {
        key: _unmasked(value) if isinstance(value, dict) else value.copy()
        for key, value in infos.items()
        if not key.startswith("_")
    }
