"""Episodes of robots as they may be after identification: each batch of episodes has one that was drawn anew."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from agents.adaptation.driving import MOST_EPISODES, RUBBING, WORLD
from agents.adaptation.identify import Identified
from agents.adaptation.robot import Robot
from agents.controllers.controller import Array, Controller
from agents.evaluation.rollout import run_with_options
from agents.runs.environment import EnvConfig
from agents.runs.seeds import BENCH
from rj_gym.tracking.vector import InstrumentVectorEnv


class LikelyRobots(InstrumentVectorEnv):
    """InstrumentVectorEnv with the next robot of a sequence at every reset.

    Args:
        num_envs: number of lanes. robots: without end. settings: of Instrument-v0, such as observe_history.
    """

    def __init__(self, num_envs: int, robots: Iterator[Robot], settings: Mapping[str, Any]) -> None:
        super().__init__(num_envs, config={**settings, **RUBBING})
        self.robots = robots

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Observations and infos of new episodes of the next robot; arguments as of InstrumentVectorEnv."""
        return super().reset(seed=seed, options=next(self.robots).options | (options or {}))


def likely(identified: Identified, seed: int = 0) -> Iterator[Robot]:
    """Robots as they may be, without end."""
    rng = np.random.default_rng([seed, identified.number])
    while True:
        yield identified.drawn(rng)


def simulated_errors(controller: Controller, drawn: Sequence[Robot], episodes: int) -> Array:
    """Mean tip error over the last steps in `episodes` episodes of each of these robots, (R, episodes) [mm]."""
    first = BENCH.start + MOST_EPISODES * drawn[0].number + MOST_EPISODES // 2
    env, seeds = EnvConfig(WORLD, settings=RUBBING), range(first, first + episodes)
    episodes_driven = [run_with_options(env, controller, seeds, [robot.options] * episodes) for robot in drawn]
    return np.stack([driven.last_errors.mean(axis=1) for driven in episodes_driven])
