"""Policies that have no form in NumPy: their parameters in a file, and their networks, built from the configuration."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium

from agents.controllers.policy import Policy
from agents.runs.algorithms import ON_POLICY, algorithm_class
from agents.runs.config import TrainConfig
from agents.runs.environment import make_lanes
from agents.runs.files import RunFolderError
from agents.runs.state_file import packed, unpacked

_AVERAGES = ("mean", "var", "count")


def parameters_of(model: Any, normaliser: Any) -> bytes:
    """The file policy.parameters.safetensors of a model with this VecNormalize of its observations, or None."""
    return packed({"parameters": model.policy.state_dict(), "averages": running_averages(normaliser)})


def load_parameters(config: TrainConfig, path: Path) -> Policy:
    """The policy of a run with this configuration; raises RunFolderError for a file that it does not fit."""
    import torch
    from stable_baselines3.common.vec_env import VecNormalize

    torch.set_num_threads(config.torch_threads)
    env = make_lanes(config.env, 1, config.policy_wrappers)
    space: Any = env.observation_space
    try:
        state = unpacked(path.read_bytes(), str(path))
        kind = algorithm_class(config.algorithm).policy_aliases[policy_name(config, space)]
        rough = bool(config.parameters.get("use_sde", False))
        policy: Any = kind(space, env.action_space, lambda _: 0.0, use_sde=rough, **network_arguments(config))
        policy.load_state_dict(state["parameters"])
        normaliser = VecNormalize(env, training=False, norm_obs=config.normalise.observation)
        set_running_averages(normaliser, state["averages"])
        return Policy(policy, normaliser if config.normalise.observation else None)
    except (ValueError, LookupError, TypeError, RuntimeError) as error:
        allowed = f"parameters of the policy that {path.parent} describes"
        raise RunFolderError("policy", str(path), allowed, f"{type(error).__name__}: {error}") from error
    finally:
        env.close()


def policy_name(config: TrainConfig, space: gymnasium.Space[Any]) -> str:
    """The name that Stable-Baselines3 has for the networks of a configuration, of observations in this space."""
    kind = "MultiInput" if isinstance(space, gymnasium.spaces.Dict) else "Mlp"
    return f"{kind}{'Lstm' if config.algorithm == 'recurrent_ppo' else ''}Policy"


def network_arguments(config: TrainConfig) -> dict[str, Any]:
    """Arguments of Stable-Baselines3's policies: layers, activation, spread of the first actions, memory."""
    import torch

    activation = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU, "elu": torch.nn.ELU}[config.policy.activation]
    layers: Any = list(config.policy.hidden)
    if config.policy.value_hidden is not None:
        value = "vf" if config.algorithm in ON_POLICY else "qf"
        layers = {"pi": layers, value: list(config.policy.value_hidden)}
    arguments: dict[str, Any] = {"net_arch": layers, "activation_fn": activation}
    if config.algorithm in ON_POLICY:
        arguments["log_std_init"] = config.policy.log_std_init
    if config.algorithm == "recurrent_ppo":
        arguments["lstm_hidden_size"] = config.policy.memory
    return arguments


def running_averages(normaliser: Any) -> list[dict[str, Any]]:
    """The averages that a VecNormalize keeps: of observations, or of their parts by name, and of returns."""
    return [{name: getattr(average, name) for name in _AVERAGES} for average in _running(normaliser)]


def set_running_averages(normaliser: Any, averages: list[dict[str, Any]]) -> None:
    """Give a VecNormalize the averages of another one; raises ValueError for averages of other observations."""
    import numpy as np

    for running, stored in zip(_running(normaliser), averages, strict=True):
        for name in _AVERAGES:
            if np.shape(stored[name]) != np.shape(getattr(running, name)):
                raise ValueError(f"{name} of shape {np.shape(stored[name])}")
            setattr(running, name, stored[name])


def _running(normaliser: Any) -> list[Any]:
    if normaliser is None:
        return []
    averages = getattr(normaliser, "obs_rms", None) or {}
    parts = [averages[key] for key in sorted(averages)] if isinstance(averages, dict) else [averages]
    return [*parts, normaliser.ret_rms]
