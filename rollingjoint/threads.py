"""Rows of a batch spread over threads of this process; the kernels release Python's lock.

Plain threads, not numba's parallel loops: those compile a second time, and abort a process that was forked after one
ran. Ranges are cut into pieces, between which Python looks at signals, so that Ctrl-C ends a batch of any size. One
solve of a long chain may take seconds: a thread works on it while the caller's waits, and Ctrl-C does not wait for it.
"""

from __future__ import annotations

import functools
import itertools
import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from queue import Empty, SimpleQueue

from rollingjoint.checks import as_integer

_JOINTS_WORTH_A_THREAD = 1024  # of all its rows: some 60 µs of work, about the time to wake a thread
_JOINTS_OF_A_PIECE = 8192  # at first; of all its rows
_BRIEF, _LONG = 0.01, 0.05  # s of processor time: below, the next piece is a larger one, above, a smaller one
_ROWS_SIDE_BY_SIDE = 8  # pieces are multiples of that
_SHORT_CHAIN = 64  # joints; a solve of a longer chain may take more than a second
_LOOK_FOR_SIGNALS = 0.1  # s: where waiting cannot be interrupted, as on Windows

_Work = Callable[[int, int], object]

_threads = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def set_threads(count: int) -> None:
    """Solve batches on this many threads; results do not depend on it. Default: the processors of this process.

    Raises:
        InvalidInput: a count below 1.
    """
    global _threads
    _threads = as_integer("threads", count, 1, allowed="a whole number, 1 or more")


def run_in_threads(work: _Work, n_rows: int, n_joints: int, abandon: bool = False) -> None:
    """Call work(first, last) on ranges that cover all rows of a batch of chains with n_joints joints.

    Ctrl-C ends it after the pieces that are being worked on, and no thread works on after the call has ended; a second
    Ctrl-C does not wait for them. An error of the work ends it likewise, and is raised: of several errors, one.

    Args:
        abandon: with long chains not to wait even for the pieces: for work on arrays that are unused afterwards.
    """
    count = _threads_for(n_rows, n_joints)
    if runs_at_once(n_joints, n_rows):
        work(0, n_rows)
    elif n_joints > _SHORT_CHAIN:
        _run_apart(_ThreadedCall(work), n_rows, count, abandon)
    else:
        rows = _ROWS_SIDE_BY_SIDE * (1 + _JOINTS_OF_A_PIECE // (_ROWS_SIDE_BY_SIDE * max(n_joints, 1)))
        _run_together(_ThreadedCall(work), n_rows, count, rows)


def runs_at_once(n_joints: int, n_rows: int = 1) -> bool:
    """True where run_in_threads does rows of such a chain by one plain call, on the thread of its caller."""
    is_brief = n_joints <= _SHORT_CHAIN and n_rows * n_joints <= _JOINTS_OF_A_PIECE
    return is_brief and _threads_for(n_rows, n_joints) == 1


def _threads_for(n_rows: int, n_joints: int) -> int:
    return max(1, min(_threads, n_rows, n_rows * n_joints // _JOINTS_WORTH_A_THREAD))


def _run_together(call: _ThreadedCall, n_rows: int, count: int, rows: int) -> None:
    """Run the call on this thread and count - 1 others, in pieces of `rows` rows at first."""
    *others, (first, last) = _ranges(n_rows, count)
    pool = _pool(os.getpid())
    pool.grow_to(len(others))
    try:
        for job in others:
            pool.jobs.put(functools.partial(call.run, *job, rows))
        call.work_on(first, last, rows)
        call.wait_for(len(others))
    finally:
        call.stop = True
        call.wait_for_begun()
    call.raise_error()


def _run_apart(call: _ThreadedCall, n_rows: int, count: int, abandon: bool) -> None:
    """Run the call on `count` new threads, row by row at first."""
    try:
        for job in _ranges(n_rows, count):
            threading.Thread(target=call.run, args=(*job, 1), name="rollingjoint", daemon=True).start()
        call.wait_for(count)
    finally:
        call.stop = True
        if not abandon:
            call.wait_for_begun()
    call.raise_error()


def _ranges(n_rows: int, count: int) -> list[tuple[int, int]]:
    """All rows in `count` ranges (first, last)."""
    return list(itertools.pairwise(n_rows * i // count for i in range(count + 1)))


class _ThreadedCall:
    """One call of run_in_threads: its work, a flag to stop it, its jobs that have begun and their errors.

    A signal may interrupt the caller between any two instructions, so the caller does not count the jobs that it gave
    away: a job itself registers its beginning, and only then looks at the flag.
    """

    def __init__(self, work: _Work) -> None:
        self.stop = False
        self._work = work
        self._begun: list[None] = []
        self._errors: list[BaseException | None] = []  # of the jobs that ended
        self._wake: SimpleQueue[None] = SimpleQueue()  # a signal may lose its items

    def run(self, first: int, last: int, rows: int) -> None:
        """A job, on another thread than the caller's."""
        self._begun.append(None)
        error: BaseException | None = None
        try:
            self.work_on(first, last, rows)
        except BaseException as exception:  # it belongs to the caller
            self.stop, error = True, exception
        self._errors.append(error)
        self._wake.put(None)

    def work_on(self, first: int, last: int, rows: int) -> None:
        """Do the work in pieces of `rows` rows at first, until all are done or it is to stop."""
        while first < last and not self.stop:
            begin, end = time.thread_time(), min(first + rows, last)
            self._work(first, end)
            took, first = time.thread_time() - begin, end
            if took < _BRIEF:
                rows *= 2
            elif took > _LONG:
                rows = max(min(rows, _ROWS_SIDE_BY_SIDE), rows // 2)

    def wait_for(self, count: int) -> None:
        """Wait until `count` jobs have ended; signals are handled meanwhile."""
        while len(self._errors) < count:
            with suppress(Empty):
                self._wake.get(timeout=_LOOK_FOR_SIGNALS)

    def wait_for_begun(self) -> None:
        """Once it is to stop: wait until no job works any more; jobs that begin later end at once."""
        while len(self._errors) < len(self._begun):
            self.wait_for(len(self._begun))

    def raise_error(self) -> None:
        """Raise the first error of a job, if there was one."""
        for error in self._errors:
            if error is not None:
                raise error


class _Pool:
    """Threads that wait for jobs; their number is the largest that a call could use so far."""

    def __init__(self) -> None:
        self.jobs: SimpleQueue[Callable[[], object]] = SimpleQueue()
        self._threads: list[threading.Thread] = []

    def grow_to(self, count: int) -> None:
        """Start threads until there are `count`."""
        while len(self._threads) < count:
            thread = threading.Thread(target=self._work, name="rollingjoint", daemon=True)
            thread.start()
            self._threads.append(thread)

    def _work(self) -> None:
        while True:
            self.jobs.get()()  # no reference to the job remains while this thread waits


@functools.cache
def _pool(process: int) -> _Pool:
    """The pool of this process; a forked one has none of the threads of its parent."""
    return _Pool()
