"""Many solves in one call, on one thread and on all."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from rollingjoint import RollingChain, five_link, set_threads, solve_lengths_batch
from speed_rows.limit import BareWalk
from speed_rows.machine import threads
from speed_rows.plots import log_log
from speed_rows.row import LIMIT, Row, Target, timed_row
from speed_rows.sizes import Sizes
from speed_rows.solver import public_walk
from speed_rows.timing import Contestant, fastest, race
from speed_rows.walk import TENSION_LIMITS, Walk, random_walk

TITLE = "Batches"
TEXT = """`solve_lengths_batch` on the same steps, each a lane of its own that starts at the equilibrium before. The
peer is a Python loop over `solve_lengths`."""
PICTURES = {"speed_batch.png": "Solves per second over the size of the batch, on one thread and on all"}

PICTURE_REPEATS = 12
DESIGNS = 64  # different mechanisms in the row of mixed batches


def measure(sizes: Sizes, images: Path) -> Iterator[Row]:
    """Rows of the section, and its picture."""
    walk = random_walk(sizes.walk)
    loop = Contestant(lambda: public_walk(walk), len(walk))
    limit = Contestant(BareWalk(walk, sizes.lanes).batch, sizes.lanes)
    for count in dict.fromkeys([1, threads()]):
        set_threads(count)
        ours = Contestant(batch_of(walk, sizes.lanes), sizes.lanes)
        timings = race({"ours": ours, LIMIT: limit, "loop over solve_lengths": loop}, sizes.repeats)
        target = Target(3e6, at_least=True) if count == threads() else None
        yield timed_row(f"{sizes.lanes:,} lanes, {threads_in_words(count)}", "solves/s", timings, target)
    yield _mixed(walk, sizes)
    _draw(walk, sizes, images / "speed_batch.png")


def batch_of(walk: Walk, lanes: int, designs: int = 1) -> Callable[[], object]:
    """A call that solves this many lanes, of one mechanism or of several that differ in their tendons' stiffness."""
    commands, loads, starts = walk.tiled(lanes)
    mechanism: RollingChain | list[RollingChain] = walk.mechanism
    if designs > 1:
        variants = [five_link(stiffness=5.0 + 0.01 * k) for k in range(designs)]
        mechanism = [variants[lane % designs] for lane in range(lanes)]
    return lambda: solve_lengths_batch(mechanism, commands, loads, starts, tension_limits=TENSION_LIMITS)


def _mixed(walk: Walk, sizes: Sizes) -> Row:
    """Lanes that differ in their mechanism, beside lanes that share one."""
    what = f"{sizes.lanes:,} lanes of {DESIGNS} mechanisms, {threads_in_words(threads())}"
    mixed, alike = batch_of(walk, sizes.lanes, DESIGNS), batch_of(walk, sizes.lanes)
    contestants = {"ours": Contestant(mixed, sizes.lanes), "one mechanism": Contestant(alike, sizes.lanes)}
    return timed_row(what, "solves/s", race(contestants, sizes.repeats))


def _draw(walk: Walk, sizes: Sizes, path: Path) -> None:
    curves = {}
    for count in dict.fromkeys([1, threads()]):
        set_threads(count)
        curves[threads_in_words(count)] = [(lanes, 1.0 / _seconds_per_lane(walk, lanes)) for lanes in sizes.batches]
    set_threads(threads())
    log_log(path, "lanes in the batch", "solves per second", curves)


def _seconds_per_lane(walk: Walk, lanes: int) -> float:
    """Seconds per lane; small batches are called often enough to be timed."""
    solve, calls = batch_of(walk, lanes), max(1, 256 // lanes)
    return fastest(lambda: [solve() for _ in range(calls)], calls * lanes, PICTURE_REPEATS).seconds


def threads_in_words(count: int) -> str:
    """1 thread, 2 threads."""
    return "1 thread" if count == 1 else f"{count} threads"
