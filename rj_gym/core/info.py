"""Infos: of all lanes in Gymnasium's vector form, or of the only lane of a scalar environment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.status import Status

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STATUS_NAMES = np.array([status.name for status in Status], dtype=object)
"""Name of every status."""


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
    column = values if len(rows) == len(values) else values[rows]
    return column.tolist() if column.ndim == 1 else list(column)


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


def put_info(info: dict[str, Any], other: Mapping[str, Any], rows: NDArray[np.int64]) -> None:
    """Copy these lanes of another info with the same entries into an info."""
    for key, value in other.items():
        if isinstance(value, dict):
            put_info(info[key], value, rows)
        else:
            info[key][rows] = value[rows]


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
