"""Frozen settings of the tracking environments: built from keywords, dictionaries or YAML, checked once.

What the tasks share, and the settings of the planar one; those of the arm are in rj_gym/arm/config.py.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

from rj_gym.core.settings import Range, Settings, assign, check_choice, checked_count, checked_number, checked_range
from rollingjoint.errors import ConfigError
from rollingjoint.planar.chain import RollingChain

PROCESSES = ("constant", "step", "ou")
"""How a load goes on from step to step."""


@dataclass(frozen=True)
class LoadConfig(Settings):
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
        check_choice("load.link", self.link, ("random", "tip"))
        check_load(self)


def check_load(load: Any) -> None:
    """Check what the loads of every task have: magnitude, process and its times."""
    assign(load, "magnitude", checked_range("load.magnitude", load.magnitude, low=0.0, unit="N"))
    check_choice("load.process", load.process, PROCESSES)
    assign(load, "hold_steps", checked_number("load.hold_steps", load.hold_steps, low=1.0))
    assign(load, "correlation_steps", checked_number("load.correlation_steps", load.correlation_steps, low=1e-3))


@dataclass(frozen=True)
class TargetConfig(Settings):
    """Where the tip should be: tips of unloaded equilibria, so that the unloaded mechanism reaches every target.

    Args:
        process: "fixed" for the whole episode, or "path": a smooth walk through `waypoints` reachable points.
        tension_range: tensions drawn log-uniformly per tendon [N]; unloaded, only their ratios matter.
        waypoints: number of drawn points of a path, its two ends included.
    """

    process: str = "fixed"
    tension_range: Range = (1.0, 6.0)
    waypoints: int = 3

    def __post_init__(self) -> None:
        check_choice("target.process", self.process, ("fixed", "path"))
        assign(self, "tension_range", checked_range("target.tension_range", self.tension_range, low=1e-3, unit="N"))
        assign(self, "waypoints", checked_count("target.waypoints", self.waypoints, low=2))


@dataclass(frozen=True)
class RewardConfig(Settings):
    """Scales and weights of the reward terms.

    Args:
        error_scale_mm: tip error that costs 1 per step [mm].
        effort: weight of mean((tension / largest tension)²).
        smoothness: weight of mean((action - previous action)²).
        failure_penalty: subtracted once when the solver gives no usable pose and the episode ends.
        goal: reward of the Goal environment, "dense" (the tracking term) or "sparse" (0 within the tolerance, else -1).
        goal_tolerance_mm: tip error that counts as reached when sparse [mm].
    """

    error_scale_mm: float = 10.0
    effort: float = 0.01
    smoothness: float = 0.01
    failure_penalty: float = 100.0
    goal: str = "dense"
    goal_tolerance_mm: float = 2.0

    def __post_init__(self) -> None:
        assign(self, "error_scale_mm", checked_number("reward.error_scale_mm", self.error_scale_mm, low=1e-3))
        for name in ("effort", "smoothness", "failure_penalty"):
            assign(self, name, checked_number(f"reward.{name}", getattr(self, name)))
        check_choice("reward.goal", self.goal, ("dense", "sparse"))
        assign(self, "goal_tolerance_mm", checked_number("reward.goal_tolerance_mm", self.goal_tolerance_mm, low=1e-6))


class Randomization(Settings):
    """What the randomisation of every task shares: numbers from 0 on, `_HIGHEST` of some."""

    _HIGHEST: ClassVar[dict[str, float]] = {}
    position_noise_mm: float
    angle_noise_rad: float

    def __post_init__(self) -> None:
        for name in (f.name for f in fields(self)):  # type: ignore[arg-type]
            high = self._HIGHEST.get(name, math.inf)
            assign(self, name, checked_number(f"randomization.{name}", getattr(self, name), high=high))

    @property
    def sensor_noise(self) -> bool:
        """Whether measured poses differ from the true ones."""
        return self.position_noise_mm > 0 or self.angle_noise_rad > 0


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


class TaskConfig(Settings):
    """What the settings of every tracking task share: fields of these names, and their checks.

    A class of settings says which mechanisms it takes, `MECHANISM` and in words, and of which classes its nested
    settings are.
    """

    MECHANISM: ClassVar[type] = object
    MECHANISMS: ClassVar[str] = "a mechanism"
    _NESTED: ClassVar[dict[str, type[Settings]]] = {}
    _SWITCHES: ClassVar[tuple[str, ...]] = ("observe_tensions", "observe_load")
    mechanism: Any
    episode_steps: int
    action_scale_mm: float
    tension_range: Range
    start: str
    start_tension: float
    start_tension_range: Range
    command_scale_mm: float
    observe_tensions: bool
    observe_load: bool
    load: Any
    target: TargetConfig
    reward: RewardConfig
    randomization: Any

    def __post_init__(self) -> None:
        if not isinstance(self.mechanism, str | self.MECHANISM):
            raise ConfigError("mechanism", self.mechanism, self.MECHANISMS)
        assign(self, "episode_steps", checked_count("episode_steps", self.episode_steps, low=1))
        for name in ("action_scale_mm", "command_scale_mm"):
            assign(self, name, checked_number(name, getattr(self, name), low=1e-6))
        assign(self, "tension_range", checked_range("tension_range", self.tension_range, low=0.0, unit="N"))
        lo, hi = self.tension_range
        if lo == hi:
            raise ConfigError("tension_range", self.tension_range, "two different tensions (low, high) [N]")
        check_choice("start", self.start, ("equal", "random"))
        assign(self, "start_tension", checked_number("start_tension", self.start_tension, low=max(lo, 1e-3), high=hi))
        assign(
            self,
            "start_tension_range",
            checked_range("start_tension_range", self.start_tension_range, low=max(lo, 1e-3), high=hi, unit="N"),
        )
        for name in self._SWITCHES:
            if not isinstance(getattr(self, name), bool):
                raise ConfigError(name, getattr(self, name), "True or False")
        self._check_nested()

    def _check_nested(self) -> None:
        for name, kind in self._NESTED.items():
            value = getattr(self, name)
            if isinstance(value, Mapping):
                assign(self, name, kind.from_dict(value))
            elif not isinstance(value, kind):
                raise ConfigError(name, value, f"a dictionary or a {kind.__name__}")


@dataclass(frozen=True)
class TrackingConfig(TaskConfig):
    """Everything that defines the tracking task.

    Args:
        mechanism: preset name, mechanism file, or a RollingChain.
        episode_steps: steps until the episode is truncated.
        action_scale_mm: tendon length pulled in by an action of 1 [mm per step].
        tension_range: what a motor holds at least and where it gives way [N].
        start: "equal" tensions `start_tension`, or "random" ones from `start_tension_range`.
        start_tension: tension of every tendon at the start, before the load acts [N].
        start_tension_range: range of the log-uniform start tensions [N].
        command_scale_mm: commanded lengths are observed in units of this [mm].
        observe_tensions: whether the observation contains the tendon tensions.
        observe_load: whether the observation contains the external force and the link where it acts.
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
    episode_steps: int = 50
    action_scale_mm: float = 1.0
    tension_range: Range = (0.5, 15.0)
    start: str = "equal"
    start_tension: float = 3.0
    start_tension_range: Range = (1.0, 6.0)
    command_scale_mm: float = 20.0
    observe_tensions: bool = True
    observe_load: bool = False
    load: LoadConfig = field(default_factory=LoadConfig)
    target: TargetConfig = field(default_factory=TargetConfig)
    reward: RewardConfig = field(default_factory=RewardConfig)
    randomization: RandomizationConfig = field(default_factory=RandomizationConfig)
