"""Episodes of the shipped policies as pages that play without the viewer; they need the extra view."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path

from agents import view

SEED = 10_003  # of the episode


def can_be_recorded() -> bool:
    """Whether what records them is installed."""
    return find_spec("viser") is not None


def record(tasks: Iterable[str], folder: Path) -> None:
    """Write the page of every task, an episode of its shipped policy, into a folder."""
    folder.mkdir(parents=True)
    for task in tasks:
        with contextlib.redirect_stdout(io.StringIO()):
            code = view.main(words(task, folder / f"{task}.html"))
        if code:
            raise SystemExit(code)


def words(task: str, page: Path) -> list[str]:
    """What follows `rj view` to record a task."""
    return ["--episodes", task, "--which", str(SEED), "--record", str(page)]
