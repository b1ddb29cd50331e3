"""Processor time and success of the inverse, beside forward solves and SciPy's least_squares on the same problems.

Run: python benchmarks/inverse.py [--targets N] [--seed N] [--paths N | --casadi N | --floors]
Targets are tips of stable equilibria under uniform random tensions within the limits, and a force on the tip. From a
neighbour: from the solution for one target to the tip under tensions that differ from its own a little; medians.
With --casadi (pip install casadi): two_segment's by IPOPT on a model in CasADi, and by `reach`; medians of single ones.
With --floors: those of docs/results.json.gz, and how far the mean of each world is from what is found now.
With --paths: plans along paths of 41 tips under tensions between two random ones, and a force along -y or -z.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

import rollingjoint as rj
from rollingjoint.tables import markdown_table

RESULTS = Path(__file__).resolve().parents[1] / "docs" / "results.json.gz"
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
CASADI_HEAD = (
    *("targets", "IPOPT [µs]", "converged", "reach [µs]", "reached", "in a batch [µs]", "reached"),
    *("tensions alike", "IPOPT's smaller", "larger"),
)
PLAN_LIMITS, PLAN_TARGETS, JUMP = (0.2, 8.0), 41, 0.2  # N, targets per path, rad


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--targets", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    instead = parser.add_mutually_exclusive_group()
    instead.add_argument("--paths", type=int, help="plan this many paths per mechanism in place of that")
    instead.add_argument("--casadi", type=int, help="this many targets of two_segment by CasADi in place of that")
    instead.add_argument("--floors", action="store_true", help="find the floors of docs/results.md again")
    args = parser.parse_args(argv)
    rj.set_threads(1)
    if args.floors:
        print(floors())
        return
    if args.paths is not None:
        print(markdown_table(PLAN_HEAD, [plans(name, args.paths, args.seed) for name in list(CHAINS)[:4]]))
        return
    if args.casadi is not None:
        print(markdown_table(CASADI_HEAD, [by_casadi(args.casadi, args.seed)]))
        return
    rows = [row(name, max(1, int(share * args.targets)), args.seed) for name, share in CHAINS.items()]
    print(markdown_table(HEAD, rows))


def row(name: str, count: int, seed: int) -> list[str]:
    """Figures of one mechanism."""
    chain, rng = rj.preset(name), np.random.default_rng(seed)
    loads, aims = targets(chain, count, rng)
    tips = aims.tip[aims.ok]
    many, batch = min((timed(lambda: rj.reach_batch(chain, tips, loads, LIMITS)) for _ in range(2)), key=itemgetter(1))
    _, forward = timed(lambda: rj.solve_lengths_batch(chain, many.lengths, loads, tension_limits=LIMITS))
    few = np.flatnonzero(many.ok)[:SINGLE].tolist()
    starts = [many.row(i) for i in few]
    moved = np.array([start.tensions for start in starts]) * rng.normal(1.0, NEIGHBOUR, (len(few), chain.n_tendons))
    near = rj.solve_tensions_batch(chain, np.clip(moved, *LIMITS), loads, starts=many.joint_angles[few]).require().tip
    pairs = list(zip(near, starts, strict=True))
    warm, neighbours = median(lambda pair: rj.reach(chain, pair[0], loads, LIMITS, start=pair[1], starts=1), pairs)
    single, _ = median(lambda i: rj.solve_lengths(chain, many.lengths[i], loads, tension_limits=LIMITS), few)
    scipy_us, scipy_reached = by_scipy(chain, loads, tips[:SCIPY])
    times = [*(1e6 * each for each in (batch / len(tips), forward / len(tips), warm, single)), scipy_us]
    in_batch, forward_us, one, one_forward, scipy = (f"{value:,.{1 if value < 100 else 0}f}" for value in times)
    reached, warm_reached = f"{np.mean(many.ok):.4%}", f"{np.mean([one.ok for one in neighbours]):.1%}"
    figures = in_batch, reached, forward_us, one, warm_reached, one_forward, scipy, f"{scipy_reached:.0%}"
    return [name, f"{len(tips):,}", *figures]


def targets(chain: Any, count: int, rng: np.random.Generator) -> tuple[list[rj.WorldForce], rj.Equilibrium]:
    """The force on the tip, and the equilibria under random tensions; the tips of those found are aimed at."""
    loads = [rj.WorldForce(-1, (FORCE, *[0.0] * (chain.dimension - 1)))]
    return loads, rj.solve_tensions_batch(chain, rng.uniform(*LIMITS, (count, chain.n_tendons)), loads)


def by_casadi(count: int, seed: int) -> list[str]:
    """Figures of IPOPT and of `reach` for the same targets: least tensions, cold starts."""
    from casadi_chain import CasadiInverse

    chain = rj.two_segment()
    loads, aims = targets(chain, count, np.random.default_rng(seed))
    peer = CasadiInverse((FORCE, 0.0), LIMITS)
    apart = max(peer.deviation(aims.row(k)) for k in np.flatnonzero(aims.ok)[:SINGLE].tolist())
    assert apart < 1e-8, f"the models differ by {apart:.1e}"
    tips = aims.tip[aims.ok]
    peer.solve(tips[0])
    rj.reach(chain, tips[0], loads, LIMITS)
    peer_time, found = median(peer.solve, tips)
    single_time, one = median(lambda tip: rj.reach(chain, tip, loads, LIMITS), tips)
    many, batch_time = timed(lambda: rj.reach_batch(chain, tips, loads, LIMITS))
    least = [float(np.linalg.norm(each.tensions - LIMITS[0])) for each in one]
    both = [k for k in range(len(tips)) if found[k][0] and one[k].ok]
    more = np.array([np.linalg.norm(found[k][2] - LIMITS[0]) - least[k] for k in both])
    times = [f"{1e6 * each:,.0f}" for each in (peer_time, single_time, batch_time / len(tips))]
    shares = [f"{np.mean(each):.2%}" for each in ([ok for ok, *_ in found], [each.ok for each in one], many.ok)]
    alike = np.abs(more) < 1e-3
    figures = [value for pair in zip(times, shares, strict=True) for value in pair]
    return [str(len(tips)), *figures, *(f"{np.mean(each):.1%}" for each in (alike, more <= -1e-3, more >= 1e-3))]


def floors() -> str:
    """How many floors the results have, and the largest change of the mean of a world if they are found again."""
    from agents.evaluation.floor import episode_floor
    from agents.results import read_results
    from agents.results.environment import changed, environment_of

    changes, count = [], 0
    for record in read_results(RESULTS).benchmarks:
        for world in record.worlds:
            if world.floors is not None:
                found = episode_floor(changed(environment_of(record), world.changes), world.seeds).errors
                changes.append(abs(float(np.mean(found - world.floors))))
                count += len(found)
    return f"{count:,} floors in {len(changes)} worlds; the largest change of a mean is {max(changes):.1e} mm"


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


def median(work: Callable[[Any], Any], items: Sequence[Any]) -> tuple[float, list[Any]]:
    """The median processor time of `work` of an item [s], each the shorter of two, and the results."""
    first, second = ([timed(lambda item=item: work(item)) for item in items] for _ in range(2))
    seconds = [min(one[1], other[1]) for one, other in zip(first, second, strict=True)]
    return float(np.median(seconds)), [result for result, _ in first]


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """The result, and the processor time taken [s]."""
    begin = time.process_time()
    result = work()
    return result, time.process_time() - begin


if __name__ == "__main__":
    main()
