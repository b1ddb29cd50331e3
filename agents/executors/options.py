"""The options --cluster and --jobs of commands, and the executor that they name."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from contextlib import contextmanager

from agents.executors.local import InlineExecutor, LocalExecutor
from agents.executors.protocol import Executor
from agents.runs.checks import job_count

LOCAL = "local"


def add_options(parser: argparse.ArgumentParser, what: str, jobs: int | None = None) -> None:
    """Add --jobs, by default the processors of this machine, and --cluster."""
    default = "processors" if jobs is None else jobs
    parser.add_argument(
        "--jobs", type=int, default=jobs or os.cpu_count() or 1, help=f"{what} at a time here (default: {default})"
    )
    parser.add_argument(
        "--cluster",
        default=LOCAL,
        metavar="local|auto|HOST:PORT",
        help="where: processes of this machine (default), the Ray cluster that runs here, or the one with that head",
    )


@contextmanager
def executor_of(cluster: str = LOCAL, jobs: int = 1, inline: bool = False) -> Iterator[Executor]:
    """The executor of a context.

    Args:
        cluster: "local", "auto" or HOST:PORT of a Ray cluster. jobs: processes, where it is local.
        inline: whether one local job is done by this process itself.
    Raises:
        ConfigError: no such cluster, or jobs below 1.
        ModuleNotFoundError: Ray is not installed.
    """
    jobs = job_count("--jobs", jobs)
    executor = _executor(cluster, jobs, inline)
    try:
        yield executor
    finally:
        executor.shutdown()


def _executor(cluster: str, jobs: int, inline: bool) -> Executor:
    if cluster == LOCAL:
        return InlineExecutor() if inline and jobs == 1 else LocalExecutor(jobs)
    from agents.executors.cluster import RayExecutor

    return RayExecutor(cluster)
