"""Entries of the planar task's observation; measuring.py fills them."""

from __future__ import annotations

from rj_gym.core.observation import (
    Entry,
    error_entries,
    instrument_entries,
    load_scale,
    position_entries,
    tendon_entries,
    tendon_truth_entries,
)
from rj_gym.planar.config import TrackingConfig
from rollingjoint.chain.rolling import RollingChain

RATE_BOUND = 100.0  # mm/mm


def observation_entries(config: TrackingConfig, mechanism: RollingChain, goal: bool = False) -> list[Entry]:
    """The entries of the observation vector, in order.

    Args:
        config: the settings.
        mechanism: the mechanism before randomisation.
        goal: entries of the Goal environment's "observation", which leaves out the target and the tip error.
    """
    seen = config.sensing.pose != "none"
    entries = pictured_entries(config, mechanism) + tendon_entries(config, mechanism.n_tendons)
    if not goal:
        entries += position_entries("target", "xy") + (error_entries(config, "xy") if seen else [])
    if config.observe_load:
        entries += _load_entries(config, mechanism.n_links)
    return entries + instrument_entries(config, mechanism.n_tendons, "xy")


def first_seen(config: TrackingConfig, mechanism: RollingChain) -> int:
    """How many of the moving links, the first ones, are not observed."""
    return {"all": 0, "tip": mechanism.n_links - 2, "none": mechanism.n_links - 1}[config.sensing.pose]


def pictured_entries(config: TrackingConfig, mechanism: RollingChain) -> list[Entry]:
    """The entries of the observed links' poses, in order."""
    return _pose_entries(range(1 + first_seen(config, mechanism), mechanism.n_links))


def planar_privileged_entries(config: TrackingConfig, mechanism: RollingChain) -> list[Entry]:
    """The entries of the privileged state, in order: true values of what can be hidden."""
    n, tendons = mechanism.n_links, range(mechanism.n_tendons)
    return [
        *_pose_entries(range(1, n)),
        *error_entries(config, "xy"),
        *_load_entries(config, n),
        *tendon_truth_entries(config, mechanism),
        *(Entry(f"tip {axis} by tendon {j}", "mm/mm", -RATE_BOUND, RATE_BOUND) for axis in "xy" for j in tendons),
    ]


def _pose_entries(links: range) -> list[Entry]:
    entries: list[Entry] = []
    for link in links:
        entries += position_entries(f"link {link}", "xy")
        entries += [Entry(f"link {link} {function} angle", "1", -1.0, 1.0) for function in ("cos", "sin")]
    return entries


def _load_entries(config: TrackingConfig, n_links: int) -> list[Entry]:
    forces = [Entry(f"load {axis}", f"{load_scale(config):g} N", -1.0, 1.0) for axis in "xy"]
    return forces + [Entry(f"load on link {link}", "1 if so, else 0", 0.0, 1.0) for link in range(1, n_links)]
