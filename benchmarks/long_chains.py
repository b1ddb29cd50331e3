"""Solve time against the number of links, and where the O(n) Newton step overtakes the dense one.

    python benchmarks/long_chains.py

Uniform chains under a tip force that falls with n, tensions given, cold start; the best of several runs in one process.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numba
import numpy as np

from rollingjoint import Equilibrium, WorldForce, solve_tensions, uniform
from rollingjoint._numba.jit import standalone
from rollingjoint.kernels.arrays import TendonLaw
from rollingjoint.kernels.chain import evaluate, fill_generators, stiffness
from rollingjoint.kernels.linear import descent_step
from rollingjoint.kernels.long_chain import long_step, new_sweep
from rollingjoint.kernels.rolling import design, new_state
from rollingjoint.load import load_table

LINKS = (3, 5, 8, 12, 20, 50, 100, 200, 500, 1000, 2000)


def solved(n: int) -> tuple[Equilibrium, float]:
    """An equilibrium of n links and the seconds that one solve takes."""
    chain, loads = uniform(n), [WorldForce(-1, (0.5 / n, 0.0))]
    result = solve_tensions(chain, (5.0, 4.9), loads)
    return result, best(lambda: solve_tensions(chain, (5.0, 4.9), loads))


@numba.njit(error_model="numpy")
def dense_steps(count, chain, loads, state, H, free, L, step):  # type: ignore[no-untyped-def]
    for _ in range(count):
        stiffness(chain, loads, state, H)
        descent_step(H, free, state.residual, L, step)


@numba.njit(error_model="numpy")
def sweeping_steps(count, chain, loads, state, sweep, free, step):  # type: ignore[no-untyped-def]
    for _ in range(count):
        fill_generators(chain, loads, state, 0.0, sweep)
        long_step(sweep, free, state.residual, step)


@numba.njit(error_model="numpy")
def evaluated(chain, law, loads, state):  # type: ignore[no-untyped-def]
    one = design(chain, 0)
    evaluate(one, law, loads, state)
    return one


def steps(n: int) -> tuple[float, float]:
    """Seconds of one dense and one O(n) Newton step, assembly included."""
    chain = uniform(n)
    law = TendonLaw(chain.neutral_lengths - 1.0, chain.stiffnesses.copy(), np.zeros(2), np.full(2, 20.0))
    state, H, sweep = standalone(new_state)(n - 1, 2), np.empty((n - 1, n - 1)), standalone(new_sweep)(n - 1, 3)
    state.angle[:] = chain.joint_angles(np.full(n - 1, 0.3))
    loads = load_table([WorldForce(-1, (0.5 / n, 0.0))], n)
    one = evaluated(chain.arrays, law, loads, state)
    free, L, step = np.ones(n - 1, bool), np.empty((n - 1, n - 1)), np.empty(n - 1)
    count = 1 + 20000 // n**2
    dense = best(lambda: dense_steps(count, one, loads, state, H, free, L, step))
    sweeping = best(lambda: sweeping_steps(count, one, loads, state, sweep, free, step))
    return dense / count, sweeping / count


def best(function: Callable[[], object], runs: int = 15) -> float:
    """Seconds of the fastest of several runs, each long enough to be timed."""
    function()
    begin = time.perf_counter()
    function()
    count = max(1, int(2e-3 / (time.perf_counter() - begin)))
    fastest = np.inf
    for _ in range(runs):
        begin = time.perf_counter()
        for _ in range(count):
            function()
        fastest = min(fastest, (time.perf_counter() - begin) / count)
    return fastest


def main() -> None:
    print("| links | status | iterations | solve [µs] | per link and iteration [µs] | dense / O(n) Newton step |")
    print("|--:|---|--:|--:|--:|--:|")
    times = []
    for n in LINKS:
        result, seconds = solved(n)
        dense, sweeping = steps(n) if n <= 100 else (np.nan, np.nan)
        ratio = f"{dense / sweeping:.2f}" if n <= 100 else ""
        per = 1e6 * seconds / n / max(result.iterations, 1)
        print(f"| {n} | {result.status.name} | {result.iterations} | {1e6 * seconds:.0f} | {per:.2f} | {ratio} |")
        times.append((n, seconds / max(result.iterations, 1)))
    long = np.log([row for row in times if row[0] >= 100])
    print(f"\nExponent of time per iteration over n, 100 to 2000 links: {np.polyfit(*long.T, 1)[0]:.2f}")


if __name__ == "__main__":
    main()
