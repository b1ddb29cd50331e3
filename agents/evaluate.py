"""Evaluate a trained controller: python -m agents.evaluate RUN."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from agents.command_line import exit_code
from agents.config import EnvConfig, TrainConfig
from agents.rollout import film, is_tracking, run_episodes
from agents.run_folder import RunFolder, typed_command, versions, write_bytes, write_json, write_text
from rollingjoint.errors import ConfigError

if TYPE_CHECKING:
    from agents.controller import Controller
    from agents.report import Report

POLICY, OPEN_LOOP = "policy", "open loop"
FILMED = (POLICY, "jacobian feedback", OPEN_LOOP)
OWN = "one more controller to compare, as described in agents.controller; repeatable"


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 evaluated, 2 an error."""
    parser = argparse.ArgumentParser(prog="python -m agents.evaluate", description="Evaluate a trained controller.")
    parser.add_argument("run", type=Path, help="the run folder")
    parser.add_argument("--episodes", type=int, default=200, help="number of episodes (default 200)")
    parser.add_argument("--seed", type=int, default=10_000, help="seed of the first episode (default 10000)")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="env.settings.key=value, repeatable"
    )
    parser.add_argument("--policy", default="best", help='"best" (default), "last" or the steps of a checkpoint')
    parser.add_argument("--out", type=Path, help="where the report goes (default: evaluation/ in the run folder)")
    parser.add_argument("--controller", action="append", default=[], metavar="MODULE:CLASS", help=OWN)
    arguments = parser.parse_args(argv)
    return exit_code(lambda: _command(arguments, typed_command("agents.evaluate", argv)))


@dataclass(frozen=True)
class Evaluation:
    """What to evaluate: a run, one of its policies, its configuration with overrides, the seeds, other controllers."""

    run: RunFolder
    policy: str
    config: TrainConfig
    seeds: range
    own: Sequence[str] = ()

    def __post_init__(self) -> None:
        if not len(self.seeds):
            raise ConfigError("--episodes", len(self.seeds), "an integer >= 1")
        if self.seeds.start < 0:
            raise ConfigError("--seed", self.seeds.start, "an integer >= 0")
        used = self.config.evaluation
        seen = range(self.config.seed, self.config.seed + self.config.env.n_envs)
        if any(_overlap(self.seeds, other) for other in (seen, range(used.seed, used.seed + used.episodes))):
            mend = "The run's seeds.json lists them; give another --seed."
            raise ConfigError("--seed", self.seeds.start, "seeds that training has not used", mend)


def _command(arguments: argparse.Namespace, command: Sequence[str]) -> int:
    run = RunFolder.open(arguments.run)
    seeds = range(arguments.seed, arguments.seed + max(arguments.episodes, 0))
    evaluation = Evaluation(run, arguments.policy, run.config(arguments.set), seeds, arguments.controller)
    folder = arguments.out or run.evaluation
    about = {"command": " ".join(command), "changed settings": ", ".join(arguments.set) or "none"}
    print(evaluate(evaluation, folder, about))
    print(f"Report: {folder / 'report.md'}")
    if is_tracking(evaluation.config.env):
        print(f"Animation: {folder / 'animation.gif'}")
    return 0


def evaluate(evaluation: Evaluation, folder: Path, about: dict[str, Any]) -> str:
    """The table of scores; report and pictures go to `folder`. Raises RollingJointError."""
    controllers = _controllers(evaluation)
    report = evaluate_controllers(evaluation.config.env, controllers, evaluation.seeds)
    report = replace(report, about=_about(evaluation) | about)
    _write(report, controllers, evaluation, folder)
    return report.text()


def evaluate_controllers(
    env: EnvConfig, controllers: Mapping[str, Controller], seeds: Sequence[int], with_floor: bool = True
) -> Report:
    """What the controllers do in the same episodes, one per seed, and the floors of these; nothing is written.

    Environments with another task than tracking have no floor.
    """
    from agents.report import Report

    episodes = {name: run_episodes(env, controller, seeds) for name, controller in controllers.items()}
    if not is_tracking(env):
        return Report(episodes)
    from agents.floor import episode_floor
    from rj_gym.core.registry import task_of

    floors = episode_floor(env, seeds).errors if with_floor else None
    return Report(episodes, task_of(env.arguments()["config"]).length, floors)


def _controllers(evaluation: Evaluation) -> dict[str, Controller]:
    from agents.baselines import baselines
    from agents.policy import Policy

    ours = baselines() if is_tracking(evaluation.config.env) else {}
    own = {text.rpartition(":")[2]: _own_controller(text) for text in evaluation.own}
    return {POLICY: Policy.load(evaluation.run, evaluation.policy), **own, **ours}


def _own_controller(text: str) -> Controller:
    """A controller of the class that "module:Class" names."""
    module, _, name = text.partition(":")
    try:
        return getattr(importlib.import_module(module), name)()
    except (ImportError, AttributeError, ValueError, TypeError) as error:
        allowed = "module:Class, a class that needs no arguments"
        raise ConfigError("--controller", text, allowed, str(error)) from error


def _write(report: Report, controllers: dict[str, Controller], evaluation: Evaluation, folder: Path) -> None:
    from agents.pictures import error_distribution, error_over_time

    errors = {name: episodes.errors for name, episodes in report.episodes.items()}
    pictures = {
        "error_over_time.png": error_over_time(errors, report.known_floors),
        "error_distribution.png": error_distribution(errors, report.known_floors),
    }
    captions = {
        "error_over_time.png": "Tip error after every step; equally good controllers lie on each other.",
        "error_distribution.png": "Tip error at the end of every episode; box: quartiles, whiskers: 5 to 95 %; errors "
        "below 0.001 mm are drawn there.",
    }
    if is_tracking(evaluation.config.env):
        seed, pictures["animation.gif"] = _film(report, controllers, evaluation)
        captions["animation.gif"] = f"The episode of seed {seed}, in which open loop ends with its median error."
    for name, content in pictures.items():
        write_bytes(folder / name, content)
    write_json(folder / "report.json", report.to_dict())
    notes = {name: (type(controller).__doc__ or "").split("\n")[0] for name, controller in controllers.items()}
    write_text(folder / "report.md", report.markdown(notes, captions))


def _film(report: Report, controllers: dict[str, Controller], evaluation: Evaluation) -> tuple[int, bytes]:
    """Seed and animation of the episode in which open loop's final error is its median one."""
    from agents.pictures import animation

    order = np.argsort(report.episodes[OPEN_LOOP].final_errors)
    seed = evaluation.seeds[int(order[len(order) // 2])]
    return seed, animation({name: film(evaluation.config.env, controllers[name], seed) for name in FILMED})


def _about(evaluation: Evaluation) -> dict[str, Any]:
    seeds, env = evaluation.seeds, evaluation.config.env
    return {
        "run": str(evaluation.run.path),
        "policy": evaluation.policy,
        "environment": env.id,
        "episodes": f"{len(seeds)}, seeds {seeds[0]} to {seeds[-1]}",
        "versions": ", ".join(f"{name} {version}" for name, version in versions().items()),
    }


def _overlap(one: range, other: range) -> bool:
    return one.start < other.stop and other.start < one.stop


if __name__ == "__main__":
    sys.exit(main())
