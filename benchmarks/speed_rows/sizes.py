"""How much is measured: FULL for the page, QUICK for a test that only wants every row."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Sizes:
    """Sizes of all measurements."""

    repeats: int = 5
    walk: int = 1000  # warm solves
    slow_peer_solves: int = 10  # of peers that take milliseconds
    lanes: int = 16_384
    batches: tuple[int, ...] = tuple(4**k for k in range(9))
    growth_lanes: int = 8192
    links: tuple[int, ...] = (5, 8, 12, 20, 50, 100, 200, 500, 1000, 2000)
    scalar_steps: int = 10_000
    vector_lanes: int = 1024
    vector_episodes: int = 2
    vector_sizes: tuple[int, ...] = (1, 4, 16, 64, 256, 1024, 4096, 16_384)
    training_lanes: tuple[int, ...] = (1024, 64)
    training_rollouts: int = 13  # of 8 steps: two episodes and a bit
    training_repeats: int = 3
    process_starts: int = 7
    profile_updates: int = 12  # of the demo's configuration, and of the one with 1,024 lanes
    profile_repeats: int = 2
    training_seeds: int = 3
    training_seconds: float = 60.0  # of processor time that a training gets at most
    minutes: bool = True  # measure what takes a minute whatever its size: fresh compilation, instruction counts


FULL = Sizes()
QUICK = Sizes(
    repeats=1,
    walk=40,
    slow_peer_solves=2,
    lanes=256,
    batches=(1, 16, 256),
    growth_lanes=64,
    links=(5, 100, 200),
    scalar_steps=200,
    vector_lanes=16,
    vector_episodes=1,
    vector_sizes=(1, 16),
    training_lanes=(64,),
    training_rollouts=2,
    training_repeats=1,
    process_starts=1,
    profile_updates=1,
    profile_repeats=1,
    minutes=False,
)
LEFT_OUT = "left out of --quick"
