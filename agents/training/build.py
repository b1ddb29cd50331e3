"""The environments and the Stable-Baselines3 model of a configuration."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import gymnasium
import torch
from stable_baselines3 import HerReplayBuffer
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnv, VecFrameStack, VecMonitor, VecNormalize

from agents.controllers.among_walls import TEACHERS
from agents.controllers.residual import base_controller, output_size
from agents.controllers.tuned import world_of
from agents.policies.parameters import network_arguments, policy_name
from agents.runs.additions import Addition, are_scalar, of_other_lanes
from agents.runs.algorithms import OWN, algorithm_class, constructor_arguments
from agents.runs.checks import prefixed
from agents.runs.config import GAIN, TrainConfig
from agents.runs.environment import EnvConfig, make_env, make_lanes, tip_errors
from agents.training.asymmetric import AsymmetricPolicy, AsymmetricRecurrentPolicy
from agents.training.convolution import PastConvolution, past_places
from agents.training.gain import GainPolicy, GainSACPolicy, keep_zero
from agents.training.residual import ResidualVecEnv
from rj_gym import SURROUNDINGS_IDS
from rj_gym.core.task import ObservedError
from rj_gym.registry import task_of
from rollingjoint.checks import as_choice
from rollingjoint.errors import ConfigError


def make_training_env(config: EnvConfig, wrappers: Sequence[Addition] = ()) -> VecEnv:
    """The lanes that training steps together: a native vector environment, else scalar ones in turn; in wrappers."""
    if are_scalar(wrappers) or not config.is_native:
        _check_reports_error(config, of_other_lanes(wrappers))
    return VecMonitor(make_lanes(config, config.n_envs, wrappers), info_keywords=("error_mm",))


def _on_top_of(envs: VecEnv, controller: str, config: EnvConfig) -> VecEnv:
    """The lanes with the outputs of a controller; raises ConfigError for one that cannot act there."""
    try:
        return ResidualVecEnv(
            envs, partial(base_controller, controller, world_of(config)), output_size(controller, config)
        )
    except ConfigError:
        envs.close()
        raise


def _check_reports_error(config: EnvConfig, wrappers: Sequence[Addition]) -> None:
    """Raise ConfigError, before training begins, for an environment without info["error_mm"]."""
    env = make_env(config, wrappers)
    try:
        tip_errors(env.reset()[1])
    finally:
        env.close()


def build_model(config: TrainConfig) -> BaseAlgorithm:
    """A fresh model on fresh, seeded environments, normalised as the configuration says.

    Raises ConfigError if Stable-Baselines3 refuses the configuration.
    """
    torch.set_num_threads(config.torch_threads)
    error = _observed_error(config)
    env = make_training_env(config.training_env, config.wrappers)
    if config.residual is not None:
        env = _on_top_of(env, config.residual, config.env)
    if config.policy.frames > 1:
        env = VecFrameStack(env, config.policy.frames)
    if config.normalise.observation or config.normalise.reward:
        gamma = config.parameters.get("gamma", 0.99)
        env = VecNormalize(env, norm_obs=config.normalise.observation, norm_reward=config.normalise.reward, gamma=gamma)
        if error is not None and env.norm_obs:
            keep_zero(env, error)
    arguments = constructor_arguments(config.parameters) | _hindsight_arguments(config)
    try:
        arguments |= _teacher_argument(config, env)
        _check_observation(config, env.observation_space)
        return algorithm_class(config.algorithm)(
            _policy_class(config, env.observation_space),
            env,
            seed=config.seed,
            device="cpu",
            policy_kwargs=_policy_arguments(config) | ({} if error is None else {"error": error}),
            **arguments,
        )
    except ConfigError:
        env.close()
        raise
    except MemoryError as error:
        env.close()
        hint = "Fewer n_steps or n_envs, or a smaller buffer_size, take less."
        raise ConfigError("parameters", dict(config.parameters), "what fits into memory", hint) from error
    except (ValueError, TypeError, AssertionError) as error:
        env.close()
        raise ConfigError("parameters", dict(config.parameters), "what the algorithm accepts", str(error)) from error


def close(model: BaseAlgorithm) -> None:
    """Close the model's environments."""
    env = model.get_env()
    if env is not None:
        env.close()


def _observed_error(config: TrainConfig) -> ObservedError | None:
    """Where observations have the tip error, for policies whose actions vanish with it; None for others.

    Raises ConfigError if they do not have it.
    """
    if config.policy.form != GAIN:
        return None
    with prefixed("policy.form = 'gain': "):
        return task_of(config.env.arguments()["config"]).observed_error(config.env.has_goals)


def _policy_class(config: TrainConfig, space: gymnasium.Space[Any]) -> Any:
    """The class of the networks, or the name that the algorithm has for it."""
    if config.algorithm in OWN and config.policy.memory is None:
        return "FeedForwardPolicy"
    if config.policy.form == GAIN and config.algorithm not in OWN:
        return GainPolicy if config.algorithm == "ppo" else GainSACPolicy
    if config.policy.critic_is_privileged:
        return AsymmetricRecurrentPolicy if config.algorithm == "recurrent_ppo" else AsymmetricPolicy
    return policy_name(config, space)


def _policy_arguments(config: TrainConfig) -> dict[str, Any]:
    if config.algorithm in OWN and config.policy.memory is not None:
        return {"width": config.policy.memory}
    arguments = network_arguments(config)
    if config.algorithm in OWN:
        return {"layers": config.policy.hidden, "activation": arguments["activation_fn"]}
    if config.policy.convolution is not None:
        past = past_places(task_of(config.env.arguments()["config"]).entries())
        arguments["features_extractor_class"] = PastConvolution
        arguments["features_extractor_kwargs"] = {
            "past": past,
            "width": config.policy.convolution,
            "activation": arguments["activation_fn"],
        }
    return arguments


def _hindsight_arguments(config: TrainConfig) -> dict[str, Any]:
    if config.her is None:
        return {}
    goals = {"n_sampled_goal": config.her.goals, "goal_selection_strategy": config.her.strategy}
    return {"replay_buffer_class": HerReplayBuffer, "replay_buffer_kwargs": goals}


def _teacher_argument(config: TrainConfig, env: VecEnv) -> dict[str, Any]:
    """The controller that a distillation imitates, where it names one; raises ConfigError if that cannot act there."""
    name, key = config.parameters.get("teacher"), "parameters.teacher"
    if name is None:
        return {}
    if config.env.id in SURROUNDINGS_IDS:
        teachers = TEACHERS[SURROUNDINGS_IDS[config.env.id]]
        return {"teacher": teachers[as_choice(key, name, tuple(teachers), ConfigError)]()}
    output_size(name, config.env, key)
    teacher = base_controller(name, world_of(config.env), key)
    teacher.bind(env.get_attr("task", [0])[0])
    return {"teacher": teacher}


def _check_observation(config: TrainConfig, space: gymnasium.Space[Any]) -> None:
    """Raise ConfigError for an algorithm that cannot work with this kind of observation."""
    parts = set(space.spaces) if isinstance(space, gymnasium.spaces.Dict) else set()
    if config.her is not None and not {"achieved_goal", "desired_goal"} <= parts:
        allowed = "an environment with goals, such as rj_gym/RollingJointGoal-v0"
        raise ConfigError("env.id", config.env.id, allowed, "Hindsight (her) relabels goals.")
    if config.algorithm == "crossq" and parts:
        hint = "sb3-contrib has no CrossQ policy for observations in parts: sac and tqc have one."
        raise ConfigError("env.id", config.env.id, "an environment whose observation is one vector", hint)
