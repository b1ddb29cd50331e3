"""Entries of the arm's observation; kernels.py fills them."""

from __future__ import annotations

import math

from rj_gym.arm.config import FlexibleArmConfig
from rj_gym.core.observation import Entry, error_entries, load_scale, position_entries, tendon_entries
from rollingjoint.spatial.chain import HingeChain


def arm_observation_entries(config: FlexibleArmConfig, mechanism: HingeChain, goal: bool = False) -> list[Entry]:
    """The entries of the observation vector, in order.

    Args:
        config: the settings.
        mechanism: the arm before randomisation.
        goal: entries of the Goal environment's "observation", which leaves out the target and the errors.
    """
    entries = _pose("tip", config) + tendon_entries(config, mechanism.n_tendons)
    if not goal:
        entries += _pose("target", config) + error_entries(config, "xyz")
        if config.orientation:
            unit = f"{config.reward.angle_scale_rad:g} rad"
            bound = math.pi / config.reward.angle_scale_rad
            entries += [Entry(f"angle error {axis}", unit, -bound, bound) for axis in "xyz"]
    if config.observe_load:
        entries += [Entry(f"gravity {axis}", "1", -1.0, 1.0) for axis in "xyz"]
        entries.append(Entry("payload", f"{load_scale(config):g} N", 0.0, 1.0))
    return entries


def _pose(what: str, config: FlexibleArmConfig) -> list[Entry]:
    """Position and, with orientation, the first two columns of the rotation matrix."""
    entries = position_entries(what, "xyz")
    if config.orientation:
        entries += [Entry(f"{what} R {row}{column}", "1", -1.0, 1.0) for column in "xy" for row in "xyz"]
    return entries
