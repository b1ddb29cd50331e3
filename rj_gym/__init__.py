"""Gymnasium environments for tendon-driven rolling-contact mechanisms.

`import rj_gym` registers rj_gym/RollingJoint-v0 and rj_gym/RollingJointGoal-v0.
"""

import gymnasium

from rj_gym.config import LoadConfig, RandomizationConfig, RewardConfig, TargetConfig, TrackingConfig
from rj_gym.tracking.env import RollingJointEnv, RollingJointGoalEnv
from rj_gym.tracking.observation import observation_entries
from rj_gym.tracking.vector import RollingJointGoalVectorEnv, RollingJointVectorEnv
from rj_gym.vector_checker import check_vector_env

__all__ = [
    "IDS",
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
    "observation_entries",
    "register_envs",
]

IDS = {
    "rj_gym/RollingJoint-v0": "RollingJoint",
    "rj_gym/RollingJointGoal-v0": "RollingJointGoal",
}
"""Registered ids and the stem of their classes: <stem>Env, and <stem>VectorEnv for gymnasium.make_vec."""


def register_envs() -> None:
    """Register every id that is not registered yet."""
    for env_id, stem in IDS.items():
        if env_id not in gymnasium.registry:
            gymnasium.register(
                env_id,
                entry_point=f"rj_gym.tracking.env:{stem}Env",
                vector_entry_point=f"rj_gym.tracking.vector:{stem}VectorEnv",
                disable_env_checker=True,  # the environments check their input themselves, and the order of calls
                order_enforce=False,
            )


register_envs()
