"""Runs of a search in several processes: each works on one run at a time and reports its progress.

Parent and worker communicate through a pipe. A worker receives the folder of a run; any message before the run is done,
and the end of the pipe, stops it after its current batch. So no worker outlives its parent.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from pathlib import Path

from agents.search.folder import SearchRun
from agents.search.run import Progress, evaluated_by, search
from rollingjoint.errors import RollingJointError

POLL = 0.2  # seconds between two looks at whether to stop
DONE = "done"
Said = Progress | str  # progress, DONE, or why a run failed


def work_on(runs: Sequence[Path], jobs: int, stop: Callable[[], bool]) -> Iterator[tuple[Path, Said]]:
    """Messages of the workers about the runs, as they arrive; ends when all runs are done, or stopped."""
    context, left, busy = get_context("spawn"), list(runs), dict[Connection, Path]()
    workers = []
    try:
        for _ in range(min(jobs, len(left))):
            ours, theirs = context.Pipe()
            worker = context.Process(target=_serve, args=(theirs,))
            with _without_interrupts(), _one_thread_each():
                worker.start()
            theirs.close()
            workers.append((worker, ours))
            _give(ours, left, busy)
        while busy:
            if stop():
                return
            for pipe in wait(list(busy), POLL):
                yield from _heard(pipe, left, busy)  # type: ignore[arg-type]
    finally:
        for _, pipe in workers:
            pipe.close()
        for worker, _ in workers:
            worker.join()


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Processes started inside ignore Ctrl-C: their parent stops them."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes started inside use one thread for linear algebra: for small matrices a second one only busy-waits."""
    names = "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _give(pipe: Connection, left: list[Path], busy: dict[Connection, Path]) -> None:
    if left:
        busy[pipe] = left.pop(0)
        pipe.send(busy[pipe])


def _heard(pipe: Connection, left: list[Path], busy: dict[Connection, Path]) -> Iterator[tuple[Path, Said]]:
    """The message of one worker; a worker that is done with a run receives the next."""
    try:
        said: Said = pipe.recv()
    except (EOFError, OSError):
        yield busy.pop(pipe), "its process was killed; the same command goes on with it"
        return
    yield busy[pipe], said
    if isinstance(said, str):
        del busy[pipe]
        _give(pipe, left, busy)


def _serve(pipe: Connection) -> None:
    """Work on the runs that arrive until the pipe ends."""
    try:
        while True:
            path = pipe.recv()
            try:
                for progress in _searched(path):
                    pipe.send(progress)
                    if pipe.poll():
                        return
                pipe.send(DONE)
            except (BrokenPipeError, EOFError):
                return
            except Exception as error:
                known = isinstance(error, RollingJointError | OSError)
                pipe.send(" ".join((str(error) if known else repr(error)).split()))
    except (EOFError, OSError):
        return


def _searched(path: Path) -> Iterator[Progress]:
    import torch

    from agents.search.problem import design_problem, optimiser

    torch.set_num_threads(1)
    run = SearchRun(path)
    problem, first = design_problem(run.config), optimiser(run.config, design_problem(run.config))
    # compilation does not count as time of a run
    first.tell(evaluated_by(problem, first, first.ask(run.config.budget)))
    return search(run, problem, optimiser(run.config, problem), run.config.budget)
