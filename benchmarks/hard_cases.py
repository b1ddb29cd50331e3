"""How often the solvers fail where it is hard to find an equilibrium: the chains of `hard_chain`, cold starts.

    python benchmarks/hard_cases.py --rows 100000 --seed 0

Every chain meets eight batches: tensions or lengths given, without load, with dead loads and springs of up to 1.5 N and
of up to 0.01 N, with follower forces.
"""

from __future__ import annotations

import argparse
import itertools
from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from rollingjoint import Equilibrium, Status, solve_lengths_batch, solve_tensions_batch
from rollingjoint.chain.random_chain import HARD_KINDS, hard_chain, hard_inputs, hard_loads
from rollingjoint.tables import markdown_table

ROWS = 64
LOADS = (("none", 0.0), ("dead", 1.5), ("dead", 0.01), ("follower", 1.5))
LIMITS = ((0.0, np.inf), (0.0, 15.0), (0.5, 30.0))


class Case(NamedTuple):
    """One batch: the kind of chain, what acted, and how its rows ended."""

    kind: str
    load: str
    result: Equilibrium


def cases(seed: int, rows: int) -> Iterator[Case]:
    """Batches of every kind of chain in turn, until every kind of load has had so many rows in all."""
    rng = np.random.default_rng(seed)
    done: Counter[str] = Counter()
    for kind in itertools.cycle(HARD_KINDS):
        chain = hard_chain(rng, kind)
        for given, (load, largest) in itertools.product(("tensions", "lengths"), LOADS):
            loads = hard_loads(rng, chain, kind, largest, load == "follower") if load != "none" else []
            inputs, limits = hard_inputs(rng, chain, kind, given, ROWS), LIMITS[rng.integers(len(LIMITS))]
            if given == "tensions":
                result = solve_tensions_batch(chain, inputs, loads)
            else:
                result = solve_lengths_batch(chain, inputs, loads, tension_limits=limits)
            done[load] += ROWS
            yield Case(kind, load, result)
        if kind == HARD_KINDS[-1] and min(done.values()) >= rows:
            return


def table(study: Iterator[Case]) -> str:
    """Rows and failures by kind of chain and load, as Markdown."""
    rows: Counter[tuple[str, str]] = Counter()
    failures: Counter[tuple[str, str]] = Counter()
    for kind, load, result in study:
        failed = int(np.sum((result.status == Status.NOT_CONVERGED) | (result.status == Status.UNSTABLE)))
        for key in ((kind, load), ("all", load)):
            rows[key] += len(result.status)
            failures[key] += failed
    loads = tuple(dict.fromkeys(load for load, _ in LOADS))
    lines = [
        [kind, *(f"{failures[kind, load]} of {rows[kind, load]:,}" for load in loads)] for kind in (*HARD_KINDS, "all")
    ]
    return markdown_table(["chain", *loads], lines, left=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=10_000, help="of each kind of load")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    print(table(cases(arguments.seed, arguments.rows)))


if __name__ == "__main__":
    main()
