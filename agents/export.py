"""Export a trained policy as one small file: python -m agents.export RUN --name NAME."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from agents.policies.export import FIRST_SEED, export_run
from agents.policies.file import SUFFIX
from agents.policies.loading import list_policies, load_policy
from agents.policies.network import PolicyError
from agents.policies.recorded_score import RecordedScore
from agents.policies.shipped import ShippedPolicy
from agents.runs.checks import integer
from agents.runs.command_line import exit_code
from agents.runs.config import TrainConfig
from agents.runs.files import write_bytes
from agents.runs.folder import RunFolder
from rollingjoint.errors import ConfigError
from rollingjoint.tables import text_table


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 exported or listed, 2 an error."""
    parser = argparse.ArgumentParser(prog="python -m agents.export", description="Export a trained policy.")
    parser.add_argument("run", type=Path, nargs="?", help="the run folder")
    parser.add_argument("--name", help="name of the policy and of its file")
    parser.add_argument("--policy", default="best", help='"best" (default), "last" or the steps of a checkpoint')
    parser.add_argument("--out", type=Path, default=Path(), help="folder of the file (default: here)")
    parser.add_argument("--episodes", type=int, default=200, help="episodes of the recorded score (default 200)")
    parser.add_argument("--force", action="store_true", help="replace a file that is there")
    parser.add_argument("--list", action="store_true", help="show the shipped policies and their recorded scores")
    arguments = parser.parse_args(argv)
    if not arguments.list and (arguments.run is None or arguments.name is None):
        parser.error("give a run folder and --name, or --list")
    return exit_code(lambda: _list() if arguments.list else _export(arguments))


def _list() -> int:
    print(table([load_policy(name) for name in list_policies()]))
    return 0


def _export(arguments: argparse.Namespace) -> int:
    episodes = integer(1, 100_000)("--episodes", arguments.episodes)
    if not re.fullmatch(r"\w[\w-]{0,63}", arguments.name, re.ASCII):
        raise PolicyError("--name", arguments.name, "letters, digits, _ and -, at most 64")
    path = arguments.out / f"{arguments.name}{SUFFIX}"
    if path.exists() and not arguments.force:
        raise PolicyError("policy file", str(path), "a new file", "Give another --name or --out, or --force.")
    run = RunFolder.open(arguments.run)
    _check_unused(run.config(), scored := range(FIRST_SEED, FIRST_SEED + episodes))
    policy, difference = export_run(run, arguments.policy, arguments.name)
    print(f"NumPy and torch agree within {difference:.1e} on the observations of real episodes")
    policy = replace(policy, score=RecordedScore.of(policy.score_on(scored), scored))
    write_bytes(path, policy.to_bytes())
    print(f"{table([policy])}\n{path}: {path.stat().st_size / 1000:.1f} kB, sha256 {policy.sha256}")
    return 0


def table(policies: Sequence[ShippedPolicy]) -> str:
    """The policies and their recorded scores, for a terminal."""
    head = ["policy", "algorithm", "steps", "hidden", "mean", "95 % below", "within 1 mm", "held", "episodes", "env"]
    rows = []
    for policy in policies:
        row = [policy.name, policy.algorithm, f"{policy.training['steps']}", "x".join(map(str, policy.network.hidden))]
        if policy.score:
            v = policy.score.values
            row += [f"{v['mean_mm']:.3f} mm", f"{v['p95_mm']:.3f} mm"]
            row += [f"{100 * v[share]:.1f} %" for share in ("within_1_mm", "held_1_mm")] + [str(policy.score.episodes)]
        rows.append([*row, *["-"] * (len(head) - 1 - len(row)), policy.env_id])
    return text_table(head, rows, left=len(head))


def _check_unused(config: TrainConfig, scored: range) -> None:
    """Raise ConfigError if training has used one of these seeds."""
    use = config.use_of(scored)
    if use:
        allowed = f"seeds below {scored[0]} or above {scored[-1]} in training"
        raise ConfigError("seed", f"{use}: {config.seeds[use]}", allowed)


if __name__ == "__main__":
    sys.exit(main())
