"""Instructions of one warm solve: a count that a busy machine does not disturb."""

from __future__ import annotations

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
comparing two versions. One by one, the call from Python is counted too."""

WALK, ROUNDS = 100, 100
WAYS = ("one_by_one", "side_by_side")
PROGRAM = """
from speed_rows.walk import CompiledWalk, random_walk
walk = CompiledWalk(random_walk({walk}))
for _ in range({one_by_one}):
    walk.one_by_one()
for _ in range({side_by_side}):
    walk.side_by_side()
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
            for way, count in _counted().items():
                yield Row(_what(way), count, "instructions", f"{WALK * ROUNDS:,} solves")
            return
        except RuntimeError as error:
            said = [line for line in str(error).splitlines() if not line.startswith("==")]
            reason = f"not measured here: {said[-1]}"
    for way in WAYS:
        yield Row(_what(way), None, "instructions", note=reason)


def _what(way: str) -> str:
    return f"compiled warm solve, {way.replace('_', ' ')}"


def _counted() -> dict[str, float]:
    """Instructions per solve, by the way of solving."""
    once = dict.fromkeys(WAYS, 1)
    runs = [once, *(once | {way: 1 + ROUNDS} for way in WAYS)]
    with tempfile.TemporaryDirectory() as folder:
        run_python(PROGRAM.format(walk=WALK, **once), _variables(folder))  # compiles
        with ThreadPoolExecutor(threads()) as pool:
            base, *longer = pool.map(lambda rounds: _instructions(rounds, folder), runs)
    return {way: (count - base) / (WALK * ROUNDS) for way, count in zip(WAYS, longer, strict=True)}


def _instructions(rounds: dict[str, int], folder: str) -> int:
    """Instructions of a whole process that solves the walk so many times in each way."""
    callgrind = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={folder}/callgrind.%p"]
    output = run_python(PROGRAM.format(walk=WALK, **rounds), _variables(folder), callgrind)
    found = re.search(r"Collected : (\d+)", output)
    if found is None:
        raise RuntimeError("callgrind printed no count")
    return int(found[1])


def _variables(folder: str) -> dict[str, str]:
    return {**HASWELL, "ROLLINGJOINT_CACHE": folder}
