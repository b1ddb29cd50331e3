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

from rollingjoint import SpatialChain, SpatialEquilibrium, pitch_yaw_two_segment, set_threads, solve_lengths_batch
from rollingjoint.load import Gravity
from speed_rows.machine import threads
from speed_rows.row import Row, Target, timed_row
from speed_rows.sizes import Sizes
from speed_rows.timing import Contestant, race

TITLE = "Rolling joints in space"
TEXT = """`pitch_yaw_two_segment()` under its weight: 14 joints, 8 tendons. Every solve has lengths of its own, up to
0.1 mm from those of the equilibrium that it starts at. The peer is the general solver on the same rows, which other
loads than dead forces, and chains of more than 15 joints, take; both take turns on one thread. A *row alone* is a
batch of one."""

FASTER = 1.5  # than the general solver, at least

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
    every = cases(sizes.walk)
    few = max(1, sizes.walk // 10)
    set_threads(1)
    for what, work, count in (
        (f"lengths, batch of {sizes.walk:,}, 1 thread", partial(together, every), sizes.walk),
        ("lengths, a row alone", partial(one_by_one, every, few), few),
    ):
        contestants = {"ours": Contestant(work, count), "general solver": Contestant(in_general(work), count)}
        timings = race(contestants, sizes.repeats)
        bound = timings["general solver"].seconds / FASTER * 1e6
        yield timed_row(what, "µs", timings, Target(bound) if count == sizes.walk else None)
    set_threads(threads())


def together(every: Cases) -> SpatialEquilibrium:
    """All cases in one call."""
    return solve_lengths_batch(every.chain, every.lengths, every.loads, every.starts)


def one_by_one(every: Cases, count: int) -> list[SpatialEquilibrium]:
    """The first cases, a call for each."""
    rows = zip(every.lengths[:count, None], every.starts[:count, None], strict=True)
    return [solve_lengths_batch(every.chain, lengths, every.loads, starts) for lengths, starts in rows]


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
