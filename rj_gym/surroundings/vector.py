"""The native vector environments of the tasks among walls."""

from __future__ import annotations

from typing import ClassVar

from rj_gym.core.env import TaskEnv
from rj_gym.core.vector import TaskVectorEnv
from rj_gym.surroundings.env import HiddenWallEnv, LumenEnv, ObstaclesEnv, ObstaclesV1Env


class LumenVectorEnv(TaskVectorEnv):
    """`num_envs` independent LumenEnv in one batch: the same task, spaces and infos.

    Lane i is seeded with `seed + i` and equals a LumenEnv with that seed to the last bit.

    Arguments as for TaskVectorEnv; `config` and `overrides` as for LumenEnv.
    """

    scalar: ClassVar[type[TaskEnv]] = LumenEnv


class ObstaclesVectorEnv(TaskVectorEnv):
    """`num_envs` independent ObstaclesEnv in one batch: the same task, spaces and infos.

    Lane i is seeded with `seed + i` and equals an ObstaclesEnv with that seed to the last bit.

    Arguments as for TaskVectorEnv; `config` and `overrides` as for ObstaclesEnv.
    """

    scalar: ClassVar[type[TaskEnv]] = ObstaclesEnv


class ObstaclesV1VectorEnv(ObstaclesVectorEnv):
    """`num_envs` independent ObstaclesV1Env in one batch; everything else as ObstaclesVectorEnv."""

    scalar: ClassVar[type[TaskEnv]] = ObstaclesV1Env


class HiddenWallVectorEnv(TaskVectorEnv):
    """`num_envs` independent HiddenWallEnv in one batch: the same task, spaces and infos.

    Lane i is seeded with `seed + i` and equals a HiddenWallEnv with that seed to the last bit.

    Arguments as for TaskVectorEnv; `config` and `overrides` as for HiddenWallEnv.
    """

    scalar: ClassVar[type[TaskEnv]] = HiddenWallEnv
