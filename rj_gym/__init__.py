"""Gymnasium environments for tendon-driven mechanisms.

`import rj_gym` registers rj_gym/RollingJoint-v0 and rj_gym/RollingJointGoal-v0 (planar rolling-contact chains),
rj_gym/Instrument-v0, rj_gym/InstrumentShift-v0, rj_gym/SlowCamera-v0 and rj_gym/LatePose-v0 (such chains with the
tip not seen, or late), rj_gym/FlexibleArm-v0 and rj_gym/FlexibleArmGoal-v0 (spatial arms), rj_gym/ArmInstrument-v0 (an
arm with the tip not seen), versions -v1 of these last five with the motors of a rig, rj_gym/PitchYaw-v0 (rolling joints
about alternating axes in space), rj_gym/Lumen-v0, rj_gym/Obstacles-v0 and rj_gym/HiddenWall-v0 (planar chains among
walls), and rj_gym/ManyMechanisms-v0 (a planar chain drawn in every episode), rj_gym/CurvatureDesign-v0 and
rj_gym/CoDesign-v0, which need torch and are imported when one is first asked for.

Modules:
    core: shared by all tasks.
    design: the design task.
    many: the tracking task with a mechanism that every episode draws.
    former_names: where pickles of earlier versions find their classes.
    registry: the table of registered environments, their settings and tasks.
    rendering: colours, lines and the window of the drawings of all tasks.
    surroundings: the tasks among walls.
    sb3: the native vector environments for Stable-Baselines3.
    torch_env: the planar tracking tasks as torch tensors on a device.
    tracking: the tracking tasks.
    vector_checker: a checker of Gymnasium vector environments.
    warmup: their kernels, for `rj warmup`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rj_gym import former_names as _former_names  # noqa: F401 (pickles name modules that are there)
from rj_gym.core.task import Entry, ObservedError
from rj_gym.registry import TABLE, late, register_envs, settings_of, task_of
from rj_gym.surroundings.config import (
    FAMILIES,
    HiddenWallConfig,
    LumenConfig,
    NoiseConfig,
    ObstaclesConfig,
    ObstaclesV1Config,
    SurroundingsConfig,
    WallRewardConfig,
)
from rj_gym.surroundings.env import HiddenWallEnv, LumenEnv, ObstaclesEnv, ObstaclesV1Env
from rj_gym.surroundings.observation import surroundings_observation_entries
from rj_gym.surroundings.vector import HiddenWallVectorEnv, LumenVectorEnv, ObstaclesV1VectorEnv, ObstaclesVectorEnv
from rj_gym.tracking.config import (
    ArmRandomizationConfig,
    ArmRewardConfig,
    ArmTargetConfig,
    FlexibleArmConfig,
    FrictionConfig,
    GravityConfig,
    LoadConfig,
    PayloadConfig,
    PitchYawConfig,
    RandomizationConfig,
    RewardConfig,
    TargetConfig,
    TaskConfig,
    TrackingConfig,
)
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
from rj_gym.tracking.observation import observation_entries
from rj_gym.tracking.observation import observation_entries as arm_observation_entries
from rj_gym.tracking.sensing import ActuationConfig, SensingConfig
from rj_gym.tracking.terms import Drawn, Memory, Observed, Start, Step, Terms
from rj_gym.tracking.vector import (
    ArmInstrumentV1VectorEnv,
    ArmInstrumentVectorEnv,
    FlexibleArmGoalVectorEnv,
    FlexibleArmVectorEnv,
    InstrumentShiftV1VectorEnv,
    InstrumentShiftVectorEnv,
    InstrumentV1VectorEnv,
    InstrumentVectorEnv,
    LatePoseV1VectorEnv,
    LatePoseVectorEnv,
    PitchYawVectorEnv,
    RollingJointGoalVectorEnv,
    RollingJointVectorEnv,
    SlowCameraV1VectorEnv,
    SlowCameraVectorEnv,
)
from rj_gym.tracking.worlds import (
    ArmInstrumentConfig,
    ArmInstrumentV1Config,
    InstrumentConfig,
    InstrumentShiftConfig,
    InstrumentShiftV1Config,
    InstrumentV1Config,
    LatePoseConfig,
    LatePoseV1Config,
    SlowCameraConfig,
    SlowCameraV1Config,
)
from rj_gym.vector_checker import check_vector_env

if TYPE_CHECKING:
    from rj_gym.design.config import CoDesignConfig, CoDesignRewardConfig, DesignConfig, DesignRewardConfig
    from rj_gym.design.env import CoDesignEnv, CurvatureDesignEnv
    from rj_gym.design.observation import design_observation_entries
    from rj_gym.design.vector import CoDesignVectorEnv, CurvatureDesignVectorEnv
    from rj_gym.many.config import (
        ManyMechanismsConfig,
        ManyMechanismsInSpaceConfig,
        MechanismsConfig,
        MechanismsInSpaceConfig,
    )
    from rj_gym.many.env import ManyMechanismsEnv, ManyMechanismsInSpaceEnv
    from rj_gym.many.vector import ManyMechanismsInSpaceVectorEnv, ManyMechanismsVectorEnv

__all__ = [
    "DESIGN_IDS",
    "FAMILIES",
    "IDS",
    "MANY_IDS",
    "SURROUNDINGS_IDS",
    "ActuationConfig",
    "ArmInstrumentConfig",
    "ArmInstrumentEnv",
    "ArmInstrumentV1Config",
    "ArmInstrumentV1Env",
    "ArmInstrumentV1VectorEnv",
    "ArmInstrumentVectorEnv",
    "ArmRandomizationConfig",
    "ArmRewardConfig",
    "ArmTargetConfig",
    "CoDesignConfig",
    "CoDesignEnv",
    "CoDesignRewardConfig",
    "CoDesignVectorEnv",
    "CurvatureDesignEnv",
    "CurvatureDesignVectorEnv",
    "DesignConfig",
    "DesignRewardConfig",
    "Drawn",
    "Entry",
    "FlexibleArmConfig",
    "FlexibleArmEnv",
    "FlexibleArmGoalEnv",
    "FlexibleArmGoalVectorEnv",
    "FlexibleArmVectorEnv",
    "FrictionConfig",
    "GravityConfig",
    "HiddenWallConfig",
    "HiddenWallEnv",
    "HiddenWallVectorEnv",
    "InstrumentConfig",
    "InstrumentEnv",
    "InstrumentShiftConfig",
    "InstrumentShiftEnv",
    "InstrumentShiftV1Config",
    "InstrumentShiftV1Env",
    "InstrumentShiftV1VectorEnv",
    "InstrumentShiftVectorEnv",
    "InstrumentV1Config",
    "InstrumentV1Env",
    "InstrumentV1VectorEnv",
    "InstrumentVectorEnv",
    "LatePoseConfig",
    "LatePoseEnv",
    "LatePoseV1Config",
    "LatePoseV1Env",
    "LatePoseV1VectorEnv",
    "LatePoseVectorEnv",
    "LoadConfig",
    "LumenConfig",
    "LumenEnv",
    "LumenVectorEnv",
    "ManyMechanismsConfig",
    "ManyMechanismsEnv",
    "ManyMechanismsInSpaceConfig",
    "ManyMechanismsInSpaceEnv",
    "ManyMechanismsInSpaceVectorEnv",
    "ManyMechanismsVectorEnv",
    "MechanismsConfig",
    "MechanismsInSpaceConfig",
    "Memory",
    "NoiseConfig",
    "Observed",
    "ObservedError",
    "ObstaclesConfig",
    "ObstaclesEnv",
    "ObstaclesV1Config",
    "ObstaclesV1Env",
    "ObstaclesV1VectorEnv",
    "ObstaclesVectorEnv",
    "PayloadConfig",
    "PitchYawConfig",
    "PitchYawEnv",
    "PitchYawVectorEnv",
    "RandomizationConfig",
    "RewardConfig",
    "RollingJointEnv",
    "RollingJointGoalEnv",
    "RollingJointGoalVectorEnv",
    "RollingJointVectorEnv",
    "SensingConfig",
    "SlowCameraConfig",
    "SlowCameraEnv",
    "SlowCameraV1Config",
    "SlowCameraV1Env",
    "SlowCameraV1VectorEnv",
    "SlowCameraVectorEnv",
    "Start",
    "Step",
    "SurroundingsConfig",
    "TargetConfig",
    "Terms",
    "TrackingConfig",
    "WallRewardConfig",
    "arm_observation_entries",
    "check_vector_env",
    "design_observation_entries",
    "observation_entries",
    "privileged_entries",
    "register_envs",
    "settings_of",
    "surroundings_observation_entries",
]

IDS = {row.env_id: row.stem for row in TABLE if row.family in ("planar", "arm")}
"""Registered ids of the tracking tasks with one mechanism and the stem of their classes.

The classes are <stem>Env, and <stem>VectorEnv for make_vec.
"""

DESIGN_IDS = {row.env_id: row.stem for row in TABLE if row.family == "design"}
"""The same for the design task."""

MANY_IDS = {row.env_id: row.stem for row in TABLE if row.family == "many"}
"""The same for tracking with many mechanisms."""

SURROUNDINGS_IDS = {row.env_id: row.stem for row in TABLE if row.family == "surroundings"}
"""The same for the tasks among walls."""


def privileged_entries(config: TaskConfig) -> list[Entry]:
    """The entries of the privileged state of a tracking task, in order, whether or not these settings show it."""
    return task_of(config).privileged_entries()


_LATE = {
    **{name: module for row in TABLE if row.family in ("design", "many") for name, module in row.classes.items()},
    "MechanismsConfig": "rj_gym.many.config",
    "MechanismsInSpaceConfig": "rj_gym.many.config",
    "DesignRewardConfig": "rj_gym.design.config",
    "CoDesignRewardConfig": "rj_gym.design.config",
    "design_observation_entries": "rj_gym.design.observation",
}


def __getattr__(name: str) -> Any:
    """The tasks of design and of many mechanisms, which need torch, imported when one is first asked for."""
    if name in _LATE:
        return late(_LATE[name], name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


register_envs()
