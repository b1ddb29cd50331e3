"""Keys by which a person steers: directions in the picture as moves of a point or of tendons."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from agents.controllers.controller import Array
from rj_gym.tracking.task import TrackingTask

KEYS: Mapping[str, tuple[str, int]] = {
    "L": ("right", 1),
    "J": ("right", -1),
    "I": ("up", 1),
    "K": ("up", -1),
    "O": ("away", 1),
    "U": ("away", -1),
}
"""The direction in the picture of every key that steers; arrows and W, A, S, D move the camera."""

PLANAR = {"right": (1.0, 0.0), "up": (0.0, 1.0)}
HANGING = {"right": (1.0, 0.0, 0.0), "up": (0.0, 0.0, -1.0), "away": (0.0, -1.0, 0.0)}
NUDGE = 0.02  # of the mechanism's length, by which one press of a key moves a point
PULL = 0.25  # of the largest pull, by which one press changes the pull of a tendon


def nudge(task: TrackingTask, key: str) -> Array:
    """The displacement of a point by a key, (d,) [mm]."""
    direction, sign = KEYS[key]
    directions: Mapping[str, tuple[float, ...]] = PLANAR if task.dimension == 2 else HANGING
    return sign * NUDGE * task.length * np.array(directions.get(direction, np.zeros(task.dimension)))


def pulls(task: TrackingTask, key: str) -> Array:
    """Changes of the pulls of all tendons by a key, (m,): it bends the mechanism to that side, or tightens it (up)."""
    direction, sign = KEYS[key]
    if direction == "up":
        return np.full(task.action_size, sign * PULL)
    towards = {"right": (1.0, 0.0), "away": (0.0, -1.0)}[direction]
    sides = _sides(task)
    return sign * PULL * (sides / np.linalg.norm(sides, axis=1, keepdims=True)) @ np.array(towards)


def _sides(task: TrackingTask) -> Array:
    """The end of every tendon relative to the middle of its link, (m, 2) [mm]."""
    mechanism: Any = task.mechanism
    if task.dimension == 2:
        return np.array([(holes[0, -1, 0], 0.0) for holes in mechanism.hole_points])
    return np.array([tendon.holes[-1] for tendon in mechanism.tendons], float)
