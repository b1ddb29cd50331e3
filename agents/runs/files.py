"""Files that are written whole or not at all, and tables read back."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rollingjoint.errors import InvalidInput, naming


class RunFolderError(InvalidInput):
    """A folder of a run, a search or a study that cannot be made or read."""


def write_file(path: Path, write: Callable[[Any], Any]) -> None:
    """Call `write` with a binary stream; the file appears whole or not at all (a neighbour that is then renamed)."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with naming(path), partial.open("wb") as stream:
            write(stream)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file of these bytes, whole or not at all."""
    write_file(path, lambda stream: stream.write(content))


def write_text(path: Path, text: str) -> None:
    """Write a text file, whole or not at all."""
    write_bytes(path, text.encode())


def write_json(path: Path, values: Any) -> None:
    """Write plain values as JSON, whole or not at all."""
    write_text(path, json.dumps(values, indent=2) + "\n")


def cut_off_unfinished_line(path: Path) -> None:
    """Remove what a killed process or a full disk left of a last line; nothing where there is no file."""
    content = path.read_bytes() if path.is_file() else b""
    whole = content.rfind(b"\n") + 1
    if whole < len(content):
        os.truncate(path, whole)


def read_rows(table: Path) -> list[dict[str, str]]:
    """The rows of a CSV file; none if there is no file."""
    if not table.is_file():
        return []
    with table.open(newline="") as stream:
        return list(csv.DictReader(stream))
