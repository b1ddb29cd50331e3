"""Gymnasium environments for tendon-driven rolling-contact mechanisms.

`import rj_gym` registers rj_gym/RollingJoint-v0, rj_gym/RollingJointGoal-v0 and rj_gym/CurvatureDesign-v0. The last one
needs torch, which is imported when it is first made.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import gymnasium

from rj_gym.config import LoadConfig, RandomizationConfig, RewardConfig, TargetConfig, TrackingConfig
from rj_gym.settings import Settings
from rj_gym.tracking.env import RollingJointEnv, RollingJointGoalEnv
from rj_gym.tracking.observation import observation_entries
from rj_gym.tracking.vector import RollingJointGoalVectorEnv, RollingJointVectorEnv
from rj_gym.vector_checker import check_vector_env
from rollingjoint.errors import ConfigError

if TYPE_CHECKING:
    from rj_gym.design.config import DesignConfig, DesignRewardConfig
    from rj_gym.design.env import CurvatureDesignEnv
    from rj_gym.design.observation import design_observation_entries
    from rj_gym.design.vector import CurvatureDesignVectorEnv

__all__ = [
    "DESIGN_IDS",
    "IDS",
    "CurvatureDesignEnv",
    "CurvatureDesignVectorEnv",
    "DesignConfig",
    "DesignRewardConfig",
    "LoadConfig",
    "RandomizationConfig",
    "RewardConfig",
    "RollingJointEnv",
    "RollingJointGoalEnv",
    "RollingJointGoalVectorEnv",
    "RollingJointVectorEnv",
    "TargetConfig",
    "TrackingConfig",
    "check_vector_env",
    "design_observation_entries",
    "observation_entries",
    "register_envs",
    "settings_of",
]

IDS = {
    "rj_gym/RollingJoint-v0": "RollingJoint",
    "rj_gym/RollingJointGoal-v0": "RollingJointGoal",
}
"""Registered ids of the tracking task and the stem of their classes: <stem>Env, and <stem>VectorEnv for make_vec."""

DESIGN_IDS = {"rj_gym/CurvatureDesign-v0": "CurvatureDesign"}
"""The same for the design task."""

_LATE = {
    "CurvatureDesignEnv": "env",
    "CurvatureDesignVectorEnv": "vector",
    "DesignConfig": "config",
    "DesignRewardConfig": "config",
    "design_observation_entries": "observation",
}


def __getattr__(name: str) -> Any:
    """What needs torch, imported when it is first asked for."""
    if name in _LATE:
        return getattr(importlib.import_module(f"rj_gym.design.{_LATE[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def settings_of(env_id: str) -> type[Settings]:
    """The class of the settings of a registered id; raises ConfigError for another id."""
    if env_id in DESIGN_IDS:
        from rj_gym.design.config import DesignConfig

        return DesignConfig
    if env_id not in IDS:
        raise ConfigError("environment", env_id, f"one of {', '.join([*IDS, *DESIGN_IDS])}")
    return TrackingConfig


def register_envs() -> None:
    """Register every id that is not registered yet."""
    for task, ids in (("tracking", IDS), ("design", DESIGN_IDS)):
        for env_id, stem in ids.items():
            if env_id not in gymnasium.registry:
                gymnasium.register(
                    env_id,
                    entry_point=f"rj_gym.{task}.env:{stem}Env",
                    vector_entry_point=f"rj_gym.{task}.vector:{stem}VectorEnv",
                    disable_env_checker=True,  # the environments check their input themselves, and the order of calls
                    order_enforce=False,
                )


register_envs()
