"""Settings of the planar tracking task; what every tracking task has is in rj_gym/core/config.py."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rj_gym.core.config import LoadSettings, Randomization, RewardConfig, TargetConfig, TaskConfig
from rj_gym.core.settings import Range, Settings
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.checks import as_choice


@dataclass(frozen=True)
class LoadConfig(LoadSettings):
    """The external force: a dead load at the origin of one moving link, its direction uniform.

    Args:
        magnitude: range of the uniform magnitude [N].
        link: "random" (uniform over the moving links, the tip included) or "tip".
        process: "constant"; "step" (jumps to a new draw at random times); "ou" (an Ornstein-Uhlenbeck process per
            component, stationary standard deviation half the largest magnitude, force clipped to that magnitude).
        hold_steps: mean number of steps between two jumps of "step".
        correlation_steps: correlation time of "ou" [steps].
    """

    magnitude: Range = (0.0, 1.0)
    link: str = "random"
    process: str = "constant"
    hold_steps: float = 15.0
    correlation_steps: float = 15.0

    def __post_init__(self) -> None:
        self._check(as_choice, "link", choices=("random", "tip"))
        super().__post_init__()


@dataclass(frozen=True)
class RandomizationConfig(Randomization):
    """Domain randomisation, drawn anew in every episode; all zero (off) by default.

    Args:
        position_noise_mm: standard deviation of the measured link positions, every step [mm].
        angle_noise_rad: standard deviation of the measured link angles, every step [rad].
        stiffness_spread: tendon stiffness is multiplied by 1 + uniform(-spread, spread).
        link_tolerance_mm: every contact surface shifts on its link by uniform(-tol, tol) in x and in y [mm].
        link_tolerance_rad: every contact surface turns on its link by uniform(-tol, tol) [rad].
        actuator_offset_mm: every length command is off by a constant uniform(-offset, offset) [mm].
    """

    _HIGHEST: ClassVar[dict[str, float]] = {
        "stiffness_spread": 0.9,
        "link_tolerance_mm": 2.0,
        "link_tolerance_rad": 0.2,
    }
    position_noise_mm: float = 0.0
    angle_noise_rad: float = 0.0
    stiffness_spread: float = 0.0
    link_tolerance_mm: float = 0.0
    link_tolerance_rad: float = 0.0
    actuator_offset_mm: float = 0.0

    @property
    def varies_mechanism(self) -> bool:
        """Whether episodes have mechanisms of their own."""
        return self.stiffness_spread > 0 or self.link_tolerance_mm > 0 or self.link_tolerance_rad > 0


@dataclass(frozen=True)
class TrackingConfig(TaskConfig):
    """Everything that defines the planar tracking task: the fields of every tracking task, see TaskConfig.

    Args:
        mechanism: preset name, mechanism file, or a RollingChain.
        load, target, reward, randomization: nested settings, each also a dictionary.
    Raises:
        ConfigError: a value out of range, with the range.
    """

    MECHANISM: ClassVar[type] = RollingChain
    MECHANISMS: ClassVar[str] = "a preset name, a mechanism file or a RollingChain"
    _NESTED: ClassVar[dict[str, type[Settings]]] = {
        "load": LoadConfig,
        "target": TargetConfig,
        "reward": RewardConfig,
        "randomization": RandomizationConfig,
    }
    mechanism: str | RollingChain = "five_link"
    load: LoadConfig = field(default_factory=LoadConfig)
    randomization: RandomizationConfig = field(default_factory=RandomizationConfig)
