"""Processor time and success of the inverse, beside forward solves and SciPy's least_squares on the same problems.

Run: python benchmarks/inverse.py [--targets N] [--seed N]
Targets are tips of stable equilibria under uniform random tensions within the limits, and a force on the tip. From a
neighbour: from the solution for one target to the tip under tensions that differ from its own a little.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from operator import itemgetter
from typing import Any

import numpy as np

import rollingjoint as rj
from rollingjoint.tables import markdown_table

LIMITS = (1.0, 20.0)  # N
FORCE = 0.3  # N, along x
NEIGHBOUR = 0.01  # of the tensions: standard deviation of their change
CHAINS = {
    "five_link": 1.0,
    "two_segment": 1.0,
    "small_arm": 1.0,
    "pitch_yaw": 0.2,
    "flexible_arm": 0.01,
}  # of --targets
SINGLE, SCIPY = 200, 30  # targets solved one by one
HEAD = (
    *("mechanism", "targets", "in a batch [µs]", "reached", "forward [µs]"),
    *("from a neighbour [µs]", "reached", "forward [µs]", "least_squares [µs]", "reached"),
)


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--targets", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args(argv)
    rj.set_threads(1)
    rows = [row(name, max(1, int(share * args.targets)), args.seed) for name, share in CHAINS.items()]
    print(markdown_table(HEAD, rows))


def row(name: str, count: int, seed: int) -> list[str]:
    """Figures of one mechanism."""
    chain = rj.preset(name)
    loads = [rj.WorldForce(-1, (FORCE, *[0.0] * (chain.dimension - 1)))]
    rng = np.random.default_rng(seed)
    tensions = rng.uniform(*LIMITS, (count, chain.n_tendons))
    aims = rj.solve_tensions_batch(chain, tensions, loads)
    tips = aims.tip[aims.ok]
    rj.reach_batch(chain, tips[:8], loads, LIMITS)
    many, batch = timed(lambda: rj.reach_batch(chain, tips, loads, LIMITS))
    _, forward = timed(lambda: rj.solve_lengths_batch(chain, many.lengths, loads, tension_limits=LIMITS))
    few = np.flatnonzero(many.ok)[:SINGLE].tolist()
    starts = [many.row(i) for i in few]
    moved = np.array([start.tensions for start in starts]) * rng.normal(1.0, NEIGHBOUR, (len(few), chain.n_tendons))
    near = rj.solve_tensions_batch(chain, np.clip(moved, *LIMITS), loads, starts=many.joint_angles[few]).require().tip
    pairs = list(zip(near, starts, strict=True))

    def search_on() -> list[bool]:
        return [rj.reach(chain, tip, loads, LIMITS, start=start, starts=1).ok for tip, start in pairs]

    def solve() -> list[Any]:
        return [rj.solve_lengths(chain, many.lengths[i], loads, tension_limits=LIMITS) for i in few]

    neighbours, warm = min((timed(search_on) for _ in range(2)), key=itemgetter(1))
    _, single = min((timed(solve) for _ in range(2)), key=itemgetter(1))
    scipy_us, scipy_reached = by_scipy(chain, loads, tips[:SCIPY])
    times = [
        1e6 * batch / len(tips),
        1e6 * forward / len(tips),
        1e6 * warm / len(few),
        1e6 * single / len(few),
        scipy_us,
    ]
    in_batch, forward_us, one, one_forward, scipy = (f"{value:,.{1 if value < 100 else 0}f}" for value in times)
    reached, warm_reached = f"{np.mean(many.ok):.3%}", f"{np.mean(neighbours):.1%}"
    figures = in_batch, reached, forward_us, one, warm_reached, one_forward, scipy, f"{scipy_reached:.0%}"
    return [name, f"{len(tips):,}", *figures]


def by_scipy(chain: Any, loads: Any, tips: np.ndarray) -> tuple[float, float]:
    """Time per target [µs] and share reached of bounded least squares on the tensions, from their middle."""
    from scipy.optimize import least_squares

    problem = rj.prepare(chain, loads, given="tensions")
    middle = np.full(chain.n_tendons, np.mean(LIMITS))

    def solve(tip: np.ndarray) -> float:
        result = least_squares(
            lambda tensions: problem.solve(np.clip(tensions, *LIMITS)).tip - tip,
            middle,
            lambda tensions: rj.sensitivity.dtip_dtensions(problem.solve(np.clip(tensions, *LIMITS))),
            bounds=LIMITS,
            xtol=1e-12,
            ftol=1e-14,
            gtol=1e-14,
        )
        return float(np.linalg.norm(result.fun))

    misses, seconds = timed(lambda: [solve(tip) for tip in tips])
    return seconds / len(tips) * 1e6, float(np.mean(np.array(misses) < 1e-6))


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """The result, and the processor time taken [s]."""
    begin = time.process_time()
    result = work()
    return result, time.process_time() - begin


if __name__ == "__main__":
    main()
