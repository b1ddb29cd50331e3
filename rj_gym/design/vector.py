"""The native vector environments of the design tasks."""

from __future__ import annotations

from typing import ClassVar

from rj_gym.core.env import TaskEnv
from rj_gym.core.vector import TaskVectorEnv
from rj_gym.design.env import CoDesignEnv, CurvatureDesignEnv


class CurvatureDesignVectorEnv(TaskVectorEnv):
    """`num_envs` independent CurvatureDesignEnv in one batch: the same task, spaces and infos.

    Lane i is seeded with `seed + i` and follows a CurvatureDesignEnv with that seed.

    Arguments as for TaskVectorEnv; `config` and `overrides` as for CurvatureDesignEnv.
    """

    metadata = TaskVectorEnv.metadata | {"render_fps": 4}
    scalar: ClassVar[type[TaskEnv]] = CurvatureDesignEnv


class CoDesignVectorEnv(TaskVectorEnv):
    """`num_envs` independent CoDesignEnv in one batch, each with its own mechanism: the same task, spaces and infos.

    Lane i is seeded with `seed + i` and follows a CoDesignEnv with that seed.

    Arguments as for TaskVectorEnv; `config` and `overrides` as for CoDesignEnv.
    """

    metadata = TaskVectorEnv.metadata | {"render_fps": 4}
    scalar: ClassVar[type[TaskEnv]] = CoDesignEnv
