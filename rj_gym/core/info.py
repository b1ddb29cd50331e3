"""Infos: of all lanes in Gymnasium's vector form, or of the only lane of a scalar environment."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.columns import (
    EFFORT,
    ERROR,
    FAILURE,
    FORCE,
    LINK,
    SMOOTHNESS,
    STATUS,
    STICKING,
    TARGET,
    TENSIONS,
    TIP,
    TRACKING,
    WORK,
)
from rj_gym.core.kernels import friction_columns
from rollingjoint.chain.status import Status

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_STATUS_NAMES = [status.name for status in Status]
STATUS_NAMES = np.array(_STATUS_NAMES, dtype=object)
"""Name of every status."""


class Places(NamedTuple):
    """Columns of readings."""

    tip: slice
    target: slice
    force: slice
    tensions: slice
    command: slice

    @classmethod
    def of(cls, dimension: int, n_tendons: int) -> Self:
        """Those of a task's readings."""
        middle, end = TENSIONS + n_tendons, TENSIONS + 2 * n_tendons
        tip, target, force = (slice(first, first + dimension) for first in (TIP, TARGET, FORCE))
        return cls(tip, target, force, slice(TENSIONS, middle), slice(middle, end))


_TERMS = {"tracking": TRACKING, "effort": EFFORT, "smoothness": SMOOTHNESS, "failure": FAILURE}


def state_info(readings: Array, places: Places) -> dict[str, Any]:
    """What info says in every step of every tracking task, arrays (B, ...): parts of the readings, and copies."""
    tip, target, force, tensions, command = places
    return {
        "error_mm": readings[:, ERROR],
        "status": STATUS_NAMES[readings[:, STATUS].astype(np.intp)],
        "tip": readings[:, tip],
        "target": readings[:, target],
        "load": {"link": readings[:, LINK].astype(np.int64), "force": readings[:, force]},
        "tensions": readings[:, tensions],
        "command": readings[:, command],
    }


def friction_info(readings: Array, n_joints: int, n_tendons: int) -> dict[str, Any]:
    """What info says of friction in every step, arrays (B, ...): parts of the readings, and copies."""
    own = readings[:, readings.shape[1] - friction_columns(n_joints, n_tendons) :]
    shape, middle = (len(own), n_joints, n_tendons), STICKING + n_joints * n_tendons
    return {
        "sticking": own[:, STICKING:middle].reshape(shape) > 0.5,
        "gap_tensions": own[:, middle:].reshape(shape),
        "dissipated_work": own[:, WORK],
    }


def reward_info(readings: Array) -> dict[str, Array]:
    """The terms of the reward, (B,) each: parts of the readings."""
    return {name: readings[:, column] for name, column in _TERMS.items()}


def single_info(readings: Array, numbers: list[float], parts: Callable[[Array], Sequence[Array]]) -> dict[str, Any]:
    """state_info and reward_info of one lane: Python numbers, `numbers`, and parts of its readings (columns,).

    `parts` takes those at Places from the readings: `operator.itemgetter`, which is faster than one subscript each.
    """
    tip, target, force, tensions, command = parts(readings)
    return {
        "error_mm": numbers[ERROR],
        "status": _STATUS_NAMES[int(numbers[STATUS])],
        "tip": tip,
        "target": target,
        "load": {"link": int(numbers[LINK]), "force": force},
        "tensions": tensions,
        "command": command,
        "reward_terms": {
            "tracking": numbers[TRACKING],
            "effort": numbers[EFFORT],
            "smoothness": numbers[SMOOTHNESS],
            "failure": numbers[FAILURE],
        },
    }


def only_lane(info: Mapping[str, Any]) -> dict[str, Any]:
    """every_lane of a batch of one, for an info without masks and nested ones."""
    return {key: values.item(0) if values.ndim == 1 else values[0] for key, values in info.items()}


def every_lane(infos: Mapping[str, Any], rows: Sequence[int]) -> list[dict[str, Any]]:
    """The infos of these lanes one by one, without masks: Python numbers and strings, and parts of the arrays."""
    keys = [key for key in infos if not key.startswith("_")]
    columns = [_column(infos[key], rows) for key in keys]
    return [dict(zip(keys, values, strict=True)) for values in zip(*columns, strict=True)]


def _column(values: Any, rows: Sequence[int]) -> list[Any]:
    if isinstance(values, dict):
        return every_lane(values, rows)
    chosen = values if len(rows) == len(values) else values[rows]
    return chosen.tolist() if chosen.ndim == 1 else list(chosen)


def masked_info(info: Mapping[str, Any], mask: Mask) -> dict[str, Any]:
    """A batch's info in Gymnasium's vector form: `_key` says which lanes have `key`; the others hold zero or None.

    The arrays in `info` are changed for that.
    """
    return _masked(info, mask.copy(), None if mask.all() else ~mask)


def whole_info(info: Mapping[str, Any], count: int) -> dict[str, Any]:
    """masked_info where all `count` lanes have everything."""
    return _masked(info, np.ones(count, bool), None)


def _masked(info: Mapping[str, Any], mask: Mask, blank: Mask | None) -> dict[str, Any]:
    masked: dict[str, Any] = {}
    for key, value in info.items():
        if isinstance(value, dict):
            value = _masked(value, mask, blank)
        elif blank is not None:
            value[blank] = None if value.dtype == object else 0
        masked[key], masked[f"_{key}"] = value, mask
    return masked


def spread_info(info: Mapping[str, Any], rows: NDArray[np.int64], count: int) -> dict[str, Any]:
    """The info of some lanes in arrays for all `count`; the other lanes hold zero or None."""
    if len(rows) == count:
        return dict(info)
    return {
        key: spread_info(value, rows, count) if isinstance(value, dict) else _spread(value, rows, count)
        for key, value in info.items()
    }


def unmasked_info(infos: Mapping[str, Any]) -> dict[str, Any]:
    """Infos without their `_key` masks, in fresh arrays."""
    return {
        key: unmasked_info(value) if isinstance(value, dict) else value.copy()
        for key, value in infos.items()
        if not key.startswith("_")
    }


def _spread(values: NDArray[Any], rows: NDArray[np.int64], count: int) -> NDArray[Any]:
    spread = np.full((count, *values.shape[1:]), None if values.dtype == object else 0, values.dtype)
    spread[rows] = values
    return spread
