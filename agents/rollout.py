"""Episodes of an environment under a controller, many side by side, from fixed seeds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium.vector import SyncVectorEnv, VectorEnv
from numpy.typing import NDArray

from agents.config import EnvConfig
from agents.controller import Array, Controller, Seen
from rj_gym.core.tracking_task import TrackingTask as Task
from rollingjoint.errors import ConfigError


@dataclass(frozen=True)
class Episodes:
    """E episodes of T steps, and what was drawn for them.

    Args:
        seeds: (E,). terminated: (E,) whether the environment ended the episode early.
        errors: tip error at the start and after every step, (E, T + 1) [mm]; an early end keeps its last error.
        rewards: sum over the episode, (E,).
        loads: force over time, (E, T + 1, 2 or 3) [N]. link: the link that it pulls, (E,). targets: (E, T + 1, 2 or 3)
            [mm]. None where the task is not tracking.
    """

    seeds: NDArray[np.int64]
    errors: Array
    rewards: Array
    terminated: NDArray[np.bool_]
    loads: Array | None = None
    link: NDArray[np.int64] | None = None
    targets: Array | None = None

    def __len__(self) -> int:
        return len(self.seeds)

    @property
    def final_errors(self) -> Array:
        """Tip error at the end, (E,) [mm]."""
        return self.errors[:, -1]


def is_tracking(env: EnvConfig) -> bool:
    """Whether its task is one of tracking, planar or of an arm, for which there are baselines and floors."""
    from rj_gym import IDS

    return env.id in IDS


def run_episodes(env: EnvConfig, controller: Controller, seeds: Sequence[int], lanes: int = 256) -> Episodes:
    """One episode per seed, `lanes` of them at a time.

    Each is the episode of the scalar environment after reset(seed=seed), whatever `lanes`.

    Raises:
        ConfigError: an environment that cannot be made, or does not report info["error_mm"].
    """
    blocks = [seeds[first : first + lanes] for first in range(0, len(seeds), lanes)]
    return _joined([_side_by_side(env, controller, block) for block in blocks])


def film(env: EnvConfig, controller: Controller, seed: int) -> list[NDArray[np.uint8]]:
    """RGB pictures (height, width, 3) of the episode with this seed: its start, and every step."""
    frames: list[NDArray[np.uint8]] = []

    def watch(envs: VectorEnv[Any, Any, Any]) -> None:
        (picture,) = cast(tuple[NDArray[np.uint8]], envs.render())
        frames.append(picture)

    _side_by_side(env, controller, [seed], watch)
    return frames


def tip_error(info: dict[str, Any]) -> float:
    """Tip error in an info [mm]; raises ConfigError for an environment that does not report one."""
    return float(_tip_errors(info))


def _tip_errors(info: dict[str, Any]) -> Any:
    if "error_mm" not in info:
        raise ConfigError("info", sorted(info), 'an environment that reports info["error_mm"], the tip error in mm')
    return info["error_mm"]


def _side_by_side(
    env: EnvConfig,
    controller: Controller,
    seeds: Sequence[int],
    watch: Callable[[VectorEnv[Any, Any, Any]], None] | None = None,
) -> Episodes:
    """One episode per seed, all at a time; `watch` is called at every state. Lanes that have ended are not read."""
    envs = _vector_env(env, len(seeds), **({"render_mode": "rgb_array"} if watch else {}))
    task = getattr(envs, "task", None) if is_tracking(env) else None
    observation, info = envs.reset(seed=[int(seed) for seed in seeds])  # type: ignore[arg-type]
    controller.begin(cast(Task, task), len(seeds))
    drawn = info.get("sampled", {}) if task else {}
    errors, rewards = [np.array(_tip_errors(info), float)], np.zeros(len(seeds))
    running, early = np.ones(len(seeds), bool), np.zeros(len(seeds), bool)
    while running.any():
        if watch:
            watch(envs)
        observation, reward, terminated, truncated, info = envs.step(controller.act(Seen(observation, task)))
        errors.append(np.where(running, _tip_errors(info), errors[-1]))
        rewards += np.where(running, reward, 0.0)
        early |= running & terminated
        running &= ~(terminated | truncated)
    if watch:
        watch(envs)
    envs.close()
    series = [drawn.get(name) for name in ("forces", "link", "targets")]
    return Episodes(np.array(seeds), np.stack(errors, axis=1), rewards, early, *series)


def _vector_env(env: EnvConfig, lanes: int, **arguments: Any) -> VectorEnv[Any, Any, Any]:
    """The native vector environment of rj_gym; else scalar environments one after the other."""
    from agents.build import make_env

    if not env.id.startswith("rj_gym/"):
        return SyncVectorEnv([partial(make_env, env, **arguments)] * lanes)
    import rj_gym  # noqa: F401  (registers its ids)

    try:
        return gymnasium.make_vec(env.id, lanes, "vector_entry_point", **env.arguments(), **arguments)
    except gymnasium.error.Error as error:
        raise ConfigError("env", env.id, "an environment that Gymnasium can make", str(error)) from error


def _joined(blocks: Sequence[Episodes]) -> Episodes:
    """The episodes of all blocks; those of shorter ones keep their last error."""
    times = max(block.errors.shape[1] for block in blocks)
    padded = [np.pad(block.errors, ((0, 0), (0, times - block.errors.shape[1])), mode="edge") for block in blocks]
    series: list[Any] = []
    for name in ("loads", "link", "targets"):
        parts = [getattr(block, name) for block in blocks]
        series.append(None if parts[0] is None else np.concatenate(parts))
    return Episodes(
        np.concatenate([block.seeds for block in blocks]),
        np.concatenate(padded),
        np.concatenate([block.rewards for block in blocks]),
        np.concatenate([block.terminated for block in blocks]),
        *series,
    )
