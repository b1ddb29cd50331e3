"""Export a trained policy as one small file: rj export-policy RUN --name NAME.

With --onnx FILE as an ONNX file, too; without --name that alone, also of a shipped policy.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from agents.policies.contract import contract, contract_text
from agents.policies.errors import PolicyError
from agents.policies.export import FIRST_SEED, export_run
from agents.policies.file import SUFFIX
from agents.policies.loading import list_policies, load_policy, shipped_policies
from agents.policies.recorded_score import RecordedScore
from agents.policies.shipped import ShippedPolicy
from agents.runs.checks import episode_count
from agents.runs.command_line import exit_code
from agents.runs.config import TrainConfig
from agents.runs.consent import add_consent, consent_of
from agents.runs.files import write_bytes
from agents.runs.folder import RunFolder
from rollingjoint.errors import ConfigError
from rollingjoint.tables import text_table


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 exported or listed, 2 an error."""
    parser = argparse.ArgumentParser(prog="rj export-policy", description="Export a trained policy.")
    parser.add_argument("run", nargs="?", help="the run folder; with --onnx alone also a shipped policy or its file")
    parser.add_argument("--name", help="name of the policy and of its file")
    parser.add_argument("--onnx", type=Path, metavar="FILE", help="write an ONNX file and print its contract")
    parser.add_argument("--policy", default="best", help='"best" (default), "last" or the steps of a checkpoint')
    parser.add_argument("--out", type=Path, default=Path(), help="folder of the file (default: here)")
    parser.add_argument("--episodes", type=int, default=200, help="episodes of the regression band (default 200)")
    parser.add_argument("--force", action="store_true", help="replace a file that is there")
    add_consent(parser)
    parser.add_argument("--list", action="store_true", help="show the shipped policies and their regression bands")
    arguments = parser.parse_args(argv)
    if not arguments.list and (arguments.run is None or not (arguments.name or arguments.onnx)):
        parser.error("give a run folder and --name, or --list; or what to write as --onnx")
    return exit_code(lambda: _command(arguments), consent_of(arguments))


def _command(arguments: argparse.Namespace) -> int:
    if arguments.list:
        return _list()
    if arguments.onnx is None:
        _export(arguments)
        return 0
    return _export_onnx(arguments, arguments.onnx)


def _export_onnx(arguments: argparse.Namespace, path: Path) -> int:
    from agents.policies.onnx_file import write_onnx

    _check_new("ONNX file", path, arguments.force)
    write_onnx(policy := _export(arguments) if arguments.name else _chosen(arguments), path)
    print(f"{path}: {path.stat().st_size / 1000:.1f} kB, of the policy with sha256 {policy.sha256}")
    print(contract_text(contract(policy)))
    return 0


def _chosen(arguments: argparse.Namespace) -> ShippedPolicy:
    """The policy of a run folder, or a shipped one, or the one in a policy file."""
    if arguments.run in list_policies() or not Path(arguments.run).is_dir():
        return load_policy(arguments.run, trust_pickle=arguments.trust)
    run = RunFolder.open(Path(arguments.run))
    return export_run(run, arguments.policy, run.path.name)


def _list() -> int:
    print(table(shipped_policies(every=True)))
    return 0


def _export(arguments: argparse.Namespace) -> ShippedPolicy:
    """The policy of the run folder with its score, after it was written to a policy file."""
    episodes = episode_count("--episodes", arguments.episodes)
    if not re.fullmatch(r"\w[\w-]{0,63}", arguments.name, re.ASCII):
        raise PolicyError("--name", arguments.name, "letters, digits, _ and -, at most 64")
    path = arguments.out / f"{arguments.name}{SUFFIX}"
    _check_new("policy file", path, arguments.force, "Give another --name or --out, or --force.")
    run = RunFolder.open(Path(arguments.run))
    _check_unused(run.config(), scored := range(FIRST_SEED, FIRST_SEED + episodes))
    policy = export_run(run, arguments.policy, arguments.name)
    policy = replace(policy, score=RecordedScore.of(policy.score_on(scored), scored, policy.has_memory))
    write_bytes(path, policy.to_bytes())
    print(f"{table([policy])}\n{path}: {path.stat().st_size / 1000:.1f} kB, sha256 {policy.sha256}")
    return policy


def _check_new(what: str, path: Path, force: bool, hint: str = "Give another name, or --force.") -> None:
    if path.exists() and not force:
        raise PolicyError(what, str(path), "a new file", hint)


def table(policies: Sequence[ShippedPolicy]) -> str:
    """The policies and the scores of their fixed episodes (regression bands), for a terminal."""
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
