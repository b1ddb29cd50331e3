"""Clocks: contestants that take turns, so that a busy moment of the machine hits all of them."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Contestant:
    """Work to be timed: one call does `pieces` pieces of it."""

    work: Callable[[], object]
    pieces: int


def repeated(work: Callable[[], object], pieces: int, calls: int) -> Contestant:
    """So many calls of work that does `pieces` pieces: caches and other threads make a single short one slow."""
    return Contestant(lambda: [work() for _ in range(calls)], pieces * calls)


@dataclass(frozen=True)
class Timing:
    """The fastest of `repeats` calls of a contestant, in seconds per piece of work."""

    seconds: float
    pieces: int
    repeats: int

    @property
    def sample(self) -> str:
        """How much was measured, in words."""
        return f"best of {self.repeats} × {self.pieces:,}"


def race(contestants: Mapping[str, Contestant | str], repeats: int) -> dict[str, Timing | str]:
    """Timings by name, after one call to warm up; in place of a contestant a text says why it does not run."""
    runners = {name: runner for name, runner in contestants.items() if isinstance(runner, Contestant)}
    for runner in runners.values():
        runner.work()
    fastest = dict.fromkeys(runners, float("inf"))
    for _ in range(repeats):
        for name, runner in runners.items():
            fastest[name] = min(fastest[name], seconds_of(runner.work) / runner.pieces)
    return {
        name: runner if isinstance(runner, str) else Timing(fastest[name], runner.pieces, repeats)
        for name, runner in contestants.items()
    }


def fastest(work: Callable[[], object], pieces: int, repeats: int) -> Timing:
    """The timing of one contestant alone."""
    timing = race({"": Contestant(work, pieces)}, repeats)[""]
    assert isinstance(timing, Timing)
    return timing


def seconds_of(work: Callable[[], object]) -> float:
    """Seconds of one call, with the garbage collected before it."""
    gc.collect()
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin
