"""Settings of sensors and motors; all off by default."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from rj_gym.core.settings import Range, Settings
from rollingjoint.checks import as_choice, as_integer, as_number, as_range
from rollingjoint.errors import ConfigError

POSES = ("all", "tip", "none")
"""Parts of the pose that can be observed."""

LOAD_CELLS = ("motor", "tendon")
"""Places of load cells: before the sheath, or behind it."""

LIMITS = ("tendon", "motor")
"""Where the upper limit of tension acts: behind play and sheath, or before them."""

PRIVILEGED = ("off", "info", "observation")
"""Where the true state can be read."""

LARGEST_PLAY = 20.0  # mm
LARGEST_SHEATH = 1.0
LARGEST_LIMIT = 1e4  # N
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
        tension_at: place of the load cells: "motor", where they measure T exp(nu zeta), or "tendon", behind the sheath,
            where they measure T.
        tension_gain_error: load cells show 1 + uniform(-error, error) times their tension, drawn per tendon and
            episode.
        tension_offset: they are also off by a constant uniform(-offset, offset), drawn likewise [N].
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
    tension_at: str = "motor"
    tension_gain_error: float = 0.0
    tension_offset: float = 0.0

    def __post_init__(self) -> None:
        self._check(as_choice, "pose", choices=POSES)
        self._check(as_integer, "period", low=1, high=1000)
        self._check(as_integer, "delay", low=0, high=LONGEST_DELAY)
        self._check(as_number, "position_bias_mm", "encoder_noise_mm", "encoder_resolution_mm", low=0.0, high=100.0)
        self._check(as_number, "angle_bias_rad", low=0.0, high=1.0)
        self._check(as_number, "tension_noise", "tension_resolution", "tension_offset", low=0.0, high=100.0)
        self._check(as_choice, "tension_at", choices=LOAD_CELLS)
        self._check(as_number, "tension_gain_error", low=0.0, high=0.9)

    @property
    def biased(self) -> bool:
        """Whether measured poses are off by a constant."""
        return self.position_bias_mm > 0 or self.angle_bias_rad > 0

    @property
    def cells_err(self) -> bool:
        """Whether load cells have errors of gain or offset."""
        return self.tension_gain_error > 0 or self.tension_offset > 0

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
        dead_band_mm: a motor's position servo is at rest while it is within this of where it is commanded, and stops as
            soon as it is [mm].
        tension_limit: upper limit of tension [N]: a number, or a range from which every tendon of an episode draws
            uniformly; None: the upper end of `tension_range`, which otherwise only scales observations and rewards.
        limit_at: where that limit acts. "tendon": on T, and the motor moves along. "motor": on T exp(nu zeta), as a
            limit of current does; a motor that pulls stops where it reaches its limit, all motors of a step together;
            at rest it holds whatever the tension becomes, and paying out is free.
        current_resolution: limits are whole multiples of this, one count of a motor's current; 0: any limits [N].
    """

    _SECTION: ClassVar[str] = "actuation."
    play_mm: Range = (0.0, 0.0)
    sheath_friction: Range = (0.0, 0.0)
    rate_limit_mm: float | None = None
    delay: int = 0
    dead_band_mm: float = 0.0
    tension_limit: Range | None = None
    limit_at: str = "tendon"
    current_resolution: float = 0.0

    def __post_init__(self) -> None:
        for name, high in (("play_mm", LARGEST_PLAY), ("sheath_friction", LARGEST_SHEATH)):
            self._check(_as_spread, name, low=0.0, high=high)
        if self.rate_limit_mm is not None:
            self._check(as_number, "rate_limit_mm", low=1e-6)
        self._check(as_integer, "delay", low=0, high=LONGEST_DELAY)
        self._check(as_number, "dead_band_mm", low=0.0, high=LARGEST_PLAY)
        self._check(as_choice, "limit_at", choices=LIMITS)
        self._check(as_number, "current_resolution", low=0.0, high=100.0)
        if self.tension_limit is not None:
            self._check(_as_spread, "tension_limit", low=1e-3, high=LARGEST_LIMIT, unit="N")

    @property
    def limits_vary(self) -> bool:
        """Whether upper limits of tension have to be kept per tendon, or act at motors."""
        return self.tension_limit is not None or self.limit_at == "motor"


def _as_spread(what: str, value: Any, low: float, high: float, error: type[ConfigError], unit: str = "") -> Range:
    """A range from which numbers are drawn; of one number, the range that holds it alone."""
    if not isinstance(value, Sequence | np.ndarray):
        value = (value, value)
    if np.shape(value) == (1,) and not isinstance(value, str):
        only = as_number(what, value[0], low, high, error=error)
        allowed = f"a number or two, (low, high) [{unit}]" if unit else "a number or two, (low, high)"
        raise error(what, value, allowed, f"Write {only:g} or ({only:g}, {only:g}).")
    return as_range(what, value, low, high, unit=unit, error=error)


def checked_lags(value: object) -> int | tuple[int, ...]:
    """The setting observe_history: a number of lags, or different lags in order; raises ConfigError for others."""
    what, allowed = "observe_history", f"0 to {LONGEST_LAG}, or a list of different lags from 1 to {LONGEST_LAG}"
    if not isinstance(value, Sequence | np.ndarray) or isinstance(value, str):
        return as_integer(what, value, 0, LONGEST_LAG, allowed=allowed, error=ConfigError)
    lags = tuple(as_integer(what, lag, 1, LONGEST_LAG, allowed=allowed, error=ConfigError) for lag in value)
    if not lags or len(set(lags)) < len(lags):
        raise ConfigError(what, value, allowed)
    return tuple(sorted(lags))
