"""Errors in the instrument worlds against the limit of tension: of policies, of the probing bank, of the true state.

    python benchmarks/tension_limit.py                        # an ideal limit, behind the sheath
    python benchmarks/tension_limit.py --limit-at motor       # the same worlds with a limit before the sheath
    python benchmarks/tension_limit.py --version 1            # the worlds with the motors of a rig

In version 0 a motor gives way exactly where the tension of its tendon, behind play and sheath, reaches 15 N. Here
nothing but that number is moved, `actuation.tension_limit`, or also the place where it acts: episodes, units and bounds
of the observations stay as they are. Controllers are told of limits at the motors, and not of another number of the
ideal one. Every line has the mean tip error over the last 10 steps under a shipped policy, where one ships, under the
probing bank, in version 1 under the smoother, and under feedback on the true state, in the same episodes, with 95 %
intervals by a bootstrap over the episodes, and how much of the time the policy has a tendon at the limit.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from agents.controllers.controller import Controller, env_for
from agents.controllers.privileged_feedback import PrivilegedFeedback
from agents.controllers.tuned import tuned_controllers
from agents.evaluation.rollout import LAST_STEPS
from agents.results.statistics import Bootstrap, Interval
from agents.results.wording import mm, share, with_interval
from agents.runs.environment import EnvConfig, make_vector_env
from agents.runs.seeds import TENSION_LIMITS
from agents.shipped import PolicyError, load_policy
from rj_gym.registry import task_of
from rj_gym.tracking.arrays import BOUND, STOP
from rollingjoint.tables import markdown_table

Array = NDArray[np.float64]

POLICIES = {"Instrument": "instrument", "InstrumentShift": "instrument_shift"}  # that ship, by world
OPPONENTS = (("probing bank",), ("probing bank", "smoother"))  # by version
POLICY = "its policy"
PLACES = ("tendon", "motor")
STYLES = (
    {"color": "black", "linewidth": 2.2},
    {"color": "#cc79a7", "linestyle": "--"},
    {"color": "#0072b2", "linestyle": "-."},
    {"color": "#009e73", "linestyle": ":"},
)
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


class Row(NamedTuple):
    """Controllers in one world with one limit."""

    world: str
    limit: float | None  # N; None: drawn
    errors: Mapping[str, Interval | None]  # by controller [mm]; None where no policy ships
    at_limit: float | None  # of the policy

    def cells(self) -> list[str]:
        """The row of the table."""
        errors = ["" if error is None else with_interval(error, mm) for error in self.errors.values()]
        at_limit = "" if self.at_limit is None else share(self.at_limit)
        return [self.world, "drawn" if self.limit is None else f"{self.limit:g}", *errors, at_limit]


def rows_of(world: str, limits: Sequence[float], episodes: int, place: str = "tendon", version: int = 0) -> list[Row]:
    """The rows of one world, one per limit [N], and one of drawn limits where the world draws them."""
    env, bootstrap = EnvConfig(f"rj_gym/{world}-v{version}"), Bootstrap(episodes)
    seeds = range(TENSION_LIMITS.start, TENSION_LIMITS.start + episodes)
    tuned = {name: tuned_controllers(env.id)[name] for name in OPPONENTS[version]}
    controllers = {POLICY: _policy(world, version)} | tuned | {"true state": PrivilegedFeedback()}
    rows = []
    for limit in [*limits, *([None] if version else [])]:
        driven = {
            name: None if each is None else drive(env, each, seeds, limit, place) for name, each in controllers.items()
        }
        errors = {name: None if each is None else bootstrap.mean(each.errors) for name, each in driven.items()}
        policy = driven[POLICY]
        rows.append(Row(world, limit, errors, None if policy is None else policy.at_limit))
    return rows


def picture(rows: Sequence[Row], path: Path) -> None:
    """Errors over the limit with their intervals, a panel per world."""
    worlds = list(dict.fromkeys(row.world for row in rows))
    figure, panels = plt.subplots(1, len(worlds), figsize=(5.4 * len(worlds), 3.8), squeeze=False, layout="constrained")
    for axes, world in zip(panels[0], worlds, strict=True):
        shown = [row for row in rows if row.world == world and row.limit is not None]
        for name, style in zip(rows[0].errors, STYLES, strict=False):
            found = [(row.limit, row.errors[name]) for row in shown if row.errors[name] is not None]
            limits, errors = [limit for limit, _ in found], [error for _, error in found]
            axes.plot(limits, [error.value for error in errors], label=name, **style)
            low, high = [error.low for error in errors], [error.high for error in errors]
            axes.fill_between(limits, low, high, color=style["color"], alpha=0.15)
        axes.set(xscale="log", yscale="log", title=world, xlabel="limit of tension [N]", ylabel="mean tip error [mm]")
        ticks = sorted({row.limit for row in shown})
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.minorticks_off()
        axes.legend(frameon=False)
    figure.savefig(path, dpi=110)


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
    parser.add_argument("--picture", type=Path, metavar="FILE", help="draw the errors into this PNG, too")
    arguments = parser.parse_args(argv)
    place = arguments.limit_at or PLACES[arguments.version]
    plan = arguments.newtons, arguments.episodes, place, arguments.version
    rows = [row for world in arguments.worlds for row in rows_of(world, *plan)]
    errors = [f"{name} [mm]" for name in rows[0].errors]
    print(markdown_table(("world", "limit [N]", *errors, "policy at the limit [%]"), [row.cells() for row in rows]))
    if arguments.picture:
        picture(rows, arguments.picture)


if __name__ == "__main__":
    main()
