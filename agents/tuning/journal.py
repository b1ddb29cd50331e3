"""The journal of a study: Optuna's log file, with a lock that a killed process does not leave behind."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.storages.journal._file import BaseJournalFileLock

from agents.runs.files import cut_off_unfinished_line
from agents.runs.locks import file_lock


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
