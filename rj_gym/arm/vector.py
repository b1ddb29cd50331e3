"""The native vector environments of the arm."""

from __future__ import annotations

from typing import ClassVar

from rj_gym.arm.config import FlexibleArmConfig
from rj_gym.core.config import TaskConfig
from rj_gym.core.vector import GoalVectorSteps, TrackingVectorEnv


class FlexibleArmVectorEnv(TrackingVectorEnv):
    """`num_envs` independent FlexibleArmEnv in one batch: the same task, spaces, infos and, for equal seeds, numbers.

    Lane i is seeded with `seed + i` and equals a FlexibleArmEnv with that seed step by step.

    Arguments as for TrackingVectorEnv; `config` and `overrides` as for FlexibleArmEnv.
    """

    settings: ClassVar[type[TaskConfig]] = FlexibleArmConfig


class FlexibleArmGoalVectorEnv(GoalVectorSteps, FlexibleArmVectorEnv):
    """`num_envs` independent FlexibleArmGoalEnv in one batch; everything else as FlexibleArmVectorEnv."""
