"""Where the settings of a controller are searched: numbers and choices by the place of a setting."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Settings = dict[str, Any]  # plain and nested, as of Settings.from_dict
_NEAR = 0.15  # of a range: standard deviation of a change to a good value


@dataclass(frozen=True)
class Uniform:
    """Numbers from low to high; `digits` significant ones are kept."""

    low: float
    high: float
    digits: int = 3

    def drawn(self, rng: np.random.Generator) -> float:
        """A number anywhere in the range."""
        return self._at(rng.uniform())

    def near(self, value: float, rng: np.random.Generator) -> float:
        """A number near a value."""
        return self._at(self._share(value) + _NEAR * rng.standard_normal())

    def _at(self, share: float) -> float:
        value = self._value(min(max(share, 0.0), 1.0))
        return float(f"{value:.{self.digits}g}")

    def _value(self, share: float) -> float:
        return self.low + (self.high - self.low) * share

    def _share(self, value: float) -> float:
        return (value - self.low) / (self.high - self.low)


class LogUniform(Uniform):
    """Numbers from low to high, their logarithms uniform."""

    def _value(self, share: float) -> float:
        return self.low * (self.high / self.low) ** share

    def _share(self, value: float) -> float:
        return math.log(value / self.low) / math.log(self.high / self.low)


@dataclass(frozen=True)
class Choice:
    """One of some values."""

    values: Sequence[Any]

    def drawn(self, rng: np.random.Generator) -> Any:
        """Any of them."""
        return self.values[int(rng.integers(len(self.values)))]

    def near(self, value: Any, rng: np.random.Generator) -> Any:
        """The same one, or now and then another."""
        return self.drawn(rng) if rng.uniform() < 2 * _NEAR else value


Space = dict[str, Uniform | Choice]
"""By the place of a setting, such as "filter.tension_sd"."""


def drawn_settings(space: Space, rng: np.random.Generator) -> Settings:
    """Settings anywhere in the space."""
    return nested({place: some.drawn(rng) for place, some in space.items()})


def settings_near(space: Space, settings: Settings, rng: np.random.Generator) -> Settings:
    """Settings near others: about half of them change."""
    return nested(
        {
            place: some.near(value_at(settings, place), rng) if rng.uniform() < 0.5 else value_at(settings, place)
            for place, some in space.items()
        }
    )


def nested(values: Mapping[str, Any]) -> Settings:
    """Settings by place as nested ones."""
    settings: Settings = {}
    for place, value in values.items():
        *sections, name = place.split(".")
        inner = settings
        for section in sections:
            inner = inner.setdefault(section, {})
        inner[name] = value
    return settings


def value_at(settings: Mapping[str, Any], place: str) -> Any:
    """The setting at a place."""
    found: Any = settings
    for name in place.split("."):
        found = found[name]
    return found


def with_settings(settings: Mapping[str, Any], changes: Mapping[str, Any]) -> Settings:
    """Settings with others on top, section by section."""
    merged = dict(settings)
    for name, value in changes.items():
        merged[name] = with_settings(merged.get(name, {}), value) if isinstance(value, dict) else value
    return merged
