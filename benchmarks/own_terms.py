"""Rates of vector environments with own terms beside the plain task: the table of docs/your_task.md.

python benchmarks/own_terms.py
"""

from __future__ import annotations

import re
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np

from rj_gym import Memory, RollingJointEnv, RollingJointVectorEnv, Terms

PAGE = Path(__file__).resolve().parents[1] / "docs" / "your_task.md"
LANES, REPEATS, EPISODE = (1, 64, 1024), 15, 200


def near(step: Any) -> Any:
    """The reward of the page."""
    return 1.0 / (1.0 + step.error_mm / 2.0)


def hold(step: Any) -> Any:
    """The bonus of the page."""
    return 0.5 * (step.memory[:, 0] >= 3)


def streak(step: Any) -> Any:
    """The memory of the page."""
    return np.where(step.error_mm <= 0.5, step.memory[:, 0] + 1, 0)


def main() -> None:
    """Print the table."""
    names: dict[str, Any] = {}
    exec(re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)[0], names)
    variants = {
        "the task as it is": Terms(),
        "own reward in NumPy": Terms(rewards={"near": near}),
        "own reward, compiled": Terms(rewards={"near": numba.njit(near)}),
        "own reward with memory in NumPy": Terms(rewards={"hold": hold}, memory=Memory([0], streak)),
        "own reward with memory, compiled": Terms(
            rewards={"hold": numba.njit(hold)}, memory=Memory([0], numba.njit(streak))
        ),
        "everything in `TERMS`": names["TERMS"],
    }
    print("| steps/s with |", *(f"{lanes:,} lanes |" for lanes in LANES))
    print("|---|" + "---|" * len(LANES))
    rates = {(name, lanes): 0.0 for name in variants for lanes in LANES}
    for lanes in LANES:
        steps = {name: stepping(terms, lanes) for name, terms in variants.items()}
        taken: dict[str, list[float]] = {name: [] for name in variants}
        for _ in range(REPEATS):  # interleaved: the machine's speed drifts
            for name, step in steps.items():
                taken[name].append(seconds(step, lanes))
        rates |= {(name, lanes): lanes / statistics.median(times) for name, times in taken.items()}
    for name in variants:
        print(f"| {name} |", *(f"{rates[name, lanes]:,.0f} |" for lanes in LANES))


def stepping(terms: Terms, lanes: int) -> Callable[[], Any]:
    """A step of an environment that has begun; episodes that end begin anew."""
    if lanes == 1:
        env, action = RollingJointEnv(terms=terms, episode_steps=EPISODE), np.zeros(2, np.float32)
        env.reset(seed=0)

        def step() -> None:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()

        return step
    vector = RollingJointVectorEnv(lanes, terms=terms, episode_steps=EPISODE)
    vector.reset(seed=0)
    actions = np.zeros((lanes, 2), np.float32)
    return lambda: vector.step(actions)


def seconds(step: Callable[[], Any], lanes: int) -> float:
    """Of one step, over about a tenth of a second."""
    count = max(5, 5_000 // lanes)
    begin = time.perf_counter()
    for _ in range(count):
        step()
    return (time.perf_counter() - begin) / count


if __name__ == "__main__":
    main()
