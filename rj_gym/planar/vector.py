"""The native vector environments of the planar tracking task."""

from __future__ import annotations

from typing import ClassVar

from rj_gym.core.episodes import EpisodeBuffer
from rj_gym.core.settings import Settings
from rj_gym.core.vector import GoalTaskVectorEnv, TaskVectorEnv
from rj_gym.planar.config import TrackingConfig
from rj_gym.planar.episodes import PlanarEpisodeBuffer
from rj_gym.planar.worlds import InstrumentConfig, InstrumentShiftConfig, LatePoseConfig, SlowCameraConfig


class RollingJointVectorEnv(TaskVectorEnv):
    """`num_envs` independent RollingJointEnv in one batch: the same task, spaces, infos and, for equal seeds, numbers.

    Lane i is seeded with `seed + i` and equals a RollingJointEnv with that seed step by step.

    Arguments as for TaskVectorEnv; `config` and `overrides` as for RollingJointEnv.
    """

    settings: ClassVar[type[Settings]] = TrackingConfig
    buffer: ClassVar[type[EpisodeBuffer]] = PlanarEpisodeBuffer


class RollingJointGoalVectorEnv(GoalTaskVectorEnv, RollingJointVectorEnv):
    """`num_envs` independent RollingJointGoalEnv in one batch; everything else as RollingJointVectorEnv."""


class InstrumentVectorEnv(RollingJointVectorEnv):
    """`num_envs` independent InstrumentEnv in one batch; everything else as RollingJointVectorEnv."""

    settings: ClassVar[type[Settings]] = InstrumentConfig


class InstrumentShiftVectorEnv(RollingJointVectorEnv):
    """`num_envs` independent InstrumentShiftEnv in one batch; everything else as RollingJointVectorEnv."""

    settings: ClassVar[type[Settings]] = InstrumentShiftConfig


class SlowCameraVectorEnv(RollingJointVectorEnv):
    """`num_envs` independent SlowCameraEnv in one batch; everything else as RollingJointVectorEnv."""

    settings: ClassVar[type[Settings]] = SlowCameraConfig


class LatePoseVectorEnv(RollingJointVectorEnv):
    """`num_envs` independent LatePoseEnv in one batch; everything else as RollingJointVectorEnv."""

    settings: ClassVar[type[Settings]] = LatePoseConfig
