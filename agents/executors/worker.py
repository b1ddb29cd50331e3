"""The code of every worker: a unit on one thread, with kernels at hand, that ends in an answer that pickles."""

from __future__ import annotations

import functools
import os
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from agents.executors.protocol import UnitFailed, UnitStopped
from agents.runs.locks import file_lock
from rollingjoint.errors import RollingJointError, one_line
from rollingjoint.interrupts import INTERRUPTED, Interruptible

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")  # read when the libraries are loaded


@dataclass(frozen=True)
class UnitAnswer:
    """How a unit ended: with a value, else with why it failed in one line and the traceback, else stopped."""

    value: Any = None
    failure: str = ""
    details: str = ""
    is_stopped: bool = False

    def settle(self, future: Future[Any]) -> None:
        """Let a future end like this."""
        if self.is_stopped:
            future.set_exception(UnitStopped())
        elif self.failure:
            error = UnitFailed(self.failure)
            error.add_note(self.details)
            future.set_exception(error)
        else:
            future.set_result(self.value)


def answered(
    function: Callable[..., Any],
    arguments: Sequence[Any],
    interruption: Interruptible,
    begin: Callable[[], None] = lambda: None,
) -> UnitAnswer:
    """Call the function; the answer, also where the function raises.

    Args:
        interruption: has SIGINT stop it.
        begin: called when SIGINT does so.
    """
    try:
        with interruption:
            begin()
            return UnitAnswer(function(*arguments))
    except KeyboardInterrupt:
        return UnitAnswer(is_stopped=True)
    except Exception as error:
        if interruption.is_interrupted:
            return UnitAnswer(is_stopped=True)
        expected = isinstance(error, RollingJointError | OSError)
        return UnitAnswer(failure=one_line(str(error) if expected else repr(error)), details=traceback.format_exc())


def end_process() -> None:
    """End this process: its unit was interrupted and goes on."""
    os._exit(INTERRUPTED)


@functools.cache
def prepare() -> None:
    """Make this process a worker: one thread for everything, and kernels compiled once per machine."""
    from rollingjoint import set_threads

    set_threads(1)
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)
    os.environ.update(dict.fromkeys(THREADS, "1"))
    _warm()


def _warm() -> None:
    """Compile the kernels that most tasks need unless this machine has them; the other workers wait so long."""
    from rollingjoint.compiled import cache_directory

    done = cache_directory() / "warm"
    if done.exists():
        return
    with file_lock(cache_directory() / "warm.lock", wait=True):
        if not done.exists():
            _compile()
            done.touch()


def _compile() -> None:
    """Call every kernel of solvers and tracking environments once."""
    import gymnasium
    import numpy as np

    import rj_gym  # noqa: F401  (registers the environments)
    from rollingjoint import five_link, small_arm, solve_lengths, solve_tensions

    for mechanism in (five_link(), small_arm()):
        assert solve_tensions(mechanism, np.ones(mechanism.n_tendons)).stiffness is not None
        solve_lengths(mechanism, mechanism.neutral_lengths + 10.0)  # the general solver
    for name in ("RollingJoint-v0", "FlexibleArm-v0"):
        envs = gymnasium.make_vec(f"rj_gym/{name}", 2, "vector_entry_point")
        envs.reset(seed=0)
        envs.step(envs.action_space.sample())
        envs.close()


@contextmanager
def output_to(log: Path) -> Iterator[None]:
    """Whatever this process prints inside, from any language, goes to the end of a file instead."""
    log.parent.mkdir(parents=True, exist_ok=True)
    copies = {number: os.dup(number) for number in (1, 2)}
    sys.stdout.flush()
    sys.stderr.flush()
    try:
        with log.open("ab") as stream:
            for number in copies:
                os.dup2(stream.fileno(), number)
        yield
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        for number, before in copies.items():
            os.dup2(before, number)
            os.close(before)
