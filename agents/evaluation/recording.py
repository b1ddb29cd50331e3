"""Recorded episodes: the observations and actions of a controller, rewards, ends, and infos."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.controllers.controller import Array, Controller, as_controller, env_for
from agents.runs.environment import EnvConfig, make_vector_env
from rollingjoint.errors import ConfigError

ERROR = "error_mm"


@dataclass(frozen=True)
class Recording:
    """One episode of `length` steps.

    Args:
        seed: its environment's reset(seed=...).
        observations: (length + 1, entries) float32, the first before the first action; or a dictionary of such arrays.
        actions: (length, m) float32, within the bounds of the space.
        rewards, terminations, truncations: (length,) each.
        infos: the requested entries by name, (length + 1, ...) each.
    """

    seed: int
    observations: Any
    actions: NDArray[np.float32]
    rewards: Array
    terminations: NDArray[np.bool_]
    truncations: NDArray[np.bool_]
    infos: Mapping[str, NDArray[Any]]

    @property
    def length(self) -> int:
        """Number of steps."""
        return len(self.rewards)


def record_episodes(
    env: EnvConfig, controller: Controller, seeds: Sequence[int], infos: Sequence[str] = (ERROR,)
) -> list[Recording]:
    """One episode per seed, all side by side, each the episode of the scalar environment after reset(seed=seed).

    A lane is recorded until its episode ends: steps after that belong to no recording.

    Args:
        infos: entries of the environment's info, numbers for every step.
    Raises:
        ConfigError: an environment that cannot be made, or that has no such info.
    """
    controller = as_controller(controller)
    envs = make_vector_env(env_for(env, controller), len(seeds))
    observation, info = envs.reset(seed=[int(seed) for seed in seeds])  # type: ignore[arg-type]
    controller.begin(getattr(envs, "task", None), len(seeds))
    space: Any = envs.single_action_space
    observations, step_infos, steps = [observation], [_chosen(info, infos)], []
    running = np.ones(len(seeds), bool)
    while running.any():
        command = np.asarray(controller.act(observation), np.float32)
        action = np.clip(command, space.low, space.high)
        observation, reward, terminated, truncated, info = envs.step(action)
        steps.append((action, reward, terminated, truncated, running))
        observations.append(observation)
        step_infos.append(_chosen(info, infos))
        running = running & ~(terminated | truncated)
    envs.close()
    return list(_lanes(seeds, observations, step_infos, steps))


def _lanes(
    seeds: Sequence[int], observed: list[Any], step_infos: list[dict[str, Any]], steps: list[Any]
) -> Iterator[Recording]:
    """The episode of every lane, cut off where it ended."""
    actions, rewards, terminated, truncated, running = (np.stack(values, axis=1) for values in zip(*steps, strict=True))
    observations, infos = _stacked(observed), _stacked(step_infos)
    for lane, seed in enumerate(seeds):
        length = int(running[lane].sum())
        yield Recording(
            int(seed),
            _part(observations, lane, length + 1),
            actions[lane, :length],
            rewards[lane, :length],
            terminated[lane, :length],
            truncated[lane, :length],
            _part(infos, lane, length + 1),
        )


def _chosen(info: Mapping[str, Any], names: Sequence[str]) -> dict[str, Any]:
    numbers = [name for name, value in info.items() if isinstance(value, np.ndarray) and not name.startswith("_")]
    for name in names:
        if name not in numbers:
            raise ConfigError("info", name, f"one of {', '.join(sorted(numbers))}")
    return {name: info[name] for name in names}


def _stacked(steps: list[Any]) -> Any:
    """Arrays (lanes, times, ...) of arrays (lanes, ...) at every time; of dictionaries by key."""
    if isinstance(steps[0], Mapping):
        return {key: _stacked([step[key] for step in steps]) for key in steps[0]}
    return np.stack(steps, axis=1)


def _part(values: Any, lane: int, times: int) -> Any:
    if isinstance(values, Mapping):
        return {key: _part(value, lane, times) for key, value in values.items()}
    return values[lane, :times]
