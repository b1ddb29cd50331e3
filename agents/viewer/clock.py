"""Time that passes in a room: a function called again and again in a separate thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable


class Clock:
    """Calls `tick` at most `rate` times per second from start() on, until it returns False or stop() is called.

    Args:
        tick: one step; returns whether the clock goes on.
        rate: per second; may be changed while the clock runs.
    """

    def __init__(self, tick: Callable[[], bool], rate: float) -> None:
        self.tick, self.rate = tick, rate
        self._stopping: threading.Event | None = None

    @property
    def running(self) -> bool:
        """Whether time passes."""
        return self._stopping is not None and not self._stopping.is_set()

    def start(self) -> None:
        """Start the clock, unless it runs."""
        if not self.running:
            self._stopping = threading.Event()
            threading.Thread(target=self._run, args=(self._stopping,), daemon=True).start()

    def stop(self) -> None:
        """Let no further tick begin."""
        if self._stopping is not None:
            self._stopping.set()

    def _run(self, stopping: threading.Event) -> None:
        due = time.monotonic()
        try:
            while not stopping.is_set() and self.tick():
                due = max(due + 1.0 / self.rate, time.monotonic())
                stopping.wait(due - time.monotonic())
        finally:
            stopping.set()
