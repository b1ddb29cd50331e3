"""Work that is timed, in a process that stays. Runs inside a checkout.

Lines of {"row": ..., "calls": ...} come in, seconds go out. They are those of the processor, on one thread, with the
garbage collected before: what else the machine does counts for less than on a clock.
"""

from __future__ import annotations

import gc
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import rj_gym  # noqa: F401  (registers its ids)
import rollingjoint as rj
from guard_rows.child import check_imports
from guard_rows.drawing import SEED

Work = Callable[[], object]
PULL = np.array([-0.3, 0.3])  # mm


def _single(n: int) -> Work:
    chain = rj.five_link() if n == 5 else rj.uniform(n)
    load, start = [rj.WorldForce(-1, (0.05, 0.0))], rj.solve_tensions(chain, [3.0, 3.0])
    command = start.lengths - start.tensions / chain.stiffnesses + PULL
    return lambda: rj.solve_lengths(chain, command, load, start, tension_limits=(0.5, 15.0))


def _prepared() -> Work:
    chain = rj.five_link()
    problem, command = rj.prepare(chain, tension_limits=(0.5, 15.0)), chain.neutral_lengths - 0.5
    start = problem.solve(command)
    return lambda: problem.solve(command + PULL, start)


def _batch(rows: int, force: float = 0.0, mu: float = 0.0) -> Work:
    chain = rj.five_link().replace(friction=rj.CapstanFriction(mu)) if mu else rj.five_link()
    commands = chain.neutral_lengths + np.random.default_rng(SEED).uniform(-2.0, 0.0, (rows, 2))
    loads = [rj.WorldForce(-1, (force, 0.1 * force))] if force else []
    start = rj.solve_lengths_batch(chain, commands, loads, tension_limits=(0.5, 15.0))
    options = {"history": start} if mu else {"starts": start}
    return lambda: rj.solve_lengths_batch(chain, commands + PULL, loads, tension_limits=(0.5, 15.0), **options)


def _arm(arm: Any, rows: int = 0) -> Work:
    loads, m = [arm.gravity((0.0, 0.0, 1.0))], arm.n_tendons
    start = rj.solve_tensions(arm, np.linspace(4.0, 1.0, m), loads)
    command = start.lengths - start.tensions / arm.stiffnesses
    if not rows:
        return lambda: rj.solve_lengths(arm, command + 0.3, loads, start)
    commands = command + np.random.default_rng(SEED).uniform(-0.5, 0.5, (rows, m))
    starts = np.tile(start.joint_angles, (rows, 1))
    return lambda: rj.solve_lengths_batch(arm, commands, loads, starts)


def _scalar_steps() -> Work:
    env = gymnasium.make("rj_gym/RollingJoint-v0")
    drawn = np.random.default_rng(SEED).uniform(-1.0, 1.0, (50, 2)).astype(np.float32)

    def work() -> None:
        env.reset(seed=0)
        for action in drawn:
            env.step(action)

    return work


def _vector_steps() -> Work:
    envs = gymnasium.make_vec("rj_gym/RollingJoint-v0", 64, "vector_entry_point")
    drawn = np.random.default_rng(SEED).uniform(-1.0, 1.0, (50, 64, 2)).astype(np.float32)

    def work() -> None:
        envs.reset(seed=0)
        for action in drawn:
            envs.step(action)

    return work


def _resets(lanes: int) -> Work:
    if lanes == 1:
        env = gymnasium.make("rj_gym/RollingJoint-v0")
        return lambda: env.reset(seed=0)
    envs = gymnasium.make_vec("rj_gym/RollingJoint-v0", lanes, "vector_entry_point")
    return lambda: envs.reset(seed=0)


ROWS: dict[str, Callable[[], Work]] = {
    "solve_lengths, 5 links": lambda: _single(5),
    "prepared solve, 5 links": _prepared,
    "batch of 4,096, 5 links": lambda: _batch(4096),
    "batch of 4,096, 5 links, a load": lambda: _batch(4096, force=0.2),
    "batch of 1,024, 5 links, friction": lambda: _batch(1024, mu=0.1),
    "arm of 4 hinges, single": lambda: _arm(rj.small_arm()),
    "arm of 4 hinges, batch of 256": lambda: _arm(rj.small_arm(), 256),
    "arm of 32 hinges, single": lambda: _arm(rj.flexible_arm()),
    "arm of 32 hinges, batch of 64": lambda: _arm(rj.flexible_arm(), 64),
    "chain of 50 links": lambda: _single(50),
    "chain of 200 links": lambda: _single(200),
    "environment, an episode of 50 steps": _scalar_steps,
    "environment of 64 lanes, 50 steps": _vector_steps,
    "environment, reset": lambda: _resets(1),
    "environment of 64 lanes, reset": lambda: _resets(64),
}


def main() -> None:
    check_imports(Path(sys.argv[1]))
    rj.set_threads(1)
    known: dict[str, Work] = {}
    for line in sys.stdin:
        asked = json.loads(line)
        if asked["row"] not in known:
            known[asked["row"]] = ROWS[asked["row"]]()
            known[asked["row"]]()
        print(seconds_of(known[asked["row"]], asked["calls"]), flush=True)


def seconds_of(work: Work, calls: int) -> float:
    """Seconds of the processor for this many calls."""
    gc.collect()
    begin = time.process_time()
    for _ in range(calls):
        work()
    return time.process_time() - begin


if __name__ == "__main__":
    main()
