"""Executors, and the ways a unit of work can end."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, Protocol

from rollingjoint.errors import RollingJointError


class Executor(Protocol):
    """Calls functions elsewhere. A function and its arguments pickle; it runs alone in the main thread of a process."""

    @property
    def slots(self) -> int:
        """How many units run at a time, at least 1; a cluster may grow and shrink."""

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """The future of function(*arguments).

        Its result is the function's. Its exception is UnitFailed where the function raised, UnitStopped
        where it was cancelled, WorkerLost where the process or the machine is gone.
        """

    def cancel(self, future: Future[Any]) -> None:
        """Ask a unit to stop: one that runs receives SIGINT, another never begins. Its future tells when it ends."""

    def shutdown(self) -> None:
        """Ask the units that are left to stop, wait for them, and end the workers."""


class UnitFailed(RollingJointError):
    """A unit with a function that raised: the reason in one line. It would raise again, so it is not tried again."""


class UnitStopped(Exception):
    """A unit that was asked to stop and did."""


class WorkerLost(Exception):
    """A unit with a lost process or machine; it can be tried again."""
