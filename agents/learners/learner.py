"""A learner that plays whole episodes of all lanes: its loop, its normaliser, its log."""

from __future__ import annotations

import time
from abc import abstractmethod
from typing import Any, ClassVar, Protocol

import numpy as np
import torch
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.type_aliases import GymEnv, MaybeCallback, Schedule
from stable_baselines3.common.utils import safe_mean
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from agents.learners.episodes import ResidualBase
from agents.learners.policy import EpisodePolicy, FeedForwardPolicy, RecurrentPolicy
from rj_gym.core.vector import TaskVectorEnv
from rj_gym.surroundings.task import SurroundingsTask
from rj_gym.tracking.task import TrackingTask
from rollingjoint.errors import ConfigError


class EpisodePlayer(Protocol):
    """A player of the episodes of a rollout."""

    def play(self, actor: Any, watch: Any) -> Any:
        """New episodes to their end, as a learner learns from them; None where `watch` has ended training."""


class EpisodeLearner(BaseAlgorithm):
    """Training of a policy, usually with memory, one rollout of whole episodes at a time.

    Args:
        policy: "MlpPolicy" (RecurrentPolicy), "FeedForwardPolicy", or one of these classes.
        env: a native vector environment of rj_gym, in the wrappers of SB3.
        learning_rate: of the optimiser, or a schedule.
        max_grad_norm: largest norm of the whole gradient; a longer one is scaled down.
        optimizer: "adam" or "muon".
    """

    policy_aliases: ClassVar[dict[str, Any]] = {
        "MlpPolicy": RecurrentPolicy,
        "MultiInputPolicy": RecurrentPolicy,
        "FeedForwardPolicy": FeedForwardPolicy,
    }
    policy: EpisodePolicy

    def __init__(
        self,
        policy: str | type[EpisodePolicy],
        env: GymEnv | str | None,
        learning_rate: float | Schedule,
        max_grad_norm: float,
        stats_window_size: int = 100,
        optimizer: str = "adam",
        policy_kwargs: dict[str, Any] | None = None,
        tensorboard_log: str | None = None,
        verbose: int = 0,
        seed: int | None = None,
        device: torch.device | str = "cpu",
        _init_setup_model: bool = True,
    ) -> None:
        super().__init__(
            policy, env, learning_rate, policy_kwargs, stats_window_size, tensorboard_log, verbose, device,
            seed=seed, supported_action_spaces=(spaces.Box,), support_multi_env=True,
        )  # fmt: skip
        self.max_grad_norm, self.optimizer, self.n_updates = max_grad_norm, optimizer, 0
        if _init_setup_model:
            self._setup_model()

    def _setup_model(self) -> None:
        self._setup_lr_schedule()
        self.policy_kwargs["optimizer"] = self.optimizer
        if self.env is not None:
            task = native_env(self.env, among_walls=True).task
            self.policy_kwargs["hidden"] = 2 * task.dimension + 3 * task.action_size
        self.set_random_seed(self.seed)
        self.policy = self.policy_class(
            self.observation_space, self.action_space, self.lr_schedule, **self.policy_kwargs
        )

    def learn(
        self,
        total_timesteps: int,
        callback: MaybeCallback = None,
        log_interval: int = 1,
        tb_log_name: str = "run",
        reset_num_timesteps: bool = True,
        progress_bar: bool = False,
    ) -> EpisodeLearner:
        """Train for `total_timesteps` steps of the environment, whole episodes of all lanes at a time."""
        total_timesteps, watcher = self._setup_learn(
            total_timesteps, callback, reset_num_timesteps, tb_log_name, progress_bar
        )
        episodes = self._episodes()
        watcher.on_training_start(locals(), globals())
        rollouts = 0
        while self.num_timesteps < total_timesteps:
            watcher.on_rollout_start()
            played = episodes.play(self.policy, lambda step: self._watch(watcher, step))
            if played is None:
                break
            watcher.on_rollout_end()
            self._update_current_progress_remaining(self.num_timesteps, total_timesteps)
            self._update(played)
            rollouts += 1
            if rollouts % log_interval == 0:
                self._log(rollouts)
        watcher.on_training_end()
        return self

    @abstractmethod
    def _episodes(self) -> EpisodePlayer:
        """The player of the episodes of a rollout."""

    @abstractmethod
    def _update(self, played: Any) -> None:
        """Learn from the episodes that these have played."""

    def _watch(self, watcher: BaseCallback, step: tuple[Any, NDArray[Any], NDArray[np.bool_]]) -> bool:
        """Count a step and tell the callbacks; whether to go on."""
        info, rewards, ended = step
        self.num_timesteps += len(rewards)
        finished = np.flatnonzero(ended)
        if self.ep_info_buffer is not None:
            self.ep_info_buffer.extend({"error_mm": float(info["error_mm"][lane])} for lane in finished)
        watcher.update_locals({"rewards": rewards, "dones": ended, "infos": info})
        return bool(watcher.on_step())

    def _normalise(self, observation: NDArray[np.float32]) -> tuple[NDArray[Any], NDArray[Any]]:
        """Mean and scale of observations; the running ones learn from these."""
        normaliser: Any = self._vec_normalize_env
        if normaliser is not None and normaliser.norm_obs:
            normaliser.obs_rms.update(observation)
        return self._statistics(observation.shape[1])

    def _statistics(self, entries: int) -> tuple[NDArray[Any], NDArray[Any]]:
        """Mean and scale of observations as they are now."""
        normaliser: Any = self._vec_normalize_env
        if normaliser is None or not normaliser.norm_obs:
            return np.zeros(entries), np.ones(entries)
        running = normaliser.obs_rms
        return running.mean.copy(), np.sqrt(running.var + normaliser.epsilon)

    def _descend(self, loss: torch.Tensor) -> float:
        """One step of the optimiser; the norm of the gradient before it is scaled down."""
        self.policy.optimizer.zero_grad()
        loss.backward()
        norm = torch.nn.utils.clip_grad_norm_(self.policy.parameters(), self.max_grad_norm)
        if bool(torch.isfinite(norm)):
            self.policy.optimizer.step()
        self.n_updates += 1
        return float(norm)

    def _log(self, rollouts: int) -> None:
        self.logger.record("time/iterations", rollouts)
        self.logger.record("time/time_elapsed", (time.time_ns() - self.start_time) / 1e9)
        self.logger.record("time/total_timesteps", self.num_timesteps)
        if self.ep_info_buffer:
            self.logger.record("rollout/error_mm", safe_mean([episode["error_mm"] for episode in self.ep_info_buffer]))
        self.logger.dump(step=self.num_timesteps)

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        return ["policy", "policy.optimizer"], []


def base_of(env: VecEnv | None) -> ResidualBase | None:
    """A new base controller of a residual policy, where a wrapper of the environment makes one: its `new_base`."""
    while isinstance(env, VecEnvWrapper):
        if hasattr(type(env), "new_base"):
            base: ResidualBase = env.new_base()
            return base
        env = env.venv
    return None


def native_env(env: VecEnv | None, among_walls: bool = False) -> TaskVectorEnv:
    """The native vector environment in the wrappers of SB3, its autoreset disabled: whole episodes are played.

    Args:
        among_walls: whether tasks among walls will do, too.
    Raises:
        ConfigError: another environment, or one that is not of a tracking task.
    """
    inner: Any = env
    while isinstance(inner, VecEnvWrapper):
        inner = inner.venv
    native = getattr(inner, "env", None)
    vectors = env is not None and isinstance(env.observation_space, spaces.Box)
    tasks = (TrackingTask, SurroundingsTask) if among_walls else (TrackingTask,)
    if not isinstance(native, TaskVectorEnv) or not isinstance(native.task, tasks) or not vectors:
        allowed = "a tracking environment of rj_gym whose observation is one vector"
        hint = "apg and distill play its episodes. Among walls distill has to be told its teacher."
        raise ConfigError("env", type(native or inner).__name__, allowed, hint)
    native.autoreset_mode = AutoresetMode.DISABLED
    return native
