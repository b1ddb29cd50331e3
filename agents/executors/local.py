"""Processes of this machine that work on one unit at a time, and this process itself."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing import get_context, parent_process, resource_tracker
from multiprocessing.connection import Connection, wait
from typing import Any

from agents.executors.protocol import UnitStopped, WorkerLost
from agents.executors.worker import THREADS, UnitAnswer, answered, end_process, prepare
from rollingjoint.interrupts import Interruptible

BEGUN = "begun"  # sent by a process when its unit begins: from now on SIGINT stops that unit
GRACE = 1.0  # s that a process without work may take to end by itself
ORPHAN = 5.0  # s that a unit may take to stop when the parent has ended
_environment = threading.Lock()


class InlineExecutor:
    """This process: submit returns when the unit has ended."""

    slots = 1

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """The future of function(*arguments), which has ended."""
        future: Future[Any] = Future()
        answered(function, arguments, Interruptible()).settle(future)
        return future

    def cancel(self, future: Future[Any]) -> None:
        """No effect: it has ended."""

    def shutdown(self) -> None:
        """No effect: there are no workers."""


class LocalExecutor:
    """Up to `jobs` processes, started when there is work for them and kept for more.

    They are in sessions of their own, so that Ctrl-C reaches them through this process alone, and stop their unit as if
    it had been cancelled when this process ends.

    SIGINT goes to a process from its word that a unit has begun to its answer; one that comes too late arrives before
    the next unit, and is ignored: none is lost, and none stops another unit. A process that has not begun, since it
    imports or compiles for a minute, is killed.
    """

    def __init__(self, jobs: int) -> None:
        self.slots = jobs
        self._threads = ThreadPoolExecutor(jobs, "worker")
        self._idle: list[_Worker] = []
        self._busy: dict[Future[Any], _Worker] = {}
        self._lock = threading.Lock()
        self._stopped: set[Future[Any]] = set()
        self._is_over = False

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """The future of function(*arguments)."""
        future: Future[Any] = Future()
        self._threads.submit(self._work, future, function, arguments)
        return future

    def cancel(self, future: Future[Any]) -> None:
        """Interrupt the process that works on it; a unit that waits never begins."""
        with self._lock:
            self._stopped.add(future)
            if worker := self._busy.get(future):
                worker.stop()

    def shutdown(self) -> None:
        """Stop the units that are left, wait for them, and end the processes."""
        with self._lock:
            self._is_over = True
            for worker in self._busy.values():
                worker.stop()
        self._threads.shutdown()
        for worker in self._idle:
            worker.dismiss()
        for worker in self._idle:
            worker.end()

    def _work(self, future: Future[Any], function: Callable[..., Any], arguments: Any) -> None:
        try:
            worker = self._worker_for(future)
        except OSError as error:  # no memory, or too many processes
            future.set_exception(WorkerLost(f"no process could be started: {error!r}"))
            return
        if worker is None:
            future.set_exception(UnitStopped())
            return
        try:
            worker.send(function, arguments)
            worker.wait_for_begin()
            with self._lock:
                worker.has_begun = True
                if self._is_stopped(future):
                    worker.stop()
            answer = worker.answer()
        except (EOFError, OSError) as error:
            self._forget(future)
            worker.end()
            lost = WorkerLost(f"its process was ended by {worker.end_in_words}: {error!r}")
            future.set_exception(UnitStopped() if self._is_stopped(future) else lost)
        except Exception as error:  # arguments that do not pickle
            self._forget(future, worker)
            future.set_exception(error)
        else:
            self._forget(future, worker)
            answer.settle(future)

    def _is_stopped(self, future: Future[Any]) -> bool:
        return self._is_over or future in self._stopped

    def _worker_for(self, future: Future[Any]) -> _Worker | None:
        """The process that the unit has from now on, None if it is not to begin; raises OSError if none can start."""
        with self._lock:
            worker = self._idle.pop() if self._idle else None
        worker = worker or _Worker()
        with self._lock:
            if self._is_stopped(future):
                self._idle.append(worker)
                return None
            self._busy[future] = worker
        return worker

    def _forget(self, future: Future[Any], worker: _Worker | None = None) -> None:
        with self._lock:
            del self._busy[future]
            if worker:
                worker.has_begun = False
                self._idle.append(worker)


class _Worker:
    """A process, and the pipe to it."""

    def __init__(self) -> None:
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=serve, args=(theirs,))
        with _one_thread_each(), _interrupts_blocked():
            self._process.start()
        theirs.close()
        self.has_begun = False  # its unit

    def send(self, function: Callable[..., Any], arguments: Any) -> None:
        """Give it a unit; raises OSError where the process is gone."""
        self._pipe.send((function, arguments))

    def wait_for_begin(self) -> None:
        """Wait until the unit begins; raises EOFError or OSError where the process is gone."""
        assert self._pipe.recv() == BEGUN

    def answer(self) -> UnitAnswer:
        """The answer of the process; raises EOFError or OSError where it is gone."""
        answer: UnitAnswer = self._pipe.recv()
        return answer

    def stop(self) -> None:
        """Send SIGINT for the unit in work; end a process that has not begun one."""
        with suppress(ProcessLookupError):
            if self.has_begun:
                os.kill(self._process.pid or 0, signal.SIGINT)
            else:
                self._process.kill()

    def dismiss(self) -> None:
        """Let go of its pipe, whereupon it ends by itself, unless it imports."""
        self._pipe.close()

    def end(self) -> None:
        """End the process, and wait for that."""
        self.dismiss()
        self._process.join(GRACE)
        self._process.kill()
        self._process.join()

    @property
    def end_in_words(self) -> str:
        """Why the process ended."""
        code = self._process.exitcode or 0
        return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def serve(pipe: Connection) -> None:
    """Work on the units that arrive until the pipe ends; SIGINT stops a unit, and has no effect between two."""
    works = threading.Event()
    if hasattr(os, "setsid"):
        with suppress(PermissionError):  # a process that leads its group already
            os.setsid()
    signal.signal(signal.SIGINT, lambda number, frame: None)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_end_with_parent, args=(works,), daemon=True).start()
    with suppress(EOFError, OSError):
        while True:
            function, arguments = pipe.recv()
            prepare()
            works.set()
            answer = answered(function, arguments, Interruptible(end_process), partial(pipe.send, BEGUN))
            works.clear()
            _send(pipe, answer)


def _send(pipe: Connection, answer: UnitAnswer) -> None:
    """Send the answer, or why it cannot be sent."""
    try:
        pipe.send(answer)
    except OSError:
        raise
    except Exception as error:  # a value that does not pickle
        pipe.send(UnitAnswer(failure=f"its value cannot be sent: {error!r}"))


def _end_with_parent(works: threading.Event) -> None:
    """Wait until the parent has ended, then end this process: at once if it does not work, else as its unit stops."""
    parent = parent_process()
    if parent is None:
        return
    wait([parent.sentinel])
    if works.is_set():
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(ORPHAN)
    end_process()


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Processes started inside receive no SIGINT before they have installed a handler for it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # the first process would start it, and it unblocks SIGINT for this thread
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes started inside use one thread for linear algebra: for small matrices a second one only busy-waits."""
    with _environment:
        before = {name: os.environ.get(name) for name in THREADS}
        os.environ.update(dict.fromkeys(THREADS, "1"))
        try:
            yield
        finally:
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value
