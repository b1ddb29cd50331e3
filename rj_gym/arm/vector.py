"""The native vector environments of the arm's tracking task."""

from __future__ import annotations

from typing import ClassVar

from rj_gym.arm.config import FlexibleArmConfig
from rj_gym.arm.episodes import ArmEpisodeBuffer
from rj_gym.arm.worlds import ArmInstrumentConfig
from rj_gym.core.episodes import EpisodeBuffer
from rj_gym.core.settings import Settings
from rj_gym.core.vector import GoalTaskVectorEnv, TaskVectorEnv


class FlexibleArmVectorEnv(TaskVectorEnv):
    """`num_envs` independent FlexibleArmEnv in one batch: the same task, spaces, infos and, for equal seeds, numbers.

    Lane i is seeded with `seed + i` and equals a FlexibleArmEnv with that seed step by step.

    Arguments as for TaskVectorEnv; `config` and `overrides` as for FlexibleArmEnv.
    """

    settings: ClassVar[type[Settings]] = FlexibleArmConfig
    buffer: ClassVar[type[EpisodeBuffer]] = ArmEpisodeBuffer


class FlexibleArmGoalVectorEnv(GoalTaskVectorEnv, FlexibleArmVectorEnv):
    """`num_envs` independent FlexibleArmGoalEnv in one batch; everything else as FlexibleArmVectorEnv."""


class ArmInstrumentVectorEnv(FlexibleArmVectorEnv):
    """`num_envs` independent ArmInstrumentEnv in one batch; everything else as FlexibleArmVectorEnv."""

    settings: ClassVar[type[Settings]] = ArmInstrumentConfig
