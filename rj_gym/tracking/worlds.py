"""Settings of worlds in which the tip is not seen, or late: a task's settings with other defaults."""

# ruff: noqa: RUF009 (settings are frozen, so that all may share a default)

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rj_gym.tracking.config import (
    ArmRandomizationConfig,
    ArmRewardConfig,
    ArmTargetConfig,
    FlexibleArmConfig,
    FrictionConfig,
    LoadConfig,
    RandomizationConfig,
    RewardConfig,
    TrackingConfig,
)
from rj_gym.tracking.sensing import ActuationConfig, SensingConfig

# The error alone counts, and its last millimetre as much as the five before it.
_REWARD = RewardConfig(effort=0.0, smoothness=0.002, precision=0.5)
_MOTORS = RandomizationConfig(stiffness_spread=0.2, actuator_offset_mm=0.5)
_MISMATCH = _MOTORS.updated({"link_tolerance_mm": 0.1, "link_tolerance_rad": 0.01})
_WANDERING = LoadConfig(process="ou")
_NOT_SEEN = SensingConfig(pose="none", tension_noise=0.1)
# Motors and sensors of a rig, assumed; docs/environment.md says why.
_LIMITS = {"tension_limit": (10.0, 30.0), "limit_at": "motor", "dead_band_mm": 0.02, "current_resolution": 0.5}
_ERRORS = {"encoder_resolution_mm": 0.015, "tension_gain_error": 0.02, "tension_offset": 0.1}
_LAST_STEP = 1  # past readings: the last action, and the changes of motors and tensions in it


@dataclass(frozen=True)
class InstrumentConfig(TrackingConfig):
    """An instrument with an unseen tip, with play and friction in its sheath: see TrackingConfig."""

    load: LoadConfig = LoadConfig(link="tip")
    reward: RewardConfig = _REWARD
    randomization: RandomizationConfig = _MISMATCH
    sensing: SensingConfig = _NOT_SEEN
    actuation: ActuationConfig = ActuationConfig(play_mm=(0.5, 3.0), sheath_friction=(0.0, 0.6))
    observe_history: int | Sequence[int] = _LAST_STEP


@dataclass(frozen=True)
class InstrumentShiftConfig(InstrumentConfig):
    """A milder instrument to train on, before it wears: its surfaces are exact, play and friction are smaller.

    It is tested with actuation={"play_mm": (2, 3)} and with actuation={"sheath_friction": (0, 0.6)}.
    """

    randomization: RandomizationConfig = _MOTORS
    actuation: ActuationConfig = ActuationConfig(play_mm=(0.5, 2.0), sheath_friction=(0.0, 0.3))


@dataclass(frozen=True)
class SlowCameraConfig(TrackingConfig):
    """A camera that takes a picture now and then, which comes late: see TrackingConfig."""

    load: LoadConfig = _WANDERING
    reward: RewardConfig = _REWARD
    randomization: RandomizationConfig = _MISMATCH.updated({"position_noise_mm": 0.5, "angle_noise_rad": 0.01})
    sensing: SensingConfig = SensingConfig(period=5, delay=3, tension_noise=0.1)
    observe_history: int | Sequence[int] = _LAST_STEP


@dataclass(frozen=True)
class LatePoseConfig(TrackingConfig):
    """Poses that come two steps late, and play and friction in the sheath: see TrackingConfig."""

    load: LoadConfig = _WANDERING.updated({"link": "tip"})
    reward: RewardConfig = _REWARD
    randomization: RandomizationConfig = RandomizationConfig(position_noise_mm=0.3, angle_noise_rad=0.005)
    sensing: SensingConfig = SensingConfig(delay=2, tension_noise=0.1)
    actuation: ActuationConfig = ActuationConfig(play_mm=(0.5, 3.0), sheath_friction=(0.0, 0.3))
    observe_history: int | Sequence[int] = _LAST_STEP


@dataclass(frozen=True)
class ArmInstrumentConfig(FlexibleArmConfig):
    """An arm with an unseen tip, with play, friction in its sheath and in its holes: see FlexibleArmConfig."""

    target: ArmTargetConfig = ArmTargetConfig(loaded=True)
    reward: ArmRewardConfig = ArmRewardConfig(effort=0.0, smoothness=0.002, precision=0.5)
    randomization: ArmRandomizationConfig = ArmRandomizationConfig(
        stiffness_spread=0.2, hinge_stiffness_spread=0.1, weight_spread=0.1, actuator_offset_mm=0.5
    )
    friction: FrictionConfig | None = FrictionConfig()
    sensing: SensingConfig = _NOT_SEEN
    actuation: ActuationConfig = ActuationConfig(play_mm=(0.2, 1.0), sheath_friction=(0.0, 0.3))
    observe_history: int | Sequence[int] = _LAST_STEP


@dataclass(frozen=True)
class InstrumentV1Config(InstrumentConfig):
    """As InstrumentConfig, with the motors and sensors of a rig: see InstrumentV1Env."""

    start: str = "measured"
    sensing: SensingConfig = InstrumentConfig.sensing.updated(_ERRORS)
    actuation: ActuationConfig = InstrumentConfig.actuation.updated(_LIMITS)


@dataclass(frozen=True)
class InstrumentShiftV1Config(InstrumentShiftConfig):
    """As InstrumentShiftConfig, with the motors and sensors of a rig: see InstrumentV1Env."""

    start: str = "measured"
    sensing: SensingConfig = InstrumentShiftConfig.sensing.updated(_ERRORS)
    actuation: ActuationConfig = InstrumentShiftConfig.actuation.updated(_LIMITS)


@dataclass(frozen=True)
class SlowCameraV1Config(SlowCameraConfig):
    """As SlowCameraConfig, with the motors and sensors of a rig: see InstrumentV1Env."""

    start: str = "measured"
    sensing: SensingConfig = SlowCameraConfig.sensing.updated(_ERRORS)
    actuation: ActuationConfig = ActuationConfig().updated(_LIMITS)


@dataclass(frozen=True)
class LatePoseV1Config(LatePoseConfig):
    """As LatePoseConfig, with the motors and sensors of a rig: see InstrumentV1Env."""

    start: str = "measured"
    sensing: SensingConfig = LatePoseConfig.sensing.updated(_ERRORS)
    actuation: ActuationConfig = LatePoseConfig.actuation.updated(_LIMITS)


@dataclass(frozen=True)
class ArmInstrumentV1Config(ArmInstrumentConfig):
    """As ArmInstrumentConfig, with the motors and sensors of a rig: see InstrumentV1Env."""

    start: str = "measured"
    sensing: SensingConfig = ArmInstrumentConfig.sensing.updated(_ERRORS)
    actuation: ActuationConfig = ArmInstrumentConfig.actuation.updated(_LIMITS)
