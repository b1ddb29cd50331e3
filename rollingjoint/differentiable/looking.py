"""Looks of the host at numbers on a device, each of which waits for all that the device has still to do.

Where a look only saves work, it is taken on the CPU alone, where it costs nothing: results are the same without it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from torch import Tensor

_AS_ON_A_DEVICE = ContextVar("as_on_a_device", default=False)


def seen(flag: Tensor, otherwise: bool) -> bool:
    """A flag on the CPU; on another device `otherwise`, the value with which everything is computed."""
    if flag.device.type != "cpu" or _AS_ON_A_DEVICE.get():
        return otherwise
    return bool(flag)


@contextmanager
def as_on_a_device() -> Iterator[None]:
    """A context in which no look that only saves work is taken, on the CPU either: what a device would compute."""
    token = _AS_ON_A_DEVICE.set(True)
    try:
        yield
    finally:
        _AS_ON_A_DEVICE.reset(token)
