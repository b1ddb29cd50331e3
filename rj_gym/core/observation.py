"""Entries of observation vectors: their names, units and bounds, and those that every tracking task has."""

from __future__ import annotations

from typing import Any, NamedTuple

from rj_gym.core.config import TaskConfig
from rj_gym.core.hardware import AGE, LAG_TENSION
from rj_gym.core.sensing import LARGEST_PLAY, LARGEST_SHEATH
from rollingjoint.friction import LARGEST_MU

POSITION_BOUND = 2.0
COMMAND_BOUND = 2.0
ERROR_BOUND = 10.0


SENSED_TENSION_BOUND = 3.0  # sheath friction makes measured tensions larger than any tension
AGE_BOUND = 100.0
LAG_BOUND = 50.0


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
        rubs = config.actuation.sheath_friction[1] > 0 or config.sensing.tension_noise > 0
        high = SENSED_TENSION_BOUND if rubs else 1.0
        entries += [Entry(f"tendon {j} tension", unit, 0.0, high) for j in range(n_tendons)]
    return entries


def instrument_entries(config: TaskConfig, n_tendons: int, axes: str) -> list[Entry]:
    """Age of the picture and past readings in every tracking task; lags count steps."""
    entries: list[Entry] = []
    if config.sensing.late:
        entries += [
            Entry("picture age", f"{AGE:g} steps", 0.0, AGE_BOUND),
            Entry("picture new", "1 if so, else 0", 0, 1),
        ]
    tendons, seen = range(n_tendons), config.sensing.pose != "none"
    moved, pulled, error = (
        f"{config.action_scale_mm:g} mm",
        f"{LAG_TENSION:g} N",
        f"{config.reward.error_scale_mm:g} mm",
    )
    for lag in config.lags:
        entries += [Entry(f"tendon {j} action, lag {lag}", "1", -1.0, 1.0) for j in tendons]
        entries += [Entry(f"tendon {j} command, lag {lag}", moved, -LAG_BOUND, LAG_BOUND) for j in tendons]
        entries += [Entry(f"tendon {j} tension, lag {lag}", pulled, -LAG_BOUND, LAG_BOUND) for j in tendons]
        entries += [Entry(f"tip error {axis}, lag {lag}", error, -ERROR_BOUND, ERROR_BOUND) for axis in axes if seen]
    return entries


def tendon_truth_entries(config: TaskConfig, mechanism: Any) -> list[Entry]:
    """The privileged numbers of every tracking task, in the order of hardware.tendon_truth."""
    newtons, far = f"{config.tension_range[1]:g} N", 1.0 + config.randomization.actuator_offset_mm
    kinds = [
        ("tendon {} command minus motor", "mm", -LARGEST_PLAY / 2, LARGEST_PLAY / 2),
        ("tendon {} half play", "mm", 0.0, LARGEST_PLAY / 2),
        ("tendon {} sheath friction", "1", 0.0, LARGEST_SHEATH),
        ("tendon {} tension", newtons, 0.0, 1.0),
        ("tendon {} motor offset", "mm", -far, far),
        ("tendon {} stiffness factor", "1", 0.0, 10.0),
    ]
    if config.has_friction(mechanism):
        kinds.append(("tendon {} friction", "1", 0.0, LARGEST_MU))
    tendons = range(mechanism.n_tendons)
    entries = [Entry(name.format(j), unit, low, high) for name, unit, low, high in kinds for j in tendons]
    return [*entries, Entry("time", "episode_steps", 0.0, 1.0)]


def error_entries(config: TaskConfig, axes: str) -> list[Entry]:
    """The tip error in every tracking task."""
    unit = f"{config.reward.error_scale_mm:g} mm"
    return [Entry(f"tip error {axis}", unit, -ERROR_BOUND, ERROR_BOUND) for axis in axes]


def load_scale(config: TaskConfig) -> float:
    """Unit of observed loads: the largest load magnitude, or 1 where there is none [N]."""
    return float(config.load.magnitude[1]) or 1.0
