"""How often the solvers converge: random mechanisms, loads, tensions and lengths, cold and warm.

    python benchmarks/convergence.py --mechanisms 1250 --seed 0

Every mechanism meets eight cases: tensions or lengths given, without load, with dead loads and springs, with follower
forces; each is solved from s = 0 (cold) and again from a perturbed solution (warm).
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from rollingjoint import (
    BodyWrench,
    Equilibrium,
    RollingChain,
    Status,
    solve_lengths,
    solve_tensions,
    solve_tensions_batch,
)
from rollingjoint.chain.random_chain import random_chain, random_lengths, random_loads, random_tensions
from rollingjoint.statics.solve import Start
from rollingjoint.tables import markdown_table

N_CASES = 8


class Case(NamedTuple):
    """One solve: what was given, what acted, from where, and how it ended."""

    given: str
    load: str
    start: str
    result: Equilibrium


def cases(seed: int, n_mechanisms: int) -> Iterator[Case]:
    """All solves of the study, in order."""
    rng = np.random.default_rng(seed)
    for _ in range(n_mechanisms):
        mechanism = random_chain(rng)
        for k in range(N_CASES):
            yield from _cold_and_warm(rng, mechanism, given_lengths=k % 2 == 0, loaded=k >= 2, follower=k >= 6)


def table(study: Iterator[Case]) -> str:
    """Counts by input, load and start, one column per status, and the worst converged residual, as Markdown."""
    counts: Counter[tuple[str, str, str, Status]] = Counter()
    iterations: dict[tuple[str, str, str], list[int]] = {}
    worst, restarted = 0.0, []
    for given, load, start, result in study:
        counts[given, load, start, result.status] += 1
        iterations.setdefault((given, load, start), []).append(result.iterations)
        if result.status is Status.CONVERGED:
            worst = max(worst, result.residual)
        if result.status in (Status.UNSTABLE, Status.NOT_CONVERGED) and given == "tensions":
            restarted.append(f"{start} {result.status.name}, {result.mechanism.n_links} links: {restarts(result)}")
    names = [status.name.lower().replace("_", " ") for status in Status]
    head, rows = ["given", "load", "start", *names, "iterations: median, 99 %, most"], []
    for key in sorted(iterations):
        row = [str(counts[(*key, status)]) for status in Status]
        steps = iterations[key]
        spread = f"{np.median(steps):.0f}, {np.quantile(steps, 0.99):.0f}, {max(steps)}"
        rows.append([*key, *row, spread])
    total = sum(counts.values())
    text = f"{total} solves; largest residual of a converged one: {worst:.1e} N·mm."
    return "\n".join([markdown_table(head, rows, left=3), "", text, *restarted])


def restarts(failed: Equilibrium, count: int = 400) -> str:
    """How many random starts end in a stable equilibrium under the same tensions and loads, in words."""
    low, high = failed.mechanism.joint_limits.T
    s = np.random.default_rng(0).uniform(low, high, (count, len(low)))
    starts = failed.mechanism.joint_angles(s)
    tensions, loads = np.tile(failed.tensions, (count, 1)), np.tile(failed.loads, (count, 1, 1))
    again = solve_tensions_batch(failed.mechanism, tensions, loads, starts)
    at_limit = int(np.sum(again.status == Status.AT_LIMIT))
    return f"{int(np.sum(again.ok))} of {count} random starts end in an equilibrium, {at_limit} at a surface limit"


def _cold_and_warm(
    rng: np.random.Generator, mechanism: RollingChain, given_lengths: bool, loaded: bool, follower: bool
) -> Iterator[Case]:
    loads = random_loads(rng, mechanism.n_links, follower=follower) if loaded else []
    kind = "none" if not loaded else "dead, spring"
    if any(isinstance(load, BodyWrench) for load in loads):
        kind = "follower"
    if given_lengths:
        command = random_lengths(rng, mechanism)

        def solve(start: Start) -> Equilibrium:
            return solve_lengths(mechanism, command, loads, start=start)
    else:
        tensions = random_tensions(rng, mechanism.n_tendons)

        def solve(start: Start) -> Equilibrium:
            return solve_tensions(mechanism, tensions, loads, start=start)

    given = "lengths" if given_lengths else "tensions"
    cold = solve(None)
    yield Case(given, kind, "cold", cold)
    yield Case(given, kind, "warm", solve(cold.joint_angles + rng.normal(0.0, 0.05, mechanism.n_joints)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mechanisms", type=int, default=1250)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    print(table(cases(arguments.seed, arguments.mechanisms)))


if __name__ == "__main__":
    main()
