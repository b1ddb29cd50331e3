"""Locks between processes; a lock ends with the process that holds it, even when that is killed."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from agents.runs.files import RunFolderError

WITHOUT_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)


@contextmanager
def file_lock(path: Path, wait: bool = False) -> Iterator[None]:
    """Hold the file at `path`, which is created if missing; without effect on a file system without locks.

    Raises filelock.Timeout if it is held elsewhere, in another process or in this one, unless told to wait.
    """
    from filelock import FileLock, Timeout  # comes with the extras that train and search

    lock = FileLock(path, blocking=wait, thread_local=False, fallback_to_soft=False)
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
    from filelock import Timeout

    with ExitStack() as held:
        try:
            held.enter_context(file_lock(folder / "lock"))
        except Timeout:
            raise RunFolderError(what, str(folder), allowed, "Wait for it to end, or stop it.") from None
        yield
