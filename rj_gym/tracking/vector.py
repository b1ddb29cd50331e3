"""The native vector environments of the tracking tasks."""

from __future__ import annotations

from typing import ClassVar

from rj_gym.core.env import TaskEnv
from rj_gym.core.vector import GoalTaskVectorEnv, TaskVectorEnv
from rj_gym.tracking.env import (
    ArmInstrumentEnv,
    ArmInstrumentV1Env,
    FlexibleArmEnv,
    FlexibleArmGoalEnv,
    InstrumentEnv,
    InstrumentShiftEnv,
    InstrumentShiftV1Env,
    InstrumentV1Env,
    LatePoseEnv,
    LatePoseV1Env,
    PitchYawEnv,
    RollingJointEnv,
    RollingJointGoalEnv,
    SlowCameraEnv,
    SlowCameraV1Env,
)


class RollingJointVectorEnv(TaskVectorEnv):
    """`num_envs` independent RollingJointEnv in one batch: the same task, spaces, infos and, for equal seeds, numbers.

    Lane i is seeded with `seed + i` and equals a RollingJointEnv with that seed step by step.

    Arguments as for TaskVectorEnv; `config` and `overrides` as for RollingJointEnv.
    """

    scalar: ClassVar[type[TaskEnv]] = RollingJointEnv


class RollingJointGoalVectorEnv(GoalTaskVectorEnv, RollingJointVectorEnv):
    """`num_envs` independent RollingJointGoalEnv in one batch; everything else as RollingJointVectorEnv."""

    scalar: ClassVar[type[TaskEnv]] = RollingJointGoalEnv


class InstrumentVectorEnv(RollingJointVectorEnv):
    """`num_envs` independent InstrumentEnv in one batch; everything else as RollingJointVectorEnv."""

    scalar: ClassVar[type[TaskEnv]] = InstrumentEnv


class InstrumentShiftVectorEnv(RollingJointVectorEnv):
    """`num_envs` independent InstrumentShiftEnv in one batch; everything else as RollingJointVectorEnv."""

    scalar: ClassVar[type[TaskEnv]] = InstrumentShiftEnv


class SlowCameraVectorEnv(RollingJointVectorEnv):
    """`num_envs` independent SlowCameraEnv in one batch; everything else as RollingJointVectorEnv."""

    scalar: ClassVar[type[TaskEnv]] = SlowCameraEnv


class LatePoseVectorEnv(RollingJointVectorEnv):
    """`num_envs` independent LatePoseEnv in one batch; everything else as RollingJointVectorEnv."""

    scalar: ClassVar[type[TaskEnv]] = LatePoseEnv


class FlexibleArmVectorEnv(TaskVectorEnv):
    """`num_envs` independent FlexibleArmEnv in one batch: the same task, spaces, infos and, for equal seeds, numbers.

    Lane i is seeded with `seed + i` and equals a FlexibleArmEnv with that seed step by step.

    Arguments as for TaskVectorEnv; `config` and `overrides` as for FlexibleArmEnv.
    """

    scalar: ClassVar[type[TaskEnv]] = FlexibleArmEnv


class FlexibleArmGoalVectorEnv(GoalTaskVectorEnv, FlexibleArmVectorEnv):
    """`num_envs` independent FlexibleArmGoalEnv in one batch; everything else as FlexibleArmVectorEnv."""

    scalar: ClassVar[type[TaskEnv]] = FlexibleArmGoalEnv


class PitchYawVectorEnv(FlexibleArmVectorEnv):
    """`num_envs` independent PitchYawEnv in one batch; everything else as FlexibleArmVectorEnv."""

    scalar: ClassVar[type[TaskEnv]] = PitchYawEnv


class ArmInstrumentVectorEnv(FlexibleArmVectorEnv):
    """`num_envs` independent ArmInstrumentEnv in one batch; everything else as FlexibleArmVectorEnv."""

    scalar: ClassVar[type[TaskEnv]] = ArmInstrumentEnv


class InstrumentV1VectorEnv(RollingJointVectorEnv):
    """`num_envs` independent InstrumentV1Env in one batch; everything else as RollingJointVectorEnv."""

    scalar: ClassVar[type[TaskEnv]] = InstrumentV1Env


class InstrumentShiftV1VectorEnv(RollingJointVectorEnv):
    """`num_envs` independent InstrumentShiftV1Env in one batch; everything else as RollingJointVectorEnv."""

    scalar: ClassVar[type[TaskEnv]] = InstrumentShiftV1Env


class SlowCameraV1VectorEnv(RollingJointVectorEnv):
    """`num_envs` independent SlowCameraV1Env in one batch; everything else as RollingJointVectorEnv."""

    scalar: ClassVar[type[TaskEnv]] = SlowCameraV1Env


class LatePoseV1VectorEnv(RollingJointVectorEnv):
    """`num_envs` independent LatePoseV1Env in one batch; everything else as RollingJointVectorEnv."""

    scalar: ClassVar[type[TaskEnv]] = LatePoseV1Env


class ArmInstrumentV1VectorEnv(FlexibleArmVectorEnv):
    """`num_envs` independent ArmInstrumentV1Env in one batch; everything else as FlexibleArmVectorEnv."""

    scalar: ClassVar[type[TaskEnv]] = ArmInstrumentV1Env
