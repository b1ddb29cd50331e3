"""The one display of work: units that run, are done or have failed, the rate, the time left."""

from __future__ import annotations

import sys
import time
from typing import Any

from agents.runs.command_line import progress_bar

EVERY = 30.0  # seconds between two plain lines at least


class Progress:
    """A line at the foot of a terminal; elsewhere a plain line now and then, on standard error. A context manager.

    Args:
        total: units in all. what: the noun for one of them, such as "run".
    """

    def __init__(self, total: int, what: str) -> None:
        self.total, self.what = total, what
        self.running = self.done = self.failed = self.lost = 0
        self._begun = self._shown = time.monotonic()

    def __enter__(self) -> Progress:
        layout = "{l_bar}{bar}| {n_fmt}/{total_fmt}{postfix}"
        self._bar: Any = progress_bar(self.total, f" {self.what}s", bar_format=layout)
        self.show()
        return self

    def __exit__(self, *exception: object) -> None:
        self._bar.close()

    def show(self) -> None:
        """Show how far the work is; without a terminal, no more often than twice a minute."""
        if not self._bar.disable:
            self._bar.n = self.done + self.failed
            self._bar.set_postfix_str(self.text())
        elif time.monotonic() - self._shown >= EVERY:
            self._shown = time.monotonic()
            print(f"{self.done} of {self.total} {self.what}s done, {self.text()}", file=sys.stderr, flush=True)

    def write(self, line: str) -> None:
        """A separate line, above the display."""
        self._bar.write(line)

    def text(self) -> str:
        """The units that run, have failed or were lost, the rate and the time left."""
        ended, seconds = self.done + self.failed, time.monotonic() - self._begun
        parts = [f"{self.running} running"]
        parts += [
            f"{count} {word}" for count, word in ((self.failed, "failed"), (self.lost, "lost and retried")) if count
        ]
        if ended:
            parts += [_rate(ended / max(seconds, 1e-9)), f"about {_time((self.total - ended) * seconds / ended)} left"]
        return ", ".join(parts)


def _rate(per_second: float) -> str:
    """A rate in the unit in which it is at least 1, per hour at most."""
    for unit, seconds in (("s", 1), ("min", 60), ("h", 3600)):
        if per_second * seconds >= 1 or unit == "h":
            break
    return f"{per_second * seconds:.3g}/{unit}"


def _time(seconds: float) -> str:
    """A time in hours and minutes, or minutes and seconds."""
    total = round(seconds)
    return f"{total // 3600} h {total % 3600 // 60:02} min" if total >= 3600 else f"{total // 60} min {total % 60:02} s"
