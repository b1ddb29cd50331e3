"""Export: the policy of a run folder as a shipped policy."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from agents.controllers.policy import model_input
from agents.policies.base import PolicyNetwork
from agents.policies.conversion import algorithm_of, network_of
from agents.policies.errors import PolicyError
from agents.policies.pickled import load_pickled
from agents.policies.shipped import ShippedPolicy, check_has_policies, entry_names, is_goal, standalone
from agents.policies.trained import check_unwrapped, read_trained
from agents.runs.checked_json import read_json
from agents.runs.config import TrainConfig
from agents.runs.environment import EnvConfig
from agents.runs.folder import PolicyFiles, RunFolder
from rj_gym.registry import making_arguments
from rollingjoint.errors import ConfigError

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

FIRST_SEED = 20_000
LARGEST_DIFFERENCE = 1e-5
MACHINE = ("platform", "processor", "cores", "imported")  # keys of versions.json that are no packages


def export_run(run: RunFolder, which: str, name: str) -> ShippedPolicy:
    """One of the policies of a run folder, without a score.

    A policy that was saved by Stable-Baselines3 alone is unpickled, where that is allowed, and compared with its
    actions in torch.

    Args:
        which: "best", "last" or the steps of a checkpoint.
    Raises:
        PolicyError: a policy of a kind that has no form in NumPy, or one for which NumPy and torch differ.
        RunFolderError: a run folder that cannot be read.
    """
    files = run.saved_policy(which)
    return _exported(run, files, name, unpickle=not files.network.is_file())


def policy_in_run(path: Path) -> ShippedPolicy:
    """The policy in this file of a run folder, which knows its environment; a zip is unpickled where that is allowed.

    Raises:
        PolicyError, RunFolderError: as export_run; or a file that is not in a run folder.
    """
    path = path.resolve()
    for run in map(RunFolder, path.parents[:3]):
        for which in ("last", "best", path.parent.name):
            if path in run.policy_files(which) and (run.path / "config.yaml").is_file():
                return _exported(run, run.saved_policy(which), run.path.name, unpickle=path.suffix == ".zip")
    raise PolicyError("policy", str(path), "a policy in its run folder", "The file alone does not say what it is for.")


def _exported(run: RunFolder, files: PolicyFiles, name: str, unpickle: bool) -> ShippedPolicy:
    config = run.config()
    if config.residual is not None:
        allowed, hint = "null: a policy that acts alone", "rj evaluate scores the run folder with its controller."
        raise PolicyError("residual", config.residual, allowed, hint)
    check_unwrapped(config)
    if not unpickle:
        trained = read_trained(files)
        training = _training(run, config, trained.steps)
        return shipped_policy(trained.network, trained.algorithm, config.env, name, training)
    old = load_pickled(config, files)
    training = _training(run, config, old.model.num_timesteps)
    policy = export_policy(old.model, old.normaliser, config.env, name, training)
    check_against_torch(policy, old.model, old.normaliser)
    return policy


def export_policy(
    model: BaseAlgorithm, normaliser: Any, environment: EnvConfig, name: str, training: Mapping[str, Any]
) -> ShippedPolicy:
    """The policy of a Stable-Baselines3 model, without a score.

    Args:
        model: as for network_of.
        normaliser: the VecNormalize that it was trained with, or None.
        environment: of its training.
        training: plain values: `config`, `steps`, `seed`, `versions`.
    Raises:
        PolicyError: a kind of policy that has no form in NumPy, or another environment than rj_gym's.
    """
    return shipped_policy(network_of(model, normaliser), algorithm_of(model), environment, name, training)


def shipped_policy(
    network: PolicyNetwork, algorithm: str, environment: EnvConfig, name: str, training: Mapping[str, Any]
) -> ShippedPolicy:
    """The policy with this forward pass, without a score; raises PolicyError for a foreign environment."""
    check_has_policies(environment.id)
    settings = standalone(environment.arguments()["config"])
    return ShippedPolicy(
        name=name,
        algorithm=algorithm,
        network=network,
        env_id=environment.id,
        settings=settings,
        entries=entry_names(settings, is_goal(environment.id)),
        training=dict(training),
    )


def check_against_torch(policy: ShippedPolicy, model: BaseAlgorithm, normaliser: Any, episodes: int = 16) -> float:
    """The largest difference between the actions of policy and model on every observation of `episodes` real episodes.

    Raises PolicyError if it exceeds LARGEST_DIFFERENCE.
    """
    envs = gymnasium.make_vec(
        policy.env_id, episodes, "vector_entry_point", **making_arguments(policy.env_id, policy.settings)
    )
    observation, _ = envs.reset(seed=FIRST_SEED)
    policy.reset(episodes)
    state: Any = None
    largest = 0.0
    for _ in range(policy.settings.episode_steps):
        inputs = model_input(model, normaliser, observation)
        expected, state = model.predict(inputs, state, deterministic=True)
        action = policy(observation)
        largest = max(largest, float(np.abs(action - expected).max()))
        observation = envs.step(action)[0]
    envs.close()
    policy.reset()
    if largest > LARGEST_DIFFERENCE:
        raise PolicyError("NumPy minus torch", largest, f"at most {LARGEST_DIFFERENCE:g} in every action")
    return largest


def _training(run: RunFolder, config: TrainConfig, steps: int) -> dict[str, Any]:
    """The training in a policy file, without the settings of the environment, which are elsewhere in the file."""
    plain = config.to_dict()
    del plain["env"]["settings"]
    path = run.path / "versions.json"
    try:
        packages = {name: version for name, version in read_json(path).items() if name not in MACHINE}
    except (ConfigError, AttributeError) as error:
        raise PolicyError("versions", str(path), "the versions that training used, as JSON", str(error)) from error
    return {"config": plain, "steps": steps, "seed": config.seed, "versions": packages}
