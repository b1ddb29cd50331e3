"""Gymnasium environments for tendon-driven mechanisms.

`import rj_gym` registers rj_gym/RollingJoint-v0 and rj_gym/RollingJointGoal-v0 (planar rolling-contact chains),
rj_gym/FlexibleArm-v0 and rj_gym/FlexibleArmGoal-v0 (spatial arms), and rj_gym/CurvatureDesign-v0. The last one needs
torch; it and the arms are imported when one is first asked for.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import gymnasium

from rj_gym.core.config import LoadConfig, RandomizationConfig, RewardConfig, TargetConfig, TrackingConfig
from rj_gym.core.env import RollingJointEnv, RollingJointGoalEnv
from rj_gym.core.settings import Settings
from rj_gym.core.vector import RollingJointGoalVectorEnv, RollingJointVectorEnv
from rj_gym.planar.observation import observation_entries
from rj_gym.vector_checker import check_vector_env
from rollingjoint.errors import ConfigError

if TYPE_CHECKING:
    from rj_gym.arm.config import (
        ArmRandomizationConfig,
        ArmRewardConfig,
        ArmTargetConfig,
        FlexibleArmConfig,
        GravityConfig,
        PayloadConfig,
    )
    from rj_gym.arm.env import FlexibleArmEnv, FlexibleArmGoalEnv
    from rj_gym.arm.observation import arm_observation_entries
    from rj_gym.arm.vector import FlexibleArmGoalVectorEnv, FlexibleArmVectorEnv
    from rj_gym.design.config import DesignConfig, DesignRewardConfig
    from rj_gym.design.env import CurvatureDesignEnv
    from rj_gym.design.observation import design_observation_entries
    from rj_gym.design.vector import CurvatureDesignVectorEnv

__all__ = [
    "DESIGN_IDS",
    "IDS",
    "ArmRandomizationConfig",
    "ArmRewardConfig",
    "ArmTargetConfig",
    "CurvatureDesignEnv",
    "CurvatureDesignVectorEnv",
    "DesignConfig",
    "DesignRewardConfig",
    "FlexibleArmConfig",
    "FlexibleArmEnv",
    "FlexibleArmGoalEnv",
    "FlexibleArmGoalVectorEnv",
    "FlexibleArmVectorEnv",
    "GravityConfig",
    "LoadConfig",
    "PayloadConfig",
    "RandomizationConfig",
    "RewardConfig",
    "RollingJointEnv",
    "RollingJointGoalEnv",
    "RollingJointGoalVectorEnv",
    "RollingJointVectorEnv",
    "TargetConfig",
    "TrackingConfig",
    "arm_observation_entries",
    "check_vector_env",
    "design_observation_entries",
    "observation_entries",
    "register_envs",
    "settings_of",
]

IDS = {
    "rj_gym/RollingJoint-v0": "RollingJoint",
    "rj_gym/RollingJointGoal-v0": "RollingJointGoal",
    "rj_gym/FlexibleArm-v0": "FlexibleArm",
    "rj_gym/FlexibleArmGoal-v0": "FlexibleArmGoal",
}
"""Registered ids of the tracking tasks and the stem of their classes: <stem>Env, and <stem>VectorEnv for make_vec."""

DESIGN_IDS = {"rj_gym/CurvatureDesign-v0": "CurvatureDesign"}
"""The same for the design task."""

_FOLDERS = {"RollingJoint": "core", "FlexibleArm": "arm", "CurvatureDesign": "design"}

_ARM_SETTINGS = (
    "ArmRandomizationConfig",
    "ArmRewardConfig",
    "ArmTargetConfig",
    "FlexibleArmConfig",
    "GravityConfig",
    "PayloadConfig",
)
_LATE = {
    "CurvatureDesignEnv": "design.env",
    "CurvatureDesignVectorEnv": "design.vector",
    "DesignConfig": "design.config",
    "DesignRewardConfig": "design.config",
    "design_observation_entries": "design.observation",
    "FlexibleArmEnv": "arm.env",
    "FlexibleArmGoalEnv": "arm.env",
    "FlexibleArmGoalVectorEnv": "arm.vector",
    "FlexibleArmVectorEnv": "arm.vector",
    "arm_observation_entries": "arm.observation",
    **dict.fromkeys(_ARM_SETTINGS, "arm.config"),
}


def __getattr__(name: str) -> Any:
    """What not every program needs, imported when it is first asked for; the design task needs torch."""
    if name in _LATE:
        return getattr(importlib.import_module(f"rj_gym.{_LATE[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def settings_of(env_id: str) -> type[Settings]:
    """The class of the settings of a registered id; raises ConfigError for another id."""
    if env_id in DESIGN_IDS:
        from rj_gym.design.config import DesignConfig

        return DesignConfig
    if env_id not in IDS:
        raise ConfigError("environment", env_id, f"one of {', '.join([*IDS, *DESIGN_IDS])}")
    if IDS[env_id].startswith("FlexibleArm"):
        from rj_gym.arm.config import FlexibleArmConfig

        return FlexibleArmConfig
    return TrackingConfig


def register_envs() -> None:
    """Register every id that is not registered yet."""
    for env_id, stem in (IDS | DESIGN_IDS).items():
        if env_id not in gymnasium.registry:
            folder = _FOLDERS[stem.removesuffix("Goal")]
            gymnasium.register(
                env_id,
                entry_point=f"rj_gym.{folder}.env:{stem}Env",
                vector_entry_point=f"rj_gym.{folder}.vector:{stem}VectorEnv",
                disable_env_checker=True,  # the environments check their input themselves, and the order of calls
                order_enforce=False,
            )


register_envs()
