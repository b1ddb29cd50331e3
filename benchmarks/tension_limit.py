"""Errors in the instrument worlds against the limit of tension: of policies, of the probing bank, of the true state.

    python benchmarks/tension_limit.py                        # an ideal limit, behind the sheath
    python benchmarks/tension_limit.py --limit-at motor       # the same worlds with a limit before the sheath
    python benchmarks/tension_limit.py --version 1            # the worlds with the motors of a rig

In version 0 a motor gives way exactly where the tension of its tendon, behind play and sheath, reaches 15 N. Here
nothing but that number is moved, `actuation.tension_limit`, or also the place where it acts: episodes, units and bounds
of the observations stay as they are. Controllers are told of limits at the motors, and not of another number of the
ideal one. Every line has the mean tip error over the last 10 steps under a shipped policy, where one ships, under the
probing bank and under feedback on the true state, in the same episodes, with 95 % intervals by a
bootstrap over the episodes, and how much of the time the policy has a tendon at the limit.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from agents.controllers.controller import Controller, env_for
from agents.controllers.privileged_feedback import PrivilegedFeedback
from agents.controllers.tuned import tuned_controllers
from agents.evaluation.rollout import LAST_STEPS
from agents.results.statistics import Bootstrap
from agents.results.wording import mm, share, with_interval
from agents.runs.environment import EnvConfig, make_vector_env
from agents.runs.seeds import TENSION_LIMITS
from agents.shipped import PolicyError, load_policy
from rj_gym.registry import task_of
from rj_gym.tracking.arrays import BOUND, STOP
from rollingjoint.tables import markdown_table

Array = NDArray[np.float64]

POLICIES = {"Instrument": "instrument", "InstrumentShift": "instrument_shift"}  # that ship, by world
OPPONENT = "probing bank"
PLACES = ("tendon", "motor")
NEWTONS = (10.0, 13.0, 14.0, 15.0, 16.0, 16.5, 17.0, 20.0, 30.0, 60.0)


class Driven(NamedTuple):
    """Episodes as a controller drove them."""

    errors: Array  # mean tip error over the last 10 steps, (B,) mm
    at_limit: float  # share of all steps of all tendons in which a limit held tension or motor


def limited(env: EnvConfig, limit: float | None, place: str) -> EnvConfig:
    """The environment with this limit [N]; None: as its settings draw it."""
    settings: Any = dict(env.settings)
    number = {} if limit is None else {"tension_limit": [limit, limit]}
    actuation = {**settings.get("actuation", {}), "limit_at": place, **number}
    return EnvConfig(env.id, settings=settings | {"actuation": actuation})


def limited_env(env: EnvConfig, lanes: int, limit: float | None, place: str = "tendon") -> VectorEnv[Any, Any, Any]:
    """The native vector environment with this limit of tension [N]."""
    return make_vector_env(limited(env, limit, place), lanes)


def drive(
    env: EnvConfig, controller: Controller, seeds: Sequence[int], limit: float | None, place: str = "tendon"
) -> Driven:
    """Episodes of these seeds under the controller, side by side."""
    env = env_for(env, controller)
    envs: Any = limited_env(env, len(seeds), limit, place)
    observation, info = envs.reset(seed=list(seeds))
    told = envs.task if place == "motor" or controller.privileged else task_of(env.arguments()["config"])
    controller.begin(told, len(seeds))
    errors, held, running = [info["error_mm"]], [], np.ones(len(seeds), bool)
    while running.any():
        observation, _, terminated, truncated, info = envs.step(controller.act(observation))
        errors.append(np.where(running, info["error_mm"], errors[-1]))
        limits = envs._buffer.hardware.limits
        held.append(((info["tensions"] >= limits[:, BOUND]) | (limits[:, STOP] > 0))[running].ravel())
        running &= ~(terminated | truncated)
    envs.close()
    return Driven(np.stack(errors, axis=1)[:, -LAST_STEPS:].mean(axis=1), float(np.concatenate(held).mean()))


def rows_of(
    world: str, limits: Sequence[float], episodes: int, place: str = "tendon", version: int = 0
) -> list[list[str]]:
    """The rows of the table of one world, one per limit [N], and one of drawn limits where the world draws them."""
    env, bootstrap = EnvConfig(f"rj_gym/{world}-v{version}"), Bootstrap(episodes)
    seeds = range(TENSION_LIMITS.start, TENSION_LIMITS.start + episodes)
    controllers = [_policy(world, version), tuned_controllers(env.id)[OPPONENT], PrivilegedFeedback()]
    rows = []
    for limit in [*limits, *([None] if version else [])]:
        driven = [None if each is None else drive(env, each, seeds, limit, place) for each in controllers]
        errors = ["" if each is None else with_interval(bootstrap.mean(each.errors), mm) for each in driven]
        at_limit = "" if driven[0] is None else share(driven[0].at_limit)
        rows.append([world, "drawn" if limit is None else f"{limit:g}", *errors, at_limit])
    return rows


def _policy(world: str, version: int) -> Controller | None:
    """The shipped policy of this version of a world; None where none ships."""
    try:
        return load_policy(POLICIES[world], version=version)
    except PolicyError:
        return None


def main(argv: Sequence[str] | None = None) -> None:
    """Print a row per world and limit."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--episodes", type=int, default=len(TENSION_LIMITS))
    parser.add_argument("--worlds", nargs="+", choices=POLICIES, default=list(POLICIES))
    parser.add_argument("--newtons", nargs="+", type=float, default=list(NEWTONS), help="the limits")
    parser.add_argument(
        "--limit-at", choices=PLACES, help="where limits act (default: tendon in version 0, else motor)"
    )
    parser.add_argument("--version", type=int, choices=(0, 1), default=0, help="of the worlds (default 0)")
    arguments = parser.parse_args(argv)
    place = arguments.limit_at or PLACES[arguments.version]
    plan = arguments.newtons, arguments.episodes, place, arguments.version
    rows = [row for world in arguments.worlds for row in rows_of(world, *plan)]
    heads = ("world", "limit [N]", "its policy [mm]", f"{OPPONENT} [mm]", "true state [mm]", "policy at the limit [%]")
    print(markdown_table(heads, rows))


if __name__ == "__main__":
    main()
