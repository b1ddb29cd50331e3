"""What the agent of the design task sees: the entries of the observation, their bounds, and their values."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from rj_gym.design.config import DesignConfig
from rj_gym.design.task import DesignTask, Episodes, Judged
from rj_gym.planar.observation import Entry
from rollingjoint.design import MARGINS

Array = NDArray[np.float64]

_POSITION_BOUND = 2.0
_ERROR_UNIT = 10.0  # mm
_DEVIATION_BOUND = 5.0


def design_observation_entries(config: DesignConfig) -> list[Entry]:
    """The entries of the observation, in order. L is the length of the middle design, n times its link height."""
    cases, links = range(config.cases), range(1, config.space.n_links)
    places = [f"case {case} link {link} {axis}" for case in cases for link in links for axis in ("x", "y")]
    loads = [f"case {case} force {axis}" for case in cases for axis in ("x", "y")]
    tendons = [f"case {case} {side} tension" for case in cases for side in ("left", "right")]
    unit, worst = f"{_ERROR_UNIT:g} mm", config.largest_error_mm / _ERROR_UNIT
    return [
        *(Entry(name, "half range", -1.0, 1.0) for name in config.space.names),
        *(Entry(f"{name} margin", "1", -1.0, 1.0) for name in MARGINS),
        *(Entry(f"case {case} error", unit, 0.0, worst) for case in cases),
        Entry("error", unit, 0.0, worst),
        *(Entry(f"{name} deviation", unit, -_DEVIATION_BOUND, _DEVIATION_BOUND) for name in places),
        *(Entry(f"{name} target", "L", -_POSITION_BOUND, _POSITION_BOUND) for name in places),
        *(Entry(name, f"{_force_unit(config):g} N", -1.0, 1.0) for name in loads),
        *(Entry(name, f"{np.max(config.tensions):g} N", 0.0, 1.0) for name in tendons),
    ]


def observation_space(config: DesignConfig) -> spaces.Box:
    """Space of one lane's observation."""
    low, high = (np.array(bound, np.float32) for bound in zip(*_bounds(config), strict=True))
    return spaces.Box(low, high, dtype=np.float32)


def observe(task: DesignTask, designs: Array, episodes: Episodes, judged: Judged) -> NDArray[np.float32]:
    """Fresh observations of B lanes, (B, entries)."""
    config = task.config
    parts = (
        designs,
        judged.margins,
        judged.case_errors / _ERROR_UNIT,
        judged.error[:, None] / _ERROR_UNIT,
        (episodes.targets - judged.positions) / _ERROR_UNIT,
        episodes.targets / task.length,
        episodes.forces / _force_unit(config),
        episodes.tensions / np.max(config.tensions),
    )
    values = np.concatenate([part.reshape(len(designs), -1) for part in parts], axis=1)
    low, high = np.array(_bounds(config)).T
    return np.clip(values, low, high).astype(np.float32)


def _bounds(config: DesignConfig) -> list[tuple[float, float]]:
    return [(entry.low, entry.high) for entry in design_observation_entries(config)]


def _force_unit(config: DesignConfig) -> float:
    """Unit of observed forces: the largest that is drawn, or 1 where none is [N]."""
    return config.force[1] or 1.0
