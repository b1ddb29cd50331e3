"""What every interface that numba keeps to itself brings: rollingjoint/_numba/README.md has the table.

    python benchmarks/compiled_layer.py            everything, some minutes
    python benchmarks/compiled_layer.py part load  only those
Each row is measured in a process of its own, with and without; the least of several times, of the processor where
kernels are compiled or loaded.
"""

from __future__ import annotations

import argparse
import functools
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

TIMED = """
import time
import numpy as np

def least(work, count, rounds=30):
    times = []
    for _ in range(rounds):
        begin = time.perf_counter()
        for _ in range(count):
            work()
        times.append((time.perf_counter() - begin) / count)
    return min(times)
"""

CHANGED = """
import sys, types
import numba
stub = types.ModuleType("rollingjoint")  # the layer is imported, and changed, before any kernel is
stub.__path__ = ["rollingjoint"]
sys.modules["rollingjoint"] = stub
from rollingjoint._numba import borrowed, cache, jit, parts
{change}
del sys.modules["rollingjoint"]
"""

SOLVE = """
import rollingjoint as rj
begin = time.process_time()
arm = rj.five_link()
rj.solve_tensions(arm, (3, 2)), rj.solve_tensions(arm, (0, 0))
print(time.process_time() - begin)
"""

PLAIN_PARTS = """
def part(function=None, *, inline=False):
    if function is None:
        return lambda one: part(one, inline=inline)
    wrappers = dict(no_cpython_wrapper=True, no_cfunc_wrapper=True)
    return numba.njit(error_model="numpy", forceinline=inline, **wrappers)(function)
jit.part = part
"""

CALLS = """
from typing import Annotated
import rollingjoint as rj
from benchmarks.on_arrays import solve_on_arrays
from rollingjoint.compiled import BatchArrays, Integers, Pinned, PinnedRange
from rollingjoint.load import LOAD_COLUMNS
from rollingjoint.kernels.batch import solve_lanes
from rollingjoint.chain.batch import TendonLaw, _on_batch
from rollingjoint.kernels.rolling import new_results

arm, B = rj.five_link(), {lanes}
kernels = arm.kernels
rng = np.random.default_rng(0)
commands = arm.neutral_lengths + rng.uniform(-2, 1, (B, 2))
law = TendonLaw(commands, np.tile(arm.stiffnesses, (B, 1)), np.full((B, 2), 0.5), np.full((B, 2), 50.0))
problem = BatchArrays(
    arm.arrays, np.zeros(B, np.int64), law, np.zeros((B, 0, len(LOAD_COLUMNS))),
    np.tile(arm.neutral_angles, (B, 1)), new_results(B, 4, 2, contacts=False),
)
rest = np.arange(B)
"""


def run(program: str, cache: str) -> float:
    """The last number that a program prints in a process of its own."""
    environment = os.environ | {"ROLLINGJOINT_CACHE": cache, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", TIMED + program]
    done = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(done.stderr)
    return float(done.stdout.split()[-1])


def fresh(program: str) -> float:
    """With an empty cache."""
    with tempfile.TemporaryDirectory() as cache:
        return run(program, cache)


@functools.cache
def _kept() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory()


def warm(program: str, rounds: int = 5, cache: str | None = None) -> float:
    """With a filled cache; the least of some processes."""
    return min([run(program, cache or _kept().name) for _ in range(1 + rounds)][1:])


def of_calls(lanes: int, program: str) -> float:
    """A program on the arrays of so many lanes."""
    return warm(CALLS.format(lanes=lanes) + program, 1)


def with_change(change: str, program: str) -> str:
    """A program in which the layer was changed before any kernel was imported."""
    return CHANGED.format(change=change) + program


def parts() -> tuple[str, float, float]:
    """First compilation of both solvers, with parts that are optimised in place and with plain functions."""
    return "first compilation", fresh(with_change(PLAIN_PARTS, SOLVE)), fresh(SOLVE)


def loops() -> tuple[str, float, float]:
    """First compilation of both solvers, by numba's own passes, and by those that copy no loops."""
    change = "from numba.core.codegen import JITCodeLibrary\nparts._UseShortLoopsLibrary.library = JITCodeLibrary"
    return "first compilation", fresh(with_change(change, SOLVE)), fresh(SOLVE)


def collector() -> tuple[str, float, float]:
    """First compilation of both solvers, while Python collects garbage, and while it does not."""
    collecting = with_change("import contextlib\njit._no_garbage_collection = contextlib.nullcontext", SOLVE)
    return "first compilation", fresh(collecting), fresh(SOLVE)


def disk() -> tuple[str, float, float]:
    """First solve of a process, without and with kernels on disk."""
    return "first solve of a process", fresh(with_change("jit.keep_on_disk = lambda *one: None", SOLVE)), warm(SOLVE)


def load() -> tuple[str, float, float]:
    """First solve of a process, with numba's refresh of everything that compiling may need, and without."""
    return "first solve of a process", warm(with_change("del cache._KernelCache.load_overload", SOLVE)), warm(SOLVE)


def code() -> tuple[str, float, float]:
    """A call of the solver: numba's dispatcher, and the machine code."""
    slow = of_calls(1, "print(least(lambda: solve_on_arrays(*problem, 0, 1), 2000))")
    direct = "solve = _on_batch(kernels, solve_on_arrays, int, int)\nprint(least(lambda: solve(*problem, 0, 1), 2000))"
    return "compiled solve, called from Python", slow, of_calls(1, direct)


def pins() -> tuple[str, float, float]:
    """A call of the solver: arrays, and the address of their pins."""
    direct = "solve = _on_batch(kernels, solve_on_arrays, int, int)\nprint(least(lambda: solve(*problem, 0, 1), 2000))"
    pinned = "solve = PinnedRange(kernels, problem)._solve\nprint(least(lambda: solve(0, 1), 2000))"
    return "compiled solve, called from Python", of_calls(1, direct), of_calls(1, pinned)


STEP = """
import gymnasium, rj_gym
from rj_gym.tracking.kernels import StepKernels
env = gymnasium.make("rj_gym/RollingJoint-v0").unwrapped
env.reset(seed=0)
buffer = env._buffer
kernels, flat = buffer._kernels, buffer._seen.ctypes.data
"""


def address() -> tuple[str, float, float]:
    """A step's compiled part: solve called from Python between two kernels, and by the kernel itself."""
    from_python = "apart = StepKernels(kernels._pinned._kept._replace(solver=0, problem=0))\n"
    from_python += "def work():\n    apart.step(flat, 0, 1)\n"
    from_python += "    buffer.solver.alone(0, 1)\n    kernels.finish(flat, 0, 1)\n"
    slow = warm(STEP + from_python + "print(least(work, 2000))", 1)
    return "compiled step", slow, warm(STEP + "print(least(lambda: kernels.step(flat, 0, 1), 2000))", 1)


def simd() -> tuple[str, float, float]:
    """A solve in a batch of 10,000: lane by lane, and eight side by side."""
    alone = "solve = _on_batch(kernels, solve_lanes, Annotated[Integers, 'left'])\n"
    alone += "print(least(lambda: solve(*problem, rest), 1, 15) / B)"
    wide = "solve = PinnedRange(kernels, problem)\nprint(least(lambda: solve(0, B), 1, 15) / B)"
    return "solve in a batch, one thread", of_calls(10_000, alone), of_calls(10_000, wide)


def borrow() -> tuple[str, float, float]:
    """A solve of the flexible arm, on NumPy arrays and on borrowed ones."""
    owned = "borrowed.borrow = jit.part(inline=True)(lambda value: value)"
    solve = "import rollingjoint as rj\narm = rj.flexible_arm()\nat = arm.neutral_lengths - 0.5\n"
    solve += "print(least(lambda: rj.solve_lengths(arm, at), 200))"
    with tempfile.TemporaryDirectory() as cache:
        return "solve of the flexible arm", warm(with_change(owned, solve), 1, cache), warm(solve, 1)


ROWS: dict[str, Callable[[], tuple[str, float, float]]] = {
    "parts": parts,
    "loops": loops,
    "collector": collector,
    "disk": disk,
    "load": load,
    "code": code,
    "pins": pins,
    "address": address,
    "simd": simd,
    "borrow": borrow,
}


def main() -> None:
    """Print a row for each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rows", nargs="*", choices=[[], *ROWS], help="default: all")
    chosen = parser.parse_args().rows or list(ROWS)
    print(f"{'interface':10s} {'time of':36s} {'without':>12s} {'with':>12s}  gain")
    for name in chosen:
        begin = time.perf_counter()
        what, without, with_it = ROWS[name]()
        print(
            f"{name:10s} {what:36s} {without * 1e6:10.2f} µs {with_it * 1e6:10.2f} µs  {without / with_it:.2f}", end=""
        )
        print(f"  (measured in {time.perf_counter() - begin:.0f} s)", flush=True)


if __name__ == "__main__":
    main()
