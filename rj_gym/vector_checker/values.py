"""Comparison of nested observations and infos, and faults in their form."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray


def difference(actual: Any, expected: Any, where: str, *, dtypes: bool = True) -> str | None:
    """The first place where two nested values differ, in words; None where they are equal.

    Numbers are equal to the last bit, and NaN equals NaN. Without `dtypes`, 1.0 in float32 equals 1.0 in float64.
    """
    if isinstance(actual, Mapping) and isinstance(expected, Mapping):
        if actual.keys() != expected.keys():
            return f"{where} has the keys {sorted(map(str, actual))}, expected {sorted(map(str, expected))}"
        pairs = [(f"{where}[{key!r}]", actual[key], expected[key]) for key in actual]
    elif _listed(actual) and _listed(expected) and len(actual) == len(expected):
        pairs = [(f"{where}[{i}]", a, b) for i, (a, b) in enumerate(zip(actual, expected, strict=True))]
    else:
        return None if _equal(actual, expected, dtypes) else _unequal(actual, expected, where)
    texts = (difference(a, b, place, dtypes=dtypes) for place, a, b in pairs)
    return next((text for text in texts if text), None)


def arrays_in(value: Any, where: str) -> Iterator[tuple[str, NDArray[Any]]]:
    """Every array in a nested value, those inside arrays of objects too, each with its place in words."""
    if isinstance(value, np.ndarray):
        yield where, value
    listed = value if _listed(value) else ()
    for key, part in value.items() if isinstance(value, Mapping) else enumerate(listed):
        yield from arrays_in(part, f"{where}[{key!r}]")


def space_fault(space: spaces.Space[Any], value: Any, where: str) -> str | None:
    """Why a value is not in the space, in words; None if it is.

    Stricter than `space.contains`: dtypes must be equal, not castable.
    """
    if isinstance(space, spaces.Dict) and isinstance(value, Mapping) and value.keys() == space.spaces.keys():
        parts = [(part, value[key], f"{where}[{key!r}]") for key, part in space.spaces.items()]
    elif isinstance(space, spaces.Tuple) and isinstance(value, tuple) and len(value) == len(space.spaces):
        parts = [(part, value[i], f"{where}[{i}]") for i, part in enumerate(space.spaces)]
    else:
        return _leaf_fault(space, value, where)
    return next((fault for fault in (space_fault(*part) for part in parts) if fault), None)


def array_fault(value: Any, shape: tuple[int, ...], kind: Any, where: str) -> str | None:
    """Why a value is not an array of this shape and kind of number, in words; None if it is."""
    if not isinstance(value, np.ndarray):
        return f"{where} is a {type(value).__name__}, expected an array"
    if value.shape != shape or not np.issubdtype(value.dtype, kind):
        return f"{where} is {value.dtype} {value.shape}, expected {kind.__name__} {shape}"
    return None


def info_fault(infos: Any, num_envs: int, where: str = "infos") -> str | None:
    """Why infos do not have Gymnasium's vector form (arrays by lane, `_key` masks, nested alike); None if they do."""
    if not isinstance(infos, dict):
        return f"{where} is a {type(infos).__name__}, expected a dict"
    for key, value in infos.items():
        name = f"{where}[{key!r}]"
        if isinstance(key, str) and key.startswith("_") and key[1:] in infos:
            fault = array_fault(value, (num_envs,), np.bool_, name)
        elif f"_{key}" not in infos:
            fault = f"{name} has no mask '_{key}' beside it"
        elif isinstance(value, dict):
            fault = info_fault(value, num_envs, name)
        else:
            fault = array_fault(value, (num_envs, *np.shape(value)[1:]), np.generic, name)
        if fault:
            return fault
    return None


def lane_info(infos: Mapping[str, Any], lane: int) -> dict[str, Any]:
    """One lane of infos: the keys with a mask that has it, without masks."""
    return {
        key: lane_info(value, lane) if isinstance(value, Mapping) else value[lane]
        for key, value in infos.items()
        if f"_{key}" in infos and infos[f"_{key}"][lane]
    }


def in_short(value: object, limit: int = 100) -> str:
    """A value on one line, cut where it is long."""
    text = " ".join((str if isinstance(value, np.generic) else repr)(value).split())
    return text if len(text) <= limit else f"{text[:limit]}..."


def _listed(value: Any) -> bool:
    return isinstance(value, tuple | list) or (isinstance(value, np.ndarray) and value.dtype == object)


def _equal(actual: Any, expected: Any, dtypes: bool) -> bool:
    if dtypes and (
        type(actual) is not type(expected) or getattr(actual, "dtype", None) != getattr(expected, "dtype", None)
    ):
        return False
    if isinstance(actual, np.ndarray | np.generic | float):
        inexact = all(np.issubdtype(np.asarray(value).dtype, np.inexact) for value in (actual, expected))
        return np.array_equal(actual, expected, equal_nan=inexact)
    return bool(actual == expected)


def _unequal(actual: Any, expected: Any, where: str) -> str:
    """In words that two values differ; for arrays of one shape and dtype, where they first do."""
    arrays = isinstance(actual, np.ndarray) and isinstance(expected, np.ndarray)
    if arrays and actual.shape == expected.shape != () and actual.dtype == expected.dtype:
        unequal = (actual != expected) & ((actual == actual) | (expected == expected))  # two NaN are equal
        index = tuple(int(i) for i in np.argwhere(unequal)[0])
        actual, expected, where = actual[index], expected[index], f"{where}[{', '.join(map(str, index))}]"
    text, expected_text = in_short(actual), in_short(expected)
    if text == expected_text:
        text, expected_text = (f"{in_short(value)} ({_kind(value)})" for value in (actual, expected))
    return f"{where} is {text}, expected {expected_text}"


def _kind(value: Any) -> str:
    return str(getattr(value, "dtype", type(value).__name__))


def _leaf_fault(space: spaces.Space[Any], value: Any, where: str) -> str | None:
    if space.shape is not None and space.dtype is not None:
        fault = array_fault(np.asarray(value) if space.shape == () else value, space.shape, space.dtype.type, where)
        if fault:
            return fault
    return None if space.contains(value) else f"{where} is {in_short(value)}, which is not in {in_short(space)}"
