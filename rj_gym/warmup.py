"""The environments' kernels, for `rj warmup`."""

from __future__ import annotations

import gymnasium

import rj_gym  # noqa: F401 (registers the environments)
from rj_gym.many.kernels import spread, step_sizes
from rollingjoint.compiled import machine_code
from rollingjoint.warmup import Group


def environments() -> None:
    """Take a step of planar chains; a step of arms is made of the same kernels and of the arm's solver.

    Those of many mechanisms are compiled alone, since their environment needs torch.
    """
    envs = gymnasium.make_vec("rj_gym/RollingJoint-v0", 2, "vector_entry_point")
    envs.reset(seed=0)
    envs.step(envs.action_space.sample())
    machine_code(spread, int, int, int, int, int)
    machine_code(step_sizes, int, int, int)


GROUPS = (Group("the environments", environments, after="the planar solver of batches", family="planar"),)
