"""Plain values, arrays and tensors in one safetensors file, which can hold no code.

Values are None, booleans, numbers, texts, lists, tuples, deques and dictionaries of such; numbers of NumPy, arrays and
torch tensors keep their type. Arrays are the file's tensors, everything else is one JSON text in its metadata.
"""

from __future__ import annotations

import json
import sys
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
import safetensors.numpy
from numpy.typing import NDArray

from agents.runs.checked_json import parse_json
from rollingjoint.errors import InvalidInput

_KEY = "state"
_DTYPES = "?bhilqBHILQfd"  # the types of NumPy that are kept: booleans, integers, floats


class StateError(InvalidInput):
    """Values that cannot be kept in a state file, or a file from which they cannot be read."""


def packed(values: Any) -> bytes:
    """The bytes of a state file; raises StateError for a value of another kind, which it names."""
    arrays: dict[str, NDArray[Any]] = {}
    text = json.dumps(_described(values, arrays, "state"), separators=(",", ":"))
    return safetensors.numpy.save(arrays, {_KEY: text})


def unpacked(data: bytes, source: str) -> Any:
    """The values in the bytes of a state file, named `source` in messages; raises StateError for any other bytes."""
    try:
        arrays = safetensors.numpy.load(data)
        header = parse_json(data[8 : 8 + int.from_bytes(data[:8], "little")], "header")
        return _read(parse_json(header["__metadata__"][_KEY], "metadata"), arrays)
    except Exception as error:  # whatever a parser makes of foreign bytes
        reason = f"{type(error).__name__}: {error}"[:200]
        raise StateError("state file", source, "a file as training writes it", reason) from error


def _described(value: Any, arrays: dict[str, NDArray[Any]], place: str) -> Any:
    """The JSON form of a value; its arrays are added to `arrays`; `place` names it in messages."""
    if value is None or (isinstance(value, bool | int | float | str) and not isinstance(value, np.generic)):
        return value
    kind = type(value)
    if kind in (list, tuple, deque):
        items = [_described(item, arrays, f"{place}[{i}]") for i, item in enumerate(value)]
        return {"deque": items, "maxlen": value.maxlen} if kind is deque else {kind.__name__: items}
    if isinstance(value, dict):
        pairs = value.items()
        return {"dict": [[_key(key, place), _described(item, arrays, f"{place}.{key}")] for key, item in pairs]}
    if isinstance(value, np.ndarray) and value.dtype.char in _DTYPES:
        return {"array": _kept(value, arrays)}
    if isinstance(value, np.generic) and value.dtype.char in _DTYPES:
        return {"number": _kept(np.asarray(value), arrays)}
    if "torch" in sys.modules and isinstance(value, sys.modules["torch"].Tensor):
        return {"tensor": _kept(value.detach().cpu().numpy(), arrays)}
    raise StateError(place, f"{kind.__module__}.{kind.__qualname__}", "plain values and arrays")


def _key(key: Any, place: str) -> str | int:
    if type(key) not in (str, int):
        raise StateError(f"{place}: key", key, "a text or an integer")
    checked: str | int = key
    return checked


def _kept(array: NDArray[Any], arrays: dict[str, NDArray[Any]]) -> str:
    """The name under which the array is added."""
    name = str(len(arrays))
    arrays[name] = np.ascontiguousarray(array).reshape(array.shape)
    return name


def _read(node: Any, arrays: dict[str, NDArray[Any]]) -> Any:
    """The value that a JSON form describes."""
    if not isinstance(node, dict):
        return node
    (kind, content), *more = node.items()
    readers: dict[str, Callable[[], Any]] = {
        "list": lambda: [_read(item, arrays) for item in content],
        "tuple": lambda: tuple(_read(item, arrays) for item in content),
        "deque": lambda: deque((_read(item, arrays) for item in content), more[0][1]),
        "dict": lambda: {key: _read(item, arrays) for key, item in content},
        "array": lambda: arrays[content].copy(),  # which may be written to
        "number": lambda: arrays[content][()],
        "tensor": lambda: _tensor(arrays[content].copy()),
    }
    return readers[kind]()


def _tensor(array: NDArray[Any]) -> Any:
    import torch

    return torch.as_tensor(array)
