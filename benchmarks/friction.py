"""How often steps with friction converge: random walks of commanded lengths under random loads.

    python benchmarks/friction.py

Every row walks from the equilibrium under 3 N per tendon, in which nothing has ever slipped: each step changes every
commanded length by up to 1 mm, at most 12 mm from the first one, and draws another dead force, normal with 0.35 N in
either direction, on a random link. Tensions stay between 0.5 and 15 N. What friction remembers goes on from step to
step; after a step that fails it is that of the step before.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint import (
    CapstanFriction,
    FrictionState,
    RollingChain,
    Status,
    five_link,
    solve_lengths_batch,
    solve_tensions,
    two_segment,
    uniform,
)
from rollingjoint.load import LOAD_COLUMNS
from rollingjoint.tables import markdown_table

CHAINS: dict[str, Callable[[], RollingChain]] = {
    "five_link": five_link,
    "uniform": uniform,
    "two_segment": two_segment,
    "uniform, 12 links": lambda: uniform(12),
}
FRICTIONS = tuple((presliding, mu) for presliding in (0.02, 0.01) for mu in (0.05, 0.1, 0.2, 0.25))
LARGEST_CHANGE, FARTHEST, FORCE, LIMITS = 1.0, 12.0, 0.35, (0.5, 15.0)  # mm, mm, N, N
STEPS = 20


class Walk(NamedTuple):
    """How the steps of many walks ended, (steps, rows)."""

    status: NDArray[np.int64]
    iterations: NDArray[np.int64]
    residual: NDArray[np.float64]


def walk(chain: RollingChain, rows: int, steps: int, seed: int) -> Walk:
    """Random walks of a chain with friction, side by side."""
    rng = np.random.default_rng(seed)
    begin = solve_tensions(chain, np.full(chain.n_tendons, 3.0))
    first = begin.lengths - begin.tensions / chain.stiffnesses
    commands = np.tile(first, (rows, 1))
    history = FrictionState(*(np.repeat(array[None], rows, axis=0) for array in begin.friction_state))
    link, force = LOAD_COLUMNS.index("link"), slice(LOAD_COLUMNS.index("fx"), LOAD_COLUMNS.index("fy") + 1)
    results = []
    for _ in range(steps):
        change = rng.uniform(-LARGEST_CHANGE, LARGEST_CHANGE, commands.shape)
        commands = np.clip(commands + change, first - FARTHEST, first + FARTHEST)
        loads = np.zeros((rows, 1, len(LOAD_COLUMNS)))
        loads[:, 0, link], loads[:, 0, force] = rng.integers(1, chain.n_links, rows), rng.normal(0.0, FORCE, (rows, 2))
        result = solve_lengths_batch(chain, commands, loads, tension_limits=LIMITS, history=history)
        history = result.friction_state
        results.append((result.status, result.iterations, result.residual))
    return Walk(*map(np.array, zip(*results, strict=True)))


def walks(rows: int, seed: int) -> Iterator[tuple[str, float, float, Walk]]:
    """Every chain with every friction: (name, presliding, mu, walk)."""
    for name, build in CHAINS.items():
        for presliding, mu in FRICTIONS:
            chain = build().replace(friction=CapstanFriction(mu, presliding))
            yield name, presliding, mu, walk(chain, rows, STEPS, seed)


def table(study: Iterator[tuple[str, float, float, Walk]]) -> str:
    """Counts by chain and friction, one column per status, and iterations, as Markdown."""
    names = [status.name.lower().replace("_", " ") for status in Status if status is not Status.INVALID_INPUT]
    head = ["chain", "presliding [mm]", "mu", *names, "iterations: mean, 99 %, most"]
    rows, worst, total, failed = [], 0.0, 0, 0
    for name, presliding, mu, result in study:
        counts = np.bincount(result.status.ravel(), minlength=len(Status))
        usable = Status.usable(result.status)
        worst, total = max(worst, float(result.residual[usable].max())), total + result.status.size
        failed += int(counts[Status.UNSTABLE :].sum())
        steps = result.iterations
        spread = f"{steps.mean():.1f}, {np.quantile(steps, 0.99):.0f}, {steps.max()}"
        rows.append([name, f"{presliding:g}", f"{mu:g}", *map(str, counts[: len(names)]), spread])
    text = f"{total} steps, {failed} failures; largest residual of the others: {worst:.1e} N·mm."
    return "\n".join([markdown_table(head, rows, left=1), "", text])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=1000, help=f"walks of {STEPS} steps per chain and friction")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    print(table(walks(arguments.rows, arguments.seed)))


if __name__ == "__main__":
    main()
