"""Locks between processes; a lock ends with the process that holds it, even when that is killed."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from agents.runs.files import RunFolderError

WITHOUT_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)


@contextmanager
def file_lock(path: Path, wait: bool = False) -> Iterator[None]:
    """Hold the file at `path`, which is made if it is not there; on a file system without locks hold nothing.

    Raises filelock.Timeout where another process, or another place of this one, holds it, unless told to wait.
    """
    lock = FileLock(path, blocking=wait, fallback_to_soft=False)
    try:
        lock.acquire()
    except OSError as error:
        if isinstance(error, Timeout) or error.errno not in WITHOUT_LOCKS:
            raise
    try:
        yield
    finally:
        lock.release()


@contextmanager
def alone_in(folder: Path, what: str, allowed: str) -> Iterator[None]:
    """Hold the lock of a folder; raises RunFolderError(what, folder, allowed) where another process holds it."""
    with ExitStack() as held:
        try:
            held.enter_context(file_lock(folder / "lock"))
        except Timeout:
            raise RunFolderError(what, str(folder), allowed, "Wait for its end, or stop it.") from None
        yield
