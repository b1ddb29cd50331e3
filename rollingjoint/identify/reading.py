"""Predicted readings at an equilibrium: positions, angles, lengths, tensions in one row; and its derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.identify.path import Rates

Array = NDArray[np.float64]

_QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])


def reading(equilibrium: Any, parameters: Mapping[str, Any]) -> Array:
    """The row at values of all parameters, (M,), in the order of Measurements.readings."""
    positions, angles = _origins(equilibrium), np.zeros(equilibrium.mechanism.n_links)
    if positions.shape[1] == 2:
        positions, angles = positions @ _rotation(parameters).T, equilibrium.poses[:, 2] + parameters["base_angle"]
    return np.concatenate(
        [positions.ravel(), angles, equilibrium.lengths - parameters["offsets"], equilibrium.tensions]
    )


def reading_rates(equilibrium: Any, rates: Rates, parameters: Mapping[str, Any]) -> Array:
    """Derivatives of the row by the columns of the rates, then by the base angle, (M, P + 1)."""
    n, m = equilibrium.mechanism.n_links, equilibrium.mechanism.n_tendons
    dimension = _origins(equilibrium).shape[1]
    moves = equilibrium.pose_jacobian @ rates.angles  # (n, 3 or 6, P)
    positions, angles = moves[:, :dimension], np.zeros_like(moves[:, 0])
    lengths = equilibrium.tendon_rates.T @ rates.angles
    lengths[:, :m] -= np.eye(m)
    by_base = np.zeros(len(reading(equilibrium, parameters)))
    if dimension == 2:
        positions, angles = _rotation(parameters) @ positions, moves[:, 2]
        by_base[: 2 * n] = (_origins(equilibrium) @ (_QUARTER @ _rotation(parameters)).T).ravel()
        by_base[2 * n : 3 * n] = 1.0
    rows = np.concatenate([positions.reshape(n * dimension, -1), angles, lengths, rates.tensions])
    return np.column_stack([rows, by_base])


def _origins(equilibrium: Any) -> Array:
    """Origins of the links, (n, 2 or 3) [mm]."""
    poses: Array = equilibrium.poses
    return poses[:, :2] if poses.ndim == 2 else poses[:, :3, 3]


def _rotation(parameters: Mapping[str, Any]) -> Array:
    cos, sin = np.cos(parameters["base_angle"]), np.sin(parameters["base_angle"])
    return np.array([[cos, -sin], [sin, cos]])
