"""Random episodes of the design task, drawn from one generator per episode."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rj_gym.design.config import DesignConfig
from rollingjoint.errors import InvalidInput

Array = NDArray[np.float64]
Rngs = Sequence[np.random.Generator]

_CANDIDATES = 6  # designs drawn at a time for a lane
_MOST_ROUNDS = 20_000


class DesignDraws(NamedTuple):
    """Random draws of B episodes: arrays with the lane first.

    Fields: the hidden design and the one to begin with, (B, d); tensions (B, K, m) [N]; force on the tip in every case,
    (B, K, 2) [N]; origins of the hidden design's moving links, (B, K, n - 1, 2) [mm]; in space 3 in place of 2.
    """

    target_design: Array
    start_design: Array
    tensions: Array
    forces: Array
    targets: Array


def blank_draws(config: DesignConfig, count: int) -> DesignDraws:
    """Zeros in the shapes of `count` episodes, with the tensions of the settings."""
    designs, plain = np.zeros((count, config.space.dimensions)), config.space.plain
    tensions, cases = np.tile(config.tensions, (count, 1, 1)), (count, config.cases)
    forces = np.zeros((*cases, config.space.dimension))
    return DesignDraws(
        designs, designs.copy(), tensions, forces, np.zeros((*cases, plain.n_links - 1, forces.shape[-1]))
    )


def tip_forces(config: DesignConfig, rngs: Rngs) -> Array:
    """Forces of all cases, uniform in direction and magnitude, (len(rngs), K, 2 or 3) [N]."""
    return directed_forces(config.force, config.cases, config.space.dimension, rngs)


def directed_forces(sizes: tuple[float, float], count: int, dimension: int, rngs: Rngs) -> Array:
    """Forces uniform in direction and in magnitude between two sizes, (len(rngs), count, 2 or 3) [N]."""
    low, high = sizes
    uniform = np.array([rng.random((count, dimension)) for rng in rngs])
    size, angle = low + (high - low) * uniform[..., 0], 2.0 * np.pi * uniform[..., 1]
    direction = np.stack([np.cos(angle), np.sin(angle)], -1)
    if dimension == 3:
        up = 2.0 * uniform[..., 2:] - 1.0
        direction = np.concatenate([np.sqrt(1.0 - up**2) * direction, up], -1)
    return size[..., None] * direction


def valid_pairs(margins: Callable[[Array], Array], dimensions: int, rngs: Rngs) -> Array:
    """Two valid designs from every generator, uniform in the box by rejection, (len(rngs), 2, d)."""
    designs: list[list[Array]] = [[] for _ in rngs]
    for _ in range(_MOST_ROUNDS):
        unfinished = [lane for lane, pairs in enumerate(designs) if len(pairs) < 2]
        if not unfinished:
            return np.array([pairs[:2] for pairs in designs])
        drawn = np.array([rngs[lane].uniform(-1.0, 1.0, (_CANDIDATES, dimensions)) for lane in unfinished])
        good = np.all(margins(drawn) >= 0, axis=-1)
        for place, lane in enumerate(unfinished):
            designs[lane] += list(drawn[place][good[place]])
    raise InvalidInput("designs", "hardly any valid", "a space with valid designs", "Narrow its ranges.")
