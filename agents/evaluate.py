"""Evaluate a trained controller: rj evaluate RUN."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from agents.controllers import untuned_controllers, why_left_out
from agents.controllers.controller import Controller
from agents.evaluation.report import POLICY, evaluate_controllers
from agents.executors.local import InlineExecutor
from agents.executors.options import add_options, executor_of
from agents.runs.checks import episode_count, prefixed, seed_number
from agents.runs.command_line import exit_code, typed_command
from agents.runs.config import TrainConfig
from agents.runs.consent import add_consent, consent_of
from agents.runs.folder import RunFolder, versions
from rollingjoint.errors import ConfigError

__all__ = ["evaluate_controllers", "main"]

MOMENTS = 11  # of an episode at which floors are drawn
NOT_TRACKING = "The policy is compared with no controllers: these need an environment with a tracking class of rj_gym."
BESIDE = "another run folder whose best policy drives the same episodes, under the name of its folder; repeatable"
OWN = "one more controller to compare, as described in agents.controllers.controller; repeatable"


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 evaluated, 2 an error."""
    parser = argparse.ArgumentParser(prog="rj evaluate", description="Evaluate a trained controller.")
    parser.add_argument("run", type=Path, help="the run folder")
    parser.add_argument("--episodes", type=int, default=200, help="number of episodes (default 200)")
    parser.add_argument("--seed", type=int, default=10_000, help="seed of the first episode (default 10000)")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="env.settings.key=value, repeatable"
    )
    parser.add_argument("--policy", default="best", help='"best" (default), "last" or the steps of a checkpoint')
    parser.add_argument("--out", type=Path, help="where the report goes (default: evaluation/ in the run folder)")
    parser.add_argument("--controller", action="append", default=[], metavar="MODULE:CLASS", help=OWN)
    parser.add_argument("--beside", type=Path, action="append", default=[], metavar="RUN", help=BESIDE)
    add_consent(parser)
    add_options(parser, "blocks of episodes", jobs=1)
    arguments = parser.parse_args(argv)
    return exit_code(lambda: _command(arguments, typed_command("rj evaluate", argv)), consent_of(arguments))


def _command(arguments: argparse.Namespace, command: Sequence[str]) -> int:
    from agents.evaluation.output import write_report
    from agents.policies.trained import load_driving

    first, episodes = seed_number("--seed", arguments.seed), episode_count("--episodes", arguments.episodes)
    seeds = range(first, first + episodes)
    run = RunFolder.open(arguments.run)
    config, folder = run.config(arguments.set), arguments.out or run.evaluation
    config.check_unused(seeds)
    additional = {text.rpartition(":")[2]: _own_controller(text) for text in arguments.controller}
    blind = why_left_out(config.env.arguments()["config"]) if config.env.is_tracking else ""
    ours = untuned_controllers(poses=not blind) if config.env.is_tracking else {}
    others = {path.name: _other_policy(path, config, seeds) for path in arguments.beside}
    names = [POLICY, *(path.name for path in arguments.beside), *additional, *ours]
    if repeated := next((name for name in names if names.count(name) > 1), ""):
        raise ConfigError("--beside or --controller", repeated, "a name that no other controller of the table has")
    controllers = {POLICY: load_driving(run, arguments.policy, in_wrappers=True), **others, **additional, **ours}
    about = {
        "run": str(run.path),
        "policy": arguments.policy,
        "environment": config.env.id,
        "episodes": f"{len(seeds)}, seeds {seeds[0]} to {seeds[-1]}",
        "versions": ", ".join(f"{name} {version}" for name, version in versions().items()),
        "command": " ".join(command),
        "changed settings": ", ".join(arguments.set) or "none",
    }
    with executor_of(arguments.cluster, arguments.jobs, inline=True) as executor:
        elsewhere = None if isinstance(executor, InlineExecutor) else executor
        evaluation = evaluate_controllers(config.env, controllers, seeds, executor=elsewhere, moments=MOMENTS)
    report = replace(evaluation, about=about)
    write_report(report, controllers, config.env, folder)
    for note in filter(None, (blind, config.why_scalar, "" if config.env.is_tracking else NOT_TRACKING)):
        print(note)
    print(f"{report.text()}\nReport: {folder / 'report.md'}")
    if config.env.is_tracking:
        print(f"Animation: {folder / 'animation.gif'}")
    return 0


def _other_policy(path: Path, config: TrainConfig, seeds: range) -> Controller:
    """The best policy of the run at `path`; raises ConfigError unless it is of this configuration's environment."""
    from agents.policies.trained import load_driving

    with prefixed("--beside: "):
        run = RunFolder.open(path)
        other = run.config()
        other.check_unused(seeds)
        if other.env.id != config.env.id:
            raise ConfigError("run folder", str(path), f"a run of {config.env.id}", f"That one is of {other.env.id}.")
        return load_driving(run, in_wrappers=True)


def _own_controller(text: str) -> Controller:
    """A controller of the class that "module:Class" names."""
    module, _, name = text.partition(":")
    try:
        return getattr(importlib.import_module(module), name)()
    except (ImportError, AttributeError, ValueError, TypeError) as error:
        allowed = "module:Class, a class that needs no arguments"
        raise ConfigError("--controller", text, allowed, str(error)) from error


if __name__ == "__main__":
    sys.exit(main())
