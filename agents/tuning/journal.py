"""Where the trials of a study are: Optuna's log file, with a lock that ends with its process; or another storage."""

from __future__ import annotations

import re
from contextlib import ExitStack
from pathlib import Path

from optuna.storages import BaseStorage, GrpcStorageProxy, JournalStorage, RDBStorage
from optuna.storages.journal import JournalFileBackend
from optuna.storages.journal._file import BaseJournalFileLock

from agents.runs.files import cut_off_unfinished_line
from agents.runs.locks import file_lock
from rollingjoint.errors import ConfigError

PATIENCE = 10  # seconds for a proxy to answer


class _Lock(BaseJournalFileLock):
    """Held while a line is written; an unfinished last line, left by a full disk, is cut off before."""

    def __init__(self, journal: Path) -> None:
        self.journal, self.held = journal, ExitStack()

    def acquire(self) -> bool:
        """Acquire the lock, waiting if necessary."""
        self.held.enter_context(file_lock(self.journal.with_suffix(".lock"), wait=True))
        cut_off_unfinished_line(self.journal)
        return True

    def release(self) -> None:
        """Release the lock."""
        self.held.close()


def journal_storage(path: Path) -> JournalStorage:
    """The storage in the file at `path`, new or existing."""
    return JournalStorage(JournalFileBackend(str(path), _Lock(path)))


def opened(url: str) -> BaseStorage:
    """The storage of Optuna at a URL: grpc://HOST:PORT of its proxy, or one of a database as SQLAlchemy has them.

    Raises:
        ConfigError: no such storage, or one that cannot be reached.
    """
    try:
        if url.startswith("grpc://"):
            host, _, port = url.removeprefix("grpc://").rpartition(":")
            proxy = GrpcStorageProxy(host=host, port=int(port))
            proxy.wait_server_ready(timeout=PATIENCE)
            return proxy
        return RDBStorage(url)
    except Exception as error:  # of SQLAlchemy, of a driver of a database, of gRPC
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        allowed = "grpc://HOST:PORT or the URL of a database that can be reached"
        raise ConfigError("--storage", _without_password(url), allowed, reason.replace(url, "it")[:200]) from None


def _without_password(url: str) -> str:
    return re.sub(r"(://[^:/@]*):[^@]*@", r"\1:***@", url)
