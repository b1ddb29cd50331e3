"""New Python processes, timed and measured."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import rollingjoint

ROOT = Path(rollingjoint.__file__).resolve().parents[1]
BENCHMARKS = Path(__file__).resolve().parents[1]


def run_python(code: str, variables: Mapping[str, str] | None = None, before: Sequence[str] = ()) -> str:
    """What a new process that runs the code printed, errors included; `before` goes before the interpreter.

    Raises:
        RuntimeError: the process failed.
    """
    done = subprocess.run(
        [*before, sys.executable, "-c", code],
        env=environment(variables or {}),
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    if done.returncode:
        raise RuntimeError(f"{code!r} failed:\n{done.stdout[-2000:]}")
    return done.stdout


def seconds_of_process(code: str, variables: Mapping[str, str] | None = None) -> float:
    """Seconds from the start to the end of a new process that runs the code."""
    begin = time.perf_counter()
    run_python(code, variables)
    return time.perf_counter() - begin


def environment(variables: Mapping[str, str]) -> dict[str, str]:
    """This process's variables and some more, with the package under test and `speed_rows` on the path.

    Bytecode is written, as on a user's machine, also where the variables of this process forbid it.
    """
    paths = [str(ROOT), str(BENCHMARKS), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "PYTHONDONTWRITEBYTECODE": "", **variables}
