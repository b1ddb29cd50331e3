"""Episodes of the arm's task as pure functions of uniform random numbers, one row per episode."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rj_gym.arm.config import ArmRandomizationConfig, FlexibleArmConfig, PayloadConfig
from rj_gym.arm.options import NOTHING_FIXED, ArmOptions
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
    of_lanes,
    shared_draws,
    symmetric,
    target_shape,
)
from rj_gym.core.hardware_draws import hardware_shapes
from rollingjoint.chain.hinge import HingeChain

Array = NDArray[np.float64]


@dataclass(kw_only=True)
class ArmDraws(TrackingDraws):
    """What was drawn for B episodes of the arm's task: see TrackingDraws, and the fields below.

    Targets are tip positions, with `orientation` followed by the rotation matrix row by row; noise is that of the tip:
    position and rotation vector.

    Args:
        gravity: direction of gravity in the base frame, unit vectors (B, 3).
        payloads: weight at the tip, (B, 1 or T + 1) [N].
        hinge_stiffnesses: (B, n - 1) [N·mm/rad]. weights: of the beads, (B, n - 1) [N].
    """

    gravity: Array
    payloads: Array
    hinge_stiffnesses: Array
    weights: Array

    @property
    def links(self) -> NDArray[np.int64]:
        """Link that carries the payload, (B,): the tip."""
        return np.full(len(self), self.mechanisms[0].n_links - 1)

    @property
    def forces(self) -> Array:
        """The payload's force on the tip, (B, 1 or T + 1, 3) [N]."""
        return self.payloads[..., None] * self.gravity[:, None]

    @property
    def rest_causes(self) -> Array:
        """Quantities that determine the pose before the payload acts, besides the mechanism, (B, m + 3)."""
        return np.concatenate([self.start_tensions, self.gravity], axis=1)


def uniform_blocks(config: FlexibleArmConfig, mechanism: HingeChain) -> dict[str, Block]:
    """The blocks of uniform numbers that one episode needs, in the order in which they are drawn."""
    times, n_joints, m = config.episode_steps + 1, mechanism.n_joints, mechanism.n_tendons
    shapes = {"target": target_shape(config, m), "gravity": (2,)}
    shapes |= load_shapes(config.load, times, ("magnitude",), walk=())
    shapes |= {"start": (m,), "stiffness": (m,), "actuator": (m,), "hinge": (n_joints,), "weight": (n_joints,)}
    if config.randomization.sensor_noise:
        shapes["noise"] = (times, 6, 2)
    return blocks_of(shapes | friction_shapes(config, m) | hardware_shapes(config, m, 6))


def sample_episodes(config: FlexibleArmConfig, nominal: HingeChain, uniforms: Uniforms, fixed: ArmOptions) -> ArmDraws:
    """B episodes of the task, with what `fixed` holds in place of what was drawn.

    Args:
        config: the settings.
        nominal: the arm before randomisation.
        uniforms: of the same configuration and mechanism.
        fixed: what is not drawn.
    """
    randomization = config.randomization
    mechanisms, designs = _mechanisms(randomization, nominal, uniforms, fixed)
    drawn = ArmDraws(
        **shared_draws(config, mechanisms, designs, uniforms, _pose_scale),
        gravity=gravity_directions(config.gravity.tilt, uniforms["gravity"]),
        payloads=payloads(config.load, uniforms),
        hinge_stiffnesses=of_lanes([[bead.stiffness for bead in arm.beads] for arm in mechanisms], designs),
        weights=of_lanes([[bead.weight for bead in arm.beads] for arm in mechanisms], designs),
    )
    return drawn if fixed is NOTHING_FIXED else hold(drawn, fixed)


def _pose_scale(mm: float, rad: float) -> list[float]:
    """The scale of a position and a rotation vector, (6,)."""
    return [mm] * 3 + [rad] * 3


def _mechanisms(
    randomization: ArmRandomizationConfig, nominal: HingeChain, uniforms: Uniforms, fixed: ArmOptions
) -> tuple[tuple[HingeChain, ...], NDArray[np.int64]]:
    """Mechanisms and designs of ArmDraws."""
    lanes = len(uniforms)
    if fixed.mechanism is not None or not randomization.varies_mechanism:
        return (fixed.mechanism or nominal,), np.zeros(lanes, np.int64)
    spreads = randomization.hinge_stiffness_spread, randomization.stiffness_spread, randomization.weight_spread
    drawn = (uniforms[name] for name in ("hinge", "stiffness", "weight"))
    factors = [1 + symmetric(spread, numbers) for spread, numbers in zip(spreads, drawn, strict=True)]
    return tuple(nominal.scaled(*each) for each in zip(*factors, strict=True)), np.arange(lanes)


def gravity_directions(tilt: tuple[float, float], uniforms: Array) -> Array:
    """Unit vectors (B, 3), uniform over the directions whose angle to (0, 0, 1) is in the range, from (B, 2)."""
    low, high = math.cos(tilt[1]), math.cos(tilt[0])
    z = low + (high - low) * uniforms[:, 0]
    across, azimuth = np.sqrt(np.maximum(1 - z * z, 0.0)), 2 * math.pi * uniforms[:, 1]
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=-1)


def payloads(config: PayloadConfig, uniforms: Uniforms) -> Array:
    """Payloads at the tip, (B, 1 or T + 1) [N]."""
    low, high = config.magnitude
    if config.process == "ou":
        walk = fading_walk(normal(uniforms["walk"]), config.correlation_steps)
        return np.clip(0.5 * (low + high) + 0.25 * (high - low) * walk, low, high)
    return loads_over_time(config, low + (high - low) * uniforms["magnitude"], uniforms)
