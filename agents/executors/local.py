"""Processes of this machine that work on one unit at a time, and this process itself."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from typing import Any

from agents.executors.protocol import UnitStopped, WorkerLost
from agents.executors.worker import THREADS, Answer, answered, prepare

_environment = threading.Lock()


class InlineExecutor:
    """This process: submit returns when the unit has ended."""

    slots = 1

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """The future of function(*arguments), which has ended."""
        future: Future[Any] = Future()
        answered(function, arguments).settle(future)
        return future

    def cancel(self, future: Future[Any]) -> None:
        """Nothing: it has ended."""

    def shutdown(self) -> None:
        """Nothing: there are no workers."""


class LocalExecutor:
    """Up to `jobs` processes, started when there is work for them and kept for more.

    They are in sessions of their own, so that Ctrl-C reaches them through this process alone, and stop their unit as if
    it had been cancelled when this process ends.
    """

    def __init__(self, jobs: int) -> None:
        self.slots = jobs
        self._threads = ThreadPoolExecutor(jobs, "worker")
        self._idle: list[_Worker] = []
        self._busy: dict[Future[Any], _Worker] = {}
        self._lock = threading.Lock()
        self._stopped: set[Future[Any]] = set()

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
                worker.interrupt()

    def shutdown(self) -> None:
        """Wait for the units that run, and end the processes."""
        self._threads.shutdown()
        for worker in self._idle:
            worker.end()

    def _work(self, future: Future[Any], function: Callable[..., Any], arguments: Any) -> None:
        with self._lock:
            if future in self._stopped:
                future.set_exception(UnitStopped())
                return
            worker = self._idle.pop() if self._idle else None
        try:
            worker = worker or _Worker()
        except OSError as error:  # no memory, or too many processes
            future.set_exception(WorkerLost(f"no process could be started: {error!r}"))
            return
        with self._lock:
            self._busy[future] = worker
            if future in self._stopped:
                worker.interrupt()
        try:
            answer = worker.call(function, arguments)
        except (EOFError, OSError) as error:
            self._forget(future)
            worker.end()
            future.set_exception(WorkerLost(f"its process was ended by {worker.end_in_words}: {error!r}"))
        except Exception as error:  # arguments that do not pickle
            self._forget(future, worker)
            future.set_exception(error)
        else:
            self._forget(future, worker)
            answer.settle(future)

    def _forget(self, future: Future[Any], worker: _Worker | None = None) -> None:
        with self._lock:
            del self._busy[future]
            if worker:
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

    def call(self, function: Callable[..., Any], arguments: Any) -> Answer:
        """What the process answers; raises EOFError or OSError where it is gone."""
        self._pipe.send((function, arguments))
        answer: Answer = self._pipe.recv()
        return answer

    def interrupt(self) -> None:
        """Send SIGINT."""
        with suppress(ProcessLookupError):
            os.kill(self._process.pid or 0, signal.SIGINT)

    def end(self) -> None:
        """Wait until the process has ended, which it does when nobody holds the other end of its pipe."""
        self._pipe.close()
        self._process.join()

    @property
    def end_in_words(self) -> str:
        """What ended the process."""
        code = self._process.exitcode or 0
        return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def serve(pipe: Connection) -> None:
    """Work on the units that arrive until the pipe ends; SIGINT stops a unit, and is nothing between two."""
    is_busy = False

    def interrupt(number: int, frame: object) -> None:
        if is_busy:
            raise KeyboardInterrupt

    if hasattr(os, "setsid"):
        with suppress(PermissionError):  # a process that leads its group already
            os.setsid()
    signal.signal(signal.SIGINT, interrupt)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_stop_with_parent, daemon=True).start()
    prepare()
    with suppress(EOFError, OSError):
        while True:
            function, arguments = pipe.recv()
            try:
                is_busy = True
                answer = answered(function, arguments)
            except KeyboardInterrupt:
                answer = Answer(is_stopped=True)
            finally:
                is_busy = False
            _send(pipe, answer)


def _send(pipe: Connection, answer: Answer) -> None:
    """Send the answer, or why it cannot be sent."""
    try:
        pipe.send(answer)
    except OSError:
        raise
    except Exception as error:  # a value that does not pickle
        pipe.send(Answer(failure=f"its value cannot be sent: {error!r}"))


def _stop_with_parent() -> None:
    """Wait until the parent has ended, then stop the unit in work; the pipe ends the process."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os.kill(os.getpid(), signal.SIGINT)


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Processes started inside receive no SIGINT before they have said what to do with it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
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
