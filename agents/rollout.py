"""Episodes of one environment under a controller, from fixed seeds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from rollingjoint.errors import ConfigError

if TYPE_CHECKING:
    from agents.baselines import Controller


@dataclass(frozen=True)
class Episode:
    """One episode: tip error at the start and after every step (steps + 1,) [mm], sum of rewards."""

    seed: int
    errors: np.ndarray
    reward: float
    terminated: bool


def run_episode(
    env: gymnasium.Env,
    controller: Controller,
    seed: int,
    watch: Callable[[], object] | None = None,
) -> Episode:
    """The episode that `controller` drives after reset(seed=seed); `watch` is called at every state."""
    observation, info = env.reset(seed=seed)
    controller.reset(env)
    errors, rewards = [tip_error(info)], []
    ended = terminated = False
    while not ended:
        if watch:
            watch()
        observation, reward, terminated, truncated, info = env.step(controller.act(observation, env))
        errors.append(tip_error(info))
        rewards.append(float(reward))
        ended = terminated or truncated
    if watch:
        watch()
    return Episode(seed, np.array(errors), float(np.sum(rewards)), bool(terminated))


def run_episodes(env: gymnasium.Env, controller: Controller, seeds: Sequence[int]) -> list[Episode]:
    """One episode per seed."""
    return [run_episode(env, controller, seed) for seed in seeds]


def error_table(episodes: Sequence[Episode]) -> np.ndarray:
    """Tip errors (episodes, steps + 1) [mm]; an episode that ended early keeps its last error."""
    length = max(len(episode.errors) for episode in episodes)
    return np.array([np.pad(e.errors, (0, length - len(e.errors)), mode="edge") for e in episodes])


def tip_error(info: dict[str, Any]) -> float:
    """Tip error in an info [mm]; raises ConfigError for an environment that does not report one."""
    if "error_mm" not in info:
        raise ConfigError("info", sorted(info), 'an environment that reports info["error_mm"], the tip error in mm')
    return float(info["error_mm"])
