"""The command `rj warmup`: all kernels compiled before they are needed, with a display."""

from __future__ import annotations

import shutil
import sys
import time

from rollingjoint._numba.cache import cache_directory
from rollingjoint.warmup import Group, WarmupProgress, all_groups, compile_kernels, missing


def run() -> bool:
    """Compile what is not on disk, and print what is done; returns whether all kernels are there."""
    begin = time.perf_counter()
    groups = all_groups()
    left = missing(groups)
    if not left:
        print(f"all kernels are there, kept in {cache_directory()}")
        return True
    display = Display()
    try:
        well = compile_kernels(left, display)
    finally:
        display.clear()
    if well:
        print(f"kernels ready after {time.perf_counter() - begin:.1f} s, kept in {cache_directory()}")
    return well


class Display(WarmupProgress):
    """A line for every group that begins or is done; at a terminal, a last line with those that are being compiled."""

    def __init__(self) -> None:
        self._begun: dict[str, float] = {}  # s, by title
        self._at_terminal = sys.stdout.isatty()
        self._drawn = ""

    def started(self, group: Group) -> None:
        """At a terminal the last line shows it."""
        self._begun[group.title] = time.perf_counter()
        if not self._at_terminal:
            print(f"compiling {group.title}", flush=True)

    def ended(self, group: Group, seconds: float, error: str) -> None:
        """An error goes to stderr, in one line."""
        del self._begun[group.title]
        self.clear()
        if error:
            print(f"rj warmup: error: {group.title}: {error}", file=sys.stderr, flush=True)
        else:
            print(f"compiled {group.title} in {seconds:.1f} s", flush=True)

    def waits(self) -> None:
        """Write the last line anew when it has changed."""
        now = time.perf_counter()
        text = ", ".join(f"{title} ({now - begin:.0f} s)" for title, begin in self._begun.items())
        line = f"compiling {text}"[: shutil.get_terminal_size().columns - 1] if text else ""
        if self._at_terminal and line != self._drawn:
            self.clear()
            print(line, end="\r", flush=True)
            self._drawn = line

    def clear(self) -> None:
        """Take the last line away."""
        if self._drawn:
            print(" " * len(self._drawn), end="\r", flush=True)
            self._drawn = ""
