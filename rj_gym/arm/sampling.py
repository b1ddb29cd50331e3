"""Episodes of the arm's task as pure functions of uniform random numbers, one row per episode."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rj_gym.arm.config import ArmRandomizationConfig, FlexibleArmConfig, PayloadConfig
from rj_gym.core.draws import (
    Uniforms,
    fading_walk,
    held_draws,
    hold,
    normal,
    start_tensions,
    symmetric,
    target_shape,
    target_tensions,
)
from rollingjoint.spatial.chain import HingeChain

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Fixed:
    """What the caller of reset holds fixed, the same in every lane; None is drawn.

    Shapes as in Episodes without the lane axis. A fixed mechanism is not randomised.
    """

    mechanism: HingeChain | None = None
    start_tensions: Array | None = None
    targets: Array | None = None
    gravity: Array | None = None
    payloads: Array | None = None


NOTHING_FIXED = Fixed()


@dataclass(frozen=True)
class Episodes:
    """What was drawn for B episodes; T is the number of steps, time 0 the start.

    A series has one entry where it does not change over time.

    Args:
        mechanisms: the arms that occur: one, or one per lane.
        designs: which of them each lane has, (B,).
        targets: tip positions [mm], with `orientation` followed by the rotation matrix row by row, (B, 1 or T + 1, 3 or
            12); or None: those of the equilibria without payload at target_tensions.
        target_tensions: (B, 1 or T + 1, m) [N].
        gravity: direction of gravity in the base frame, unit vectors (B, 3).
        payloads: what hangs from the tip, (B, 1 or T + 1) [N].
        start_tensions: tensions before the payload acts, (B, m) [N].
        stiffnesses: of the tendons, (B, m) [N/mm].
        hinge_stiffnesses: (B, n - 1) [N·mm/rad]. weights: of the beads, (B, n - 1) [N].
        actuator_offsets: what the motors add to every length command, (B, m) [mm].
        noise: measurement error of the tip: position and rotation vector, (B, T + 1, 6) [mm, rad], or None.
    """

    mechanisms: tuple[HingeChain, ...]
    designs: NDArray[np.int64]
    targets: Array | None
    target_tensions: Array
    gravity: Array
    payloads: Array
    start_tensions: Array
    stiffnesses: Array
    hinge_stiffnesses: Array
    weights: Array
    actuator_offsets: Array
    noise: Array | None

    def __len__(self) -> int:
        return len(self.designs)

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
        """Numbers on which the pose before the payload acts depends, beside the mechanism, (B, m + 3)."""
        return np.concatenate([self.start_tensions, self.gravity], axis=1)


def uniform_shapes(config: FlexibleArmConfig, mechanism: HingeChain) -> dict[str, tuple[int, ...]]:
    """Shapes of the uniform numbers that one episode needs, in the order in which they are drawn."""
    times, n_joints, m = config.episode_steps + 1, mechanism.n_joints, mechanism.n_tendons
    shapes: dict[str, tuple[int, ...]] = {"target": target_shape(config, m), "gravity": (2,)}
    if config.load.process == "ou":
        shapes["walk"] = (times, 2)
    else:
        shapes["magnitude"] = (times if config.load.process == "step" else 1,)
        if config.load.process == "step":
            shapes["jump"] = (times,)
    shapes |= {"start": (m,), "stiffness": (m,), "actuator": (m,), "hinge": (n_joints,), "weight": (n_joints,)}
    if config.randomization.sensor_noise:
        shapes["noise"] = (times, 6, 2)
    return shapes


def sample_episodes(
    config: FlexibleArmConfig, nominal: HingeChain, uniforms: Uniforms, fixed: Fixed = NOTHING_FIXED
) -> Episodes:
    """B episodes of the task, with what `fixed` holds in place of what was drawn.

    Args:
        config: the settings.
        nominal: the arm before randomisation.
        uniforms: of the same configuration and mechanism.
        fixed: what is not drawn.
    """
    randomization = config.randomization
    mechanisms, designs = _mechanisms(randomization, nominal, uniforms, fixed)
    drawn = Episodes(
        mechanisms,
        designs,
        None,
        target_tensions(config, uniforms["target"]),
        gravity_directions(config.gravity.tilt, uniforms["gravity"]),
        payloads(config.load, uniforms),
        start_tensions(config, uniforms["start"]),
        _of_lanes([arm.stiffnesses for arm in mechanisms], designs),
        _of_lanes([[bead.stiffness for bead in arm.beads] for arm in mechanisms], designs),
        _of_lanes([[bead.weight for bead in arm.beads] for arm in mechanisms], designs),
        symmetric(randomization.actuator_offset_mm, uniforms["actuator"]),
        _sensor_noise(randomization, uniforms["noise"]) if randomization.sensor_noise else None,
    )
    return hold(drawn, fixed, ("targets", "payloads", "gravity", "start_tensions"))


def _mechanisms(
    randomization: ArmRandomizationConfig, nominal: HingeChain, uniforms: Uniforms, fixed: Fixed
) -> tuple[tuple[HingeChain, ...], NDArray[np.int64]]:
    """Mechanisms and designs of Episodes."""
    lanes = len(uniforms)
    if fixed.mechanism is not None or not randomization.varies_mechanism:
        return (fixed.mechanism or nominal,), np.zeros(lanes, np.int64)
    spreads = randomization.hinge_stiffness_spread, randomization.stiffness_spread, randomization.weight_spread
    drawn = (uniforms[name] for name in ("hinge", "stiffness", "weight"))
    factors = [1 + symmetric(spread, numbers) for spread, numbers in zip(spreads, drawn, strict=True)]
    return tuple(nominal.scaled(*each) for each in zip(*factors, strict=True)), np.arange(lanes)


def _of_lanes(values: list[Array] | list[list[float]], designs: NDArray[np.int64]) -> Array:
    return np.array(values, float).take(designs, axis=0)


def gravity_directions(tilt: tuple[float, float], uniforms: Array) -> Array:
    """Unit vectors (B, 3), uniform over the directions whose angle to (0, 0, 1) is in the range, from (B, 2)."""
    low, high = math.cos(tilt[1]), math.cos(tilt[0])
    z = low + (high - low) * uniforms[:, 0]
    across, azimuth = np.sqrt(np.maximum(1 - z * z, 0.0)), 2 * math.pi * uniforms[:, 1]
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=-1)


def payloads(config: PayloadConfig, uniforms: Uniforms) -> Array:
    """What hangs from the tip, (B, 1 or T + 1) [N]."""
    low, high = config.magnitude
    if config.process == "ou":
        walk = fading_walk(normal(uniforms["walk"]), config.correlation_steps)
        return np.clip(0.5 * (low + high) + 0.25 * (high - low) * walk, low, high)
    drawn = low + (high - low) * uniforms["magnitude"]
    if config.process == "constant":
        return drawn
    return np.take_along_axis(drawn, held_draws(uniforms["jump"], config.hold_steps), axis=1)


def _sensor_noise(config: ArmRandomizationConfig, uniforms: Array) -> Array:
    return np.repeat([config.position_noise_mm, config.angle_noise_rad], 3) * normal(uniforms)
