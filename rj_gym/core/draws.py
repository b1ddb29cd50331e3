"""Uniform numbers of episodes, one row each, and what every tracking task makes of them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.config import TaskConfig
from rj_gym.core.generators import Generators

Array = NDArray[np.float64]
_E = TypeVar("_E")


class Block(NamedTuple):
    """Where one quantity's uniform numbers stand in the row of an episode, and their shape."""

    start: int
    stop: int
    shape: tuple[int, ...]


class Uniforms:
    """Uniform numbers in [0, 1): one row per episode, the blocks of it by name, (B, *shape) each, to be read only.

    Args:
        blocks: from uniform_blocks.
        rngs: one generator per episode; each is asked once.
    """

    def __init__(self, blocks: dict[str, Block], rngs: Sequence[np.random.Generator] | Generators) -> None:
        self._blocks = blocks
        self._rows: Array = np.empty((len(rngs), next(reversed(blocks.values())).stop))
        if isinstance(rngs, Generators):
            rngs.fill(self._rows)
        else:
            for rng, row in zip(rngs, self._rows, strict=True):
                rng.random(out=row)

    def __getitem__(self, name: str) -> Array:
        start, stop, shape = self._blocks[name]
        return self._rows[:, start:stop].reshape(-1, *shape)

    def __len__(self) -> int:
        return len(self._rows)


def blocks_of(shapes: Mapping[str, tuple[int, ...]]) -> dict[str, Block]:
    """Blocks of these shapes, one after the other."""
    stops = list(itertools.accumulate(map(math.prod, shapes.values())))
    return dict(zip(shapes, map(Block, [0, *stops], stops, shapes.values()), strict=False))


def target_shape(config: TaskConfig, n_tendons: int) -> tuple[int, int]:
    """Shape of the uniform numbers from which targets come, (waypoints, m)."""
    return config.target.waypoints if config.target.process == "path" else 1, n_tendons


def hold(drawn: _E, fixed: Any, names: Sequence[str]) -> _E:
    """Episodes with what is fixed among these fields, the same in every lane."""
    held = {name: value for name in names if (value := getattr(fixed, name)) is not None}
    if not held:
        return drawn
    lanes = len(drawn)  # type: ignore[arg-type]
    repeated = {name: np.stack([np.asarray(value)] * lanes) for name, value in held.items()}
    return replace(drawn, **repeated)  # type: ignore[type-var]


def target_tensions(config: TaskConfig, uniforms: Array) -> Array:
    """Tensions whose unloaded equilibria have their tips at the targets, (B, 1 or T + 1, m) [N].

    A path moves from one of its waypoints (B, W, m) to the next with a smoothstep in log tension, so it stays in the
    drawn range and is at rest at each of them.
    """
    tensions = log_uniform(uniforms, config.target.tension_range)
    if config.target.process == "fixed":
        return tensions
    position = np.linspace(0.0, tensions.shape[1] - 1, config.episode_steps + 1)
    before = np.minimum(position.astype(int), tensions.shape[1] - 2)
    u = (position - before)[:, None]
    blend = u * u * (3 - 2 * u)
    logs = np.log(tensions)
    return np.exp((1 - blend) * logs[:, before] + blend * logs[:, before + 1])


def held_draws(uniforms: Array, hold_steps: float) -> NDArray[np.int64]:
    """Which draw holds at each time, (B, T + 1), where the next one comes after `hold_steps` on average."""
    jumps = uniforms < 1 / hold_steps
    jumps[:, 0] = False
    return np.cumsum(jumps, axis=1, dtype=np.int64)


def fading_walk(normal: Array, correlation_steps: float) -> Array:
    """Ornstein-Uhlenbeck processes of standard deviation 1, (B, T + 1, ...), from normal numbers of that shape."""
    keep = math.exp(-1 / correlation_steps)
    walk = normal.copy()
    for t in range(1, walk.shape[1]):
        walk[:, t] = keep * walk[:, t - 1] + math.sqrt(1 - keep * keep) * normal[:, t]
    return walk


def start_tensions(config: TaskConfig, uniforms: Array) -> Array:
    """Tensions before the load acts, (B, m) [N]."""
    if config.start == "random":
        return log_uniform(uniforms, config.start_tension_range)
    return np.full(uniforms.shape, config.start_tension)


def symmetric(bound: float | Array, uniforms: Array) -> Array:
    """Uniform numbers in [-bound, bound)."""
    return 2 * bound * uniforms - bound


def log_uniform(uniforms: Array, limits: tuple[float, float]) -> Array:
    """Numbers within the limits whose logarithms are uniform."""
    low, high = limits
    return low * (high / low) ** uniforms


def normal(uniforms: Array) -> Array:
    """Standard normal numbers from pairs of uniform ones, (..., 2) -> (...) (Box and Muller 1958)."""
    return np.sqrt(-2 * np.log1p(-uniforms[..., 0])) * np.cos(2 * np.pi * uniforms[..., 1])
