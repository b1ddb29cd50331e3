"""Workers of a Ray cluster: one processor and a declared amount of memory for every unit; Ray does the scheduling."""

from __future__ import annotations

import logging
import os
import platform
import signal
import socket
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from typing import Any

from agents.executors.protocol import UnitStopped, WorkerLost
from agents.executors.worker import UnitAnswer, answered, end_process, prepare
from rollingjoint import __version__
from rollingjoint.errors import ConfigError
from rollingjoint.interrupts import Interruptible

MEMORY = 2**30  # bytes per unit: a training of PPO takes some 600 MB
LOOPBACK = ("127.0.0.1", "localhost")
PATIENCE = 10.0  # seconds for the head to accept a connection
REFRESH = 5.0  # seconds between two looks at the size of the cluster


class RayExecutor:
    """A running Ray cluster, which this process joins as a driver.

    Units are handed over without Ray's own retries: agents.executors.driver counts and shows them.

    Args:
        address: HOST:PORT of its head, or "auto": the cluster that runs on this machine.
        memory: of a unit [bytes]; Ray starts no more units on a machine than fit.
    Raises:
        ConfigError: no cluster there.
    """

    def __init__(self, address: str = "auto", memory: int = MEMORY) -> None:
        self._ray = _joined(address)
        remote = self._ray.remote(num_cpus=1, memory=memory, max_retries=0)
        self._answer = remote(_answer_there)
        self._references: dict[Future[Any], Any] = {}
        self._stopped: set[Future[Any]] = set()
        self._slots, self._looked = 1, -REFRESH

    @property
    def slots(self) -> int:
        """Processors of the cluster as it is now."""
        if time.monotonic() - self._looked > REFRESH:
            self._looked = time.monotonic()
            self._slots = max(1, int(self._ray.cluster_resources().get("CPU", 1)))
        return self._slots

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """The future of function(*arguments), called in this process's current folder where that is there."""
        future: Future[Any] = Future()
        reference = self._answer.remote(__version__, os.getcwd(), function, arguments)
        self._references[future] = reference
        reference.future().add_done_callback(lambda theirs: self._settle(future, theirs))
        return future

    def cancel(self, future: Future[Any]) -> None:
        """Ask Ray to interrupt it; one that waits never begins."""
        reference = self._references.get(future)
        if reference is not None:
            self._stopped.add(future)
            with suppress(self._ray.exceptions.RayError):
                self._ray.cancel(reference, force=False)

    def shutdown(self) -> None:
        """Leave the cluster, which goes on running."""
        self._ray.shutdown()

    def _settle(self, future: Future[Any], theirs: Future[UnitAnswer]) -> None:
        del self._references[future]
        error = theirs.exception()
        if error is None:
            theirs.result().settle(future)
        elif future in self._stopped or isinstance(error, self._ray.exceptions.TaskCancelledError):
            future.set_exception(UnitStopped())
        elif isinstance(error, self._ray.exceptions.RayTaskError):  # such as a function that cannot be imported there
            UnitAnswer(failure=_reason(error.cause), details=str(error)).settle(future)
        else:
            future.set_exception(WorkerLost(f"its worker or machine is gone ({type(error).__name__})"))


def _joined(address: str) -> Any:
    """Ray, joined to the cluster; on the loopback interface alone where the head is there."""
    host, _, port = _address(address).rpartition(":")
    if not host or "/" in host or not port.isdecimal():
        raise _no_cluster(address, "Ray has noted none on this machine" if address == "auto" else "not HOST:PORT")
    if host in LOOPBACK:
        os.environ.setdefault("RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER", "0")  # Ray's name for: stay on 127.0.0.1
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    import ray

    try:
        socket.create_connection((host, int(port)), PATIENCE).close()  # Ray would wait for minutes
        ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
    except (OSError, ValueError, RuntimeError) as error:
        raise _no_cluster(address, " ".join(str(error).split())) from error
    return ray


def _address(address: str) -> str:
    """The address of the head; of "auto" the one that Ray has noted on this machine, or empty."""
    if address != "auto":
        return address
    noted = Path(tempfile.gettempdir()) / "ray" / "ray_current_cluster"
    with suppress(OSError):
        return os.environ.get("RAY_ADDRESS") or noted.read_text("utf-8").strip()
    return ""


def _no_cluster(address: str, reason: str) -> ConfigError:
    hint = f"Start a head with: ray start --head --include-dashboard=false ({reason[:120]})"
    return ConfigError("--cluster", address, "local, or auto or HOST:PORT of a running Ray cluster", hint)


def _reason(error: BaseException) -> str:
    """Why a task broke off outside the function that it calls, in one line."""
    text = " ".join(str(error).partition("traceback:")[0].split())
    missing = "No module named" in text
    return f"{text}: every machine of the cluster needs rollingjoint and its extras installed" if missing else text


def _answer_there(version: str, folder: str, function: Callable[..., Any], arguments: Any) -> UnitAnswer:
    """In a worker of Ray: call the function; the answer."""
    if version != __version__:
        place = f"the machine {platform.node()} has {__version__}"
        return UnitAnswer(
            failure=f"rollingjoint {version} is needed, {place}: install the same version on all machines"
        )
    if Path(folder).is_dir():
        os.chdir(folder)
    if not callable(signal.getsignal(signal.SIGINT)):  # ignored, if Ray was started in the background of a script
        signal.signal(signal.SIGINT, signal.default_int_handler)
    prepare()
    return answered(function, arguments, Interruptible(end_process))
