"""Rates of vector environments with own terms beside the plain task, the table of docs/your_task.md, and of wrappers.

python benchmarks/own_terms.py
"""

from __future__ import annotations

import re
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numba
import numpy as np
from gymnasium.vector import VectorRewardWrapper

from agents.runs.consent import Consent, allowing
from agents.runs.environment import EnvConfig, make_lanes
from rj_gym import Memory, RollingJointEnv, RollingJointVectorEnv, Terms

PAGE = Path(__file__).resolve().parents[1] / "docs" / "your_task.md"
LANES, REPEATS, EPISODE = (1, 64, 1024), 15, 200


class Half(gymnasium.RewardWrapper):
    """Half the reward of one environment."""

    def reward(self, reward: Any) -> Any:
        """Half of it."""
        return 0.5 * reward


class Halves(VectorRewardWrapper):
    """Half the rewards of all lanes."""

    def rewards(self, rewards: Any) -> Any:
        """Half of them."""
        return 0.5 * rewards


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
    print("\n| 64 lanes for Stable-Baselines3 | steps/s |\n|---|---|")
    here = Path(__file__).stem
    named = {"no wrapper": "", "VectorRewardWrapper": f"{here}:Halves", "RewardWrapper": f"{here}:Half"}
    with allowing(Consent(modules=(__file__,))):
        for kind, name in named.items():
            step = stepping_for_sb3([{name: {}}] if name else [])
            rate = 64 / statistics.median(seconds(step, 64) for _ in range(REPEATS))
            print(f"| {kind} | {rate:,.0f} |")


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


def stepping_for_sb3(wrappers: list[dict[str, Any]]) -> Callable[[], Any]:
    """A step of 64 lanes in wrappers, as a training configuration makes them."""
    lanes = make_lanes(EnvConfig(settings={"episode_steps": EPISODE}), 64, wrappers)
    lanes.seed(0)
    lanes.reset()
    actions = np.zeros((64, 2), np.float32)
    return lambda: lanes.step(actions)


def seconds(step: Callable[[], Any], lanes: int) -> float:
    """Of one step, over about a tenth of a second."""
    count = max(5, 5_000 // lanes)
    begin = time.perf_counter()
    for _ in range(count):
        step()
    return (time.perf_counter() - begin) / count


if __name__ == "__main__":
    main()
