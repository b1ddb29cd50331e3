"""Settings of the tracking tasks: for every mechanism, for chains in the plane, and for arms in space."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from rj_gym.core.settings import LONGEST_EPISODE, Range, Settings
from rj_gym.tracking.sensing import PRIVILEGED, ActuationConfig, SensingConfig, checked_lags
from rj_gym.tracking.terms import Terms
from rollingjoint.chain.hinge import HingeChain
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.checks import as_boolean, as_choice, as_integer, as_number, as_range
from rollingjoint.errors import ConfigError
from rollingjoint.friction import LARGEST_MU, SMALLEST_PRESLIDING

_PLAIN_SENSING, _PLAIN_ACTUATION = SensingConfig(), ActuationConfig()

STARTS = ("equal", "random", "measured")
"""How the tensions of the start are chosen."""

PROCESSES = ("constant", "step", "ou")
"""How a load changes from step to step."""


class LoadSettings(Settings):
    """Settings of the loads in every task: a range of magnitudes, and how they change over time."""

    _SECTION: ClassVar[str] = "load."
    magnitude: Range
    process: str
    hold_steps: float
    correlation_steps: float

    def __post_init__(self) -> None:
        self._check(as_range, "magnitude", low=0.0, unit="N")
        self._check(as_choice, "process", choices=PROCESSES)
        self._check(as_number, "hold_steps", low=1.0)
        self._check(as_number, "correlation_steps", low=1e-3)


@dataclass(frozen=True)
class TargetConfig(Settings):
    """Where the tip should be: tips of equilibria, so that the mechanism can reach every target.

    Args:
        process: "fixed" for the whole episode, or "path": a smooth walk through `waypoints` reachable points.
        tension_range: tensions drawn log-uniformly per tendon [N]; unloaded, only their ratios matter.
        waypoints: number of drawn points of a path, its two ends included.
        loaded: whether the equilibria are those under the load with which the episode ends; else they are unloaded.
    """

    _SECTION: ClassVar[str] = "target."
    process: str = "fixed"
    tension_range: Range = (1.0, 6.0)
    waypoints: int = 3
    loaded: bool = False

    def __post_init__(self) -> None:
        self._check(as_boolean, "loaded")
        self._check(as_choice, "process", choices=("fixed", "path"))
        self._check(as_range, "tension_range", low=1e-3, unit="N")
        self._check(as_integer, "waypoints", low=2, high=1000)


@dataclass(frozen=True)
class RewardConfig(Settings):
    """Scales and weights of the reward terms.

    Args:
        error_scale_mm: tip error that costs 1 per step [mm].
        precision: cost of the last millimetre: tracking loses precision · error / (error + 1 mm) as well.
        effort: weight of mean((tension / largest tension)²).
        smoothness: weight of mean((action - previous action)²).
        failure_penalty: subtracted once when the solver finds no usable pose and the episode ends.
        goal: reward of the Goal environment, "dense" (the tracking term) or "sparse" (0 within the tolerance, else -1).
        goal_tolerance_mm: tip error that counts as reached when sparse [mm].
    """

    _SECTION: ClassVar[str] = "reward."
    error_scale_mm: float = 10.0
    effort: float = 0.01
    smoothness: float = 0.01
    failure_penalty: float = 100.0
    goal: str = "dense"
    goal_tolerance_mm: float = 2.0
    precision: float = 0.0

    def __post_init__(self) -> None:
        self._check(as_number, "error_scale_mm", low=1e-3)
        self._check(as_number, "effort", "precision", "smoothness", "failure_penalty", low=0.0)
        self._check(as_choice, "goal", choices=("dense", "sparse"))
        self._check(as_number, "goal_tolerance_mm", low=1e-6)


class Randomization(Settings):
    """Base of the randomisation settings: numbers of 0 or more, some limited by `_HIGHEST`."""

    _SECTION: ClassVar[str] = "randomization."
    _HIGHEST: ClassVar[dict[str, float]] = {}
    position_noise_mm: float
    angle_noise_rad: float

    def __post_init__(self) -> None:
        for name in (f.name for f in fields(self)):  # type: ignore[arg-type]
            self._check(as_number, name, low=0.0, high=self._HIGHEST.get(name, float("inf")))

    @property
    def sensor_noise(self) -> bool:
        """Whether measured poses differ from the true ones."""
        return self.position_noise_mm > 0 or self.angle_noise_rad > 0


@dataclass(frozen=True)
class FrictionConfig(Settings):
    """Capstan friction of the tendons in their holes, which remembers which way they slipped; it is not observed.

    Args:
        mu: coefficient of friction, 0 to 0.25: a number, or a range from which every episode draws uniformly.
        presliding: slip over which friction builds up, 0.01 or more [mm].
        shared: whether all tendons of an episode have the same coefficient.
    """

    _SECTION: ClassVar[str] = "friction."
    mu: Range = (0.0, 0.1)
    presliding: float = 0.02
    shared: bool = True

    def __post_init__(self) -> None:
        if not isinstance(self.mu, Sequence | np.ndarray):
            self._set("mu", (self.mu, self.mu))
        self._check(as_range, "mu", low=0.0, high=LARGEST_MU)
        self._check(as_number, "presliding", low=SMALLEST_PRESLIDING, high=10.0)
        self._check(as_boolean, "shared")


@dataclass(frozen=True)
class TaskConfig(Settings):
    """The settings that every tracking task has, and their checks.

    A task's own class says which mechanisms it takes, `MECHANISM` and in words, how many coordinates a position has,
    and the classes of nested settings.

    Args:
        mechanism: preset name, mechanism file, or a mechanism.
        episode_steps: steps until the episode is truncated.
        action_scale_mm: tendon length pulled in by an action of 1 [mm per step].
        tension_range: minimum and maximum tendon tension [N]. With `actuation.tension_limit` the maximum is only the
            unit of tensions in observations and rewards.
        start: "equal" tensions `start_tension`, "random" ones from `start_tension_range`, or "measured": motors are
            where their load cells show `start_tension`, whatever their offsets, sheaths and cells are.
        start_tension: tension of every tendon at the start, before the load acts [N].
        start_tension_range: range of the log-uniform start tensions [N].
        command_scale_mm: commanded lengths are observed in units of this [mm].
        observe_tensions: whether the observation contains the tendon tensions.
        observe_load: whether the observation contains the external force and the link where it acts.
        load, target, reward, randomization: nested settings, each also a dictionary.
        friction: a FrictionConfig or a dictionary; None leaves the mechanism its own friction, if it has any.
        sensing, actuation: nested settings, too, of sensors and motors.
        observe_history: past readings in the observation: those 1 to k steps ago for a number k, or a list of lags.
        privileged: where the true state can be read, hidden parts included: "off", "info" (as info["privileged"]), or
            "observation" (a Dict with it under "privileged", for critics).
        terms: own reward terms, observation entries, ends, targets and loads, a Terms.
    """

    DIMENSION: ClassVar[int] = 0
    MECHANISM: ClassVar[type[Any]] = object
    MECHANISMS: ClassVar[str] = "a mechanism"
    _NESTED: ClassVar[dict[str, type[Settings]]] = {}
    _SWITCHES: ClassVar[tuple[str, ...]] = ("observe_tensions", "observe_load")
    mechanism: Any = ""
    episode_steps: int = 50
    action_scale_mm: float = 1.0
    tension_range: Range = (0.5, 15.0)
    start: str = "equal"
    start_tension: float = 3.0
    start_tension_range: Range = (1.0, 6.0)
    command_scale_mm: float = 20.0
    observe_tensions: bool = True
    observe_load: bool = False
    load: Any = None
    target: TargetConfig = field(default_factory=TargetConfig)
    reward: RewardConfig = field(default_factory=RewardConfig)
    randomization: Any = None
    friction: FrictionConfig | None = None
    sensing: SensingConfig = field(default_factory=SensingConfig)
    actuation: ActuationConfig = field(default_factory=ActuationConfig)
    observe_history: int | Sequence[int] = 0
    privileged: str = "off"
    terms: Terms = field(default_factory=Terms)

    def __post_init__(self) -> None:
        if not isinstance(self.mechanism, str | self.MECHANISM):
            raise ConfigError("mechanism", self.mechanism, self.MECHANISMS)
        self._check(as_integer, "episode_steps", low=1, high=LONGEST_EPISODE)
        self._check(as_number, "action_scale_mm", "command_scale_mm", low=1e-6)
        self._check(as_range, "tension_range", low=0.0, unit="N")
        low, high = self.tension_range
        if low == high:
            raise ConfigError("tension_range", self.tension_range, "two different tensions (low, high) [N]")
        self._check(as_choice, "start", choices=STARTS)
        self._check(as_number, "start_tension", low=max(low, 1e-3), high=high)
        self._check(as_range, "start_tension_range", low=max(low, 1e-3), high=high, unit="N")
        self._check(as_boolean, *self._SWITCHES)
        self._check(as_choice, "privileged", choices=PRIVILEGED)
        self._set("observe_history", checked_lags(self.observe_history))
        nested = self._NESTED | {"sensing": SensingConfig, "actuation": ActuationConfig, "terms": Terms}
        self._check_nested(nested | ({} if self.friction is None else {"friction": FrictionConfig}))
        self._check_limit()

    def _check_limit(self) -> None:
        """Raise ConfigError for a limit at which motors could not hold the lowest tensions, or those of the start."""
        limit, (low, _) = self.actuation.tension_limit, self.tension_range
        if limit is None:
            return
        start = self.start_tension_range[1] if self.start == "random" else self.start_tension
        rubs = math.exp(self.actuation.sheath_friction[1]) if self.actuation.limit_at == "motor" else 1.0
        lowest = max(low * rubs, start)
        if not limit[0] > lowest:
            allowed = f"above {lowest:g} N, the tension of the start and what motors need for tension_range[0]"
            raise ConfigError("actuation.tension_limit", limit, allowed)

    @property
    def held_tensions(self) -> Range:
        """The tensions behind the sheath that controllers plan with where they do not know the limits [N].

        Up to the lowest limit that can be drawn. Where limits act before the sheath, also no higher than the middle
        limit behind the sheath with the most friction, and than `tension_range`.
        """
        (low, high), actuation = self.tension_range, self.actuation
        limit = actuation.tension_limit or (high, high)
        if actuation.limit_at == "tendon":
            return low, limit[0]
        return low, min(high, limit[0], 0.5 * sum(limit) / math.exp(actuation.sheath_friction[1]))

    @property
    def possible_tensions(self) -> Range:
        """All tensions behind the sheath that motors may have to hold: any where their limit acts before it [N]."""
        limit = self.actuation.tension_limit
        high = math.inf if self.actuation.limit_at == "motor" else self.tension_range[1] if limit is None else limit[1]
        return self.tension_range[0], high

    @property
    def yield_tensions(self) -> Range:
        """The tensions behind the sheath at which motors take tendons along; inf where settings do not fix one [N]."""
        low, high = self.possible_tensions
        drawn = self.actuation.tension_limit or (high, high)
        return low, high if drawn[0] == drawn[1] else math.inf

    @cached_property
    def lags(self) -> tuple[int, ...]:
        """How many steps ago the observed past readings are from."""
        past = self.observe_history
        return tuple(range(1, past + 1)) if isinstance(past, int) else tuple(past)

    @cached_property
    def is_instrumented(self) -> bool:
        """Whether readings can differ from the truth, motors from tendons, or more than the present is to be read."""
        plain = self.sensing == _PLAIN_SENSING and self.actuation == _PLAIN_ACTUATION
        return not plain or bool(self.lags) or self.privileged != "off"

    @property
    def sees_all(self) -> bool:
        """Whether all that sensors can measure of the pose is observed."""
        return self.sensing.pose == "all"

    @property
    def orientation(self) -> bool:
        """Whether the tip has to turn into a target frame, too: a setting of arms."""
        return False

    @property
    def target_numbers(self) -> int:
        """Numbers of a target: its position and, with orientation, a rotation matrix row by row."""
        return self.DIMENSION + (9 if self.orientation else 0)

    def has_friction(self, mechanism: Any) -> bool:
        """Whether episodes of this nominal mechanism take steps with friction."""
        return self.friction is not None or mechanism.has_friction


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

    DIMENSION: ClassVar[int] = 2
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
    """Scales and weights of the reward terms: as RewardConfig, and with `orientation` two more.

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

    DIMENSION: ClassVar[int] = 3
    MECHANISM: ClassVar[type] = HingeChain
    MECHANISMS: ClassVar[str] = "a preset name or a mechanism file of an arm, or a HingeChain"
    _SWITCHES: ClassVar[tuple[str, ...]] = (*TaskConfig._SWITCHES, "orientation")
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


@dataclass(frozen=True)
class PitchYawConfig(FlexibleArmConfig):
    """A slender instrument in space, of rolling joints about alternating axes, held at any attitude.

    The settings are those of FlexibleArmConfig with other defaults: gravity, along which the payload pulls, has any
    direction, and a joint counts as a hinge.

    Args:
        mechanism: preset name, mechanism file, or a SpatialChain.
        load, target, reward, randomization, gravity: nested settings, each also a dictionary.
    Raises:
        ConfigError: a value out of range, with the range.
    """

    MECHANISM: ClassVar[type] = SpatialChain
    MECHANISMS: ClassVar[str] = "a preset name or a mechanism file of a chain in space, or a SpatialChain"
    mechanism: Any = "pitch_yaw_two_segment"
    action_scale_mm: float = 0.5
    command_scale_mm: float = 10.0
    load: PayloadConfig = field(default_factory=lambda: PayloadConfig(magnitude=(0.0, 0.2)))
    target: ArmTargetConfig = field(default_factory=lambda: ArmTargetConfig(tension_range=(2.0, 8.0)))
    reward: ArmRewardConfig = field(default_factory=lambda: ArmRewardConfig(error_scale_mm=10.0, goal_tolerance_mm=2.0))
    gravity: GravityConfig = field(default_factory=lambda: GravityConfig(tilt=(0.0, math.pi)))
