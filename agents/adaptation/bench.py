"""Robots on the bench: unloaded, their motors sweep to and fro, and sensors are recorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from agents.adaptation.driving import MOST_EPISODES, RUBBING, WORLD
from agents.adaptation.robot import SEED, Robot
from agents.controllers.controller import Array, Reading
from agents.runs.environment import EnvConfig, make_vector_env
from agents.runs.seeds import BENCH
from rollingjoint.checks import as_integer

CAMERA_MM = 0.2  # standard deviation of a measured tip coordinate
FIRST_STEPS = 16  # depend on the unknown place in the play where tendons began
BENDS_MM, COMMON_MM = (5.0, 8.0), (-0.5, 2.0)  # by which motors pull against each other, and together
_UNLOADED = {"load": {"link": -1, "force": (0.0, 0.0)}}
_SILENT = {"sensing": {"pose": "none", "tension_noise": 0.0}}  # the sensors of Instrument-v0 without their noise


@dataclass(frozen=True)
class BenchRecording:
    """E episodes of T steps of a robot, or of a model of it.

    Args:
        seeds: of the episodes, E. motors, tensions: measured, (E, T + 1, m) [mm, N].
        tips: (E, T + 1, 2) [mm]; None without a camera.
        running: whether the episode still went on, (E, T + 1): tendons that run out of travel end it.
    """

    seeds: Sequence[int]
    motors: Array
    tensions: Array
    tips: Array | None
    running: NDArray[np.bool_]


class Bench:
    """Unloaded episodes side by side in which motors follow given paths.

    Args:
        episodes: how many, E.
        noise: whether tensions are measured with the noise of Instrument-v0. Models have none.
    """

    def __init__(self, episodes: int, noise: bool = False) -> None:
        env = EnvConfig(WORLD, settings=RUBBING if noise else RUBBING | _SILENT)
        self.envs = cast(Any, make_vector_env(env, episodes))
        self.steps: int = self.envs.config.episode_steps
        self.n_tendons: int = self.envs.task.mechanism.n_tendons

    def follow(self, robot: Robot, seeds: Sequence[int], paths: Array, relative: bool = False) -> BenchRecording:
        """Recording of a robot while its motors go along paths (E, T, m) [mm] as fast as they can.

        relative: whether paths begin at zero, wherever motors are.
        """
        scale = self.envs.config.action_scale_mm
        observation, info = self.envs.reset(seed=list(seeds), options=robot.options | _UNLOADED)
        series = [self._measured(observation, info, np.ones(len(seeds), bool))]
        ways = paths + series[0][0][:, None] if relative else paths
        for step in range(self.steps):
            motors, _, _, running = series[-1]
            actions = np.clip((motors - ways[:, step]) / scale, -1.0, 1.0)
            observation, _, terminated, _, info = self.envs.step(np.where(running[:, None], actions, 0.0))
            series.append(self._measured(observation, info, running & ~terminated))
        return BenchRecording(seeds, *(np.stack(values, axis=1) for values in zip(*series, strict=True)))

    def _measured(self, observation: Any, info: Any, running: NDArray[np.bool_]) -> tuple[Any, ...]:
        reading = Reading(observation, self.envs.task)
        return reading.commands, reading.tensions, np.array(info["tip"], float), running

    def close(self) -> None:
        """Free the environments."""
        self.envs.close()


def record(robot: Robot, episodes: int, sees_tip: bool) -> BenchRecording:
    """Recording of episodes in which motors sweep to and fro, with seeds that no score uses.

    Args:
        robot: the robot. episodes: how many, 1 to 500. sees_tip: whether a camera measures the tip.
    Raises:
        InvalidInput: a number of episodes out of range.
    """
    as_integer("episodes on the bench", episodes, 1, MOST_EPISODES // 2)
    first = BENCH.start + MOST_EPISODES * robot.number
    rng, bench = np.random.default_rng([SEED, 1, robot.number]), Bench(episodes, noise=True)
    paths = sweeps(rng, episodes, bench.steps, bench.n_tendons)
    recording = bench.follow(robot, range(first, first + episodes), paths, relative=True)
    bench.close()
    assert recording.tips is not None
    return replace(
        recording, tips=recording.tips + CAMERA_MM * rng.standard_normal(recording.tips.shape) if sees_tip else None
    )


def sweeps(rng: np.random.Generator, episodes: int, steps: int, n_tendons: int) -> Array:
    """Paths of motors from zero, (E, T, m) [mm]: to one side and the other, by 1 mm a step, each time differently."""
    signs, paths = (-1.0) ** np.arange(n_tendons), np.empty((episodes, steps, n_tendons))
    for path in paths:
        side, ends = rng.choice([-1.0, 1.0]), [np.zeros(n_tendons)]
        while len(ends) <= steps:
            end = side * rng.uniform(*BENDS_MM) * signs - rng.uniform(*COMMON_MM)
            count = int(np.ceil(np.abs(end - ends[-1]).max()))
            ends += [ends[-1] + (end - ends[-1]) * k / count for k in range(1, count + 1)]
            side = -side
        path[:] = ends[1 : steps + 1]
    return paths
