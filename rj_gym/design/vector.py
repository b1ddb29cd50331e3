"""The native vector environment of the design task."""

from __future__ import annotations

from typing import ClassVar

from rj_gym.core.env import TaskEnv
from rj_gym.core.vector import TaskVectorEnv
from rj_gym.design.env import CurvatureDesignEnv


class CurvatureDesignVectorEnv(TaskVectorEnv):
    """`num_envs` independent CurvatureDesignEnv in one batch: the same task, spaces and infos.

    Lane i is seeded with `seed + i` and follows a CurvatureDesignEnv with that seed.

    Arguments as for TaskVectorEnv; `config` and `overrides` as for CurvatureDesignEnv.
    """

    metadata = TaskVectorEnv.metadata | {"render_fps": 4}
    scalar: ClassVar[type[TaskEnv]] = CurvatureDesignEnv
