"""Base of the native vector environments: all lanes in one batch, plain and with goals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from rj_gym.core.arguments import (
    checked_array,
    checked_autoreset_mode,
    checked_count,
    checked_lanes,
    checked_mask,
    checked_parts,
    checked_render_mode,
    checked_seeds,
    used_alone,
)
from rj_gym.core.columns import REWARD, STEP, TIP
from rj_gym.core.env import EpisodeSpec, TaskEnv
from rj_gym.core.generators import Generators, check_generator_states, generator_states, set_generator_states
from rj_gym.core.info import masked_info, put_info, spread_info, unmasked_info, whole_info
from rj_gym.core.settings import Settings, made_settings
from rj_gym.core.spaces import goal_observation, lane_observations, observation_space, observed
from rj_gym.core.task import ObservedError
from rollingjoint.checks import as_boolean
from rollingjoint.errors import InvalidInput

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Vectors = NDArray[np.float32]


class TaskVectorEnv(VectorEnv[Any, NDArray[np.float32], NDArray[Any]]):
    """Base of the native vector environments; a class names the scalar environment of its lanes.

    It computes on several threads itself; used from several threads at once, the later call raises EnvironmentInUse.

    Args:
        num_envs: number of lanes, 1 to 2^20.
        render_mode: None or "rgb_array"; `render` then returns one picture per lane in `render_lanes`.
        config, overrides: as for the scalar environment.
        autoreset_mode: an AutoresetMode or its value ("NextStep", "SameStep", "Disabled").
        render_lanes: lanes to draw; None is all of them.
    Raises:
        InvalidInput, ConfigError: arguments that cannot be used.
        MissingPackage: pictures are asked for, and pygame, which the extra `plot` brings, is not installed.
    """

    metadata = {  # noqa: RUF012 (Gymnasium's own form)
        "render_modes": ["rgb_array"],
        "render_fps": 12,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }
    scalar: ClassVar[type[TaskEnv]]
    spec = EpisodeSpec()

    def __init__(
        self,
        num_envs: int = 1,
        render_mode: str | None = None,
        config: Settings | Mapping[str, Any] | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_lanes: Sequence[int] | None = None,
        **overrides: Any,
    ) -> None:
        self._calls: dict[str, Any] = {}
        self._renderer: Any = None  # these first: Gymnasium 1.1 closes even where an argument is refused
        self.num_envs = checked_count(num_envs)
        self.goal = self.scalar.goal
        self.task: Any = self.scalar.task_class(made_settings(self.scalar.settings, config, overrides, self.goal))
        self.render_mode = checked_render_mode(render_mode, self.metadata["render_modes"])
        self.render_lanes = checked_lanes(render_lanes, self.num_envs)
        self.autoreset_mode = checked_autoreset_mode(autoreset_mode)
        self.metadata = self.metadata | {"autoreset_mode": self.autoreset_mode}
        self.single_action_space = spaces.Box(-1.0, 1.0, (self.task.action_size,), np.float32)
        self.single_observation_space = observation_space(self.task, self.goal)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self._generators = Generators([None] * self.num_envs)
        self._buffer = self.scalar.buffer(self.task, self.num_envs, self.goal)
        self._begun = False
        self._kept: list[Any] = []  # options of every lane, if some are kept
        self._over: Mask = np.ones(self.num_envs, bool)
        self._trail: list[Array] = []

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

    @property
    def has_begun(self) -> bool:
        """Whether episodes run: after the first reset."""
        return self._begun

    @used_alone
    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Observations and infos of new episodes.

        Args:
            seed: lane i gets seed + i; or one seed per lane, None leaving a lane's random numbers as they are.
            options: as for the scalar environment, for every lane; and "reset_mask": (num_envs,) booleans, the lanes
                to reset; "lanes": a sequence with the options of every lane, in place of the same for all (lanes with
                one object begin together, which is faster); "keep": true, if options hold, too, for the episodes that
                these lanes begin themselves, until they are reset (not part of `get_state`).
        Raises:
            InvalidInput: seeds or options that cannot be used; the state is unchanged then.
        """
        fixed_options = dict(options or {})
        mask = checked_mask(fixed_options.pop("reset_mask", None), self.num_envs, self._begun)
        keep = as_boolean("options['keep']", fixed_options.pop("keep", False))
        fixed = self._checked_options(fixed_options)
        before = self._buffer.get_state() if self._begun and len(_groups(fixed)) > 1 else None
        replaced = self._seed(checked_seeds(seed, self.num_envs), mask)
        try:
            sampled, vectors = self._begin(np.flatnonzero(mask), fixed)
        except InvalidInput:
            for lane, rng in replaced.items():
                self._generators[lane] = rng
            if before is not None:
                self._buffer.set_state(before)
            raise
        self._keep(fixed, mask, keep)
        if not mask.all():
            vectors = self._buffer.observe()
        readings = self._buffer.readings.copy()
        self._begun = True
        self._over = self._over & ~mask
        self._remember(readings)
        info = self.task.state_info(readings) | {"sampled": sampled}
        return self._observation(vectors, readings), masked_info(info, mask)

    @used_alone
    def step(self, actions: ArrayLike) -> tuple[Any, Array, Mask, Mask, dict[str, Any]]:
        """Observations, rewards, terminations, truncations and infos after one step of every lane.

        Raises:
            InvalidInput: actions that are not of the space's shape or not finite; the state is unchanged then.
            gymnasium.error.ResetNeeded: before the first reset; with autoreset disabled, while an ended lane waits.
        """
        if not self._begun:
            raise ResetNeeded("No episode is running: call reset() before step().")
        fresh = np.flatnonzero(self._over)
        if len(fresh) and self.autoreset_mode is AutoresetMode.DISABLED:
            raise ResetNeeded(f"Lanes {fresh.tolist()} have ended: reset them with options={{'reset_mask': ...}}.")
        self._buffer.accept(actions)
        vectors, sampled = self._advance(fresh)
        readings = self._buffer.readings.copy()
        self._remember(readings)
        terminated, truncated = (
            self.task.terminated(readings),
            readings[:, STEP] >= self.config.episode_steps,
        )
        terminated[fresh] = False
        observations = self._observation(vectors, readings)
        rewards, terms = self._rewards(observations, readings)
        rewards[fresh] = 0.0
        infos = self._infos(readings, terms, sampled)
        self._over = terminated | truncated
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._over.any():
            observations, infos = self._restart(vectors, observations, infos)
        return observations, rewards, terminated, truncated, infos

    @used_alone
    def tangent(self) -> Any:
        """The state of all lanes and how it answers actions: of tracking tasks a Tangent, among walls a Response.

        Raises:
            InvalidInput: a task of design.
            gymnasium.error.ResetNeeded: before the first reset.
        """
        if not self._begun:
            raise ResetNeeded("No episode is running: call reset() before tangent().")
        return self._buffer.tangent()

    @used_alone
    def get_state(self) -> dict[str, Any]:
        """Everything that later steps depend on, copied: plain values and arrays, for `set_state`, here or elsewhere.

        Pictures' trails are not part of it.

        Raises:
            gymnasium.error.ResetNeeded: before the first reset.
        """
        if not self._begun:
            raise ResetNeeded("There is no state yet: call reset() before get_state().")
        generators = generator_states(self._generators)
        return {"episodes": self._buffer.get_state(), "generators": generators, "over": self._over.copy()}

    @used_alone
    def set_state(self, state: Mapping[str, Any]) -> None:
        """Continue from a state of an environment with the same settings and number of lanes, to the last bit.

        Raises:
            InvalidInput: any other state; the state is unchanged then.
        """
        parts = checked_parts(state, ("episodes", "generators", "over"))
        check_generator_states(parts["generators"], self.num_envs)
        over = checked_array("over", parts["over"], self._over).copy()
        self._buffer.set_state(parts["episodes"])
        set_generator_states(self._generators, parts["generators"])
        self._over, self._begun, self._trail = over, True, []

    @used_alone
    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """One picture (H, W, 3) per lane in `render_lanes`."""
        if self.render_mode is None:
            return None
        if not self._begun:
            raise ResetNeeded("There is nothing to draw yet: call reset() before render().")
        if self._renderer is None:
            self._renderer = self._buffer.renderer()
        return tuple(self._picture(self._renderer, lane) for lane in self.render_lanes)

    @used_alone
    def scene(self, lane: int = 0) -> Any:
        """The scene of this lane's picture, in arrays that no later step changes.

        Of tracking tasks it is a TrackingScene. Its trail is kept in mode "rgb_array" only.

        Raises:
            gymnasium.error.ResetNeeded: before the first reset.
        """
        if not self._begun:
            raise ResetNeeded("There is nothing to draw yet: call reset() before scene().")
        scene = self._scene(lane)
        arrays = {name: value.copy() for name, value in vars(scene).items() if isinstance(value, np.ndarray)}
        return replace(scene, **arrays)

    @used_alone
    def close_extras(self, **kwargs: Any) -> None:
        """Free the renderer."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    @used_alone
    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_renderer": None, "_calls": {}}

    def _seed(self, seeds: Sequence[int | None], mask: Mask) -> dict[int, np.random.Generator | None]:
        """New generators where lanes to reset have a seed, or none yet; those that they replace."""
        replaced = {}
        for lane, seed in enumerate(seeds):
            if mask[lane] and (seed is not None or self._generators[lane] is None):
                replaced[lane] = self._generators[lane]
                self._generators[lane] = seeding.np_random(seed)[0]
        return replaced

    def _checked_options(self, options: dict[str, Any]) -> list[Any]:
        """Checked options of every lane; lanes that share an object share the checked one, too."""
        lanes = options.pop("lanes", None)
        if lanes is None:
            return [self.task.checked_options(options)] * self.num_envs
        allowed = f"a sequence of {self.num_envs} options, one per lane, and no others beside it"
        if not isinstance(lanes, Sequence) or len(lanes) != self.num_envs or options:
            raise InvalidInput("options['lanes']", lanes, allowed)
        checked = {id(lane): self.task.checked_options(lane) for lane in lanes}
        return [checked[id(lane)] for lane in lanes]

    def _keep(self, fixed: Sequence[Any], mask: Mask, keep: bool) -> None:
        """Keep options of the lanes in a mask for later episodes, or forget kept ones."""
        if keep or self._kept:
            before = self._kept or [None] * self.num_envs
            self._kept = [new if keep else None for new in fixed]
            for lane in np.flatnonzero(~mask).tolist():
                self._kept[lane] = before[lane]

    def _begin(self, rows: NDArray[np.int64], fixed: Sequence[Any] | None = None) -> tuple[dict[str, Any], Vectors]:
        """New episodes in these lanes: info["sampled"], spread over all lanes, and the vectors of these lanes.

        fixed: checked options of every lane; None: the kept ones.
        """
        lanes = self._kept if fixed is None else fixed
        if not lanes:
            return self._begin_alike(rows, None)
        groups = _groups([lanes[row] for row in rows])
        if len(groups) == 1:
            return self._begin_alike(rows, lanes[rows[0]])
        parts = [(places, *self._begin_alike(rows[places], lanes[rows[places[0]]])) for places in groups]
        sampled, vectors = parts[0][1], np.empty((len(rows), parts[0][2].shape[1]), np.float32)
        for places, own_sampled, own_vectors in parts:
            put_info(sampled, own_sampled, rows[places])
            vectors[places] = own_vectors
        return sampled, vectors

    def _begin_alike(self, rows: NDArray[np.int64], fixed: Any) -> tuple[dict[str, Any], Vectors]:
        """`_begin` with the same options in all of these lanes."""
        rngs = self._generators if len(rows) == self.num_envs else self._generators.of(rows)
        sampled, vectors = self._buffer.restart(rows, rngs, fixed)
        return spread_info(sampled, rows, self.num_envs), vectors

    def _advance(self, fresh: NDArray[np.int64]) -> tuple[Vectors, dict[str, Any] | None]:
        """One step, in which ended lanes restart: all vectors, and info["sampled"], None where no lane restarted."""
        if len(fresh) == self.num_envs:
            sampled, vectors = self._begin(fresh)
            return vectors, sampled
        vectors = self._buffer.advance(fresh)
        if len(fresh) == 0:
            return vectors, None
        sampled, vectors[fresh] = self._begin(fresh)
        return vectors, sampled

    def _restart(self, vectors: Vectors, observations: Any, infos: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
        """Same-step autoreset: ended lanes restart; their last observations and infos go to final_obs, final_info."""
        ended = self._over
        rows = np.flatnonzero(ended)
        sampled, fresh = self._begin(rows)
        final = np.full(self.num_envs, None, dtype=object)
        final[rows] = lane_observations(observations, rows)
        if len(rows) < self.num_envs:
            vectors = vectors.copy()
            vectors[rows] = fresh
        else:
            vectors = fresh
        self._over = np.zeros(self.num_envs, bool)
        readings = self._buffer.readings.copy()
        base = self.task.state_info(readings)
        restarted = whole_info(base, self.num_envs) | masked_info({"sampled": sampled}, ended)
        if len(rows) < self.num_envs:
            stepped = {key: value for key, value in unmasked_info(infos).items() if key not in base}
            restarted |= masked_info(stepped, ~ended)
        restarted |= masked_info({"final_info": unmasked_info(infos)}, ended)
        restarted |= {"final_obs": final, "_final_obs": ended.copy()}
        return self._observation(vectors, readings), restarted

    def _infos(self, readings: Array, terms: dict[str, Array], sampled: dict[str, Any] | None) -> dict[str, Any]:
        """Infos of a step; lanes that restarted in it are those still marked as over."""
        everywhere, stepped = self.task.state_info(readings), self._step_info(readings, terms)
        if sampled is None:
            return whole_info(everywhere | stepped, self.num_envs)
        infos = whole_info(everywhere, self.num_envs) | masked_info({"sampled": sampled}, self._over)
        return infos if self._over.all() else infos | masked_info(stepped, ~self._over)

    def _step_info(self, readings: Array, terms: dict[str, Array]) -> dict[str, Any]:
        """Entries that only infos of a step have, (B, ...)."""
        return {"reward_terms": terms}

    def _rewards(self, observations: Any, readings: Array) -> tuple[Array, dict[str, Array]]:
        """Rewards and their terms, (B,) each."""
        return readings[:, REWARD].copy(), self.task.reward_info(readings)

    def _observation(self, vectors: Vectors, readings: Array) -> Any:
        return observed(self.task, vectors, readings)

    def _remember(self, readings: Array) -> None:
        """Keep tips for the trails in pictures."""
        if self.render_mode is not None:
            self._trail = [*self._trail[-self.config.episode_steps :], self._tips(readings)]

    def _tips(self, readings: Array) -> Array:
        return readings[:, TIP : TIP + self.task.dimension].copy()

    def _picture(self, renderer: Any, lane: int) -> NDArray[np.uint8]:
        picture: NDArray[np.uint8] = renderer.picture(self._scene(lane))
        return picture

    def _scene(self, lane: int) -> Any:
        steps = int(self._buffer.readings[lane, STEP])
        trail = self._trail or [self._tips(self._buffer.readings)]
        return self._buffer.scene(np.array(trail)[-(steps + 1) :, lane], lane)


def _groups(values: Sequence[Any]) -> list[NDArray[np.int64]]:
    """The places of values that are one object, a group per object."""
    places: dict[int, list[int]] = {}
    for place, value in enumerate(values):
        places.setdefault(id(value), []).append(place)
    return [np.array(alike, np.int64) for alike in places.values()]


class GoalTaskVectorEnv(TaskVectorEnv):
    """Base of the Goal vector environments; a task's class lists it before its plain environment."""

    def compute_reward(self, achieved_goal: ArrayLike, desired_goal: ArrayLike, info: Any) -> NDArray[np.float64]:
        """Reward for goals (..., d), (...); info is not used. Raises InvalidInput for other goals."""
        return self.task.goal_reward(*self.task.checked_goals(achieved_goal, desired_goal))

    def _observation(self, vectors: Vectors, readings: Array) -> Any:
        return goal_observation(self.task, vectors, readings)

    def _rewards(self, observations: Any, readings: Array) -> tuple[Array, dict[str, Array]]:
        rewards = self.task.goal_reward(observations["achieved_goal"], observations["desired_goal"])
        return rewards, {"tracking": rewards.copy()}

    def _step_info(self, readings: Array, terms: dict[str, Array]) -> dict[str, Any]:
        return {"reward_terms": terms, "is_success": self.task.reached(readings)}
