"""What the agent sees of the arm: the entries of the observation vector and their bounds; kernels.py fills them."""

from __future__ import annotations

import math

from rj_gym.arm.config import FlexibleArmConfig
from rj_gym.planar.observation import ERROR_BOUND, POSITION_BOUND, Entry, tendon_entries
from rollingjoint.spatial.chain import HingeChain

_AXES = ("x", "y", "z")


def arm_observation_entries(config: FlexibleArmConfig, mechanism: HingeChain, goal: bool = False) -> list[Entry]:
    """The entries of the observation vector, in order.

    Args:
        goal: entries of the Goal environment's "observation", which leaves out the target and the tip error.
    """
    entries = _pose("tip", config)
    entries += tendon_entries(config, mechanism.n_tendons)
    if not goal:
        entries += _pose("target", config)
        unit = f"{config.reward.error_scale_mm:g} mm"
        entries += [Entry(f"tip error {axis}", unit, -ERROR_BOUND, ERROR_BOUND) for axis in _AXES]
        if config.orientation:
            unit = f"{config.reward.angle_scale_rad:g} rad"
            bound = math.pi / config.reward.angle_scale_rad
            entries += [Entry(f"angle error {axis}", unit, -bound, bound) for axis in _AXES]
    if config.observe_load:
        entries += [Entry(f"gravity {axis}", "1", -1.0, 1.0) for axis in _AXES]
        entries.append(Entry("payload", f"{payload_scale(config):g} N", 0.0, 1.0))
    return entries


def _pose(what: str, config: FlexibleArmConfig) -> list[Entry]:
    """Position and, with orientation, the first two columns of the rotation matrix."""
    entries = [Entry(f"{what} {axis}", "L", -POSITION_BOUND, POSITION_BOUND) for axis in _AXES]
    if config.orientation:
        entries += [Entry(f"{what} R {row}{column}", "1", -1.0, 1.0) for column in "xy" for row in _AXES]
    return entries


def payload_scale(config: FlexibleArmConfig) -> float:
    """Unit of the observed payload: the largest one, or 1 where there is none [N]."""
    return config.load.magnitude[1] or 1.0
