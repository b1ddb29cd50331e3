"""Entries of the design task's observation, and their values."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.task import POSITION_BOUND, Entry
from rj_gym.design.config import DesignConfig
from rj_gym.design.sampling import DesignDraws

Array = NDArray[np.float64]

_ERROR_UNIT = 10.0  # mm
_DEVIATION_BOUND = 5.0


def design_observation_entries(config: DesignConfig) -> list[Entry]:
    """The entries of the observation, in order. L is the length of the space's reference."""
    cases, links = range(config.cases), range(1, config.space.plain.n_links)
    axes = "xyz"[: config.space.dimension]
    places = [f"case {case} link {link} {axis}" for case in cases for link in links for axis in axes]
    loads = [f"case {case} force {axis}" for case in cases for axis in axes]
    m = config.space.plain.n_tendons
    sides = ["left", "right"] if m == 2 else [f"tendon {j}" for j in range(m)]
    tendons = [f"case {case} {side} tension" for case in cases for side in sides]
    unit, worst = f"{_ERROR_UNIT:g} mm", config.largest_error_mm / _ERROR_UNIT
    return [
        *(Entry(name, "half range", -1.0, 1.0) for name in config.space.names),
        *(Entry(f"{name} margin", "1", -1.0, 1.0) for name in config.space.margin_names),
        *(Entry(f"case {case} error", unit, 0.0, worst) for case in cases),
        Entry("error", unit, 0.0, worst),
        *(Entry(f"{name} deviation", unit, -_DEVIATION_BOUND, _DEVIATION_BOUND) for name in places),
        *(Entry(f"{name} target", "L", -POSITION_BOUND, POSITION_BOUND) for name in places),
        *(Entry(name, f"{_force_unit(config):g} N", -1.0, 1.0) for name in loads),
        *(Entry(name, f"{np.max(config.tensions):g} N", 0.0, 1.0) for name in tendons),
    ]


def observation_values(config: DesignConfig, length: float, read: Callable[[str], Array], draws: DesignDraws) -> Array:
    """The values of the entries in B lanes, (B, entries); `read` gives a part of their readings by name."""
    parts = (
        read("design"),
        read("margins"),
        read("case_errors") / _ERROR_UNIT,
        read("error") / _ERROR_UNIT,
        (draws.targets - read("positions")) / _ERROR_UNIT,
        draws.targets / length,
        draws.forces / _force_unit(config),
        draws.tensions / np.max(config.tensions),
    )
    return np.concatenate([part.reshape(len(part), -1) for part in parts], axis=1)


def _force_unit(config: DesignConfig) -> float:
    """Unit of observed forces: the largest that is drawn, or 1 where none is [N]."""
    return config.force[1] or 1.0
