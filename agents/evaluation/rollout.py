"""Episodes of an environment under a controller, many at a time, from fixed seeds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from time import process_time
from typing import Any, cast

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from agents.controllers.controller import Array, Controller, as_controller, envs_for
from agents.controllers.own_models import with_own_models
from agents.runs.environment import EnvConfig, tip_errors
from rollingjoint.errors import InvalidInput

LAST_STEPS = 10
BLOCK = 256  # episodes side by side


@dataclass(frozen=True)
class Episodes:
    """E episodes of T steps, and their random draws.

    Args:
        seeds: (E,). terminated: (E,) whether the environment ended the episode early.
        errors: tip error at the start and after every step, (E, T + 1) [mm]; an early end keeps its last error.
        rewards: sum over the episode, (E,).
        loads: force over time, (E, T + 1, 2 or 3) [N]. link: the link that it pulls, (E,). targets: (E, T + 1, 2 or 3)
            [mm]. None where the task is not tracking.
        reward_terms: sum of every term of the reward over the episode, (E,), by name; of ids that rj_gym has not
            registered, where they report them.
        action_us: processor time of the controller per action, episodes side by side; of blocks the shortest, since the
            first may compile [µs].
    """

    seeds: NDArray[np.int64]
    errors: Array
    rewards: Array
    terminated: NDArray[np.bool_]
    loads: Array | None = None
    link: NDArray[np.int64] | None = None
    targets: Array | None = None
    reward_terms: Mapping[str, Array] = field(default_factory=dict)
    action_us: float = 0.0

    def __len__(self) -> int:
        return len(self.seeds)

    @property
    def final_errors(self) -> Array:
        """Tip error at the end, (E,) [mm]."""
        return self.errors[:, -1]

    @property
    def last_errors(self) -> Array:
        """Tip errors after each of the last 10 steps, or of all steps where there are fewer, (E, 10) [mm]."""
        return self.errors[:, 1:][:, -LAST_STEPS:]


def run_episodes(env: EnvConfig, controller: Controller, seeds: Sequence[int], batch: int = BLOCK) -> Episodes:
    """One episode per seed, `batch` of them at a time.

    Each is the episode of the scalar environment after reset(seed=seed), whatever `batch`. A privileged controller is
    given the true state.

    Raises:
        ConfigError: an environment that cannot be made, or does not report info["error_mm"].
    """
    blocks = [seeds[first : first + batch] for first in range(0, len(seeds), batch)]
    return joined([_side_by_side(env, controller, block) for block in blocks])


def run_with_options(
    env: EnvConfig, controller: Controller, seeds: Sequence[int], options: Sequence[Mapping[str, Any]]
) -> Episodes:
    """One episode per seed, all side by side, each with its reset options, one entry of `options` per seed.

    Their random draws are not returned.

    Raises:
        InvalidInput: another number of options than of seeds; or options that cannot be used.
    """
    if len(options) != len(seeds):
        raise InvalidInput("number of options", len(options), f"{len(seeds)}, one per seed")
    return _side_by_side(env, controller, seeds, options=options)


def film(env: EnvConfig, controller: Controller, seed: int) -> list[NDArray[np.uint8]]:
    """RGB pictures (height, width, 3) of the episode with this seed: its start, and every step."""
    frames: list[NDArray[np.uint8]] = []

    def watch(envs: VectorEnv[Any, Any, Any]) -> None:
        (picture,) = cast(tuple[NDArray[np.uint8]], envs.render())
        frames.append(picture)

    _side_by_side(env, controller, [seed], watch)
    return frames


def _side_by_side(
    env: EnvConfig,
    controller: Controller,
    seeds: Sequence[int],
    watch: Callable[[VectorEnv[Any, Any, Any]], None] | None = None,
    options: Sequence[Mapping[str, Any]] = (),
) -> Episodes:
    """One episode per seed, all at a time, each to its end; `watch` is called at every state."""
    controller = as_controller(controller)
    envs = envs_for(env, controller, len(seeds), **({"render_mode": "rgb_array"} if watch else {}))
    task = getattr(envs.unwrapped, "task", None) if env.is_tracking else None
    observation, info = _begun(envs, [int(seed) for seed in seeds], options)
    controller = with_own_models(controller, envs.unwrapped)
    controller.begin(task, len(seeds))
    drawn = info.get("sampled", {}) if task and not options else {}
    errors, rewards = [np.array(tip_errors(info), float)], np.zeros(len(seeds))
    terms: dict[str, Array] = {}
    running, early, seconds = np.ones(len(seeds), bool), np.zeros(len(seeds), bool), 0.0
    while running.any():
        if watch:
            watch(envs)
        begun = process_time()
        actions = controller.act(observation)
        seconds += process_time() - begun
        observation, reward, terminated, truncated, info = envs.step(actions)
        errors.append(np.where(running, tip_errors(info), errors[-1]))
        rewards += np.where(running, reward, 0.0)
        for name, values in ({} if env.is_built_in else _reward_terms(info)).items():
            terms[name] = terms.get(name, 0.0) + np.where(running, values, 0.0)
        early |= running & terminated
        running &= ~(terminated | truncated)
    if watch:
        watch(envs)
    envs.close()
    loads, link, targets = (drawn.get(name) for name in ("forces", "link", "targets"))
    errors_over_time, action_us = np.stack(errors, axis=1), 1e6 * seconds / max(len(seeds) * (len(errors) - 1), 1)
    return Episodes(np.array(seeds), errors_over_time, rewards, early, loads, link, targets, terms, action_us)


def _reward_terms(info: Mapping[str, Any]) -> dict[str, Array]:
    """The terms of the reward in the info of a step, (B,) each; none where it does not report them."""
    terms = info.get("reward_terms", {})
    return {name: values for name, values in terms.items() if not name.startswith("_")}


def _begun(envs: VectorEnv[Any, Any, Any], seeds: list[int], options: Sequence[Mapping[str, Any]]) -> tuple[Any, Any]:
    """Observation and info of new episodes; neighbouring lanes that share one object of options begin together."""
    if not options:
        return envs.reset(seed=seeds)  # type: ignore[arg-type]
    observation, info = envs.reset(seed=seeds, options=dict(options[0]))  # type: ignore[arg-type]
    errors, first = np.array(tip_errors(info), float), 0
    for _, alike in groupby(options, key=id):
        lanes = np.zeros(len(seeds), bool)
        lanes[first : (first := first + len(list(alike)))] = True
        if not lanes[0]:
            fixed = {**options[first - 1], "reset_mask": lanes}
            observation, info = envs.reset(seed=seeds, options=fixed)  # type: ignore[arg-type]
            errors = np.where(lanes, tip_errors(info), errors)
    return observation, {"error_mm": errors}


def joined(blocks: Sequence[Episodes]) -> Episodes:
    """The episodes of all blocks; shorter ones keep their last error."""
    times = max(block.errors.shape[1] for block in blocks)
    padded = [np.pad(block.errors, ((0, 0), (0, times - block.errors.shape[1])), mode="edge") for block in blocks]

    def together(name: str) -> Any:
        parts = [getattr(block, name) for block in blocks]
        return None if parts[0] is None else np.concatenate(parts)

    return Episodes(
        np.concatenate([block.seeds for block in blocks]),
        np.concatenate(padded),
        np.concatenate([block.rewards for block in blocks]),
        np.concatenate([block.terminated for block in blocks]),
        together("loads"),
        together("link"),
        together("targets"),
        {name: np.concatenate([block.reward_terms[name] for block in blocks]) for name in blocks[0].reward_terms},
        min(block.action_us for block in blocks),
    )
