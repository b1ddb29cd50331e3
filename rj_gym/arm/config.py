"""Settings of the arm's tracking task; what every tracking task has is in rj_gym/core/config.py."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

from rj_gym.core.config import LoadSettings, Randomization, RewardConfig, TargetConfig, TaskConfig
from rj_gym.core.settings import Range, Settings
from rollingjoint.chain.hinge import HingeChain
from rollingjoint.checks import as_number, as_range


@dataclass(frozen=True)
class GravityConfig(Settings):
    """The direction of gravity in the base frame, constant in an episode: the arm hangs from a tilted base.

    Args:
        tilt: range of the angle to (0, 0, 1), the direction in which the arm hangs straight; uniform over that part of
            the sphere [rad].
    """

    _SECTION: ClassVar[str] = "gravity."
    tilt: Range = (0.0, 0.5)

    def __post_init__(self) -> None:
        self._check(as_range, "tilt", low=0.0, high=math.pi, unit="rad")


@dataclass(frozen=True)
class PayloadConfig(LoadSettings):
    """The payload at the tip: a dead force along gravity.

    Args:
        magnitude: range of its uniform size [N].
        process: "constant"; "step" (jumps to a new draw at random times); "ou" (an Ornstein-Uhlenbeck process about the
            middle of the range, stationary standard deviation a quarter of its width, clipped to the range).
        hold_steps: mean number of steps between two jumps of "step".
        correlation_steps: correlation time of "ou" [steps].
    """

    magnitude: Range = (0.0, 0.5)
    process: str = "constant"
    hold_steps: float = 15.0
    correlation_steps: float = 15.0


@dataclass(frozen=True)
class ArmTargetConfig(TargetConfig):
    """Where the tip should be: as TargetConfig, but tips of equilibria under the gravity of the episode, no payload."""

    tension_range: Range = (1.0, 5.0)


@dataclass(frozen=True)
class ArmRewardConfig(RewardConfig):
    """Scales and weights of the reward terms: those of RewardConfig, and with `orientation` two more.

    Args:
        angle_scale_rad: angle between tip and target frame that costs 1 per step [rad].
        goal_tolerance_rad: such an angle that counts as reached, if the tip error does, when sparse [rad].
    """

    error_scale_mm: float = 30.0
    goal_tolerance_mm: float = 5.0
    angle_scale_rad: float = 0.3
    goal_tolerance_rad: float = 0.05

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check(as_number, "angle_scale_rad", low=1e-6)
        self._check(as_number, "goal_tolerance_rad", low=1e-9)


@dataclass(frozen=True)
class ArmRandomizationConfig(Randomization):
    """Domain randomisation, drawn anew in every episode; all zero (off) by default.

    Args:
        position_noise_mm: standard deviation of the measured tip position in x, y and z, every step [mm].
        angle_noise_rad: standard deviation of the rotation vector between measured and true tip frame, every step
            [rad].
        stiffness_spread: tendon stiffness is multiplied by 1 + uniform(-spread, spread).
        hinge_stiffness_spread: the same for every hinge.
        weight_spread: the same for the weight of every bead.
        actuator_offset_mm: every length command is off by a constant uniform(-offset, offset) [mm].
    """

    _HIGHEST: ClassVar[dict[str, float]] = {
        "stiffness_spread": 0.9,
        "hinge_stiffness_spread": 0.9,
        "weight_spread": 0.9,
    }
    position_noise_mm: float = 0.0
    angle_noise_rad: float = 0.0
    stiffness_spread: float = 0.0
    hinge_stiffness_spread: float = 0.0
    weight_spread: float = 0.0
    actuator_offset_mm: float = 0.0

    @property
    def varies_mechanism(self) -> bool:
        """Whether episodes have arms of their own."""
        return self.stiffness_spread > 0 or self.hinge_stiffness_spread > 0 or self.weight_spread > 0


@dataclass(frozen=True)
class FlexibleArmConfig(TaskConfig):
    """Everything that defines the arm's task: the fields of every tracking task, see TaskConfig, and two more.

    Args:
        mechanism: preset name, mechanism file, or a HingeChain.
        start_tension, start_tension_range: at the start, before the payload acts [N].
        observe_load: whether the observation contains the direction of gravity and the payload.
        orientation: whether the tip has to turn into a target frame, too.
        load, target, reward, randomization, gravity: nested settings, each also a dictionary.
        sensing: likewise; "all" and "tip" are the same, for of an arm's pose only the tip is measured.
    Raises:
        ConfigError: a value out of range, with the range.
    """

    MECHANISM: ClassVar[type] = HingeChain
    MECHANISMS: ClassVar[str] = "a preset name or a mechanism file of an arm, or a HingeChain"
    _SWITCHES: ClassVar[tuple[str, ...]] = ("observe_tensions", "observe_load", "orientation")
    _NESTED: ClassVar[dict[str, type[Settings]]] = {
        "load": PayloadConfig,
        "target": ArmTargetConfig,
        "reward": ArmRewardConfig,
        "randomization": ArmRandomizationConfig,
        "gravity": GravityConfig,
    }
    mechanism: str | HingeChain = "flexible_arm"
    start_tension_range: Range = (1.0, 5.0)
    command_scale_mm: float = 30.0
    load: PayloadConfig = field(default_factory=PayloadConfig)
    target: ArmTargetConfig = field(default_factory=ArmTargetConfig)
    reward: ArmRewardConfig = field(default_factory=ArmRewardConfig)
    randomization: ArmRandomizationConfig = field(default_factory=ArmRandomizationConfig)
    orientation: bool = False
    gravity: GravityConfig = field(default_factory=GravityConfig)

    @property
    def sees_all(self) -> bool:
        """Whether all that sensors can measure of the pose is observed: of an arm, that is the tip."""
        return self.sensing.pose != "none"
