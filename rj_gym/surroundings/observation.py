"""Entries of the observations of tasks among walls, and their values."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.task import POSITION_BOUND, Entry
from rj_gym.surroundings.config import HiddenWallConfig, LumenConfig, ObstaclesConfig, SurroundingsConfig
from rj_gym.surroundings.drawing import AHEAD
from rj_gym.surroundings.scenes import Scenes, along, places
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.io.mechanism_file import load_mechanism

Array = NDArray[np.float64]

COMMAND_MM, FORCE_N, WALL_FORCE_N = 10.0, 5.0, 1.0  # units of commands, of the insertion force, of the force of walls
_BOUND = 4.0  # of commands and forces, in their units


def surroundings_observation_entries(config: SurroundingsConfig) -> list[Entry]:
    """The entries of the observation, in order. L is the length of the mechanism; places are relative to the base."""
    mechanism = config.mechanism
    chain = load_mechanism(mechanism, RollingChain) if isinstance(mechanism, str) else mechanism
    tension, entries = f"{config.tension_range[1]:g} N", []
    for k in observed_links(config, chain):
        entries += [Entry(f"link {k} {axis}", "L", -POSITION_BOUND, POSITION_BOUND) for axis in "xy"]
        entries += [Entry(f"link {k} {what} angle", "1", -1.0, 1.0) for what in ("cos", "sin")]
    tendons = range(chain.n_tendons)
    entries += [Entry(f"tendon {j} command", f"{COMMAND_MM:g} mm", -_BOUND, _BOUND) for j in tendons]
    entries += [Entry(f"tendon {j} tension", tension, 0.0, 1.0) for j in tendons]
    if isinstance(config, LumenConfig):
        entries.append(Entry("feed", f"{config.feed_range[1]:g} mm", 0.0, 1.0))
        entries.append(Entry("insertion force", f"{FORCE_N:g} N", -_BOUND, _BOUND))
    entries += [Entry(f"target {axis}", "L", -POSITION_BOUND, POSITION_BOUND) for axis in "xy"]
    if config.poses != "none":
        names = ("error x", "error y", "error along the tip", "error across the tip")
        entries += [Entry(name, "L", -POSITION_BOUND, POSITION_BOUND) for name in names]
    if isinstance(config, LumenConfig) and config.walls == "ahead":
        for ahead in AHEAD:
            ways = (f"centre {ahead:g} mm ahead, {way} the tip" for way in ("along", "across"))
            entries += [Entry(name, "L", -POSITION_BOUND, POSITION_BOUND) for name in ways]
    if isinstance(config, ObstaclesConfig):
        for i in range(config.discs):
            parts = [f"disc {i} {what}" for what in ("x", "y", "radius")]
            parts += [f"disc {i} {axis} from the tip" for axis in "xy"] if config.poses != "none" else []
            entries += [Entry(name, "L", -POSITION_BOUND, POSITION_BOUND) for name in parts]
    if isinstance(config, HiddenWallConfig) and config.observe_force:
        entries.append(Entry("wall force", f"{WALL_FORCE_N:g} N", 0.0, _BOUND))
    return entries


def noisy_entries(config: SurroundingsConfig) -> int:
    """Number of random numbers of an observation: places and angles of links, tensions, the force on the base."""
    noise = config.noise
    if not (noise.position_mm or noise.angle or noise.tension or noise.force):
        return 0
    mechanism = config.mechanism
    chain = load_mechanism(mechanism, RollingChain) if isinstance(mechanism, str) else mechanism
    return 3 * chain.n_links + chain.n_tendons + 1


def observation_values(
    config: SurroundingsConfig, chain: RollingChain, read: Callable[[str], Array], scenes: Scenes
) -> Array:
    """The values of the entries in B lanes, (B, entries); `read` gives a part of their readings by name."""
    length, links = float(chain.length), observed_links(config, chain)
    poses, tensions, push, feed = read("poses").copy(), read("tensions"), read("insertion_force"), read("feed")
    poses[..., 1] -= feed[:, None]
    if scenes.noise.size:
        lanes, n, noise = np.arange(len(feed)), chain.n_links, config.noise
        steps = np.minimum(read("step"), scenes.noise.shape[1] - 1)  # lanes that have ended take one more
        errors = scenes.noise[lanes, steps.astype(np.int64)]
        scale = noise.position_mm, noise.position_mm, noise.angle
        poses = poses + scale * errors[:, : 3 * n].reshape(-1, n, 3)
        tensions = tensions + noise.tension * errors[:, 3 * n : -1]
        push = push + noise.force * errors[:, -1]
    cos, sin = np.cos(poses[..., 2]), np.sin(poses[..., 2])
    seen = np.stack([poses[..., 0] / length, poses[..., 1] / length, cos, sin], -1)[:, links]
    target = scenes.target - np.stack([np.zeros_like(feed), feed], -1)
    parts = [seen, (read("commands") - chain.neutral_lengths) / COMMAND_MM, tensions / config.tension_range[1]]
    if isinstance(config, LumenConfig):
        parts += [(feed / config.feed_range[1])[:, None], (push / FORCE_N)[:, None]]
    parts.append(target / length)
    tip, turn = poses[:, -1, :2], (cos[:, -1], sin[:, -1])
    if config.poses != "none":
        parts += [(target - tip) / length, _in_the_tip(target - tip, turn) / length]
    if isinstance(config, LumenConfig) and config.walls == "ahead":
        at = read("tip")[:, :2]
        arcs, _ = along(scenes.line, at)
        points = places(scenes.line, arcs[:, None] + AHEAD)
        parts.append(_in_the_tip(points - at[:, None], (turn[0][:, None], turn[1][:, None])) / length)
    if isinstance(config, ObstaclesConfig):
        discs = scenes.walls.discs[..., :3] / length
        near = discs[..., :2] - tip[:, None] / length
        parts.append(discs if config.poses == "none" else np.concatenate([discs, near], -1))
    if isinstance(config, HiddenWallConfig) and config.observe_force:
        parts.append(read("wall_force")[:, None] / WALL_FORCE_N)
    return np.concatenate([part.reshape(len(feed), -1) for part in parts], axis=1)


def observed_links(config: SurroundingsConfig, chain: RollingChain) -> list[int]:
    """The links with an observed pose."""
    return {"all": list(range(1, chain.n_links)), "tip": [chain.n_links - 1], "none": []}[config.poses]


def _in_the_tip(vectors: Array, turn: tuple[Array, Array]) -> Array:
    """Vectors (B, ..., 2) along and across the last link, whose y axis is along it; turn: cos and sin of its angle."""
    cos, sin = turn
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([cos * y - sin * x, cos * x + sin * y], -1)
