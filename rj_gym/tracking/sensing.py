"""Settings of sensors and motors; all off by default."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rj_gym.core.settings import Range, Settings
from rollingjoint.checks import as_choice, as_integer, as_number, as_range
from rollingjoint.errors import ConfigError

POSES = ("all", "tip", "none")
"""Parts of the pose that can be observed."""

PRIVILEGED = ("off", "info", "observation")
"""Where the true state can be read."""

LARGEST_PLAY = 20.0  # mm
LARGEST_SHEATH = 1.0
LONGEST_DELAY = 100  # steps
LONGEST_LAG = 200  # steps


@dataclass(frozen=True)
class SensingConfig(Settings):
    """Sensors. Noise of poses is in RandomizationConfig; biases and noise are hidden.

    Args:
        pose: the part of the pose that is observed: "all", "tip" (of the last link alone) or "none".
        period: a picture of the pose comes at every period-th step, counted from a random one.
        delay: age of a picture when it comes [steps]. Every episode begins with a picture of its start.
        position_bias_mm: all measured positions are off by a constant uniform(-bias, bias) per coordinate [mm].
        angle_bias_rad: the same for measured angles [rad].
        encoder_noise_mm: standard deviation of the measured motor positions, every step [mm].
        encoder_resolution_mm: measured motor positions are rounded to multiples of this; 0: not at all [mm].
        tension_noise: standard deviation of the measured tensions, every step [N].
        tension_resolution: measured tensions are rounded to multiples of this; 0: not at all [N].
    """

    _SECTION: ClassVar[str] = "sensing."
    pose: str = "all"
    period: int = 1
    delay: int = 0
    position_bias_mm: float = 0.0
    angle_bias_rad: float = 0.0
    encoder_noise_mm: float = 0.0
    encoder_resolution_mm: float = 0.0
    tension_noise: float = 0.0
    tension_resolution: float = 0.0

    def __post_init__(self) -> None:
        self._check(as_choice, "pose", choices=POSES)
        self._check(as_integer, "period", low=1, high=1000)
        self._check(as_integer, "delay", low=0, high=LONGEST_DELAY)
        self._check(as_number, "position_bias_mm", "encoder_noise_mm", "encoder_resolution_mm", low=0.0, high=100.0)
        self._check(as_number, "angle_bias_rad", low=0.0, high=1.0)
        self._check(as_number, "tension_noise", "tension_resolution", low=0.0, high=100.0)

    @property
    def biased(self) -> bool:
        """Whether measured poses are off by a constant."""
        return self.position_bias_mm > 0 or self.angle_bias_rad > 0

    @property
    def late(self) -> bool:
        """Whether pictures can be old."""
        return self.pose != "none" and (self.period > 1 or self.delay > 0)


@dataclass(frozen=True)
class ActuationConfig(Settings):
    """How motors move tendons. A motor's position q and the tendon's command p differ by play; only q is measured.

    Args:
        play_mm: width of the play between motor and tendon, 0 to 20 mm: a number, or a range from which every tendon of
            an episode draws uniformly. p stays within half a width of q; it starts anywhere in there.
        sheath_friction: coefficient nu, 0 to 1, of the friction between motor and tendon, drawn likewise: the motor
            measures T exp(nu zeta) of a tension T, zeta = (p - q) / (half the width), 1 while the motor pulls in.
        rate_limit_mm: the farthest that a motor moves in a step, on the way to where it is commanded; None: any way.
        delay: actions act this many steps late.
    """

    _SECTION: ClassVar[str] = "actuation."
    play_mm: Range = (0.0, 0.0)
    sheath_friction: Range = (0.0, 0.0)
    rate_limit_mm: float | None = None
    delay: int = 0

    def __post_init__(self) -> None:
        for name, high in (("play_mm", LARGEST_PLAY), ("sheath_friction", LARGEST_SHEATH)):
            value = getattr(self, name)
            if not isinstance(value, Sequence | np.ndarray):
                self._set(name, (value, value))
            self._check(as_range, name, low=0.0, high=high)
        if self.rate_limit_mm is not None:
            self._check(as_number, "rate_limit_mm", low=1e-6)
        self._check(as_integer, "delay", low=0, high=LONGEST_DELAY)


def checked_lags(value: object) -> int | tuple[int, ...]:
    """The setting observe_history: a number of lags, or different lags in order; raises ConfigError for others."""
    what, allowed = "observe_history", f"0 to {LONGEST_LAG}, or a list of different lags from 1 to {LONGEST_LAG}"
    if not isinstance(value, Sequence | np.ndarray) or isinstance(value, str):
        return as_integer(what, value, 0, LONGEST_LAG, allowed=allowed, error=ConfigError)
    lags = tuple(as_integer(what, lag, 1, LONGEST_LAG, allowed=allowed, error=ConfigError) for lag in value)
    if not lags or len(set(lags)) < len(lags):
        raise ConfigError(what, value, allowed)
    return tuple(sorted(lags))
