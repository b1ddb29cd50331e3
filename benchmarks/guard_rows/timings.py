"""Timings of both checkouts, in pairs that take turns, and what a new process waits for."""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from guard_rows.checkout import Checkout
from guard_rows.compare import Allowances, Difference, Result
from guard_rows.drawing import SEED, Sizes

ROWS = (  # of speed_work
    "solve_lengths, 5 links",
    "prepared solve, 5 links",
    "batch of 4,096, 5 links",
    "batch of 4,096, 5 links, a load",
    "batch of 1,024, 5 links, friction",
    "arm of 4 hinges, single",
    "arm of 4 hinges, batch of 256",
    "arm of 32 hinges, single",
    "arm of 32 hinges, batch of 64",
    "chain of 50 links",
    "chain of 200 links",
    "environment, an episode of 50 steps",
    "environment of 64 lanes, 50 steps",
    "environment, reset",
    "environment of 64 lanes, reset",
)
LIMIT, LONG_LIMIT = 1.03, 1.05
FIRST_SOLVE_LIMIT, WHOLE_WARMUP_LIMIT, WARMUP_LIMIT = 1.1, 1.3, 1.0

FIRST_SOLVE = "import rollingjoint as rj; m = rj.five_link(); rj.solve_lengths(m, m.neutral_lengths - 0.5)"
WARMUP = "from rollingjoint.cli import main; main(['warmup'])"
_COMPILED = re.compile(r"^compiled (.*) in ([\d.]+) s$", re.M)

T = TypeVar("T")
Sides = Sequence[Checkout]
Pair = tuple[float, float]  # s before and after


def judged(row: str, pairs: Sequence[Pair], limit: float, allowed: Allowances) -> Result:
    """The median ratio of after to before and its 95 % interval; the interval's lower end has to keep the limit."""
    bound, reason = allowed.limit(row, limit)
    median, low, high = ratio_and_interval(pairs)
    figure = f"{median:.3f} ({low:.3f} to {high:.3f}), limit {bound:g}" + (f" [{reason}]" if reason else "")
    result = Result(row, f"{len(pairs)} pairs", figure=figure)
    if low > bound:
        before, after = (f"{seconds:.4g} s" for seconds in np.median(pairs, axis=0))
        result.differences.append(Difference(row, "seconds", "the median", before, after))
    return result


def ratio_and_interval(pairs: Sequence[Pair]) -> tuple[float, float, float]:
    """Median of after / before, and its 95 % interval by resampling the pairs."""
    ratios = np.array([after / before for before, after in pairs])
    drawn = np.random.default_rng(SEED).choice(ratios, (4000, len(ratios)))
    low, high = np.quantile(np.median(drawn, axis=1), [0.025, 0.975])
    return float(np.median(ratios)), float(low), float(high)


def in_pairs(count: int, measures: Sequence[Callable[[], T]]) -> list[tuple[T, T]]:
    """Pairs of (before, after), measured in the order A B, B A, A B and so on."""
    pairs = []
    for k in range(count):
        order = (0, 1) if k % 2 == 0 else (1, 0)
        found = {which: measures[which]() for which in order}
        pairs.append((found[0], found[1]))
    return pairs


def speed_results(sides: Sides, sizes: Sizes, allowed: Allowances) -> Iterator[Result]:
    """One row for every kind of work.

    Processes stay for some pairs. Where code and arrays come to lie in memory differs from process to process, so there
    are several rounds of processes.
    """
    pairs: dict[str, list[Pair]] = {row: [] for row in ROWS}
    for number in range(sizes.rounds):
        with ExitStack() as stack:
            workers = [stack.enter_context(_worker(one)) for one in sides]
            for row, measured in pairs.items():
                calls = _calls(workers, row, sizes.work)
                works = [partial(work, row, calls) for work in workers]
                measured += in_pairs(-(-sizes.pairs // sizes.rounds), works)
        print(f"speed: round {number + 1} of {sizes.rounds}", file=sys.stderr, flush=True)
    for row, measured in pairs.items():
        limit = LONG_LIMIT if row.startswith("chain of") else LIMIT
        yield judged(f"speed: {row}", measured, limit if sizes.judged else math.inf, allowed)


def _calls(workers: Sequence[Callable[[str, int], float]], row: str, seconds: float) -> int:
    """How many calls of a row's work take about these seconds; every worker has then done it once."""
    for work in workers:
        work(row, 1)
    once = min(workers[0](row, 1) for _ in range(3))
    return max(1, round(seconds / max(once, 1e-6)))


@contextmanager
def _worker(checkout: Checkout) -> Iterator[Callable[[str, int], float]]:
    """Seconds of some calls of a row's work, in a process of its own."""
    arguments = ("-m", "guard_rows.speed_work", str(checkout.folder))
    process = checkout.start(*arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdin and process.stdout

    def measure(row: str, calls: int) -> float:
        print(json.dumps({"row": row, "calls": calls}), file=process.stdin, flush=True)
        answer = process.stdout.readline()
        if not answer:
            raise SystemExit(f"speed of {checkout.name} ({checkout.folder}): {row} failed")
        return float(answer)

    try:
        yield measure
    finally:
        process.stdin.close()
        process.stdout.close()
        process.kill()
        process.wait()


def startup_results(sides: Sides, sizes: Sizes, allowed: Allowances) -> Iterator[Result]:
    """First solves and warm-ups with empty caches, in seconds of all processors; Python finds its bytecode on disk."""
    with tempfile.TemporaryDirectory() as folder:
        fresh = [partial(_fresh, one, Path(folder) / one.name) for one in sides]
        for run in fresh if sizes.judged else ():
            run(FIRST_SOLVE)  # leaves the bytecode
        first = in_pairs(sizes.starts, [lambda run=run: run(FIRST_SOLVE)[0] for run in fresh])
        limits = (FIRST_SOLVE_LIMIT, WARMUP_LIMIT, WHOLE_WARMUP_LIMIT) if sizes.judged else (math.inf,) * 3
        yield judged("startup: first solve, empty cache", first, limits[0], allowed)
        if sizes.warmups:
            warmups = in_pairs(sizes.warmups, [partial(run, WARMUP) for run in fresh])
            existing = [_of_common_groups(before, after) for before, after in warmups]
            yield judged("startup: warm-up of the groups of before", existing, limits[1], allowed)
            whole = [(before[0], after[0]) for before, after in warmups]
            yield judged("startup: warm-up of all groups", whole, limits[2], allowed)


def _fresh(checkout: Checkout, bytecode: Path, program: str) -> tuple[float, str]:
    """Seconds of the processors that a new process with an empty cache and its children take, and what it prints."""
    with tempfile.TemporaryDirectory() as cache, tempfile.TemporaryFile("w+") as said:
        variables = {"ROLLINGJOINT_CACHE": cache, "PYTHONPYCACHEPREFIX": str(bytecode), "PYTHONDONTWRITEBYTECODE": ""}
        process = checkout.start("-P", "-c", program, variables=variables, stdout=said)
        _, code, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(code)
        if process.returncode:
            raise SystemExit(f"{program!r} of {checkout.name} ({checkout.folder}) failed")
        said.seek(0)
        return usage.ru_utime + usage.ru_stime, said.read()


def _of_common_groups(before: tuple[float, str], after: tuple[float, str]) -> Pair:
    """The share of two warm-ups' seconds that their printed times say went into groups of kernels of the older one."""
    known = dict(_COMPILED.findall(before[1]))
    times = [(title, float(wall)) for title, wall in _COMPILED.findall(after[1])]
    share = sum(wall for title, wall in times if title in known) / sum(wall for _, wall in times)
    return before[0], after[0] * share
