"""Hyper-parameters that change during training."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from agents.runs.checks import Check, number
from rollingjoint.checked_yaml import mapping
from rollingjoint.errors import ConfigError


@dataclass(frozen=True)
class Linear:
    """A schedule from `start` to `end`, linear in the steps done; called with the share of steps that remains."""

    start: float
    end: float

    def __call__(self, progress_remaining: float) -> float:
        """The value when this share of the steps remains."""
        return self.end + (self.start - self.end) * progress_remaining


def schedule(low: float = 0.0) -> Check:
    """Accepts a number from `low` on, or {linear: [start, end]} with two of them."""
    check = number(low)

    def check_schedule(what: str, value: Any) -> Any:
        if not isinstance(value, Mapping):
            return check(what, value)
        ends = mapping(what, value, ["linear"], required=["linear"])["linear"]
        if not isinstance(ends, list | tuple) or len(ends) != 2:
            raise ConfigError(f"{what}.linear", ends, "two numbers [start, end]")
        return {"linear": [check(f"{what}.linear", end) for end in ends]}

    return Check(check_schedule, f"{check.allowed}; `{{linear: [first, last]}}`")


def built(value: Any) -> Any:
    """The number, or the Linear schedule, that a checked value stands for."""
    return Linear(*value["linear"]) if isinstance(value, Mapping) else value
