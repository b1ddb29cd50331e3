"""Checkouts, and processes that import the packages from one of them."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

BENCHMARKS = Path(__file__).resolve().parents[1]
REPOSITORY = BENCHMARKS.parent
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


@dataclass(frozen=True)
class Checkout:
    """One of the two: its name (before, after), its folder, and where its kernels are kept (None: where users' are)."""

    name: str
    folder: Path
    cache: Path | None = None

    def environment(self) -> dict[str, str]:
        """Variables of a process that imports from this checkout first, then from the guard's own folder.

        The environment's editable install of another checkout comes after both. Checkouts stay clean of bytecode.
        """
        own = {
            "PYTHONPATH": os.pathsep.join([str(self.folder), str(BENCHMARKS)]),
            "PYTHONDONTWRITEBYTECODE": "1",
            "COLUMNS": "200",
            "MPLBACKEND": "Agg",
            **ONE_THREAD,
            **({"ROLLINGJOINT_CACHE": str(self.cache)} if self.cache else {}),
        }
        return os.environ | own

    def start(self, *arguments: str, variables: Mapping[str, str] = {}, **options: Any) -> subprocess.Popen[str]:
        """Start Python on some arguments in this checkout."""
        environment = self.environment() | variables
        return subprocess.Popen([sys.executable, *arguments], cwd=self.folder, env=environment, text=True, **options)


def run_sides(checkouts: Sequence[Checkout], section: str, folder: Path, quick: bool) -> list[Path]:
    """One section in every checkout at the same time; the folders with their records.

    Raises:
        SystemExit: a process failed.
    """
    outs, processes = [folder / section / one.name for one in checkouts], []
    older = checkouts[0].folder
    for one, out in zip(checkouts, outs, strict=True):
        out.mkdir(parents=True)
        words = [section, str(out), str(one.folder), str(older), *(["--quick"] if quick else [])]
        processes.append(one.start("-m", "guard_rows.child", *words, stdout=subprocess.DEVNULL))
    try:
        for one, process in zip(checkouts, processes, strict=True):
            if process.wait():
                raise SystemExit(f"{section} of {one.name} ({one.folder}) failed with exit code {process.returncode}")
    finally:
        for process in processes:
            process.kill()
    return outs


@contextmanager
def checked_out(name: str, path_or_revision: str, scratch: Path) -> Iterator[Path]:
    """The folder of a checkout: the path itself, or a git revision as a temporary work tree.

    Raises:
        SystemExit: neither a checkout nor a revision.
    """
    path = Path(path_or_revision).resolve()
    if (path / "rollingjoint" / "__init__.py").is_file():
        yield path
        return
    folder = scratch / f"checkout-{name}"
    made = _git("worktree", "add", "--detach", str(folder), path_or_revision)
    if made.returncode:
        reason = made.stderr.strip().splitlines()[-1]
        raise SystemExit(f"--{name} = {path_or_revision!r}: expected a checkout's folder or a git revision ({reason}).")
    try:
        yield folder
    finally:
        _git("worktree", "remove", "--force", str(folder))


def _git(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["git", *words], cwd=REPOSITORY, capture_output=True, text=True)
