"""Processes forked from one that has imported what training needs: a new interpreter imports for five seconds.

That one starts none of the threads that learning does, which a fork would lose.
"""

import multiprocessing
import os
import runpy
import subprocess
import sys
from typing import IO, Any

import pytest

if not hasattr(os, "fork"):
    pytest.skip("processes cannot be forked here", allow_module_level=True)
CONTEXT = multiprocessing.get_context("forkserver")
CONTEXT.set_forkserver_preload(["agents.train", "agents.tune", "agents.tuning.trials"])


class Forked:
    """What tests use of `subprocess.Popen` for `python -m MODULE ...` and `python -c PROGRAM ...`."""

    def __init__(self, command: list[str], stdout: IO[Any] | int | None = None, **others: Any) -> None:
        path = os.devnull if stdout == subprocess.DEVNULL else stdout and stdout.name
        self._process = CONTEXT.Process(target=_run, args=(command[1:], os.getcwd(), path))
        self._process.start()

    def poll(self) -> int | None:
        return self._process.exitcode

    returncode = property(poll)

    def wait(self) -> int:
        self._process.join()
        return self.returncode

    def kill(self) -> None:
        self._process.kill()

    def terminate(self) -> None:
        self._process.terminate()


def _run(words: list[str], folder: str, output: str | None) -> None:
    """What the interpreter does with these words."""
    os.setsid()
    os.chdir(folder)
    if output:
        log = os.open(output, os.O_WRONLY | os.O_APPEND)
        os.dup2(log, 1)
        os.dup2(log, 2)
    kind, what, *arguments = words
    sys.argv = [kind, *arguments]
    if kind == "-m":
        runpy.run_module(what, run_name="__main__", alter_sys=False)
    else:
        exec(what, {"__name__": "__main__"})
