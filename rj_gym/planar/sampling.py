"""Episodes as pure functions of uniform random numbers, one row per episode.

A generator is asked once per episode (`Uniforms`); everything after that is arithmetic on (B, ...) arrays. So an
episode depends on its own row alone, whatever the batch around it, and a scalar and a native vector environment share
this code. What randomisation and friction need comes last: switching them on leaves the loads of a seed as they are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.draws import (
    Block,
    TrackingDraws,
    Uniforms,
    blocks_of,
    fading_walk,
    friction_shapes,
    hold,
    load_shapes,
    loads_over_time,
    normal,
    shared_draws,
    symmetric,
    target_shape,
)
from rj_gym.core.hardware_draws import hardware_shapes
from rj_gym.planar.config import LoadConfig, RandomizationConfig, TrackingConfig
from rj_gym.planar.options import NOTHING_FIXED, PlanarOptions
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.variations import ChainVariations

Array = NDArray[np.float64]


@dataclass(kw_only=True)
class PlanarDraws(TrackingDraws):
    """What was drawn for B episodes of the planar task: see TrackingDraws, and the fields below.

    Args:
        links: link that the load pulls, (B,).
        forces: loads, (B, 1 or T + 1, 2) [N].
        surface_offsets: displacement (x, y, angle) of every link's parent and child surface, (B, n, 2, 3) [mm, rad].
    """

    links: NDArray[np.int64]
    forces: Array
    surface_offsets: Array


def uniform_blocks(config: TrackingConfig, mechanism: RollingChain) -> dict[str, Block]:
    """The blocks of uniform numbers that one episode needs, in the order in which they are drawn."""
    times, moving, m = config.episode_steps + 1, mechanism.n_links - 1, mechanism.n_tendons
    shapes = {"target": target_shape(config, m), "link": (1,)}
    shapes |= load_shapes(config.load, times, ("direction", "magnitude"), walk=(2,))
    shapes |= {"start": (m,), "stiffness": (m,), "actuator": (m,), "surface": (mechanism.n_links, 2, 3)}
    if config.randomization.sensor_noise:
        shapes["noise"] = (times, moving, 3, 2)
    return blocks_of(shapes | friction_shapes(config, m) | hardware_shapes(config, m, 3))


def sample_episodes(
    config: TrackingConfig, nominal: RollingChain, uniforms: Uniforms, fixed: PlanarOptions
) -> PlanarDraws:
    """B episodes of the task, with what `fixed` holds in place of what was drawn.

    Args:
        config: the settings.
        nominal: the mechanism before randomisation.
        uniforms: of the same configuration and mechanism.
        fixed: what is not drawn.
    """
    randomization = config.randomization
    mechanisms, designs, offsets = _mechanisms(randomization, nominal, uniforms, fixed)
    drawn = PlanarDraws(
        **shared_draws(config, mechanisms, designs, uniforms, _pose_scale, (nominal.n_links - 1,)),
        links=load_links(config.load, nominal.n_links, uniforms["link"]),
        forces=load_forces(config.load, uniforms),
        surface_offsets=offsets,
    )
    return drawn if fixed is NOTHING_FIXED else hold(drawn, fixed)


def _mechanisms(
    randomization: RandomizationConfig, nominal: RollingChain, uniforms: Uniforms, fixed: PlanarOptions
) -> tuple[Sequence[RollingChain], NDArray[np.int64], Array]:
    """Mechanisms, designs and surface offsets of PlanarDraws."""
    lanes = len(uniforms)
    if fixed.mechanism is not None or not randomization.varies_mechanism:
        chosen = fixed.mechanism or nominal
        return (chosen,), np.zeros(lanes, np.int64), np.zeros((lanes, nominal.n_links, 2, 3))
    tolerance = _pose_scale(randomization.link_tolerance_mm, randomization.link_tolerance_rad)
    offsets = symmetric(np.array(tolerance), uniforms["surface"])
    factors = 1 + symmetric(randomization.stiffness_spread, uniforms["stiffness"])
    return ChainVariations(nominal, offsets, factors), np.arange(lanes), offsets


def load_links(config: LoadConfig, n_links: int, uniforms: Array) -> NDArray[np.int64]:
    """Link that the load pulls, (B,): the tip, or uniform over the moving links."""
    if config.link == "tip":
        return np.full(len(uniforms), n_links - 1)
    return 1 + (uniforms[:, 0] * (n_links - 1)).astype(np.int64)


def load_forces(config: LoadConfig, uniforms: Uniforms) -> Array:
    """Loads, (B, 1 or T + 1, 2) [N]."""
    if config.process == "ou":
        return _ornstein_uhlenbeck(config, normal(uniforms["walk"]))
    low, high = config.magnitude
    angle = 2 * math.pi * uniforms["direction"]
    magnitude = low + (high - low) * uniforms["magnitude"]
    drawn = np.empty((*angle.shape, 2))
    np.cos(angle, out=drawn[..., 0])
    np.sin(angle, out=drawn[..., 1])
    drawn *= magnitude[..., None]
    return loads_over_time(config, drawn, uniforms)


def _ornstein_uhlenbeck(config: LoadConfig, normal: Array) -> Array:
    """Force with exponentially fading memory, (B, T + 1, 2) [N], started in its stationary distribution."""
    largest = config.magnitude[1]
    walk = fading_walk(normal, config.correlation_steps)
    walk *= largest / 2
    magnitude = np.linalg.norm(walk, axis=-1, keepdims=True)
    return walk * np.minimum(1.0, largest / np.maximum(magnitude, 1e-12))


def _pose_scale(mm: float, rad: float) -> list[float]:
    """The scale of x, y, angle, (3,)."""
    return [mm, mm, rad]
