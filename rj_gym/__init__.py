"""Gymnasium environments for tendon-driven rolling-contact mechanisms.

`import rj_gym` registers rj_gym/RollingJoint-v0 and rj_gym/RollingJointGoal-v0.
"""

import gymnasium

from rj_gym.config import LoadConfig, RandomizationConfig, RewardConfig, TargetConfig, TrackingConfig
from rj_gym.tracking.env import RollingJointEnv, RollingJointGoalEnv
from rj_gym.tracking.observation import observation_entries

__all__ = [
    "IDS",
    "LoadConfig",
    "RandomizationConfig",
    "RewardConfig",
    "RollingJointEnv",
    "RollingJointGoalEnv",
    "TargetConfig",
    "TrackingConfig",
    "observation_entries",
    "register_envs",
]

IDS = {
    "rj_gym/RollingJoint-v0": "rj_gym.tracking.env:RollingJointEnv",
    "rj_gym/RollingJointGoal-v0": "rj_gym.tracking.env:RollingJointGoalEnv",
}
"""Registered ids and their classes."""


def register_envs() -> None:
    """Register every id that is not registered yet."""
    for env_id, entry_point in IDS.items():
        if env_id not in gymnasium.registry:
            gymnasium.register(env_id, entry_point)


register_envs()
