"""Export a trained policy as one small file: python -m agents.export RUN --name NAME."""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from agents.policies.conversion import algorithm_of, network_of
from agents.policies.file import SUFFIX
from agents.policies.network import PolicyError
from agents.policies.recorded_score import RecordedScore
from agents.runs.command_line import exit_code
from agents.runs.config import EnvConfig, TrainConfig
from agents.runs.folder import RunFolder, seeds, write_bytes
from agents.runs.schedules import check_integer
from agents.shipped import ShippedPolicy, entry_names, is_goal, list_policies, load_policy, standalone
from rj_gym import IDS
from rollingjoint.errors import ConfigError, RollingJointError

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

FIRST_SEED = 20_000
LARGEST_DIFFERENCE = 1e-5
MACHINE = ("platform", "processor", "cores")  # of versions.json: no business of who gets the policy


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
    check_integer("--episodes", arguments.episodes, 1, 100_000)
    if not re.fullmatch(r"\w[\w-]{0,63}", arguments.name, re.ASCII):
        raise PolicyError("--name", arguments.name, "letters, digits, _ and -, at most 64")
    path = arguments.out / f"{arguments.name}{SUFFIX}"
    if path.exists() and not arguments.force:
        raise PolicyError("policy file", str(path), "a new file", "Give another --name or --out, or --force.")
    run = RunFolder.open(arguments.run)
    _check_unseen(run.config(), scored := range(FIRST_SEED, FIRST_SEED + arguments.episodes))
    policy, difference = export_run(run, arguments.policy, arguments.name)
    print(f"NumPy and torch agree within {difference:.1e} on the observations of real episodes")
    policy = replace(policy, score=RecordedScore.of(policy.score_on(scored), scored))
    write_bytes(path, policy.to_bytes())
    print(f"{table([policy])}\n{path}: {path.stat().st_size / 1000:.1f} kB, sha256 {policy.sha256}")
    return 0


def table(policies: Sequence[ShippedPolicy]) -> str:
    """The policies and their recorded scores, for a terminal."""
    head = ["policy", "algorithm", "steps", "hidden", "mean", "95 % below", "within 1 mm", "held", "episodes", "env"]
    rows = [head]
    for policy in policies:
        row = [policy.name, policy.algorithm, f"{policy.training['steps']}", "x".join(map(str, policy.network.hidden))]
        if policy.score:
            v = policy.score.values
            row += [f"{v['mean_mm']:.3f} mm", f"{v['p95_mm']:.3f} mm"]
            row += [f"{100 * v[share]:.1f} %" for share in ("within_1_mm", "held_1_mm")] + [str(policy.score.episodes)]
        rows.append([*row, *["-"] * (len(head) - 1 - len(row)), policy.env_id])
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)


def export_run(run: RunFolder, which: str, name: str) -> tuple[ShippedPolicy, float]:
    """One of the policies of a run folder, without a score, and the largest difference between NumPy and torch.

    Args:
        which: "best", "last" or the steps of a checkpoint.
    Raises:
        PolicyError: a policy of a kind that has no form in NumPy, or one for which NumPy and torch differ.
        RollingJointError: a run folder that cannot be read.
    """
    from agents.evaluation.policy import Policy

    config = run.config()
    try:
        trained = Policy.load(run, which)
    except RollingJointError:
        raise
    except Exception as error:  # whatever SB3, torch and pickle make of a damaged file
        path = run.policy_files(which)[0]
        raise PolicyError("policy", str(path), "a zip that Stable-Baselines3 can load", repr(error)) from error
    policy = export_policy(trained.model, trained.normaliser, config.env, name, _training(run, config, trained.model))
    return policy, check_against_torch(policy, trained.model, trained.normaliser)


def policy_in_run(path: Path) -> ShippedPolicy:
    """The policy in a zip of a run folder, which knows its normaliser and environment; this loads pickles."""
    path = path.resolve()
    for run in map(RunFolder, path.parents[:3]):
        for which in ("last", "best", path.parent.name):
            if run.policy_files(which)[0] == path and (run.path / "config.yaml").is_file():
                return export_run(run, which, run.path.name)[0]
    raise PolicyError("policy", str(path), "a policy in its run folder", "The zip alone does not say what it is for.")


def export_policy(
    model: BaseAlgorithm, normaliser: Any, environment: EnvConfig, name: str, training: Mapping[str, Any]
) -> ShippedPolicy:
    """The policy of a Stable-Baselines3 model, without a score.

    Args:
        model: PPO, SAC, TQC or CrossQ with MlpPolicy or MultiInputPolicy.
        normaliser: the VecNormalize that it was trained with, or None.
        environment: what it was trained for.
        training: plain values: `config`, `steps`, `seed`, `versions`.
    Raises:
        PolicyError: a kind of policy that has no form in NumPy, or another environment than rj_gym's.
    """
    if environment.id not in IDS:
        raise PolicyError("environment", environment.id, f"one of {', '.join(IDS)}")
    settings = standalone(environment.arguments()["config"])
    return ShippedPolicy(
        name=name,
        algorithm=algorithm_of(model),
        network=network_of(model, normaliser),
        env_id=environment.id,
        settings=settings,
        entries=entry_names(settings, is_goal(environment.id)),
        training=dict(training),
    )


def check_against_torch(policy: ShippedPolicy, model: BaseAlgorithm, normaliser: Any, lanes: int = 16) -> float:
    """The largest difference between the actions of policy and model on every observation of `lanes` real episodes.

    Raises PolicyError if it exceeds LARGEST_DIFFERENCE.
    """
    import gymnasium

    envs = gymnasium.make_vec(policy.env_id, lanes, "vector_entry_point", config=policy.settings)
    observation, _ = envs.reset(seed=FIRST_SEED)
    largest = 0.0
    for _ in range(policy.settings.episode_steps):
        seen = normaliser.normalize_obs(observation) if normaliser else observation
        expected, _ = model.predict(seen, deterministic=True)
        action = policy(observation)
        largest = max(largest, float(np.abs(action - expected).max()))
        observation = envs.step(action)[0]
    envs.close()
    if largest > LARGEST_DIFFERENCE:
        raise PolicyError("NumPy minus torch", largest, f"at most {LARGEST_DIFFERENCE:g} in every action")
    return largest


def _training(run: RunFolder, config: TrainConfig, model: BaseAlgorithm) -> dict[str, Any]:
    """What a policy file says about training; the settings of the environment stand elsewhere in it."""
    plain = config.to_dict()
    del plain["env"]["settings"]
    path = run.path / "versions.json"
    try:
        packages = {name: version for name, version in json.loads(path.read_text()).items() if name not in MACHINE}
    except (OSError, ValueError, AttributeError) as error:
        raise PolicyError("versions", str(path), "the versions that training used, as JSON", str(error)) from error
    return {"config": plain, "steps": model.num_timesteps, "seed": config.seed, "versions": packages}


def _check_unseen(config: TrainConfig, scored: range) -> None:
    """Raise ConfigError if training has used one of these seeds."""
    for name, used in seeds(config).items():
        first, last = used if isinstance(used, list) else (used, used)
        if first <= scored[-1] and scored[0] <= last:
            raise ConfigError("seed", f"{name}: {used}", f"seeds below {scored[0]} or above {scored[-1]} in training")


if __name__ == "__main__":
    sys.exit(main())
