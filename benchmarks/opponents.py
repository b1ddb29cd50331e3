"""How long opponents and shipped policies take for an action: python benchmarks/opponents.py rj_gym/Instrument-v0.

Microseconds of processor time per action and lane, for one lane and for 256 side by side, on one thread, without the
environment. What controllers see is recorded first; the best of some rounds counts.

With --episodes 10000 it counts episodes that fail instead, those with a mean tip error above 5 mm over the last 10
steps, and those of them in which privileged feedback does not fail, on seeds that nothing else uses.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from agents.controllers.controller import Controller
from agents.controllers.privileged_feedback import PrivilegedFeedback
from agents.controllers.tuned import tuned_controllers
from agents.evaluation.rollout import run_episodes
from agents.policies.loading import shipped_policies
from agents.runs.environment import EnvConfig, make_vector_env
from agents.runs.seeds import TAILS
from rollingjoint import set_threads
from rollingjoint.tables import text_table

FAILED_MM = 5.0


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


def failures(env_id: str, controllers: Mapping[str, Controller], seeds: Sequence[int]) -> list[list[str]]:
    """A row per controller, privileged feedback first: errors [mm] and numbers of episodes that fail."""
    every = {"privileged feedback": PrivilegedFeedback(), **controllers}
    errors = {
        name: run_episodes(EnvConfig(env_id), controller, seeds).last_errors.mean(axis=1)
        for name, controller in every.items()
    }
    reachable = errors["privileged feedback"] <= FAILED_MM
    return [
        [
            *(name, f"{off.mean():.3f}", f"{np.percentile(off, 99):.2f}", f"{off.max():.1f}"),
            *(str((off > FAILED_MM).sum()), str((reachable & (off > FAILED_MM)).sum())),
        ]
        for name, off in errors.items()
    ]


def main(argv: Sequence[str] | None = None) -> None:
    """Print a row per controller."""
    parser = argparse.ArgumentParser(description="How long opponents and policies take for an action; how many fail.")
    parser.add_argument("world", nargs="?", default="rj_gym/Instrument-v0")
    parser.add_argument("--lanes", type=int, nargs="+", default=[1, 256])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--controllers", nargs="+", help="only these")
    parser.add_argument("--episodes", type=int, default=0, help="count failures in this many episodes instead")
    arguments = parser.parse_args(argv)
    set_threads(1)
    policies = {policy.name: policy for policy in shipped_policies() if policy.environment.id == arguments.world}
    controllers = tuned_controllers(arguments.world) | policies
    chosen = {name: controllers[name] for name in arguments.controllers or controllers}
    if arguments.episodes:
        header = ["controller", "mean", "99 % below", "largest", "above 5 mm", "privileged within"]
        rows = failures(arguments.world, chosen, TAILS[: arguments.episodes])
    else:
        header = ["controller", *(f"µs, {n} lanes" for n in arguments.lanes)]
        rows = [
            [name, *(f"{microseconds(arguments.world, each, n, arguments.rounds):.1f}" for n in arguments.lanes)]
            for name, each in chosen.items()
        ]
    print(text_table(header, rows, ruled=True))


if __name__ == "__main__":
    main()
