"""Settings of the arm's world in which the tip is not seen: defaults of FlexibleArmConfig, and nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from rj_gym.arm.config import ArmRandomizationConfig, ArmRewardConfig, ArmTargetConfig, FlexibleArmConfig
from rj_gym.core.config import FrictionConfig
from rj_gym.core.sensing import ActuationConfig, SensingConfig


@dataclass(frozen=True)
class ArmInstrumentConfig(FlexibleArmConfig):
    """An arm whose tip nobody sees, with play, friction in its sheath and in its holes: see FlexibleArmConfig."""

    target: ArmTargetConfig = field(default_factory=lambda: ArmTargetConfig(loaded=True))
    reward: ArmRewardConfig = field(
        default_factory=lambda: ArmRewardConfig(effort=0.0, smoothness=0.002, precision=0.5)
    )
    randomization: ArmRandomizationConfig = field(
        default_factory=lambda: ArmRandomizationConfig(
            stiffness_spread=0.2, hinge_stiffness_spread=0.1, weight_spread=0.1, actuator_offset_mm=0.5
        )
    )
    friction: FrictionConfig | None = field(default_factory=FrictionConfig)
    sensing: SensingConfig = field(default_factory=lambda: SensingConfig(pose="none", tension_noise=0.1))
    actuation: ActuationConfig = field(
        default_factory=lambda: ActuationConfig(play_mm=(0.2, 1.0), sheath_friction=(0.0, 0.3))
    )
    observe_history: int | Sequence[int] = 1  # the last action, and what it did to motors and tensions
