"""Chains in space with contacts: batches in SIMD lanes beside the general solver on the same rows."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint import (
    Problem,
    SpatialChain,
    SpatialEquilibrium,
    pitch_yaw_two_segment,
    prepare,
    set_threads,
    solve_lengths_batch,
)
from rollingjoint.load import Gravity
from speed_rows.machine import threads
from speed_rows.row import Row, Target, in_unit, timed_row
from speed_rows.sizes import Sizes
from speed_rows.timing import Contestant, Timing, race

TITLE = "Rolling joints in space"
TEXT = """`pitch_yaw_two_segment()` under its weight: 14 joints, 8 tendons. Every solve has lengths of its own, up to
0.1 mm from those of the equilibrium that it starts at. The peer is the general solver on the same rows, which other
loads than dead forces, and chains of more than 15 joints, take; both take turns on one thread. *Prepared* is `prepare`
once, and its `solve` for every row."""

FASTER = 1.5  # than the general solver, at least
MOST_ROWS = 400  # few milliseconds: on a machine that others share, longer work is interrupted more often
REPEATS = 10  # times as many as elsewhere, for the same reason

Array = NDArray[np.float64]


class Cases(NamedTuple):
    """Commands near equilibria, (n, 8), and the angles of these, (n, 14) [rad]."""

    chain: SpatialChain
    loads: list[Gravity]
    lengths: Array
    starts: Array


def cases(count: int) -> Cases:
    """This many commands, the same in every run."""
    chain, rng = pitch_yaw_two_segment(), np.random.default_rng(0)
    loads = [chain.gravity()]
    lengths = chain.neutral_lengths + rng.uniform(-0.8, 0.3, (count, chain.n_tendons))
    before = solve_lengths_batch(chain, lengths, loads)
    return Cases(chain, loads, lengths + rng.uniform(-0.1, 0.1, lengths.shape), before.joint_angles)


def measure(sizes: Sizes, images: Path) -> Iterator[Row]:
    """Rows of the section."""
    count = min(sizes.walk, MOST_ROWS)
    every, repeats = cases(count), REPEATS * sizes.repeats
    set_threads(1)
    timings = race(beside_the_general(partial(together, every), partial(together, every), count), repeats)
    general = timings["general solver"]
    target = Target(in_unit(general.seconds, "µs") / FASTER) if isinstance(general, Timing) else None
    yield timed_row(f"lengths, batch of {count}, 1 thread", "µs", timings, target)
    ours, theirs = (partial(one_by_one, prepare(every.chain, every.loads), every) for _ in range(2))
    yield timed_row("lengths, prepared", "µs", race(beside_the_general(ours, theirs, count), repeats))
    set_threads(threads())


def together(every: Cases) -> SpatialEquilibrium:
    """All cases in one call."""
    return solve_lengths_batch(every.chain, every.lengths, every.loads, every.starts)


def one_by_one(problem: Problem[SpatialEquilibrium], every: Cases) -> list[SpatialEquilibrium]:
    """All cases, a call for each."""
    rows = zip(every.lengths, every.starts, strict=True)
    return [problem.solve(lengths, start) for lengths, start in rows]


def beside_the_general(ours: Callable[[], object], theirs: Callable[[], object], count: int) -> dict[str, Contestant]:
    """Runners of a race: `count` rows in lanes, and by the general solver."""
    return {"ours": Contestant(ours, count), "general solver": Contestant(in_general(theirs), count)}


def in_general(work: Callable[[], object]) -> Callable[[], object]:
    """The same work by the general solver."""

    def general() -> object:
        with _without_lanes():
            return work()

    return general


@contextmanager
def _without_lanes() -> Iterator[None]:
    kernels = SpatialChain.kernels
    SpatialChain.kernels = replace(kernels, most_joints=0)
    try:
        yield
    finally:
        SpatialChain.kernels = kernels
