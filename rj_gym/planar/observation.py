"""What the agent sees: the entries of the observation vector and their bounds; kernels.py fills them."""

from __future__ import annotations

from typing import NamedTuple

from rj_gym.core.config import TaskConfig, TrackingConfig
from rollingjoint.planar.chain import RollingChain

POSITION_BOUND = 2.0
COMMAND_BOUND = 2.0
ERROR_BOUND = 10.0


class Entry(NamedTuple):
    """One number of the observation: its name, its unit in words, and its bounds."""

    name: str
    unit: str
    low: float
    high: float


def observation_entries(config: TrackingConfig, mechanism: RollingChain, goal: bool = False) -> list[Entry]:
    """The entries of the observation vector, in order.

    Args:
        goal: entries of the Goal environment's "observation", which leaves out the target and the tip error.
    """
    entries: list[Entry] = []
    for link in range(1, mechanism.n_links):
        entries += [Entry(f"link {link} {axis}", "L", -POSITION_BOUND, POSITION_BOUND) for axis in ("x", "y")]
        entries += [Entry(f"link {link} {function} angle", "1", -1.0, 1.0) for function in ("cos", "sin")]
    entries += tendon_entries(config, mechanism.n_tendons)
    if not goal:
        entries += [Entry(f"target {axis}", "L", -POSITION_BOUND, POSITION_BOUND) for axis in ("x", "y")]
        unit = f"{config.reward.error_scale_mm:g} mm"
        entries += [Entry(f"tip error {axis}", unit, -ERROR_BOUND, ERROR_BOUND) for axis in ("x", "y")]
    if config.observe_load:
        unit = f"{force_scale(config):g} N"
        entries += [Entry(f"load {axis}", unit, -1.0, 1.0) for axis in ("x", "y")]
        entries += [Entry(f"load on link {link}", "1 if so, else 0", 0.0, 1.0) for link in range(1, mechanism.n_links)]
    return entries


def tendon_entries(config: TaskConfig, n_tendons: int) -> list[Entry]:
    """The entries of commands and tensions in every task."""
    unit = f"{config.command_scale_mm:g} mm"
    entries = [Entry(f"tendon {j} command", unit, -COMMAND_BOUND, COMMAND_BOUND) for j in range(n_tendons)]
    if config.observe_tensions:
        unit = f"{config.tension_range[1]:g} N"
        entries += [Entry(f"tendon {j} tension", unit, 0.0, 1.0) for j in range(n_tendons)]
    return entries


def force_scale(config: TrackingConfig) -> float:
    """Unit of observed forces: the largest load magnitude, or 1 where there is none [N]."""
    return config.load.magnitude[1] or 1.0
