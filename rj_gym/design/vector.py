"""The native vector environment of the design task: all lanes and cases in one batched solve."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from rj_gym.core.info import masked_info, spread_info, unmasked_info, whole_info
from rj_gym.core.vector_arguments import checked_autoreset_mode, checked_mask, checked_seeds
from rj_gym.design.config import DesignConfig
from rj_gym.design.episodes import Lanes, sampled_info
from rj_gym.design.observation import observation_space
from rj_gym.design.options import checked_options
from rj_gym.design.render import DesignRenderer, scene
from rj_gym.design.task import Fixed, design_task
from rollingjoint.checks import as_integer
from rollingjoint.errors import InvalidInput

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Observations = NDArray[np.float32]


class CurvatureDesignVectorEnv(VectorEnv[Observations, NDArray[np.float32], NDArray[Any]]):
    """`num_envs` independent CurvatureDesignEnv in one batch: the same task, spaces and infos.

    Lane i is seeded with `seed + i` and follows a CurvatureDesignEnv with that seed.

    Args:
        num_envs: number of lanes, at least 1.
        render_mode: None or "rgb_array"; `render` then returns one picture per lane in `render_lanes`.
        config, overrides: as for CurvatureDesignEnv.
        autoreset_mode: an AutoresetMode or its value ("NextStep", "SameStep", "Disabled").
        render_lanes: lanes to draw; None is all of them.
    """

    metadata = {  # noqa: RUF012 (Gymnasium's own form)
        "render_modes": ["rgb_array"],
        "render_fps": 4,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        render_mode: str | None = None,
        config: DesignConfig | Mapping[str, Any] | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_lanes: Sequence[int] | None = None,
        **overrides: Any,
    ) -> None:
        self.num_envs = as_integer("num_envs", num_envs, 1, allowed="a whole number of lanes, 1 or more")
        if render_mode not in (None, "rgb_array"):
            raise InvalidInput("render_mode", render_mode, 'None or "rgb_array"')
        self.task = design_task(config, overrides)
        self.render_mode = render_mode
        self.render_lanes = range(self.num_envs) if render_lanes is None else tuple(render_lanes)
        self.autoreset_mode = checked_autoreset_mode(autoreset_mode)
        self.metadata = self.metadata | {"autoreset_mode": self.autoreset_mode}
        self.single_action_space = spaces.Box(-1.0, 1.0, (self.task.space.dimensions,), np.float32)
        self.single_observation_space = observation_space(self.config)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self._generators: list[np.random.Generator | None] = [None] * self.num_envs
        self._lanes = Lanes(self.task, self.num_envs)
        self._begun = False
        self._over: Mask = np.ones(self.num_envs, bool)
        self._renderer: DesignRenderer | None = None

    @property
    def config(self) -> DesignConfig:
        """The settings."""
        return self.task.config

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Observations and infos of new episodes.

        Args:
            seed: lane i gets seed + i; or one seed per lane, None leaving a lane's random numbers as they are.
            options: as for CurvatureDesignEnv, for every lane; and "reset_mask": (num_envs,) booleans, the lanes to
                reset.
        Raises:
            InvalidInput: seeds or options that cannot be used; no episode has changed then.
        """
        fixed_options = dict(options or {})
        mask = checked_mask(fixed_options.pop("reset_mask", None), self.num_envs, self._begun)
        fixed = checked_options(fixed_options, self.task)
        for lane, lane_seed in enumerate(checked_seeds(seed, self.num_envs)):
            if mask[lane] and (lane_seed is not None or self._generators[lane] is None):
                self._generators[lane] = seeding.np_random(lane_seed)[0]
        sampled = self._begin(mask, fixed)
        self._begun = True
        self._over = self._over & ~mask
        return self._lanes.observe(), masked_info(self._lanes.state_info() | {"sampled": sampled}, mask)

    def step(self, actions: ArrayLike) -> tuple[Observations, Array, Mask, Mask, dict[str, Any]]:
        """Observations, rewards, terminations, truncations and infos after one step of every lane.

        Raises:
            InvalidInput: actions that are not (num_envs, d) finite numbers; nothing has changed then.
            gymnasium.error.ResetNeeded: before the first reset; with autoreset disabled, while an ended lane waits.
        """
        if not self._begun:
            raise ResetNeeded("No episode is running: call reset() before step().")
        over, lanes = self._over, self._lanes
        if over.any() and self.autoreset_mode is AutoresetMode.DISABLED:
            waiting = np.flatnonzero(over).tolist()
            raise ResetNeeded(f"Lanes {waiting} have ended: reset them with options={{'reset_mask': ...}}.")
        checked = lanes.checked("actions", actions, (self.num_envs, self.task.space.dimensions))
        moving = np.flatnonzero(~over)
        if len(moving):
            lanes.advance(moving, checked[moving])
        sampled = self._begin(over) if over.any() else None
        observations, rewards = lanes.observe(), lanes.rewards
        infos = self._infos(sampled, over)
        ended = self._over = lanes.steps >= self.config.episode_steps
        if self.autoreset_mode is AutoresetMode.SAME_STEP and ended.any():
            observations, infos = self._restart(observations, infos)
        return observations, rewards, np.zeros(self.num_envs, bool), ended.copy(), infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """One picture (H, W, 3) per lane in `render_lanes`."""
        if self.render_mode is None:
            return None
        if not self._begun:
            raise ResetNeeded("There is nothing to draw yet: call reset() before render().")
        if self._renderer is None:
            self._renderer = DesignRenderer(self.task.length)
        return tuple(self._renderer.picture(scene(self._lanes, lane)) for lane in self.render_lanes)

    def close_extras(self, **kwargs: Any) -> None:
        """Free the renderer."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_renderer": None}

    def _begin(self, mask: Mask, fixed: Fixed = Fixed()) -> dict[str, Any]:  # noqa: B008 - immutable
        """New episodes in these lanes; what was drawn, spread over all lanes."""
        rows = np.flatnonzero(mask)
        rngs = [rng for lane, rng in enumerate(self._generators) if mask[lane] and rng is not None]
        return spread_info(sampled_info(self._lanes.begin(rows, rngs, fixed)), rows, self.num_envs)

    def _restart(self, observations: Observations, infos: dict[str, Any]) -> tuple[Observations, dict[str, Any]]:
        """Same-step autoreset: ended lanes begin anew; what they ended with goes into final_obs and final_info."""
        ended = self._over
        final = np.full(self.num_envs, None, dtype=object)
        for lane in np.flatnonzero(ended):
            final[lane] = observations[lane]
        restarted = self._infos(self._begin(ended), ended)
        restarted |= masked_info({"final_info": unmasked_info(infos)}, ended)
        self._over = np.zeros(self.num_envs, bool)
        return self._lanes.observe(), restarted | {"final_obs": final, "_final_obs": ended.copy()}

    def _infos(self, sampled: dict[str, Any] | None, fresh: Mask) -> dict[str, Any]:
        """Infos of all lanes, of which the fresh ones have just begun and the others made a step."""
        infos = whole_info(self._lanes.state_info(), self.num_envs)
        if sampled is not None:
            infos |= masked_info({"sampled": sampled}, fresh)
        if not fresh.all():
            infos |= masked_info({"reward_terms": self._lanes.reward_info()}, ~fresh)
        return infos
