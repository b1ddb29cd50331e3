"""Settings of the planar worlds in which the tip is not seen, or late: defaults of TrackingConfig, and nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from rj_gym.core.config import RewardConfig
from rj_gym.core.sensing import ActuationConfig, SensingConfig
from rj_gym.planar.config import LoadConfig, RandomizationConfig, TrackingConfig

TENSION_NOISE = 0.1  # N, in every one of them
LAST_STEP = 1  # past readings: the last action, and what it did to motors and tensions


def _reward() -> RewardConfig:
    """Nothing but the error, of which the last millimetre counts as much as the five before it."""
    return RewardConfig(effort=0.0, smoothness=0.002, precision=0.5)


def _unlike_the_model(**more: float) -> RandomizationConfig:
    """How mechanisms and motors differ from the nominal ones."""
    mismatch = {
        "link_tolerance_mm": 0.1,
        "link_tolerance_rad": 0.01,
        "stiffness_spread": 0.2,
        "actuator_offset_mm": 0.5,
    }
    return RandomizationConfig(**(mismatch | more))


@dataclass(frozen=True)
class InstrumentConfig(TrackingConfig):
    """An instrument whose tip nobody sees, with play and friction in its sheath: see TrackingConfig."""

    load: LoadConfig = field(default_factory=lambda: LoadConfig(link="tip"))
    reward: RewardConfig = field(default_factory=_reward)
    randomization: RandomizationConfig = field(default_factory=_unlike_the_model)
    sensing: SensingConfig = field(default_factory=lambda: SensingConfig(pose="none", tension_noise=TENSION_NOISE))
    actuation: ActuationConfig = field(
        default_factory=lambda: ActuationConfig(play_mm=(0.5, 3.0), sheath_friction=(0.0, 0.6))
    )
    observe_history: int | Sequence[int] = LAST_STEP


@dataclass(frozen=True)
class InstrumentShiftConfig(InstrumentConfig):
    """A milder instrument to train on, before it wears: its surfaces are exact, play and friction are smaller.

    It is tested with actuation={"play_mm": (2, 3)} and with actuation={"sheath_friction": (0, 0.6)}.
    """

    randomization: RandomizationConfig = field(
        default_factory=lambda: _unlike_the_model(link_tolerance_mm=0.0, link_tolerance_rad=0.0)
    )
    actuation: ActuationConfig = field(
        default_factory=lambda: ActuationConfig(play_mm=(0.5, 2.0), sheath_friction=(0.0, 0.3))
    )


@dataclass(frozen=True)
class SlowCameraConfig(TrackingConfig):
    """A camera that takes a picture now and then, which comes late: see TrackingConfig."""

    load: LoadConfig = field(default_factory=lambda: LoadConfig(process="ou"))
    reward: RewardConfig = field(default_factory=_reward)
    randomization: RandomizationConfig = field(
        default_factory=lambda: _unlike_the_model(position_noise_mm=0.5, angle_noise_rad=0.01)
    )
    sensing: SensingConfig = field(
        default_factory=lambda: SensingConfig(period=5, delay=3, tension_noise=TENSION_NOISE)
    )
    observe_history: int | Sequence[int] = LAST_STEP


@dataclass(frozen=True)
class LatePoseConfig(TrackingConfig):
    """Poses that come two steps late, and play and friction in the sheath: see TrackingConfig."""

    load: LoadConfig = field(default_factory=lambda: LoadConfig(link="tip", process="ou"))
    reward: RewardConfig = field(default_factory=_reward)
    randomization: RandomizationConfig = field(
        default_factory=lambda: RandomizationConfig(position_noise_mm=0.3, angle_noise_rad=0.005)
    )
    sensing: SensingConfig = field(default_factory=lambda: SensingConfig(delay=2, tension_noise=TENSION_NOISE))
    actuation: ActuationConfig = field(
        default_factory=lambda: ActuationConfig(play_mm=(0.5, 3.0), sheath_friction=(0.0, 0.3))
    )
    observe_history: int | Sequence[int] = LAST_STEP
