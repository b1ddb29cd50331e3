"""Observation spaces and observations, plain and with goals."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray


def observation_space(task: Any, goal: bool) -> spaces.Space[Any]:
    """Space of one lane's observation; privileged states and goals belong to tracking tasks."""
    vector = _box(*task.observation_bounds(goal))
    if task.observes_truth:
        return spaces.Dict(observation=vector, privileged=_box(*task.privileged_bounds()))
    if not goal:
        return vector
    bound = task.goal_bounds()
    return spaces.Dict(observation=vector, achieved_goal=_box(-bound, bound), desired_goal=_box(-bound, bound))


def observed(task: Any, vector: NDArray[np.float32], readings: NDArray[np.float64]) -> Any:
    """The observation from its vector (..., entries) and the readings (..., columns)."""
    if task.observes_truth:
        return {"observation": vector, "privileged": task.privileged(readings)}
    return vector


def goal_observation(
    task: Any, vector: NDArray[np.float32], readings: NDArray[np.float64]
) -> dict[str, NDArray[np.float32]]:
    """The Goal variant's observation from its vector (..., entries) and the readings (..., columns)."""
    return {
        "observation": vector,
        "achieved_goal": task.achieved_goals(readings),
        "desired_goal": task.desired_goals(readings),
    }


def lane_observations(observations: Any, rows: NDArray[np.int64]) -> NDArray[Any]:
    """The observations of some lanes, one by one, as an array of objects."""
    lanes: Iterable[Any] = observations
    if isinstance(observations, dict):
        parts = (part[rows] for part in observations.values())
        lanes = (dict(zip(observations, lane, strict=True)) for lane in zip(*parts, strict=True))
    elif len(rows) < len(observations):
        lanes = observations[rows]
    return np.fromiter(lanes, dtype=object, count=len(rows))


def _box(low: NDArray[np.float64], high: NDArray[np.float64]) -> spaces.Box:
    return spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)
