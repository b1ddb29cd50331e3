"""How the time of a solve in a batch grows with lanes, links, tendons and loads."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from rollingjoint import RollingChain, Tendon, WorldForce, set_threads, solve_tensions_batch, uniform
from rollingjoint.load import load_table
from speed_rows.machine import threads
from speed_rows.row import Row
from speed_rows.sizes import Sizes
from speed_rows.timing import fastest

TITLE = "What a solve grows with"
TEXT = """`solve_tensions_batch` on uniform chains, 1 thread: the time of the whole call over the Newton iterations of
all lanes. One of lanes, links, tendons and loads changes at a time; the others are the most lanes of the table, five
links, two tendons and a force at the tip. Tensions of 2 to 8 N change at random by at most 0.2 N, and every lane
starts at the equilibrium before. Chains of more than 16 links are solved one by one, by the solver for all cases."""

LINKS, TENDONS = 5, 2
FORCE = (0.3, 0.1)  # N


def measure(sizes: Sizes, images: Path) -> Iterator[Row]:
    """Rows of the section."""
    set_threads(1)
    try:
        lanes = sizes.growth_lanes
        for count in dict.fromkeys([1, 8, 64, lanes]):
            yield _row(f"{count:,} {'lane' if count == 1 else 'lanes'}", count, sizes)
        for links in (2, 5, 10, 20, 50):
            yield _row(f"{links} links", lanes, sizes, links=links)
        for tendons in (2, 4, 8):
            yield _row(f"{tendons} tendons", lanes, sizes, tendons=tendons)
        for what, loaded in (("no load", ()), ("a force at the tip", (-1,)), ("a force on every link", (1, 2, 3, 4))):
            yield _row(what, lanes, sizes, loaded=loaded)
    finally:
        set_threads(threads())


def _row(
    what: str, lanes: int, sizes: Sizes, links: int = LINKS, tendons: int = TENDONS, loaded: Sequence[int] = (-1,)
) -> Row:
    mechanism, rng = _chain(links, tendons), np.random.default_rng(0)
    loads = [WorldForce(link, FORCE) for link in loaded]
    table = np.tile(load_table(loads, mechanism.n_links), (lanes, 1, 1))
    before = rng.uniform(2.0, 8.0, (lanes, tendons)) * TENDONS / tendons
    after = before + rng.uniform(-0.2, 0.2, before.shape)
    start = solve_tensions_batch(mechanism, before, table).joint_angles
    iterations = int(solve_tensions_batch(mechanism, after, table, start).iterations.sum())
    calls = max(1, 256 // lanes)
    timing = fastest(
        lambda: [solve_tensions_batch(mechanism, after, table, start) for _ in range(calls)],
        calls * iterations,
        sizes.repeats,
    )
    note = f"{iterations / lanes:.1f} iterations a lane"
    return Row(f"iteration, {what}", 1e9 * timing.seconds, "ns", timing.sample, note=note)


def _chain(links: int, tendons: int) -> RollingChain:
    """A uniform chain whose tendons are spread over the width of its links."""
    return uniform(links).replace(tendons=[Tendon.on_surfaces(s) for s in np.linspace(-10.0, 10.0, tendons)])
