"""What the agent sees: the entries of the observation vector, their bounds, and the vector itself."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rj_gym.config import TrackingConfig
from rollingjoint.rolling_chain import RollingChain

Array = NDArray[np.float64]

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
    tendons = range(mechanism.n_tendons)
    unit = f"{config.command_scale_mm:g} mm"
    entries += [Entry(f"tendon {j} command", unit, -COMMAND_BOUND, COMMAND_BOUND) for j in tendons]
    if config.observe_tensions:
        entries += [Entry(f"tendon {j} tension", f"{config.tension_range[1]:g} N", 0.0, 1.0) for j in tendons]
    if not goal:
        entries += [Entry(f"target {axis}", "L", -POSITION_BOUND, POSITION_BOUND) for axis in ("x", "y")]
        unit = f"{config.reward.error_scale_mm:g} mm"
        entries += [Entry(f"tip error {axis}", unit, -ERROR_BOUND, ERROR_BOUND) for axis in ("x", "y")]
    if config.observe_load:
        unit = f"{force_scale(config):g} N"
        entries += [Entry(f"load {axis}", unit, -1.0, 1.0) for axis in ("x", "y")]
        entries += [Entry(f"load on link {link}", "1 if so, else 0", 0.0, 1.0) for link in range(1, mechanism.n_links)]
    return entries


def force_scale(config: TrackingConfig) -> float:
    """Unit of observed forces: the largest load magnitude, or 1 where there is none [N]."""
    return config.load.magnitude[1] or 1.0


def observation_vector(
    config: TrackingConfig,
    length: float,
    poses: Array,
    commands: Array,
    tensions: Array,
    targets: Array | None,
    forces: Array,
    links: NDArray[np.int64],
) -> Array:
    """Observation before clipping, (B, entries); the order is that of observation_entries.

    Args:
        length: length of the mechanism [mm].
        poses: measured poses of the moving links, (B, n - 1, 3) [mm, rad].
        commands: commanded lengths minus neutral lengths, (B, m) [mm].
        tensions: (B, m) [N].
        targets: (B, 2) [mm], or None to leave out target and tip error (Goal environment).
        forces, links: the load, (B, 2) [N] and (B,).
    """
    lanes, moving = poses.shape[:2]
    links_seen = np.empty((lanes, moving, 4))
    links_seen[..., :2] = poses[..., :2] / length
    links_seen[..., 2] = np.cos(poses[..., 2])
    links_seen[..., 3] = np.sin(poses[..., 2])
    parts = [links_seen.reshape(lanes, -1), commands / config.command_scale_mm]
    if config.observe_tensions:
        parts.append(tensions / config.tension_range[1])
    if targets is not None:
        parts += [targets / length, (targets - poses[:, -1, :2]) / config.reward.error_scale_mm]
    if config.observe_load:
        parts += [forces / force_scale(config), (links[:, None] == np.arange(1, moving + 1)).astype(float)]
    return np.concatenate(parts, axis=1)
