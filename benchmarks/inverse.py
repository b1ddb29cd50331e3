"""Processor time and success of the inverse, beside forward solves and SciPy's least_squares on the same problems, in one run.

Run: python benchmarks/inverse.py [--targets N] [--seed N]
Targets are tips of stable equilibria under uniform random tensions within the limits, and a force on the tip. Those of the
warm column are neighbours: a search goes on from the solution for one target to the tip under tensions that differ by a
hundredth.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import rollingjoint as rj

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


def main(argv: Sequence[str] | None = None) -> None:
    """Print a row for each mechanism."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--targets", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args(argv)
    rj.set_threads(1)
    print(
        "| mechanism | targets | reached | in a batch [µs] | forward [µs] | ratio | warm [µs] | reached | forward [µs] | ratio"
        " | least_squares [µs] | reached |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|---|")
    for name, share in CHAINS.items():
        print(row(name, max(1, int(share * args.targets)), args.seed), flush=True)


def row(name: str, count: int, seed: int) -> str:
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
    rj.reach(chain, near[0], loads, LIMITS, start=starts[0], starts=1)
    neighbours, warm = timed(
        lambda: [rj.reach(chain, tip, loads, LIMITS, start=start, starts=1) for tip, start in pairs]
    )
    _, single = timed(lambda: [rj.solve_lengths(chain, many.lengths[i], loads, tension_limits=LIMITS) for i in few])
    scipy_us, scipy_reached = by_scipy(chain, loads, tips[:SCIPY])
    per_target = 1e6 / len(tips)
    figures = (
        f"{np.mean(many.ok):.3%}", f"{batch * per_target:.1f}", f"{forward * per_target:.1f}", f"{batch / forward:.1f}",
        f"{warm / len(few) * 1e6:.0f}", f"{np.mean([one.ok for one in neighbours]):.1%}", f"{single / len(few) * 1e6:.0f}", f"{warm / single:.1f}",
        f"{scipy_us:.0f}", f"{scipy_reached:.0%}",
    )  # fmt: skip
    return f"| {name} | {len(tips):,} | {' | '.join(figures)} |"


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
