"""What info says, batch-first; a scalar environment takes its lane out of a batch of one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.render import Scene
from rj_gym.tracking.sampling import Episodes
from rj_gym.tracking.task import State, TrackingTask
from rollingjoint.equilibrium import Status

_STATUS_NAMES = np.array([status.name for status in Status], dtype=object)


def state_info(episodes: Episodes, state: State) -> dict[str, Any]:
    """What info says in every step: fresh arrays (B, ...)."""
    return {
        "error_mm": state.errors.copy(),
        "status": _STATUS_NAMES[state.status],
        "tip": state.tips.copy(),
        "target": state.targets.copy(),
        "load": {"link": episodes.links.copy(), "force": state.forces.copy()},
        "tensions": state.tensions.copy(),
        "command": state.commands.copy(),
    }


def sampled_info(episodes: Episodes) -> dict[str, Any]:
    """What was drawn for each lane: fresh arrays (B, ...)."""
    names = np.empty(len(episodes.mechanisms), dtype=object)
    names[:] = [mechanism.name for mechanism in episodes.mechanisms]
    return {
        "mechanism": names,
        "targets": episodes.targets.copy(),
        "link": episodes.links.copy(),
        "forces": episodes.forces.copy(),
        "start_tensions": episodes.start_tensions.copy(),
        "stiffnesses": episodes.stiffnesses.copy(),
        "surface_offsets": episodes.surface_offsets.copy(),
        "actuator_offsets": episodes.actuator_offsets.copy(),
    }


def lane_info(info: dict[str, Any], lane: int = 0) -> dict[str, Any]:
    """One lane of a batch's info: Python numbers and strings, fresh arrays, nested dictionaries."""
    return {key: _lane(value, lane) for key, value in info.items()}


def masked_info(info: dict[str, Any], mask: NDArray[np.bool_]) -> dict[str, Any]:
    """A batch's info in Gymnasium's vector form: `_key` says which lanes have `key`; the others hold zero or None."""
    masked: dict[str, Any] = {}
    for key, value in info.items():
        masked[key] = masked_info(value, mask) if isinstance(value, dict) else _blanked(value, mask)
        masked[f"_{key}"] = mask.copy()
    return masked


def lane_scene(
    task: TrackingTask, episodes: Episodes, state: State, trail: NDArray[np.float64], lane: int = 0
) -> Scene:
    """What a picture of one lane shows; trail (steps, 2) [mm] is where its tip has been."""
    return Scene(
        mechanism=episodes.mechanisms[lane],
        poses=state.poses[lane],
        tensions=state.tensions[lane],
        tension_range=task.config.tension_range,
        targets=episodes.targets[lane],
        force=state.forces[lane],
        link=int(episodes.links[lane]),
        trail=trail,
        step=int(state.step[lane]),
    )


def _lane(value: Any, lane: int) -> Any:
    if isinstance(value, dict):
        return lane_info(value, lane)
    if value.dtype == object:
        return value[lane]
    return value[lane].copy() if value.ndim > 1 else value[lane].item()


def _blanked(value: NDArray[Any], mask: NDArray[np.bool_]) -> NDArray[Any]:
    if not mask.all():
        value[~mask] = None if value.dtype == object else 0
    return value
