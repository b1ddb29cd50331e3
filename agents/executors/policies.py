"""Units that need the policy of a run, which travels with them to machines that do not see the run folder."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from agents.executors.driver import Unit
from agents.executors.folders import FILES, files_of, write_files
from agents.runs.folder import RunFolder


class _NoPolicy(NamedTuple):
    """A machine does not see the run folder, and needs its policy."""


@dataclass(frozen=True)
class PolicyUnit(Unit):
    """A unit with a function that is called with `arguments` and with the run folder as the machine sees it.

    Args:
        run: None: the function is called with None. travels: whether to send the policy along.
    """

    run: RunFolder | None = None
    travels: bool = False

    def call(self, attempt: int) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        """Function and arguments."""
        if self.run is None:
            return self.function, (*self.arguments, None)
        files = files_of(self.run.path, FILES) if self.travels else {}
        return with_policy, (self.function, self.arguments, RunFolder(self.run.path.resolve()), files)

    def received(self, value: Any) -> Any:
        """The function's result; or the unit that sends the policy along."""
        return replace(self, travels=True) if isinstance(value, _NoPolicy) else value


def with_policy(
    function: Callable[..., Any], arguments: tuple[Any, ...], run: RunFolder, files: Mapping[str, bytes]
) -> Any:
    """Call the function with the run folder that this machine sees, else with one made of the files."""
    if (run.path / "config.yaml").is_file():
        return function(*arguments, run)
    if not files:
        return _NoPolicy()
    with tempfile.TemporaryDirectory(prefix="rollingjoint-") as scratch:
        write_files(files, Path(scratch))
        return function(*arguments, RunFolder(Path(scratch)))
