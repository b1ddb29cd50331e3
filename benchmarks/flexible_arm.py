"""Time per equilibrium of the flexible arm: 32 hinges, 8 tendons, one thread.

    python benchmarks/flexible_arm.py

Processor time, the best of some rounds of 400 different inputs near one equilibrium. Warm: each starts from that one.
Friction: each is a step from that one, with a coefficient of 0.1.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from rollingjoint import (
    CapstanFriction,
    HingeEquilibrium,
    flexible_arm,
    set_threads,
    solve_lengths_batch,
    solve_tensions_batch,
)

LANES, ROUNDS = 400, 20
TENSIONS = np.array([8.0, 0.0, 0.0, 0.0, 3.0, 3.0, 0.0, 0.0])


def measure(what: str, solve: Callable[..., HingeEquilibrium], *arguments: object, **more: object) -> None:
    """Print microseconds and Newton steps per equilibrium."""
    best = np.inf
    for _ in range(ROUNDS):
        begin = time.process_time()
        found = solve(*arguments, **more)
        best = min(best, (time.process_time() - begin) / LANES)
    print(f"{what:28} {1e6 * best:6.1f} µs  {np.mean(found.iterations):4.1f} steps  {np.mean(found.ok):4.0%} stable")


def main() -> None:
    set_threads(1)
    rng = np.random.default_rng(0)
    for model in ("exact", "linear", "end_couple"):
        arm = flexible_arm(model)
        loads = [arm.gravity((0.0, 0.0, 1.0))]
        base = solve_tensions_batch(arm, np.tile(TENSIONS, (LANES, 1)), loads)
        pulled = TENSIONS + rng.uniform(0.0, 0.5, (LANES, 8))
        short = base.lengths - base.tensions / arm.stiffnesses + rng.uniform(-0.5, 0.5, (LANES, 8))
        measure(f"{model}, tensions, warm", solve_tensions_batch, arm, pulled, loads, base)
        measure(f"{model}, tensions, cold", solve_tensions_batch, arm, pulled, loads)
        measure(f"{model}, lengths, warm", solve_lengths_batch, arm, short, loads, base)
        measure(f"{model}, lengths, cold", solve_lengths_batch, arm, short, loads)
        if model == "exact":
            rough = arm.replace(friction=CapstanFriction(0.1))
            settled = solve_tensions_batch(rough, base.tensions + 0.2, loads, history=base)
            measure(f"{model}, tensions, friction", solve_tensions_batch, rough, pulled, loads, history=settled)
            measure(f"{model}, lengths, friction", solve_lengths_batch, rough, short, loads, history=settled)


if __name__ == "__main__":
    main()
