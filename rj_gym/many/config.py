"""Settings of tracking with many mechanisms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, ClassVar

from rj_gym.core.settings import Settings
from rj_gym.many.designs import MOST_LINKS, DrawnDesigns, plain_space
from rj_gym.tracking.config import (
    ArmTargetConfig,
    FrictionConfig,
    PayloadConfig,
    PitchYawConfig,
    TaskConfig,
    TrackingConfig,
)
from rj_gym.tracking.terms import Terms
from rollingjoint.checks import as_integer
from rollingjoint.errors import ConfigError
from rollingjoint.io.mechanism_file import mechanism_to_dict

LARGEST_NUMBER = 2**31
"""Designs have numbers below this."""


@dataclass(frozen=True)
class MechanismsConfig(Settings):
    """The mechanisms from which episodes draw.

    Design k is always the same: its number of links, uniform over `links`, and a valid design of the space with that
    number of links, uniform in the space's box, come from a random generator with the seed k. So designs for
    training, for choosing and for tests are ranges that do not overlap.

    Args:
        space: the designs: fields of rollingjoint.design.DesignSpace but n_links, or with `mechanism` those of
            MechanismSpace, a dictionary or such a space; by default links need not be symmetric.
        links: fewest and most links, the base included, 2 to 16; of designs around a mechanism twice its number.
        designs: numbers of the designs, (first, last + 1); an episode draws one of them uniformly.
    Raises:
        ConfigError: a value that cannot be used, with the allowed ones.
    """

    _SECTION: ClassVar[str] = "mechanisms."
    DIMENSION: ClassVar[int] = 2
    space: Mapping[str, Any] = field(default_factory=lambda: {"symmetric": False})
    links: tuple[int, int] = (3, 8)
    designs: tuple[int, int] = (0, 256)

    def __post_init__(self) -> None:
        self._set("space", plain_space(self.space, self.DIMENSION))
        self._set("links", _whole_range("mechanisms.links", self.links, 2, MOST_LINKS, 0))
        self._set("designs", _whole_range("mechanisms.designs", self.designs, 0, LARGEST_NUMBER, 1))
        self.drawn  # noqa: B018  (spaces whose designs cannot have these links are refused here)

    @cached_property
    def drawn(self) -> DrawnDesigns:
        """The designs."""
        return DrawnDesigns.of(self.space, self.DIMENSION, self.links)


@dataclass(frozen=True)
class MechanismsInSpaceConfig(MechanismsConfig):
    """The mechanisms from which episodes draw, as MechanismsConfig, of links that roll on each other in space.

    Args:
        space: the designs: fields of rollingjoint.design.SpatialDesignSpace but n_joints, or with `mechanism` those of
            MechanismSpace, a dictionary or such a space. `ends` are of designs with the most links; in shorter ones
            rings of tendons end at the same shares of the joints. By default joints are up to 0.3 rad off pitch or yaw.
        links, designs: as in MechanismsConfig.
    Raises:
        ConfigError: a value that cannot be used, with the allowed ones.
    """

    DIMENSION: ClassVar[int] = 3
    space: Mapping[str, Any] = field(default_factory=lambda: {"azimuth": [-0.3, 0.3]})


class ManyMechanismsSettings(Settings):
    """What settings of tracking with many mechanisms add to those of one, in the plane and in space.

    Attributes:
        ONE: the class of the settings with one mechanism. SPREADS: of randomization, those of the mechanism.
    """

    ONE: ClassVar[type[TaskConfig]]
    SPREADS: ClassVar[tuple[str, ...]]
    mechanism: Any
    mechanisms: MechanismsConfig
    randomization: Any
    friction: FrictionConfig | None
    terms: Terms

    def _check_designs_alone(self) -> None:
        """Raise ConfigError where mechanisms differ by more than their designs."""
        self._check_mechanism()
        for name in self.SPREADS:
            if getattr(self.randomization, name) > 0.0:
                hint = "Mechanisms differ by their designs, in `mechanisms`."
                raise ConfigError(f"randomization.{name}", getattr(self.randomization, name), "0", hint)
        hint = "Friction of tendons is for environments with one mechanism."
        if self.friction is not None:
            raise ConfigError("friction", self.friction, "None with many mechanisms", hint)
        longest = self.mechanisms.drawn.reference(self.mechanisms.links[1])
        if longest.has_friction:
            raise ConfigError("mechanisms.space", longest, "a mechanism without friction", hint)
        if self.terms != Terms():
            raise ConfigError("terms", "own functions", "none with many mechanisms", "Write a wrapper of Gymnasium.")

    def _check_mechanism(self) -> None:
        """Raise ConfigError for a mechanism other than the longest plain chain of the space, or none."""
        if self.mechanism == "":
            return
        given, reference = self.mechanism, self.mechanisms.drawn.reference(self.mechanisms.links[1])
        if isinstance(given, str) or _numbers(given) != _numbers(reference):
            hint = "rj_gym/RollingJoint-v0 and rj_gym/PitchYaw-v0 have one mechanism."
            raise ConfigError("mechanism", given, "'': mechanisms come from `mechanisms`", hint)
        self._set("mechanism", reference)

    def of_one(self, mechanism: Any) -> TaskConfig:
        """The settings of the environment with this mechanism alone, and all else as here."""
        values = {entry.name: getattr(self, entry.name) for entry in fields(self.ONE)}
        return self.ONE(**values | {"mechanism": mechanism})


@dataclass(frozen=True)
class ManyMechanismsConfig(ManyMechanismsSettings, TrackingConfig):
    """Everything that defines tracking with many mechanisms: the fields of TrackingConfig, see there, and one more.

    Mechanisms differ by their designs alone: without friction, without randomised surfaces and stiffnesses, without
    own terms.

    Args:
        mechanism: not to be set; of the task it is the plain chain with the most links, after which entries are named.
        mechanisms: a MechanismsConfig or a dictionary of its fields.
    Raises:
        ConfigError: a value out of range, with the range.
    """

    ONE: ClassVar[type[TaskConfig]] = TrackingConfig
    SPREADS: ClassVar[tuple[str, ...]] = ("stiffness_spread", "link_tolerance_mm", "link_tolerance_rad")
    _NESTED: ClassVar[dict[str, type[Settings]]] = TrackingConfig._NESTED | {"mechanisms": MechanismsConfig}
    mechanism: Any = ""
    mechanisms: MechanismsConfig = field(default_factory=MechanismsConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_designs_alone()


@dataclass(frozen=True)
class ManyMechanismsInSpaceConfig(ManyMechanismsSettings, PitchYawConfig):
    """Everything that defines tracking with many mechanisms in space: the fields of PitchYawConfig, and one more.

    Mechanisms differ by their designs alone, as in ManyMechanismsConfig. Targets are tips under the payload: the tip of
    a mechanism with four tendons moves on a surface, off which a payload pushes it.

    Args:
        mechanism: not to be set; of the task it is the plain chain with the most links, after which entries are named.
        mechanisms: a MechanismsInSpaceConfig or a dictionary of its fields.
    Raises:
        ConfigError: a value out of range, with the range.
    """

    ONE: ClassVar[type[TaskConfig]] = PitchYawConfig
    SPREADS: ClassVar[tuple[str, ...]] = ("stiffness_spread", "hinge_stiffness_spread", "weight_spread")
    _NESTED: ClassVar[dict[str, type[Settings]]] = PitchYawConfig._NESTED | {"mechanisms": MechanismsInSpaceConfig}
    mechanism: Any = ""
    load: PayloadConfig = field(default_factory=lambda: PayloadConfig(magnitude=(0.0, 1.0)))
    target: ArmTargetConfig = field(default_factory=lambda: ArmTargetConfig(tension_range=(2.0, 8.0), loaded=True))
    mechanisms: MechanismsInSpaceConfig = field(default_factory=MechanismsInSpaceConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_designs_alone()


def _numbers(mechanism: Any) -> dict[str, Any]:
    """A mechanism as plain values, without its name."""
    return mechanism_to_dict(mechanism) | {"name": ""}


def _whole_range(what: str, value: Any, low: int, high: int, apart: int) -> tuple[int, int]:
    """Two whole numbers (first, last) within [low, high], the last at least `apart` above; ConfigError for others."""
    allowed = f"two whole numbers from {low} to {high}, the second {'above' if apart else 'not below'} the first"
    try:
        first, last = value
    except (TypeError, ValueError):
        raise ConfigError(what, value, allowed) from None
    pair = tuple(as_integer(what, number, low, high, allowed=allowed, error=ConfigError) for number in (first, last))
    if pair[1] - pair[0] < apart:
        raise ConfigError(what, value, allowed)
    return pair[0], pair[1]
