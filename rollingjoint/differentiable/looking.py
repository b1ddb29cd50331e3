"""Looks of the host at numbers on a device. Each look waits for all pending work of the device.

Where a look only saves work, it is taken on the CPU alone, where it is free: results are the same without it.
Where the host has to decide, it looks unless a fixed number of steps was asked for.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from torch import Tensor

_AS_ON_A_DEVICE = ContextVar("as_on_a_device", default=False)
_BLIND = ContextVar("blind", default=False)


def seen(flag: Tensor, otherwise: bool) -> bool:
    """A flag on the CPU; on another device `otherwise`, the value that leaves all work in place."""
    if flag.device.type != "cpu" or _AS_ON_A_DEVICE.get() or _BLIND.get():
        return otherwise
    return bool(flag)


def may_look() -> bool:
    """Whether the host may wait for the device to decide something."""
    return not _BLIND.get()


@contextmanager
def as_on_a_device() -> Iterator[None]:
    """A context without looks that only save work, on the CPU too: the computation of a device."""
    with _turned_on(_AS_ON_A_DEVICE):
        yield


@contextmanager
def without_looking(blind: bool = True) -> Iterator[None]:
    """A context without looks of the host; with False, no change."""
    if not blind:
        yield
        return
    with _turned_on(_BLIND):
        yield


@contextmanager
def _turned_on(variable: ContextVar[bool]) -> Iterator[None]:
    token = variable.set(True)
    try:
        yield
    finally:
        variable.reset(token)
