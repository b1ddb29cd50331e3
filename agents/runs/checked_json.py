"""JSON read with limits, since files come from strangers: on bytes, packed and unpacked, on values and on depth."""

from __future__ import annotations

import gzip
import json
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rollingjoint.errors import ConfigError

LARGEST = 2**27  # bytes, unpacked: eighteen times the size of docs/results.json.gz
MOST_VALUES = 10_000_000  # ten times the number in that file
DEEPEST = 64  # levels of lists and mappings inside each other
PACKED = ".gz"


def read_json(path: Path) -> Any:
    """Content of a JSON file, gzipped where its name ends with .gz; raises ConfigError, as parse_json does."""
    try:
        if path.exists() and not path.is_file():
            raise ConfigError("file", str(path), "a file, no folder or device")
        with gzip.open(path, "rb") if path.suffix == PACKED else path.open("rb") as stream:
            content = stream.read(LARGEST + 1)
    except (OSError, EOFError, zlib.error) as error:  # EOFError: cut short
        raise ConfigError("file", str(path), "readable JSON, gzipped or not as its name says", str(error)) from None
    return parse_json(content, str(path))


def parse_json(content: bytes | str, where: str) -> Any:
    """Plain values of JSON text.

    Raises:
        ConfigError: no JSON, more than LARGEST bytes, MOST_VALUES values or DEEPEST levels.
    """
    if len(content) > LARGEST:
        raise ConfigError(f"size of {where}", f"over {LARGEST:,}", f"at most {LARGEST:,} bytes, unpacked")
    text = content if isinstance(content, bytes) else content.encode(errors="replace")
    if (count := sum(map(text.count, (b",", b"[", b"{")))) > MOST_VALUES:
        raise ConfigError(f"values in {where}", count, f"at most {MOST_VALUES:,}")
    try:
        values = json.loads(content)
    except RecursionError:
        raise _too_deep(where) from None
    except ValueError as error:
        raise ConfigError(where, "no JSON", "JSON text", str(error)) from None
    if _is_deep(values):
        raise _too_deep(where)
    return values


def _is_deep(values: Any) -> bool:
    """Whether there are more than DEEPEST levels."""
    level = _containers([values])
    for _ in range(DEEPEST):
        level = [
            child
            for container in level
            for child in _containers(container.values() if type(container) is dict else container)
        ]
    return bool(level)


def _containers(values: Iterable[Any]) -> list[Any]:
    return [value for value in values if type(value) is dict or type(value) is list]


def _too_deep(where: str) -> ConfigError:
    return ConfigError(where, f"more than {DEEPEST} levels", f"at most {DEEPEST} levels of lists and mappings")
