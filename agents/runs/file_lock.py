"""A lock between processes that ends with the process that holds it, however that ends."""

from __future__ import annotations

import errno
import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

WITHOUT_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)


@contextmanager
def file_lock(path: Path, wait: bool = False) -> Iterator[None]:
    """Hold the file at `path`, which is made if it is not there; on a file system without locks hold nothing.

    Raises BlockingIOError where another process, or another place of this one, holds it, unless told to wait.
    """
    with path.open("ab") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            raise
        except OSError as error:
            if error.errno not in WITHOUT_LOCKS:
                raise
        yield
