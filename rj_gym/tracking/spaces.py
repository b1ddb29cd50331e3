"""Observation spaces and batched observations of the plain and the Goal variant."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from rj_gym.tracking.observation import POSITION_BOUND
from rj_gym.tracking.sampling import Episodes
from rj_gym.tracking.task import State, TrackingTask


def observation_space(task: TrackingTask, goal: bool) -> spaces.Space[Any]:
    """Space of one lane's observation."""
    vector = _box(*task.observation_bounds(goal))
    if not goal:
        return vector
    bound = np.full(2, POSITION_BOUND)
    return spaces.Dict(observation=vector, achieved_goal=_box(-bound, bound), desired_goal=_box(-bound, bound))


def batch_observation(task: TrackingTask, episodes: Episodes, state: State, goal: bool) -> Any:
    """Fresh observations (B, ...) of all lanes: an array, or a dictionary of them."""
    vector = task.observe(episodes, state, goal)
    if not goal:
        return vector
    return {"observation": vector, "achieved_goal": task.goals(state.tips), "desired_goal": task.goals(state.targets)}


def _box(low: NDArray[np.float64], high: NDArray[np.float64]) -> spaces.Box:
    return spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)
