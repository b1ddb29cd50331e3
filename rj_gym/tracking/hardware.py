"""Random numbers of motors and sensors for every episode, and their arrays."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.generators import Uniforms
from rj_gym.tracking.arrays import (
    BOUND,
    CELL_ROWS,
    GAIN,
    LIMIT,
    LIMIT_ROWS,
    MOTOR_ROWS,
    MOVES,
    OFFSET,
    SENSED,
    STOP,
    Hardware,
    HardwareRules,
)
from rj_gym.tracking.config import TaskConfig
from rollingjoint.transmission import sheath_direction, sheath_ratio

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class HardwareDraws:
    """Random numbers of B episodes; None where the settings leave a quantity out.

    Args:
        play: widths, (B, m) [mm]. motor_starts: motor minus tendon at the start, (B, m) [mm].
        sheath_friction: (B, m). phase: of the pictures, (B,) [steps].
        encoder_noise: (B, T + 1, m) [mm]. tension_noise: (B, T + 1, m) [N].
        tension_gains: of load cells, (B, m). tension_offsets: (B, m) [N].
        tension_limits: of motors, (B, m) [N].
    """

    play: Array | None = None
    motor_starts: Array | None = None
    sheath_friction: Array | None = None
    phase: NDArray[np.int64] | None = None
    encoder_noise: Array | None = None
    tension_noise: Array | None = None
    tension_gains: Array | None = None
    tension_offsets: Array | None = None
    tension_limits: Array | None = None

    def held(self, play: Array | None = None, **others: Any) -> HardwareDraws:
        """The draws with these in place of drawn ones, (B, m); motors start at the same share of another play."""
        if play is None or self.play is None or self.motor_starts is None:
            return replace(self, **others)
        shares = np.divide(self.motor_starts, self.play, out=np.zeros_like(play), where=self.play > 0)
        return replace(self, play=play, motor_starts=shares * play, **others)

    def true_tensions(self, shown: Array, at_tendons: bool) -> Array:
        """Tensions behind the sheath at the start, (B, m) [N], where load cells show these.

        at_tendons: whether the cells are behind the sheath.
        """
        tensions = shown if self.tension_offsets is None else shown - self.tension_offsets
        if self.tension_gains is not None:
            tensions = tensions / self.tension_gains
        if at_tendons or self.sheath_friction is None or self.play is None or self.motor_starts is None:
            return tensions
        place = sheath_direction(np.zeros_like(self.play), self.motor_starts, 0.5 * self.play)
        return np.asarray(tensions / sheath_ratio(self.sheath_friction, place))

    def sampled_info(self) -> dict[str, Any]:
        """Entries of info["sampled"], (B, ...) each."""
        named = {
            "play_mm": self.play,
            "motor_starts": self.motor_starts,
            "sheath_friction": self.sheath_friction,
            "picture_phase": self.phase,
            "tension_gains": self.tension_gains,
            "tension_offsets": self.tension_offsets,
            "tension_limits": self.tension_limits,
        }
        return {name: values for name, values in named.items() if values is not None}


def hardware_shapes(config: TaskConfig, n_tendons: int, pose_numbers: int) -> dict[str, tuple[int, ...]]:
    """Shapes of the uniform numbers of an episode: none where sensing and actuation are plain."""
    sensing, actuation, m = config.sensing, config.actuation, n_tendons
    series = (config.episode_steps + 1, m, 2)
    shapes = {
        "play": ((m,), actuation.play_mm[1] > 0),
        "play start": ((m,), actuation.play_mm[1] > 0),
        "sheath": ((m,), actuation.sheath_friction[1] > 0),
        "phase": ((1,), sensing.period > 1),
        "bias": ((pose_numbers,), sensing.biased),
        "encoder": (series, sensing.encoder_noise_mm > 0),
        "tension": (series, sensing.tension_noise > 0),
        "cells": ((2, m), sensing.cells_err),
        "limits": ((m,), actuation.tension_limit is not None),
    }
    return {name: shape for name, (shape, needed) in shapes.items() if needed}


def draw_hardware(config: TaskConfig, uniforms: Uniforms, normal: Callable[[Array], Array]) -> HardwareDraws | None:
    """HardwareDraws from uniform numbers; None where sensing and actuation are plain.

    normal: standard normal numbers from pairs of uniform ones.
    """
    if not config.is_instrumented:
        return None
    sensing, actuation = config.sensing, config.actuation
    play = motor_starts = sheath = phase = encoder = tension = None
    if actuation.play_mm[1] > 0:
        play = _between(actuation.play_mm, uniforms["play"])
        motor_starts = play * (uniforms["play start"] - 0.5)
    if actuation.sheath_friction[1] > 0:
        sheath = _between(actuation.sheath_friction, uniforms["sheath"])
    if sensing.period > 1:
        phase = (uniforms["phase"][:, 0] * sensing.period).astype(np.int64)
    if sensing.encoder_noise_mm > 0:
        encoder = sensing.encoder_noise_mm * normal(uniforms["encoder"])
    if sensing.tension_noise > 0:
        tension = sensing.tension_noise * normal(uniforms["tension"])
    gains, offsets = _cells(config, uniforms)
    return HardwareDraws(
        play=play,
        motor_starts=motor_starts,
        sheath_friction=sheath,
        phase=phase,
        encoder_noise=encoder,
        tension_noise=tension,
        tension_gains=gains,
        tension_offsets=offsets,
        tension_limits=_limits(config, uniforms),
    )


def _cells(config: TaskConfig, uniforms: Uniforms) -> tuple[Array | None, Array | None]:
    """Gains of load cells, and their offsets [N], (B, m)."""
    sensing = config.sensing
    if not sensing.cells_err:
        return None, None
    shares = 2.0 * uniforms["cells"] - 1.0
    return 1.0 + sensing.tension_gain_error * shares[:, 0], sensing.tension_offset * shares[:, 1]


def _limits(config: TaskConfig, uniforms: Uniforms) -> Array | None:
    """Upper limits of tension, (B, m) [N]."""
    actuation = config.actuation
    if not actuation.limits_vary:
        return None
    if actuation.tension_limit is None:
        limits = np.full(uniforms["start"].shape, config.tension_range[1])
    else:
        limits = _between(actuation.tension_limit, uniforms["limits"])
    unit = actuation.current_resolution
    return unit * np.maximum(np.round(limits / unit), 1.0) if unit > 0 else limits


def _between(limits: tuple[float, float], uniforms: Array) -> Array:
    low, high = limits
    return low + (high - low) * uniforms


def new_hardware(config: TaskConfig, capacity: int, n_tendons: int, pose_numbers: int, dimension: int) -> Hardware:
    """Empty arrays for `capacity` lanes, and for none where everything is plain.

    pose_numbers: of a picture, in which true poses are kept.
    """
    sensing, m, times = config.sensing, n_tendons, config.episode_steps + 1
    lanes = capacity if config.is_instrumented else 0
    depth = sensing.delay + 2 if sensing.late else 0
    axes = 0 if sensing.pose == "none" else dimension
    remembered = 1 + max(config.actuation.delay, *config.lags, 0)
    return Hardware(
        half_play=np.zeros((lanes, m)),
        sheath=np.zeros((lanes, m)),
        starts=np.zeros((lanes, m)),
        friction=np.zeros((lanes, m)),
        encoder_noise=np.zeros((lanes, times if sensing.encoder_noise_mm > 0 else 0, m)),
        tension_noise=np.zeros((lanes, times if sensing.tension_noise > 0 else 0, m)),
        phase=np.zeros(lanes, np.int64),
        cells=np.zeros((lanes if sensing.cells_err else 0, CELL_ROWS, m)),
        limits=np.zeros((lanes if config.actuation.limits_vary else 0, LIMIT_ROWS, m)),
        motors=np.zeros((lanes, MOTOR_ROWS, m)),
        measured=np.zeros((lanes, SENSED, m)),
        pictures=np.zeros((lanes, depth, pose_numbers)),
        picture=np.zeros((lanes, 2), np.int64),
        errors=np.zeros((lanes, axes)),
        past=np.zeros((lanes, remembered, 3 * m + axes)),
    )


def enter_hardware(hardware: Hardware, draws: HardwareDraws, commands: Array, at_motors: bool) -> None:
    """Put random numbers into the first lanes, where tendons have these commands, (B, m) [mm].

    at_motors: whether limits of tension act there.
    """
    count = len(commands)
    hardware.half_play[:count] = 0.0 if draws.play is None else 0.5 * draws.play
    hardware.sheath[:count] = 0.0 if draws.sheath_friction is None else draws.sheath_friction
    hardware.starts[:count] = 0.0 if draws.motor_starts is None else draws.motor_starts
    hardware.phase[:count] = 0 if draws.phase is None else draws.phase
    if draws.encoder_noise is not None:
        hardware.encoder_noise[:count] = draws.encoder_noise
    if draws.tension_noise is not None:
        hardware.tension_noise[:count] = draws.tension_noise
    hardware.motors[:count] = (commands + hardware.starts[:count])[:, None]
    if draws.tension_gains is not None and draws.tension_offsets is not None:
        hardware.cells[:count, GAIN], hardware.cells[:count, OFFSET] = draws.tension_gains, draws.tension_offsets
    if draws.tension_limits is not None:
        hardware.limits[:count, LIMIT] = draws.tension_limits
        hardware.limits[:count, BOUND] = np.inf if at_motors else draws.tension_limits
        hardware.limits[:count, STOP] = MOVES


def hardware_rules(config: TaskConfig, mechanism: Any, bounds: tuple[Array, Array], at: int) -> HardwareRules:
    """The parameters of motors and sensors that all lanes share.

    Args:
        config: the settings.
        mechanism: before randomisation.
        bounds: of the privileged numbers, (K,) each; at: the first of their columns of readings.
    """
    sensing, actuation = config.sensing, config.actuation
    low, high = (bound if config.privileged != "off" else bound[:0] for bound in bounds)
    return HardwareRules(
        active=config.is_instrumented,
        rate_limit=math.inf if actuation.rate_limit_mm is None else actuation.rate_limit_mm,
        action_delay=actuation.delay,
        dead_band=actuation.dead_band_mm,
        limits_pulls=actuation.limit_at == "motor",
        cells_at_tendons=sensing.tension_at == "tendon",
        encoder_resolution=sensing.encoder_resolution_mm,
        tension_resolution=sensing.tension_resolution,
        late=sensing.late,
        period=sensing.period,
        picture_delay=sensing.delay,
        lags=np.array(config.lags, np.int64),
        stiffnesses=np.array(mechanism.stiffnesses, float),
        tells_limits=actuation.limits_vary,
        friction=bool(config.has_friction(mechanism)),
        steps=config.episode_steps,
        privileged_at=at,
        privileged_low=low.astype(np.float32),
        privileged_high=high.astype(np.float32),
    )
