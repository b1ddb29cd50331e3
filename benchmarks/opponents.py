"""How long opponents and shipped policies take for an action: python benchmarks/opponents.py rj_gym/Instrument-v0.

Microseconds of processor time per action and lane, for one lane and for 256 side by side, on one thread, without the
environment. What controllers see is recorded first; the best of some rounds counts.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from typing import Any

from agents.controllers.controller import Controller
from agents.controllers.tuned import tuned_controllers
from agents.policies.loading import shipped_policies
from agents.runs.environment import EnvConfig, make_vector_env
from rollingjoint import set_threads
from rollingjoint.tables import text_table


def recorded(env_id: str, controller: Controller, lanes: int) -> tuple[Any, list[Any]]:
    """The task, and the observations in the steps of an episode of every lane."""
    envs = make_vector_env(EnvConfig(env_id), lanes)
    observation, _ = envs.reset(seed=list(range(lanes)))
    controller.begin(envs.task, lanes)
    observations = []
    for _ in range(envs.task.config.episode_steps):
        observations.append(observation.copy())
        observation, *_ = envs.step(controller.act(observation))
    envs.close()
    return envs.task, observations


def microseconds(env_id: str, controller: Controller, lanes: int, rounds: int = 5) -> float:
    """The time of an action, per lane [µs]."""
    (task, observations), best = recorded(env_id, controller, lanes), float("inf")
    for _ in range(rounds):
        controller.begin(task, lanes)
        start = time.process_time()
        for each in observations:
            controller.act(each)
        best = min(best, time.process_time() - start)
    return 1e6 * best / len(observations) / lanes


def main(argv: Sequence[str] | None = None) -> None:
    """Print a row per controller."""
    parser = argparse.ArgumentParser(description="How long opponents and policies take for an action.")
    parser.add_argument("world", nargs="?", default="rj_gym/Instrument-v0")
    parser.add_argument("--lanes", type=int, nargs="+", default=[1, 256])
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args(argv)
    set_threads(1)
    policies = {policy.name: policy for policy in shipped_policies() if policy.environment.id == arguments.world}
    rows = [
        [name, *(f"{microseconds(arguments.world, each, n, arguments.rounds):.1f}" for n in arguments.lanes)]
        for name, each in (tuned_controllers(arguments.world) | policies).items()
    ]
    print(text_table(["controller", *(f"µs, {n} lanes" for n in arguments.lanes)], rows, ruled=True))


if __name__ == "__main__":
    main()
