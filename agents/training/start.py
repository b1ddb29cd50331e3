"""A fresh model, or one that starts as the policy of another run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm

from agents.policies.conversion import actor_arrays
from agents.policies.errors import PolicyError
from agents.policies.trained import TrainedPolicy, read_trained
from agents.runs.algorithms import OWN
from agents.runs.config import TrainConfig
from agents.runs.folder import RunFolder
from agents.training.build import build_model, close
from rollingjoint.errors import ConfigError, RollingJointError


def fresh_model(config: TrainConfig) -> BaseAlgorithm:
    """The model with which a run begins: build_model's, with the best policy of `config.start_from`.

    Raises:
        ConfigError: a policy that does not fit, or a configuration that Stable-Baselines3 refuses.
        RunFolderError: no run there, or one with a policy that cannot be read without unpickling.
        PolicyError: a policy.safetensors that cannot be read.
    """
    earlier = earlier_policy(config)
    model = build_model(config)
    if earlier is not None:
        try:
            _start(model, earlier, config)
        except RollingJointError:
            close(model)
            raise
    return model


def earlier_policy(config: TrainConfig) -> TrainedPolicy | None:
    """The best policy of `config.start_from`, if that names a run; raises as fresh_model."""
    if config.start_from is None:
        return None
    return read_trained(RunFolder.open(Path(config.start_from)).network_to_start_from())


def _start(model: Any, earlier: TrainedPolicy, config: TrainConfig) -> None:
    """Give the model the actor of an earlier policy, and that policy's statistics of observations."""
    normaliser = model.get_vec_normalize_env()
    normalises = normaliser is not None and normaliser.norm_obs
    arrays = _arrays_for(model, earlier)
    if arrays is None or normalises != (earlier.observations > 0):
        entries, width = model.observation_space.shape[0], config.policy.memory
        allowed = f"a run of {' or '.join(OWN)} with {entries} entries in the observation and policy.memory: {width}"
        hint = "Observation, actions, layers, form and normalise.observation must be those of that run."
        raise ConfigError("start_from", config.start_from, allowed, hint)
    model.policy.actor.load_state_dict({name: torch.as_tensor(array) for name, array in arrays.items()})
    if normalises:
        normaliser.obs_rms.mean, normaliser.obs_rms.count = earlier.network.mean.copy(), earlier.observations
        normaliser.obs_rms.var = np.maximum(earlier.network.scale**2 - normaliser.epsilon, 0.0)


def _arrays_for(model: Any, earlier: TrainedPolicy) -> dict[str, Any] | None:
    """The parameters of the model's actor that make it the earlier one; None if none do."""
    try:
        arrays = actor_arrays(earlier.network)
    except PolicyError:
        return None
    shapes = {name: tuple(value.shape) for name, value in model.policy.actor.state_dict().items()}
    return arrays if {name: array.shape for name, array in arrays.items()} == shapes else None
