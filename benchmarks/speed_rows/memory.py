"""Memory that a lane of a batch takes beyond its results."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path

import gymnasium
import numpy as np

import rj_gym  # noqa: F401  (registers its ids)
from rollingjoint import Equilibrium, solve_lengths_batch
from speed_rows.row import Row, Target
from speed_rows.sizes import Sizes
from speed_rows.walk import TENSION_LIMITS, random_walk

TITLE = "Memory"
ONCE = True
TEXT = """Peak of what Python and NumPy allocate (`tracemalloc`) in a call with twice as many lanes minus that with
as many, per lane; inputs are made before. The results of the solver are subtracted. Scratch space of the compiled
code, which does not grow with the lanes, is not seen."""


def measure(sizes: Sizes, images: Path) -> Iterator[Row]:
    """Rows of the section."""
    walk, lanes = random_walk(sizes.walk), sizes.lanes
    first, second = walk.tiled(lanes), walk.tiled(2 * lanes)

    def solve(commands: np.ndarray, loads: np.ndarray, starts: np.ndarray) -> Equilibrium:
        return solve_lengths_batch(walk.mechanism, commands, loads, starts, tension_limits=TENSION_LIMITS)

    results = sum(value.nbytes for value in vars(solve(*first)).values() if isinstance(value, np.ndarray)) / lanes
    growth = (peak(lambda: solve(*second)) - peak(lambda: solve(*first))) / lanes
    sample = f"{lanes:,} and {2 * lanes:,} lanes"
    note = f"the results take {results / 1024:.2f} KiB more"
    yield Row("solve_lengths_batch, per lane", (growth - results) / 1024, "KiB", sample, Target(4.0), note=note)

    lanes = sizes.vector_lanes
    growth = (peak(lambda: two_steps(2 * lanes)) - peak(lambda: two_steps(lanes))) / lanes
    sample = f"{lanes:,} and {2 * lanes:,} lanes"
    note = "all that it holds and allocates: construction, reset, two steps"
    yield Row("vector environment, per lane", growth / 1024, "KiB", sample, note=note)


def two_steps(lanes: int) -> None:
    """A vector environment made, reset and stepped twice."""
    env = gymnasium.make_vec("rj_gym/RollingJoint-v0", lanes, "vector_entry_point")
    env.reset(seed=0)
    for _ in range(2):
        env.step(np.zeros(env.action_space.shape, np.float32))


def peak(call: Callable[[], object]) -> int:
    """Most bytes that a call holds at once."""
    call()
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
