"""Rows of a batch spread over threads of this process; the kernels release Python's lock.

Plain threads, not numba's parallel loops: those compile a second time, and abort a process that was forked after one
ran.
"""

from __future__ import annotations

import functools
import itertools
import os
import threading
from collections.abc import Callable
from queue import SimpleQueue

from rollingjoint.checks import as_integer

_JOINTS_WORTH_A_THREAD = 1024  # of all its rows: some 60 µs of work, about what it takes to wake a thread

_Job = tuple[Callable[[int, int], object], int, int, SimpleQueue[BaseException | None]]

_threads = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def set_threads(count: int) -> None:
    """Solve batches on this many threads; results do not depend on it. Default: the processors of this process.

    Raises:
        InvalidInput: a count below 1.
    """
    global _threads
    _threads = as_integer("threads", count, 1, allowed="a whole number, 1 or more")


def run_in_threads(work: Callable[[int, int], object], n_rows: int, n_joints: int) -> None:
    """Call work(first, last) on ranges that cover all rows of a batch of chains with n_joints joints."""
    count = max(1, min(_threads, n_rows, n_rows * n_joints // _JOINTS_WORTH_A_THREAD))
    if count == 1:
        work(0, n_rows)
        return
    borders = [n_rows * i // count for i in range(count + 1)]
    jobs, done = _jobs(os.getpid(), count - 1), SimpleQueue[BaseException | None]()
    for first, last in itertools.pairwise(borders[:-1]):
        jobs.put((work, first, last, done))
    outcomes: list[BaseException | None] = []
    try:
        work(*borders[-2:])
    finally:
        outcomes = [done.get() for _ in range(count - 1)]
    for error in outcomes:
        if error is not None:
            raise error


@functools.cache
def _jobs(process: int, count: int) -> SimpleQueue[_Job]:
    """Where threads of this process wait for work; a forked one must not wait for those of its parent."""
    jobs: SimpleQueue[_Job] = SimpleQueue()
    for _ in range(count):
        threading.Thread(target=_work, args=(jobs,), name="rollingjoint", daemon=True).start()
    return jobs


def _work(jobs: SimpleQueue[_Job]) -> None:
    while True:
        work, first, last, done = jobs.get()
        try:
            work(first, last)
        except BaseException as error:  # it belongs to the caller
            done.put(error)
        else:
            done.put(None)
        del work, done  # nothing of the caller is kept while this thread waits
