"""The command `rj warmup`: all kernels compiled before they are needed, with a display."""

from __future__ import annotations

import argparse
import shutil
import sys
import time

from rollingjoint._numba.cache import cache_directory
from rollingjoint.checks import as_choice
from rollingjoint.warmup import FAMILIES, Group, WarmupProgress, all_groups, compile_kernels, missing


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    text = f"only kernels of these: {', '.join(FAMILIES)} (default: all)"
    parser.add_argument("families", nargs="*", metavar="MECHANISM", help=text)
    parser.add_argument("--without-walls", action="store_true", help="leave out kernels of mechanisms among walls")


def run(families: list[str], walls: bool) -> bool:
    """Compile the kernels that are not on disk, and print the progress; returns whether all kernels are there.

    Args:
        families: of rollingjoint.warmup.FAMILIES; empty: all. walls: also of mechanisms among walls.
    Raises:
        InvalidInput: another family.
    """
    begin = time.perf_counter()
    families = [as_choice("MECHANISM", family, FAMILIES) for family in families] or list(FAMILIES)
    groups = all_groups(families, walls)
    missing_groups = missing(groups)
    if not missing_groups:
        print(f"all kernels are there, kept in {cache_directory()}")
        return True
    display = Display()
    try:
        complete = compile_kernels(missing_groups, display)
    finally:
        display.clear()
    if complete:
        print(f"kernels ready after {time.perf_counter() - begin:.1f} s, kept in {cache_directory()}")
    return complete


class Display(WarmupProgress):
    """A line for every group that starts or ends; at a terminal, a last line with the running groups."""

    def __init__(self) -> None:
        self._begun: dict[str, float] = {}  # s, by title
        self._at_terminal = sys.stdout.isatty()
        self._drawn = ""

    def started(self, group: Group) -> None:
        """Add the group to the last line, or print a line where there is no terminal."""
        self._begun[group.title] = time.perf_counter()
        if not self._at_terminal:
            print(f"compiling {group.title}", flush=True)

    def ended(self, group: Group, seconds: float, error: str) -> None:
        """Print a line: the time, or the error on stderr."""
        del self._begun[group.title]
        self.clear()
        if error:
            print(f"rj warmup: error: {group.title}: {error}", file=sys.stderr, flush=True)
        else:
            print(f"compiled {group.title} in {seconds:.1f} s", flush=True)

    def waits(self) -> None:
        """Rewrite the last line when it has changed."""
        now = time.perf_counter()
        text = ", ".join(f"{title} ({now - begin:.0f} s)" for title, begin in self._begun.items())
        line = f"compiling {text}"[: shutil.get_terminal_size().columns - 1] if text else ""
        if self._at_terminal and line != self._drawn:
            self.clear()
            print(line, end="\r", flush=True)
            self._drawn = line

    def clear(self) -> None:
        """Erase the last line."""
        if self._drawn:
            print(" " * len(self._drawn), end="\r", flush=True)
            self._drawn = ""
