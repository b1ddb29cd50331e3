"""Units that work in a folder below the folder of a campaign, a search or a study.

A machine that sees the folder works in it: files on its disk are never lost. Another one receives a copy, works in a
private folder, and the folder travels home when the unit has ended: whole or not at all.
"""

from __future__ import annotations

import io
import os
import secrets
import shutil
import tarfile
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from filelock import Timeout

from agents.executors.driver import Unit
from agents.runs.files import RunFolderError, write_text
from agents.runs.locks import file_lock

WAIT = 120.0  # seconds that a further attempt waits for the process of the one before to end
FIRST_WAIT = 30.0  # seconds that a first attempt waits: a worker that a killed command left behind may still save
PAUSE = 0.2
FILES = ("*.yaml*", "*.json*", "command.txt*", "policy.*", "normaliser.pkl*", "best/*")  # files of a policy


@dataclass(frozen=True)
class Home:
    """A folder with an empty file of a random name while work goes on, so that a machine knows whether it sees it.

    A copy of the folder at the same path, from an earlier day, has no such file.

    Args:
        path: absolute. mark: the name.
    """

    path: Path
    mark: str

    @property
    def is_here(self) -> bool:
        """Whether this machine sees the folder."""
        return (self.path / self.mark).is_file()


@contextmanager
def marked(path: Path) -> Iterator[Home]:
    """The folder of a campaign, marked inside the context."""
    home = Home(path.resolve(), f".home-{secrets.token_hex(8)}")
    write_text(home.path / home.mark, "")
    try:
        yield home
    finally:
        (home.path / home.mark).unlink(missing_ok=True)


class _Travelled(NamedTuple):
    """The result of a unit elsewhere: its value, its folder."""

    value: Any
    parcel: bytes


class _NotHere(NamedTuple):
    """A machine does not see the folder, and needs a copy."""


class _InUse(NamedTuple):
    """Another process works in the folder."""


@dataclass(frozen=True)
class FolderUnit(Unit):
    """A unit with a function that is called with its folder, then with `arguments`.

    Args:
        home: the folder of all units. place: this unit's folder, below home; PLACE.log next to it belongs to it.
        travels: whether to send a copy along.
        waits: whether to wait for the lock in the folder; not where who gave the unit holds it.
        patience: for how long a first attempt waits [s]; 0: it comes back, and says that it will wait.
    """

    home: Home = Home(Path(), "")
    place: str = ""
    travels: bool = False
    waits: bool = True
    patience: float = 0.0

    def call(self, attempt: int) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        """Function and arguments of this attempt."""
        parcel = pack(self.home.path, self.place) if self.travels else b""
        patience = (WAIT if attempt else self.patience) if self.waits else None
        return in_folder, (self.function, self.home, self.place, parcel, patience, self.arguments)

    def received(self, value: Any) -> Any:
        """The function's result, its folder at home; or the unit that sends a copy along, or that waits."""
        if isinstance(value, _NotHere):
            return replace(self, travels=True)
        if isinstance(value, _InUse):
            note = f"another process works in its folder; waiting for up to {FIRST_WAIT:g} s"
            return replace(self, patience=FIRST_WAIT, note=note)
        if isinstance(value, _Travelled):
            unpack(value.parcel, self.home.path, self.place)
            return value.value
        return value


def in_folder(
    function: Callable[..., Any],
    home: Home,
    place: str,
    parcel: bytes,
    patience: float | None,
    arguments: tuple[Any, ...],
) -> Any:
    """Call the function in the folder itself, or in a copy of it.

    Args:
        patience: for how long to wait for the lock in the folder [s]; None: it does not matter.
    """
    if home.is_here:
        if patience is not None and not _is_free(home.path / place, patience) and not patience:
            return _InUse()
        return function(home.path / place, *arguments)  # where the lock is still held, this says so
    if not parcel:
        return _NotHere()
    with tempfile.TemporaryDirectory(prefix="rollingjoint-") as scratch:
        unpack(parcel, Path(scratch), place)
        value = function(Path(scratch) / place, *arguments)
        return _Travelled(value, pack(Path(scratch), place))


def _is_free(folder: Path, patience: float) -> bool:
    """Whether no process holds the lock in a folder, at once or some seconds later."""
    until = time.monotonic() + patience
    while (folder / "lock").exists():
        try:
            with file_lock(folder / "lock"):
                return True
        except Timeout:
            if time.monotonic() >= until:
                return False
            time.sleep(PAUSE)
    return True


def files_of(folder: Path, patterns: Sequence[str]) -> dict[str, bytes]:
    """The content of files in a folder by their paths in it."""
    paths = (path for pattern in patterns for path in folder.glob(pattern) if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def write_files(files: Mapping[str, bytes], folder: Path) -> None:
    """Write such files into a folder."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


def pack(home: Path, place: str) -> bytes:
    """The folder, and the log next to it, as an archive."""
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w") as archive:
        for name in (place, f"{place}.log"):
            if (home / name).exists():
                archive.add(home / name, name)
    return stream.getvalue()


def unpack(parcel: bytes, home: Path, place: str) -> None:
    """Put a packed folder in its place, whole or not at all; an existing one is replaced."""
    folder = home / place
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".", suffix=f".{os.getpid()}", dir=folder.parent) as partial:
        with tarfile.open(fileobj=io.BytesIO(parcel)) as archive:
            archive.extractall(partial, filter="data")
        arrived, old = Path(partial) / place, Path(partial) / "old"
        if not arrived.is_dir():
            raise RunFolderError("parcel", place, "the folder of the unit")
        if folder.exists():
            os.replace(folder, old)
        os.replace(arrived, folder)
        log = Path(partial) / f"{place}.log"
        if log.is_file():
            shutil.move(log, folder.with_name(f"{folder.name}.log"))
