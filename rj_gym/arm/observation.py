"""Entries of the arm's observation; measuring.py fills them."""

from __future__ import annotations

import math

from rj_gym.arm.config import FlexibleArmConfig
from rj_gym.core.observation import (
    Entry,
    error_entries,
    instrument_entries,
    load_scale,
    position_entries,
    tendon_entries,
    tendon_truth_entries,
)
from rollingjoint.chain.hinge import HingeChain

ANGLE_BOUND = 2 * math.pi


def arm_observation_entries(config: FlexibleArmConfig, mechanism: HingeChain, goal: bool = False) -> list[Entry]:
    """The entries of the observation vector, in order.

    Args:
        config: the settings.
        mechanism: the arm before randomisation.
        goal: entries of the Goal environment's "observation", which leaves out the target and the errors.
    """
    seen = config.sensing.pose != "none"
    entries = _pose("tip", config.orientation) if seen else []
    entries += tendon_entries(config, mechanism.n_tendons)
    if not goal:
        entries += _pose("target", config.orientation) + (_errors(config) if seen else [])
    if config.observe_load:
        entries += _load_entries(config)
    return entries + instrument_entries(config, mechanism.n_tendons, "xyz")


def arm_privileged_entries(config: FlexibleArmConfig, mechanism: HingeChain) -> list[Entry]:
    """The entries of the privileged state, in order: true values of what can be hidden."""
    angles = [Entry(f"hinge {i} angle", "rad", -ANGLE_BOUND, ANGLE_BOUND) for i in range(mechanism.n_joints)]
    return [
        *_pose("tip", frame=True),
        *error_entries(config, "xyz"),
        *_load_entries(config),
        *angles,
        *tendon_truth_entries(config, mechanism),
    ]


def _pose(what: str, frame: bool) -> list[Entry]:
    """Position and, with a frame, the first two columns of the rotation matrix."""
    entries = position_entries(what, "xyz")
    if frame:
        entries += [Entry(f"{what} R {row}{column}", "1", -1.0, 1.0) for column in "xy" for row in "xyz"]
    return entries


def _errors(config: FlexibleArmConfig) -> list[Entry]:
    """Errors of the tip's position and, with orientation, of its frame."""
    entries = error_entries(config, "xyz")
    if config.orientation:
        unit, bound = f"{config.reward.angle_scale_rad:g} rad", math.pi / config.reward.angle_scale_rad
        entries += [Entry(f"angle error {axis}", unit, -bound, bound) for axis in "xyz"]
    return entries


def _load_entries(config: FlexibleArmConfig) -> list[Entry]:
    """Direction of gravity and payload."""
    entries = [Entry(f"gravity {axis}", "1", -1.0, 1.0) for axis in "xyz"]
    return [*entries, Entry("payload", f"{load_scale(config):g} N", 0.0, 1.0)]
