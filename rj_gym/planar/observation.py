"""Entries of the planar task's observation; kernels.py fills them."""

from __future__ import annotations

from rj_gym.core.observation import Entry, error_entries, load_scale, position_entries, tendon_entries
from rj_gym.planar.config import TrackingConfig
from rollingjoint.planar.chain import RollingChain


def observation_entries(config: TrackingConfig, mechanism: RollingChain, goal: bool = False) -> list[Entry]:
    """The entries of the observation vector, in order.

    Args:
        config: the settings.
        mechanism: the mechanism before randomisation.
        goal: entries of the Goal environment's "observation", which leaves out the target and the tip error.
    """
    entries: list[Entry] = []
    for link in range(1, mechanism.n_links):
        entries += position_entries(f"link {link}", "xy")
        entries += [Entry(f"link {link} {function} angle", "1", -1.0, 1.0) for function in ("cos", "sin")]
    entries += tendon_entries(config, mechanism.n_tendons)
    if not goal:
        entries += position_entries("target", "xy") + error_entries(config, "xy")
    if config.observe_load:
        entries += [Entry(f"load {axis}", f"{load_scale(config):g} N", -1.0, 1.0) for axis in "xy"]
        entries += [Entry(f"load on link {link}", "1 if so, else 0", 0.0, 1.0) for link in range(1, mechanism.n_links)]
    return entries
