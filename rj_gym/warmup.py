"""The environments' kernels, for `rj warmup`."""

from __future__ import annotations

import gymnasium

import rj_gym  # noqa: F401 (registers the environments)
from rollingjoint.warmup import Group


def planar_environments() -> None:
    """Take a step of planar chains."""
    _step("rj_gym/RollingJoint-v0")


def arm_environments() -> None:
    """Take a step of arms."""
    _step("rj_gym/FlexibleArm-v0")


def _step(env_id: str) -> None:
    envs = gymnasium.make_vec(env_id, 2, "vector_entry_point")
    envs.reset(seed=0)
    envs.step(envs.action_space.sample())


GROUPS = (
    Group("the planar environments", planar_environments, after="the planar solver of batches", family="planar"),
    Group("the arm's environments", arm_environments, after="the arm's solver", family="arm"),
)
