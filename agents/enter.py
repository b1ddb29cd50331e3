"""Score a controller of your own, or one of ours, on the seeds of a benchmark: rj enter FILE.py:NAME --env ID.

NAME is a controller (agents.controllers.controller), a class or function that makes one without arguments, or one
that makes a function from observations to actions; without a file it is the name of an opponent. Its episodes go into
a results file, which rj results merges with others, and a table compares it with the known results of the same
episodes. docs/enter.md shows how.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from agents.runs.checks import integer
from agents.runs.command_line import exit_code, typed_command
from agents.runs.config import apply_overrides
from agents.runs.consent import add_consent, consent_of
from agents.runs.environment import EnvConfig
from agents.runs.seeds import TEST, VALIDATION
from rollingjoint.errors import ConfigError

if TYPE_CHECKING:
    from agents.controllers.controller import Controller
    from agents.results.record import Results, World

SEEDS = {"test": TEST, "validation": VALIDATION}
PUBLISHED = Path("docs/results.json.gz")


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 scored, 2 an error."""
    parser = argparse.ArgumentParser(prog="rj enter", description="Score a controller of your own.")
    parser.add_argument(
        "controller",
        metavar="FILE.py:NAME",
        help="or MODULE:NAME: what makes the controller, or an opponent such as 'probing bank'",
    )
    parser.add_argument("--env", default="rj_gym/RollingJoint-v0", help="id of the environment (default %(default)s)")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="setting of the environment, repeatable"
    )
    parser.add_argument("--seeds", choices=SEEDS, default="validation", help="episodes (default %(default)s)")
    parser.add_argument("--name", help="what tables call it (default: NAME)")
    parser.add_argument("--training-seed", type=int, help="of a learned controller: enter one per training seed")
    parser.add_argument(
        "--everywhere", action="store_true", help="also under all other settings that the results file has scores of"
    )
    parser.add_argument("--alone", action="store_true", help="compare with nothing")
    parser.add_argument(
        "--beside", type=Path, help=f"results file to compare with (default: {PUBLISHED}, if it has these episodes)"
    )
    parser.add_argument("--out", type=Path, help="results file to write, or to add to")
    add_consent(parser, pickles=False)
    arguments = parser.parse_args(argv)
    return exit_code(lambda: _command(arguments, typed_command("rj enter", argv)), consent_of(arguments))


def _command(arguments: argparse.Namespace, command: Sequence[str]) -> int:
    from agents.results.entry import comparison_table, enter
    from agents.results.file import read_results, write_results
    from agents.results.merging import merged
    from agents.results.record import World

    env = EnvConfig(arguments.env, settings=apply_overrides({}, arguments.set))
    if not env.is_built_in_tracking:
        hint = "Ids begin with rj_gym/; others, tasks among walls and of design too, have no rows in the results."
        raise ConfigError("--env", env.id, "a tracking environment of rj_gym", hint)
    if arguments.training_seed is not None:
        integer(0, 2**31)("--training-seed", arguments.training_seed)
    if arguments.alone and arguments.beside and not arguments.everywhere:
        hint = "Leave one of them out, or add --everywhere, which takes the settings from that file."
        raise ConfigError("--beside", str(arguments.beside), "no results file with --alone", hint)
    name = arguments.name or arguments.controller.rpartition(":")[2]
    kind, controller = _controller(arguments.controller, env)
    title, seeds = " ".join([env.id.removeprefix("rj_gym/"), *arguments.set]), SEEDS[arguments.seeds]
    world = World(arguments.seeds, arguments.seeds, seeds.start, len(seeds))
    worlds = _worlds(arguments.beside or PUBLISHED, env, world) if arguments.everywhere else [world]
    entered = enter(env, {name: controller}, title, worlds, kind, arguments.training_seed, command)
    others = None if arguments.alone else _others(arguments.beside, env, title, world)
    print(f"{env.id}, {len(seeds):,} {arguments.seeds} episodes, seeds {seeds[0]} to {seeds[-1]}, last 10 steps")
    print(comparison_table(entered, others, world))
    if arguments.out:
        results = [read_results(arguments.out)] if arguments.out.exists() else []
        write_results(arguments.out, merged([*results, entered]))
        print(f"Entered in {arguments.out}")
    return 0


def _controller(text: str, env: EnvConfig) -> tuple[str, Controller]:
    """Kind of the controller in results, and the controller itself."""
    from agents.controllers.controller import load_controller
    from agents.controllers.tuned import hint
    from agents.results.record import BASELINE, ENTRY
    from agents.results.roster import opponents

    if ":" in text:
        return ENTRY, load_controller(text)
    able, _ = opponents(env)
    if text not in able:
        allowed = f"FILE.py:NAME or MODULE:NAME, or an opponent in {env.id}: {', '.join(able)}"
        raise ConfigError("controller", text, allowed, hint(text, able))
    return BASELINE, able[text]


def _worlds(path: Path, env: EnvConfig, world: World) -> Sequence[World]:
    """All worlds of a results file that has these episodes."""
    from agents.results.entry import known_in
    from agents.results.file import read_results

    results = known_in(read_results(path), env, world)
    if results is None:
        raise ConfigError("--everywhere", str(path), f"results of {env.id} in the {world.name} episodes {world.seeds}")
    return results.benchmarks[0].worlds


def _others(beside: Path | None, env: EnvConfig, title: str, world: World) -> Results:
    """Results to compare with: those in the results file, or else the shipped controllers, scored now."""
    from agents.results.entry import known_in, shipped
    from agents.results.file import read_results

    path = beside or PUBLISHED
    results = known_in(read_results(path), env, world) if beside or path.exists() else None
    if results is None and beside:
        raise ConfigError("--beside", str(beside), f"results of {env.id} in the {world.name} episodes {world.seeds}")
    return results or shipped(env, title, world)


if __name__ == "__main__":
    sys.exit(main())
