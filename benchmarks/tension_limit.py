"""How much policies of the instrument worlds owe to motors that give way at an ideal limit of tension.

    python benchmarks/tension_limit.py

In the simulation a motor gives way exactly where the tension of its tendon, behind play and sheath, reaches the upper
end of `tension_range`. Here nothing but that number is moved: episodes, units and bounds of the observations stay as
they are, and so does what controllers are told, the limit of the world. Every line has the mean tip error over the last
10 steps under a shipped policy and under the best opponent of its world, in the same episodes, with 95 % intervals by a
bootstrap over the episodes, and how much of the time the policy has a tendon at the limit.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from agents.controllers.controller import Controller
from agents.controllers.tuned import tuned_controllers
from agents.evaluation.rollout import LAST_STEPS
from agents.results.statistics import Bootstrap
from agents.results.wording import mm, share, with_interval
from agents.runs.environment import EnvConfig, make_vector_env
from agents.runs.seeds import TENSION_LIMITS
from agents.shipped import load_policy
from rj_gym.registry import task_of
from rollingjoint.tables import markdown_table

Array = NDArray[np.float64]

POLICIES = {"Instrument": "instrument", "InstrumentShift": "instrument_shift"}  # that ship, by world
OPPONENT = "probing bank"
NEWTONS = (10.0, 13.0, 14.0, 15.0, 16.0, 16.5, 17.0, 20.0, 30.0, 60.0)


class Driven(NamedTuple):
    """Episodes as a controller drove them."""

    errors: Array  # mean tip error over the last 10 steps, (B,) mm
    at_limit: float  # share of all steps of all tendons at the upper limit of tension


def limited_env(env: EnvConfig, lanes: int, limit: float) -> VectorEnv[Any, Any, Any]:
    """The native vector environment, in which motors give way at this tension [N]; its `task` does not say so."""
    envs: Any = make_vector_env(env, lanes)
    low, _ = envs.config.tension_range
    envs._buffer.task = task_of(replace(envs.config, tension_range=(low, limit)))  # its units are bound already
    return envs


def drive(env: EnvConfig, controller: Controller, seeds: Sequence[int], limit: float) -> Driven:
    """Episodes of these seeds under the controller, side by side."""
    envs: Any = limited_env(env, len(seeds), limit)
    observation, info = envs.reset(seed=list(seeds))
    controller.begin(envs.task, len(seeds))
    errors, held, running = [info["error_mm"]], [], np.ones(len(seeds), bool)
    while running.any():
        observation, _, terminated, truncated, info = envs.step(controller.act(observation))
        errors.append(np.where(running, info["error_mm"], errors[-1]))
        held.append((info["tensions"] >= limit)[running].ravel())
        running &= ~(terminated | truncated)
    envs.close()
    return Driven(np.stack(errors, axis=1)[:, -LAST_STEPS:].mean(axis=1), float(np.concatenate(held).mean()))


def rows_of(world: str, limits: Sequence[float], episodes: int) -> list[list[str]]:
    """The rows of the table of one world, one per limit [N]."""
    env, bootstrap = EnvConfig(f"rj_gym/{world}-v0"), Bootstrap(episodes)
    seeds = range(TENSION_LIMITS.start, TENSION_LIMITS.start + episodes)
    controllers = load_policy(POLICIES[world]), tuned_controllers(env.id)[OPPONENT]
    rows = []
    for limit in limits:
        policy, opponent = (drive(env, each, seeds, limit) for each in controllers)
        errors = [with_interval(bootstrap.mean(each.errors), mm) for each in (policy, opponent)]
        rows.append([world, f"{limit:g}", *errors, share(policy.at_limit)])
    return rows


def main(argv: Sequence[str] | None = None) -> None:
    """Print a row per world and limit."""
    parser = argparse.ArgumentParser(description="What the instrument policies owe to an ideal limit of tension.")
    parser.add_argument("--episodes", type=int, default=len(TENSION_LIMITS))
    parser.add_argument("--worlds", nargs="+", choices=POLICIES, default=list(POLICIES))
    parser.add_argument("--newtons", nargs="+", type=float, default=list(NEWTONS), help="the limits")
    arguments = parser.parse_args(argv)
    rows = [row for world in arguments.worlds for row in rows_of(world, arguments.newtons, arguments.episodes)]
    heads = ("world", "limit [N]", "its policy [mm]", f"{OPPONENT} [mm]", "policy at the limit [%]")
    print(markdown_table(heads, rows))


if __name__ == "__main__":
    main()
