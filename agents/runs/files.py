"""Files that are written whole or not at all, hashes that tell whether they are still as written, tables read back.

The hash of FILE is in FILE.sha256, which is written first. It also keeps the hash of the file before: a process killed
between the two leaves a file that is still known.
"""

from __future__ import annotations

import csv
import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

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


def write_hashed(path: Path, write: Callable[[Any], Any]) -> None:
    """As write_file, with the hash of the file in FILE.sha256."""
    hashing = _Hashing()

    def both(stream: BinaryIO) -> None:
        hashing.stream = stream
        write(hashing)
        before = [_hash(path)] if path.is_file() and is_as_written(path) else []
        write_text(hash_file(path), "\n".join([hashing.digest.hexdigest(), *before]) + "\n")

    write_file(path, both)


def write_hashed_bytes(path: Path, content: bytes) -> None:
    """Write a file of these bytes, and its hash in FILE.sha256."""
    write_hashed(path, lambda stream: stream.write(content))


def write_hashed_text(path: Path, text: str) -> None:
    """Write a text file, and its hash in FILE.sha256."""
    write_hashed_bytes(path, text.encode())


def seal(*tables: Path) -> None:
    """Write the hashes of files that have grown and no longer will."""
    for table in tables:
        if table.is_file():
            write_text(hash_file(table), _hash(table) + "\n")


def unseal(*tables: Path) -> None:
    """Remove the hashes of files that go on growing."""
    for table in tables:
        hash_file(table).unlink(missing_ok=True)


def hash_file(path: Path) -> Path:
    """Where the hash of a file is."""
    return path.with_name(f"{path.name}.sha256")


def is_as_written(path: Path) -> bool:
    """True for a file as `write_hashed` wrote it, and where there is no hash, as in folders of older versions."""
    beside = hash_file(path)
    if not beside.is_file():
        return True
    return path.is_file() and _hash(path) in beside.read_text("utf-8", errors="replace").split()


def check_as_written(*paths: Path) -> None:
    """Raise RunFolderError for the first file that is not as `write_hashed` wrote it."""
    for path in paths:
        if not is_as_written(path):
            hint = f"Bring it back from a copy; if it was changed on purpose, delete {hash_file(path).name} beside it."
            raise RunFolderError("damaged file", str(path), "the content that was written, which its hash tells", hint)


def _hash(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


class _Hashing:
    """A binary stream that hashes its content."""

    stream: BinaryIO

    def __init__(self) -> None:
        self.digest = hashlib.sha256()

    def write(self, content: bytes | memoryview) -> int:
        """Write the content."""
        self.digest.update(content)
        return self.stream.write(content)


def cut_off_unfinished_line(path: Path) -> None:
    """Remove an unfinished last line, left by a killed process or a full disk; no effect without a file."""
    content = path.read_bytes() if path.is_file() else b""
    end = content.rfind(b"\n") + 1
    if end < len(content):
        os.truncate(path, end)


def read_rows(table: Path) -> list[dict[str, str]]:
    """The rows of a CSV file; none if there is no file. Raises RunFolderError if it is damaged."""
    check_as_written(table)
    if not table.is_file():
        return []
    try:
        with table.open(encoding="utf-8", newline="") as stream:
            return list(csv.DictReader(stream))
    except (ValueError, csv.Error) as error:
        raise RunFolderError("table", str(table), "CSV as training writes it", str(error)) from error
