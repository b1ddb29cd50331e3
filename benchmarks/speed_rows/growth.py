"""How the time of a solve in a batch grows with lanes, links, tendons and loads."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from rollingjoint import RollingChain, Tendon, WorldForce, set_threads, solve_tensions_batch, uniform
from rollingjoint.load import load_table
from speed_rows.batch import batch_of
from speed_rows.limit import BareWalk
from speed_rows.machine import threads
from speed_rows.row import LIMIT, Row, timed_row
from speed_rows.sizes import Sizes
from speed_rows.timing import fastest, race, repeated
from speed_rows.walk import Walk, random_walk

TITLE = "What a solve grows with"
TEXT = """The time of a whole call on 1 thread over the Newton iterations of all its lanes. *Lanes*:
`solve_lengths_batch` on the steps of the sections above; their limit is the time of the bare kernel over the same
number of iterations.
*Links*, *tendons* and *loads*: `solve_tensions_batch` on uniform chains of five links with two tendons and a force at
the tip, of which one changes at a time, in as many lanes as the table has at most; tensions of 2 to 8 N change at
random by at most 0.2 N, and every lane starts at the equilibrium before. Chains of more than 16 links are solved one
by one, by the general solver."""

LANES = (1, 8, 64, 1024, 8192)
LINKS, TENDONS = 5, 2
FORCE = (0.3, 0.1)  # N


def measure(sizes: Sizes, images: Path) -> Iterator[Row]:
    """Rows of the section."""
    set_threads(1)
    try:
        walk = random_walk(sizes.walk)
        for count in (count for count in LANES if count <= sizes.growth_lanes):
            yield _lanes(walk, count, sizes)
        lanes = sizes.growth_lanes
        for links in (2, 5, 10, 20, 50):
            yield _row(f"{links} links", lanes, sizes, links=links)
        for tendons in (2, 4, 8):
            yield _row(f"{tendons} tendons", lanes, sizes, tendons=tendons)
        for what, loaded in (("no load", ()), ("a force at the tip", (-1,)), ("a force on every link", (1, 2, 3, 4))):
            yield _row(what, lanes, sizes, loaded=loaded)
    finally:
        set_threads(threads())


def _lanes(walk: Walk, lanes: int, sizes: Sizes) -> Row:
    """Lanes of the walk beside the bare kernel."""
    calls = max(1, min(256, LANES[-1] // lanes))
    iterations = sum(walk.equilibria[lane % len(walk)].iterations for lane in range(lanes))
    works = {"ours": batch_of(walk, lanes), LIMIT: BareWalk(walk, lanes).batch}
    contestants = {name: repeated(work, iterations, calls) for name, work in works.items()}
    what = f"iteration, {lanes:,} {'lane' if lanes == 1 else 'lanes'}"
    note = f"{iterations / lanes:.1f} iterations a lane"
    return timed_row(what, "ns", race(contestants, sizes.repeats), note=note)


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
    timing = fastest(lambda: solve_tensions_batch(mechanism, after, table, start), iterations, sizes.repeats)
    note = f"{iterations / lanes:.1f} iterations a lane"
    return Row(f"iteration, {what}", 1e9 * timing.seconds, "ns", timing.sample, note=note)


def _chain(links: int, tendons: int) -> RollingChain:
    """A uniform chain whose tendons are spread over the width of its links."""
    return uniform(links).replace(tendons=[Tendon.on_surfaces(s) for s in np.linspace(-10.0, 10.0, tendons)])
