"""One caller at a time: a second thread gets an error instead of arrays that another one is writing."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

from rollingjoint.errors import RollingJointError

P = ParamSpec("P")
R = TypeVar("R")


class EnvironmentInUse(RollingJointError, RuntimeError):
    """A call of an environment while another call of it is running; nothing has changed."""


class Usable(Protocol):
    """What has methods that are used alone."""

    _calls: dict[str, Any]  # the running call, if there is one; empty at first


Self = TypeVar("Self", bound=Usable)


def used_alone(method: Callable[Concatenate[Self, P], R]) -> Callable[Concatenate[Self, P], R]:
    """The method, which raises EnvironmentInUse while another such method of the same object is running.

    A mark and no lock: nobody waits. `setdefault` marks in one step, whichever threads come together.
    """

    @functools.wraps(method)
    def alone(self: Self, *args: P.args, **kwargs: P.kwargs) -> R:
        calls, call = self._calls, object()
        try:
            if calls.setdefault("running", call) is not call:
                raise EnvironmentInUse(
                    f"{type(self).__name__}.{method.__name__}: another call of this environment is running. "
                    "Use it from one thread at a time, or make one environment per thread."
                )
            return method(self, *args, **kwargs)
        finally:
            if calls.get("running") is call:
                calls.clear()

    return alone
