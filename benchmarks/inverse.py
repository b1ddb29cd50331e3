"""Processor time and success of the inverse, beside forward solves and SciPy's least_squares on the same problems.

Run: python benchmarks/inverse.py [--targets N] [--seed N] [--paths N]
Targets are tips of stable equilibria under uniform random tensions within the limits, and a force on the tip. From a
neighbour: from the solution for one target to the tip under tensions that differ from its own a little.
With --paths: plans along paths of 41 tips under tensions between two random ones, and a force along -y or -z.
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
PLAN_HEAD = (
    *("mechanism", "paths", "followed", "with a detour", "snapped", "missed", "solves per step", "ms per step"),
    *("lengths by reach: followed", "snapped"),
)
PLAN_LIMITS, PLAN_TARGETS, JUMP = (0.2, 8.0), 41, 0.2  # N, targets per path, rad


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--targets", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--paths", type=int, help="plan this many paths per mechanism in place of that")
    args = parser.parse_args(argv)
    rj.set_threads(1)
    if args.paths is not None:
        print(markdown_table(PLAN_HEAD, [plans(name, args.paths, args.seed) for name in list(CHAINS)[:4]]))
        return
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
    many, batch = min((timed(lambda: rj.reach_batch(chain, tips, loads, LIMITS)) for _ in range(2)), key=itemgetter(1))
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


def plans(name: str, count: int, seed: int) -> list[str]:
    """Figures of plans of one mechanism, beside lengths that `reach` gives at one target after the other."""
    chain, rng = rj.preset(name), np.random.default_rng(seed)
    loads = [rj.WorldForce(-1, (*[0.0] * (chain.dimension - 1), -FORCE))]
    shares = np.linspace(0.0, 1.0, PLAN_TARGETS)[:, None]
    results, alone, seconds = [], [], 0.0
    while len(results) < count:
        first, last = rng.uniform(*PLAN_LIMITS, (2, chain.n_tendons))
        drawn = rj.trace(chain, first + shares * (last - first), loads, given="tensions").require()
        path = drawn.tip
        if jumps(drawn):  # under these tensions: no path
            continue
        plan, time_taken = timed(lambda path=path: rj.plan_path(chain, path, loads, PLAN_LIMITS, step=1e9))
        results.append(plan)
        seconds += time_taken
        there = [rj.reach(chain, path[0], loads, PLAN_LIMITS)]
        for tip in path[1:]:
            there.append(rj.reach(chain, tip, loads, PLAN_LIMITS, start=there[-1]))
        way = rj.trace(chain, [one.lengths for one in there], loads, tension_limits=PLAN_LIMITS)
        near = np.abs(way.tip - path).max() < 1e-3
        alone.append((near, jumps(way)))
    steps = sum(len(plan.times) for plan in results)
    kinds = [
        sum(plan.ok for plan in results),
        *(
            sum(bool((plan.status == status).any()) for plan in results)
            for status in (rj.PlanStatus.DETOUR, rj.PlanStatus.SNAPPED, rj.PlanStatus.MISSED)
        ),
    ]
    followed, snapped = (sum(bool(each[k]) for each in alone) for k in (0, 1))
    solves = sum(plan.solves for plan in results) / steps
    figures = [f"{solves:.1f}", f"{1e3 * seconds / steps:.2f}", str(followed), str(snapped)]
    return [name, str(count), *map(str, kinds), *figures]


def jumps(way: Any) -> bool:
    """Whether a joint turns by more than JUMP in any step."""
    return bool(np.abs(np.diff(way.joint_angles, axis=0)).max() > JUMP)


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

    solve(tips[0])  # compiles
    misses, seconds = timed(lambda: [solve(tip) for tip in tips])
    return seconds / len(tips) * 1e6, float(np.mean(np.array(misses) < 1e-6))


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """The result, and the processor time taken [s]."""
    begin = time.process_time()
    result = work()
    return result, time.process_time() - begin


if __name__ == "__main__":
    main()
