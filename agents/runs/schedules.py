"""Checks for values that come from a configuration file; each raises ConfigError naming the key."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rollingjoint.checked_yaml import mapping
from rollingjoint.checks import suggestion
from rollingjoint.errors import ConfigError


@dataclass(frozen=True)
class Linear:
    """A schedule from `start` to `end`, linear in the steps done; called with the share that remains."""

    start: float
    end: float

    def __call__(self, progress_remaining: float) -> float:
        """The value when this share of the steps remains."""
        return self.end + (self.start - self.end) * progress_remaining


def check_integer(what: str, value: Any, low: int, high: float = math.inf) -> None:
    """Accept an integer in [low, high]."""
    allowed = f"an integer >= {low}" if high == math.inf else f"an integer from {low} to {high}"
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise ConfigError(what, value, allowed)


def check_number(what: str, value: Any, low: float = -math.inf, high: float = math.inf) -> None:
    """Accept a finite number in [low, high]."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not math.isfinite(value) or not low <= value <= high:
        raise ConfigError(what, value, f"a finite number from {low:g} to {high:g}")


def check_boolean(what: str, value: Any) -> None:
    """Accept true or false."""
    if not isinstance(value, bool):
        raise ConfigError(what, value, "true or false")


def check_choice(what: str, value: Any, choices: Sequence[str]) -> None:
    """Accept one of the given words."""
    if value not in choices:
        raise ConfigError(what, value, f"one of {', '.join(choices)}", suggestion(str(value), choices))


def check_schedule(what: str, value: Any, low: float = 0.0, high: float = math.inf) -> None:
    """Accept a number in [low, high], or {linear: [start, end]} with two of them."""
    if isinstance(value, Mapping):
        ends = mapping(what, value, ["linear"], required=["linear"])["linear"]
        if not isinstance(ends, list | tuple) or len(ends) != 2:
            raise ConfigError(f"{what}.linear", ends, "two numbers [start, end]")
        for end in ends:
            check_number(f"{what}.linear", end, low, high)
    else:
        check_number(what, value, low, high)


def schedule(value: Any) -> float | Linear:
    """The number, or the Linear schedule, that a checked value stands for."""
    return Linear(*value["linear"]) if isinstance(value, Mapping) else value
