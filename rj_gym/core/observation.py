"""Entries of observation vectors: their names, units and bounds, and those that every tracking task has."""

from __future__ import annotations

from typing import NamedTuple

from rj_gym.core.config import TaskConfig

POSITION_BOUND = 2.0
COMMAND_BOUND = 2.0
ERROR_BOUND = 10.0


class Entry(NamedTuple):
    """One number of the observation: its name, its unit in words, and its bounds."""

    name: str
    unit: str
    low: float
    high: float


def position_entries(what: str, axes: str) -> list[Entry]:
    """The coordinates of a position in units of the length."""
    return [Entry(f"{what} {axis}", "L", -POSITION_BOUND, POSITION_BOUND) for axis in axes]


def tendon_entries(config: TaskConfig, n_tendons: int) -> list[Entry]:
    """The entries of commands and tensions in every tracking task."""
    unit = f"{config.command_scale_mm:g} mm"
    entries = [Entry(f"tendon {j} command", unit, -COMMAND_BOUND, COMMAND_BOUND) for j in range(n_tendons)]
    if config.observe_tensions:
        unit = f"{config.tension_range[1]:g} N"
        entries += [Entry(f"tendon {j} tension", unit, 0.0, 1.0) for j in range(n_tendons)]
    return entries


def error_entries(config: TaskConfig, axes: str) -> list[Entry]:
    """The tip error in every tracking task."""
    unit = f"{config.reward.error_scale_mm:g} mm"
    return [Entry(f"tip error {axis}", unit, -ERROR_BOUND, ERROR_BOUND) for axis in axes]


def load_scale(config: TaskConfig) -> float:
    """Unit of observed loads: the largest load magnitude, or 1 where there is none [N]."""
    return float(config.load.magnitude[1]) or 1.0
