"""Instructions of one warm solve: a count that a busy machine does not disturb."""

from __future__ import annotations

import itertools
import platform
import re
import shutil
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from speed_rows.machine import threads
from speed_rows.processes import run_python
from speed_rows.row import Row
from speed_rows.sizes import LEFT_OUT, Sizes

TITLE = "Instructions"
ONCE = True
TEXT = """Instructions of the compiled warm solve as valgrind's callgrind counts them: a process with 1,000 solves
more minus one without them, so that interpreter and imports cancel. The code is compiled for a Haswell processor,
because valgrind does not know AVX-512. The count does not depend on what else the machine does; it is meant for
comparing two versions. One by one, the call from Python is counted too. The limit is the count of the bare kernel."""

WALK, ROUNDS = 100, 100
WAYS = ("one_by_one", "side_by_side")
KERNELS = ("compiled", "bare")
PROGRAM = """
from speed_rows.limit import BareWalk
from speed_rows.walk import CompiledWalk, random_walk
walk = random_walk({walk})
compiled, bare = CompiledWalk(walk), BareWalk(walk)
rounds = {rounds}
for (kernel, way), count in rounds.items():
    solve = getattr(dict(compiled=compiled, bare=bare)[kernel], way)
    for _ in range(count):
        solve()
"""
HASWELL = {
    "NUMBA_CPU_NAME": "haswell",
    "NUMBA_CPU_FEATURES": "+avx,+avx2,+fma",
    "OPENBLAS_NUM_THREADS": "1",
    "PYTHONHASHSEED": "0",
}


def measure(sizes: Sizes, images: Path) -> Iterator[Row]:
    """Rows of the section."""
    if not sizes.minutes:
        reason = LEFT_OUT
    elif shutil.which("valgrind") is None or platform.machine() != "x86_64":
        reason = "not measured here: needs valgrind on x86-64"
    else:
        try:
            counted = _counted()
            for way in WAYS:
                ours, limit = (counted[kernel, way] for kernel in KERNELS)
                yield Row(_what(way), ours, "instructions", f"{WALK * ROUNDS:,} solves", limit=limit)
            return
        except RuntimeError as error:
            said = [line for line in str(error).splitlines() if not line.startswith("==")]
            reason = f"not measured here: {said[-1]}"
    for way in WAYS:
        yield Row(_what(way), None, "instructions", note=reason)


def _what(way: str) -> str:
    return f"compiled warm solve, {way.replace('_', ' ')}"


def _counted() -> dict[tuple[str, str], float]:
    """Instructions per solve, by the kernel and the way of solving."""
    once = dict.fromkeys(itertools.product(KERNELS, WAYS), 1)
    runs = [once, *(once | {solve: 1 + ROUNDS} for solve in once)]
    with tempfile.TemporaryDirectory() as folder:
        run_python(PROGRAM.format(walk=WALK, rounds=once), _variables(folder))  # compiles
        with ThreadPoolExecutor(threads()) as pool:
            base, *longer = pool.map(lambda rounds: _instructions(rounds, folder), runs)
    return {solve: (count - base) / (WALK * ROUNDS) for solve, count in zip(once, longer, strict=True)}


def _instructions(rounds: dict[tuple[str, str], int], folder: str) -> int:
    """Instructions of a whole process that solves the walk so many times by each kernel in each way."""
    callgrind = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={folder}/callgrind.%p"]
    output = run_python(PROGRAM.format(walk=WALK, rounds=rounds), _variables(folder), callgrind)
    found = re.search(r"Collected : (\d+)", output)
    if found is None:
        raise RuntimeError("callgrind printed no count")
    return int(found[1])


def _variables(folder: str) -> dict[str, str]:
    return {**HASWELL, "ROLLINGJOINT_CACHE": folder}
