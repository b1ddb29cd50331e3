"""What every settings class shares: construction from plain dictionaries, and checks of single values."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from numbers import Real
from typing import Any, Self

from rollingjoint.checks import suggestion
from rollingjoint.errors import ConfigError

Range = tuple[float, float]

_LARGEST = sys.float_info.max


class Settings:
    """Construction from plain dictionaries, shared by every settings class."""

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """The defaults with `values` on top; nested settings are dictionaries.

        Raises:
            ConfigError: an unknown key (with the nearest valid one) or a value out of range.
        """
        return cls().updated(values)

    def updated(self, values: Mapping[str, Any]) -> Self:
        """These settings with `values` on top; a nested dictionary changes only the keys that it names."""
        if not isinstance(values, Mapping):
            raise ConfigError(type(self).__name__, values, "a dictionary of settings")
        valid = [f.name for f in fields(self)]  # type: ignore[arg-type]
        merged = {}
        for key, value in values.items():
            if key not in valid:
                raise ConfigError(
                    f"{type(self).__name__} key", key, f"one of {', '.join(valid)}", suggestion(str(key), valid)
                )
            current = getattr(self, key)
            nested = isinstance(current, Settings) and isinstance(value, Mapping)
            merged[key] = current.updated(value) if nested else value
        return replace(self, **merged)  # type: ignore[type-var]


def assign(settings: Settings, name: str, value: object) -> None:
    """Set a field of frozen settings while they are being built."""
    object.__setattr__(settings, name, value)


def check_choice(name: str, value: object, choices: tuple[str, ...]) -> None:
    """Raise ConfigError, with the nearest choice, for a value that is none of them."""
    if value not in choices:
        raise ConfigError(name, value, " or ".join(map(repr, choices)), suggestion(str(value), choices))


def checked_number(name: str, value: object, low: float = 0.0, high: float = math.inf) -> float:
    """The value as a float; ConfigError unless it is a finite number within the bounds."""
    number = isinstance(value, Real) and not isinstance(value, bool)
    if not number or not max(low, -_LARGEST) <= value <= min(high, _LARGEST):  # type: ignore[operator]
        upper = "" if high == math.inf else f" and <= {high:g}"
        raise ConfigError(name, value, f"a finite number >= {low:g}{upper}")
    return float(value)  # type: ignore[arg-type]


def checked_count(name: str, value: object, low: int) -> int:
    """The value as an int; ConfigError unless it is a whole number of at least `low`."""
    number = checked_number(name, value, low)
    if number != int(number):
        raise ConfigError(name, value, f"a whole number >= {low}")
    return int(number)


def checked_range(name: str, value: object, low: float, high: float = math.inf, unit: str = "") -> Range:
    """Two numbers in order within the bounds; ConfigError for anything else."""
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != 2:
        raise ConfigError(name, value, f"two numbers (low, high) [{unit}]")
    first, second = (checked_number(name, number, low, high) for number in value)
    if first > second:
        raise ConfigError(name, value, f"low <= high [{unit}]", f"Write ({second:g}, {first:g}).")
    return first, second
