"""A run of a search: one method with one seed, in one folder.

config.yaml          the search, with this method and this seed alone
command.txt          the typed command; one more line whenever the run is continued
versions.json        Python, packages, platform
evaluations.jsonl    a line per batch: designs, their evaluation, processor time; an incomplete line is ignored
lock                 held by the process that searches
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from agents.runs.checked_json import parse_json
from agents.runs.files import RunFolderError, write_json, write_text
from agents.runs.folder import versions
from agents.runs.locks import alone_in
from agents.search.config import SearchConfig, load_search
from agents.search.optimiser import Evaluated
from rollingjoint.checked_yaml import dump_yaml

VERSIONS = "versions.json"
COLUMNS = {field.name: bool if field.name in ("ok", "feasible") else float for field in fields(Evaluated)}


@dataclass(frozen=True)
class SearchRun:
    """Paths of a run, its configuration and its journal."""

    path: Path

    @classmethod
    def begin(cls, path: Path, config: SearchConfig, command: Sequence[str], force: bool = False) -> SearchRun:
        """The run at `path`, new or existing; `force` restarts it.

        Raises RunFolderError where the folder holds something else, another search, or a run that a process works on.
        """
        run = cls(path)
        if path.exists() and not _not_begun(path):
            if not run.is_there:
                raise RunFolderError("run", str(path), "a new folder, or one with a run", "It stays as it is.")
            if force:
                with run.locked():
                    pass  # and free it again: Windows deletes no file that is open
                shutil.rmtree(path)
            elif run.config.to_dict() != config.to_dict():
                hint = "Another --out begins a new search, --force replaces the runs that are there."
                raise RunFolderError("run", str(path), "a run of the search that the file describes now", hint)
        if not run.is_there:
            write_json(path / VERSIONS, versions("cma", "ribs", "optuna"))
            write_text(path / "config.yaml", dump_yaml(config.to_dict()))
        run = cls(path)
        if not run.is_finished:
            commands = path / "command.txt"
            before = commands.read_text("utf-8") if commands.is_file() else ""
            write_text(commands, before + shlex.join(command) + "\n")
        return run

    @property
    def is_there(self) -> bool:
        """Whether the folder holds a run."""
        return (self.path / "config.yaml").is_file()

    @cached_property
    def config(self) -> SearchConfig:
        """The search of this run."""
        return load_search(self.path / "config.yaml")

    @property
    def is_finished(self) -> bool:
        """Whether its budget is used up."""
        return self.evaluations == self.config.budget

    @property
    def evaluations(self) -> int:
        """Designs in the journal."""
        return sum(len(batch) for batch, _ in self.batches())

    @property
    def journal(self) -> Path:
        """The file of the batches."""
        return self.path / "evaluations.jsonl"

    def locked(self) -> AbstractContextManager[None]:
        """Hold the run alone; raises RunFolderError where another process holds it."""
        return alone_in(self.path, "run", "one in which no other process searches")

    def batches(self) -> list[tuple[Evaluated, float]]:
        """All batches, the processor time after each [s]; raises RunFolderError for a broken journal."""
        if not self.journal.is_file():
            return []
        lines = self.journal.read_bytes().split(b"\n")[:-1]
        try:
            return [_batch(parse_json(line, f"line {number}")) for number, line in enumerate(lines, 1)]
        except (ValueError, KeyError, TypeError) as error:
            hint = f"{error}. --force begins the run anew."
            raise RunFolderError("journal", str(self.journal), "lines as rj search writes them", hint) from error

    def append(self, evaluated: Evaluated, seconds: float) -> None:
        """Add a batch: after this it is on the disk, whole."""
        columns = {name: getattr(evaluated, name) for name in COLUMNS}
        values = {name: column.tolist() for name, column in columns.items() if column is not None}
        with self.journal.open("ab") as stream:
            stream.write(json.dumps({"seconds": seconds, **values}).encode() + b"\n")
            stream.flush()
            os.fsync(stream.fileno())


def _not_begun(path: Path) -> bool:
    """True for a folder with no more than the files of a process killed before it wrote the configuration."""
    partial = f".{VERSIONS}.", ".config.yaml."
    return all(file.name == VERSIONS or file.name.startswith(partial) for file in path.iterdir())


def _batch(values: dict[str, Any]) -> tuple[Evaluated, float]:
    columns = {name: np.array(values[name], kind) for name, kind in COLUMNS.items() if name in values}
    return Evaluated(**columns), float(values["seconds"])
