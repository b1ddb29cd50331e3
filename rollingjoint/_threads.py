"""Lanes of a batch spread over threads of this process; the kernels release Python's lock.

Plain threads, not numba's parallel loops: those compile a second time, and abort a process that was forked after one
ran.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from rollingjoint.errors import as_integer

_LANES_WORTH_A_THREAD = 64

_threads = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def set_threads(count: int) -> None:
    """Solve batches on this many threads; results do not depend on it. Default: the processors of this process.

    Raises:
        InvalidInput: a count below 1.
    """
    global _threads
    _threads = as_integer("threads", count, "a whole number, 1 or more", low=1)


def run_lanes(work: Callable[[int, int], object], n_lanes: int) -> None:
    """Call work(first, last) on ranges that cover all lanes."""
    count = max(1, min(_threads, n_lanes // _LANES_WORTH_A_THREAD))
    borders = np.linspace(0, n_lanes, count + 1).astype(int).tolist()
    pool = _pool(os.getpid(), count) if count > 1 else None
    waiting = [pool.submit(work, *borders[i : i + 2]) for i in range(count - 1)] if pool else []
    work(*borders[-2:])
    for future in waiting:
        future.result()


@functools.cache
def _pool(process: int, count: int) -> ThreadPoolExecutor:
    """Threads of this process: a forked one must not wait for those of its parent."""
    return ThreadPoolExecutor(count - 1, thread_name_prefix="rollingjoint")
