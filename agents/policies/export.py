"""Export: the policy of a run folder as a shipped policy, checked against torch."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from agents.evaluation.policy import Policy
from agents.policies.conversion import algorithm_of, network_of
from agents.policies.network import PolicyError
from agents.policies.shipped import ShippedPolicy, entry_names, is_goal, standalone
from agents.runs.config import TrainConfig
from agents.runs.environment import EnvConfig
from agents.runs.folder import RunFolder
from rj_gym import IDS

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

FIRST_SEED = 20_000
LARGEST_DIFFERENCE = 1e-5
MACHINE = ("platform", "processor", "cores")  # keys of versions.json that users of the policy do not need


def export_run(run: RunFolder, which: str, name: str) -> tuple[ShippedPolicy, float]:
    """One of the policies of a run folder, without a score, and the largest difference between NumPy and torch.

    Args:
        which: "best", "last" or the steps of a checkpoint.
    Raises:
        PolicyError: a policy of a kind that has no form in NumPy, or one for which NumPy and torch differ.
        RunFolderError: a run folder that cannot be read.
    """
    config, trained = run.config(), Policy.load(run, which)
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


def check_against_torch(policy: ShippedPolicy, model: BaseAlgorithm, normaliser: Any, episodes: int = 16) -> float:
    """The largest difference between the actions of policy and model on every observation of `episodes` real episodes.

    Raises PolicyError if it exceeds LARGEST_DIFFERENCE.
    """
    envs = gymnasium.make_vec(policy.env_id, episodes, "vector_entry_point", config=policy.settings)
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
