"""Episodes on robots outside the training distribution, and the score of a controller."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from agents.adaptation.robot import Robot, robots
from agents.controllers.controller import Array, Controller, env_for
from agents.evaluation.rollout import run_episodes, run_with_options
from agents.results.statistics import Bootstrap, Interval
from agents.runs.environment import EnvConfig
from agents.runs.seeds import ROBOTS
from rj_gym.tracking.worlds import InstrumentConfig, InstrumentV1Config
from rollingjoint.checks import as_integer

WORLD = "rj_gym/Instrument-v0"
MOST_EPISODES = 1_000  # of a robot
_LANES = 256
RUBBING = {"friction": {"mu": 0.0, "shared": False}}  # controllers read from it that there is no friction


@dataclass(frozen=True)
class RobotScore:
    """How one controller did on R robots in E episodes each.

    Args:
        errors: tip error over the last 10 steps, (R, E) [mm].
        known: the same in episodes of Instrument-v0 itself with the same seeds, (R, E) [mm]; None: not driven.
    """

    errors: Array
    known: Array | None = None

    @property
    def of_robots(self) -> Array:
        """Mean error of every robot, (R,) [mm]."""
        return self.errors.mean(axis=1)

    @property
    def mean(self) -> Interval:
        """The score: the mean over robots with its 95 % interval, from a bootstrap of robots [mm]."""
        return _over_robots(self.errors)

    @property
    def known_mean(self) -> Interval | None:
        """The same of the episodes of Instrument-v0 itself."""
        return None if self.known is None else _over_robots(self.known)


def score_on_robots(
    controller: Controller,
    driven: Sequence[Robot] | None = None,
    episodes: int = 4,
    settings: Mapping[str, Any] | None = None,
    known: bool = False,
) -> RobotScore:
    """Drive every robot through its episodes, many side by side, with targets and loads of Instrument-v0.

    The controller is told that it drives rj_gym/Instrument-v0: the nominal mechanism, and the ranges of that world; of
    robots with limits of their own, the settings of rj_gym/Instrument-v1.

    Args:
        controller: whatever drives Instrument-v0.
        driven: the robots; None: all of the test bed. episodes: of every robot, 1 to 1,000.
        settings: of the environment, such as observe_history. known: whether Instrument-v0 itself is driven as well.
    Raises:
        InvalidInput, ConfigError: a number of episodes out of range, settings that do not exist.
    """
    listed = robots() if driven is None else driven
    as_integer("episodes", episodes, 1, MOST_EPISODES)
    rig = {} if listed[0].tension_limits is None else rig_settings()
    env = env_for(EnvConfig(WORLD, settings=rig | dict(settings or {})), controller)
    rubbing = EnvConfig(WORLD, settings={**env.settings, **RUBBING})
    at_once = max(1, _LANES // episodes)
    blocks = [listed[first : first + at_once] for first in range(0, len(listed), at_once)]
    errors = np.concatenate([_errors(rubbing, controller, block, episodes) for block in blocks])
    if not known:
        return RobotScore(errors)
    seeds = [seed for robot in listed for seed in seeds_of(robot, episodes)]
    return RobotScore(errors, run_episodes(env, controller, seeds).last_errors.mean(axis=1).reshape(errors.shape))


def rig_settings() -> dict[str, Any]:
    """Settings that make Instrument-v0 the world of Instrument-v1, whose policies of version 0 are not refused."""
    first, rig = InstrumentConfig(), InstrumentV1Config()
    changes: dict[str, Any] = {"start": rig.start}
    for section in ("sensing", "actuation"):
        before, after = (asdict(getattr(config, section)) for config in (first, rig))
        changes[section] = {name: value for name, value in after.items() if value != before[name]}
    return changes


def seeds_of(robot: Robot, episodes: int) -> range:
    """Seeds of a robot's episodes: their targets, loads and noise, and where in the play its tendons begin."""
    first = ROBOTS.start + MOST_EPISODES * robot.number
    return range(first, first + episodes)


def _errors(env: EnvConfig, controller: Controller, driven: Sequence[Robot], episodes: int) -> Array:
    """Errors of these robots, all side by side, (R, episodes) [mm]."""
    seeds = [seed for robot in driven for seed in seeds_of(robot, episodes)]
    options = [options for robot in driven for options in [robot.options] * episodes]
    episodes_driven = run_with_options(env, controller, seeds, options)
    return episodes_driven.last_errors.mean(axis=1).reshape(len(driven), episodes)


def _over_robots(errors: Array) -> Interval:
    return Bootstrap(len(errors)).mean(errors.mean(axis=1))
