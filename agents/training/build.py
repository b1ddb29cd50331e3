"""From a configuration to environments and a Stable-Baselines3 model; torch is loaded here, late."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium

from agents.evaluation.rollout import tip_error
from agents.runs.algorithms import constructor_arguments
from agents.runs.config import EnvConfig, TrainConfig
from rollingjoint.errors import ConfigError

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm
    from stable_baselines3.common.vec_env import VecEnv


def make_env(config: EnvConfig, **arguments: Any) -> gymnasium.Env:
    """One environment of the run; raises ConfigError if Gymnasium cannot make it."""
    if config.id.startswith("rj_gym/"):
        import rj_gym  # noqa: F401  (registers its ids)
    try:
        return gymnasium.make(config.id, **config.arguments(), **arguments)
    except (gymnasium.error.Error, TypeError) as error:
        raise ConfigError("env", config.id, "an environment that Gymnasium can make", str(error)) from error


def make_vec_env(config: EnvConfig) -> VecEnv:
    """The copies that training steps together: lanes of a native vector environment, else one after the other."""
    from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

    envs: VecEnv
    if config.id.startswith("rj_gym/"):
        from rj_gym.sb3 import make_sb3_env

        try:
            envs = make_sb3_env(config.id, config.n_envs, **config.arguments())
        except gymnasium.error.Error as error:
            raise ConfigError("env", config.id, "an environment that Gymnasium can make", str(error)) from error
    else:
        _check_reports_error(config)
        envs = DummyVecEnv([lambda: make_env(config) for _ in range(config.n_envs)])
    return VecMonitor(envs, info_keywords=("error_mm",))


def _check_reports_error(config: EnvConfig) -> None:
    """Raise ConfigError, before training begins, for an environment without info["error_mm"]."""
    env = make_env(config)
    try:
        tip_error(env.reset()[1])
    finally:
        env.close()


def build_model(config: TrainConfig) -> BaseAlgorithm:
    """A fresh model on fresh, seeded environments, normalised as the configuration says.

    Raises ConfigError if Stable-Baselines3 refuses the configuration.
    """
    import torch
    from gymnasium.spaces import Dict
    from stable_baselines3.common.vec_env import VecNormalize

    torch.set_num_threads(config.torch_threads)
    env = make_vec_env(config.env)
    if config.normalise.observation or config.normalise.reward:
        gamma = config.parameters.get("gamma", 0.99)
        env = VecNormalize(env, norm_obs=config.normalise.observation, norm_reward=config.normalise.reward, gamma=gamma)
    policy = "MultiInputPolicy" if isinstance(env.observation_space, Dict) else "MlpPolicy"
    arguments = constructor_arguments(config.parameters) | _hindsight_arguments(config)
    try:
        _check_observation(config, env.observation_space)
        return algorithm_class(config.algorithm)(
            policy, env, seed=config.seed, device="cpu", policy_kwargs=_policy_arguments(config), **arguments
        )
    except ConfigError:
        env.close()
        raise
    except (ValueError, TypeError, AssertionError) as error:
        env.close()
        raise ConfigError("parameters", dict(config.parameters), "what the algorithm accepts", str(error)) from error


def algorithm_class(name: str) -> type[BaseAlgorithm]:
    """The class of "ppo" or "sac" in Stable-Baselines3, of "tqc" or "crossq" in its contributions."""
    if name in ("tqc", "crossq"):
        import sb3_contrib

        contributed: dict[str, type[BaseAlgorithm]] = {"tqc": sb3_contrib.TQC, "crossq": sb3_contrib.CrossQ}
        return contributed[name]
    import stable_baselines3

    classes: dict[str, type[BaseAlgorithm]] = {"ppo": stable_baselines3.PPO, "sac": stable_baselines3.SAC}
    return classes[name]


def close(model: BaseAlgorithm) -> None:
    """Close the model's environments."""
    env = model.get_env()
    if env is not None:
        env.close()


def load_normaliser(path: Path) -> Any:
    """The VecNormalize saved at `path`, frozen, without environments; None if the run does not normalise."""
    if not path.is_file():
        return None
    with path.open("rb") as stream:
        normaliser = pickle.load(stream)
    normaliser.training = False
    return normaliser


def _policy_arguments(config: TrainConfig) -> dict[str, Any]:
    import torch

    activation = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU, "elu": torch.nn.ELU}[config.policy.activation]
    layers: Any = list(config.policy.hidden)
    if config.policy.value_hidden is not None:
        value = "vf" if config.algorithm == "ppo" else "qf"
        layers = {"pi": layers, value: list(config.policy.value_hidden)}
    arguments: dict[str, Any] = {"net_arch": layers, "activation_fn": activation}
    if config.algorithm == "ppo":
        arguments["log_std_init"] = config.policy.log_std_init
    return arguments


def _hindsight_arguments(config: TrainConfig) -> dict[str, Any]:
    if config.her is None:
        return {}
    from stable_baselines3 import HerReplayBuffer

    goals = {"n_sampled_goal": config.her.goals, "goal_selection_strategy": config.her.strategy}
    return {"replay_buffer_class": HerReplayBuffer, "replay_buffer_kwargs": goals}


def _check_observation(config: TrainConfig, space: gymnasium.Space[Any]) -> None:
    """Raise ConfigError for an algorithm that cannot work with this kind of observation."""
    parts = set(space.spaces) if isinstance(space, gymnasium.spaces.Dict) else set()
    if config.her is not None and not {"achieved_goal", "desired_goal"} <= parts:
        allowed = "an environment with goals, such as rj_gym/RollingJointGoal-v0"
        raise ConfigError("env.id", config.env.id, allowed, "Hindsight (her) relabels goals.")
    if config.algorithm == "crossq" and parts:
        hint = "sb3-contrib has no CrossQ policy for observations in parts: sac and tqc have one."
        raise ConfigError("env.id", config.env.id, "an environment whose observation is one vector", hint)
