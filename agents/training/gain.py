"""Policies of Stable-Baselines3 whose actions vanish with the tip error, and statistics that keep its zero.

Their mean actions are those of agents.learners.gain.GainHead.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.torch_layers import MlpExtractor
from stable_baselines3.common.type_aliases import PyTorchObs, Schedule
from stable_baselines3.sac.policies import LOG_STD_MAX, LOG_STD_MIN, Actor, SACPolicy
from torch import nn

from agents.learners.gain import GainHead
from rj_gym.core.task import ObservedError


class HiddenAndError(nn.Module):
    """Hidden layers of policy and value function, those of the policy with the error's entries behind them.

    Args:
        layers: of both. error: where the observation has the tip error.
    """

    def __init__(self, layers: MlpExtractor, error: ObservedError) -> None:
        super().__init__()
        self.policy_net, self.value_net, self.places = layers.policy_net, layers.value_net, list(error.places)
        self.latent_dim_pi, self.latent_dim_vf = layers.latent_dim_pi + len(error.places), layers.latent_dim_vf

    def forward(self, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The input of the policy's head, and the last hidden layer of the value function."""
        return self.forward_actor(features), self.forward_critic(features)

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        """The input of a GainHead, (B, latent_dim_pi)."""
        return torch.cat([self.policy_net(features), features[:, self.places]], 1)

    def forward_critic(self, features: torch.Tensor) -> torch.Tensor:
        """The last hidden layer of the value function, (B, latent_dim_vf)."""
        hidden: torch.Tensor = self.value_net(features)
        return hidden


class GainPolicy(ActorCriticPolicy):
    """Networks of PPO whose mean actions vanish with the tip error.

    Args:
        space, actions, rate: the spaces and the learning rate's schedule, as for ActorCriticPolicy.
        error: where the observation has the tip error.
        arguments: of ActorCriticPolicy.
    """

    def __init__(self, space: Any, actions: Any, rate: Schedule, error: ObservedError, **arguments: Any) -> None:
        self.error = error
        super().__init__(space, actions, rate, **arguments)

    def _build_mlp_extractor(self) -> None:
        super()._build_mlp_extractor()
        self.mlp_extractor = HiddenAndError(self.mlp_extractor, self.error)

    def _build(self, lr_schedule: Schedule) -> None:
        super()._build(lr_schedule)
        width = self.mlp_extractor.latent_dim_pi - len(self.error.places)
        self.action_net = GainHead(width, spaces.flatdim(self.action_space), self.error)
        self.optimizer = self.optimizer_class(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)


class GainActor(Actor):
    """The actor of SAC whose mean actions, before tanh, vanish with the tip error.

    Args:
        error: where the observation has the tip error. arguments: of Actor.
    """

    def __init__(self, *, error: ObservedError, **arguments: Any) -> None:
        super().__init__(**arguments)
        self.mu: nn.Module = GainHead(arguments["net_arch"][-1], spaces.flatdim(self.action_space), error)

    def get_action_dist_params(self, obs: PyTorchObs) -> tuple[torch.Tensor, torch.Tensor, dict[str, torch.Tensor]]:
        """Mean and logarithm of the standard deviation of actions before tanh, (B, m) each, and no other arguments."""
        features = self.extract_features(obs, self.features_extractor)
        hidden = self.latent_pi(features)
        deviation = self.log_std(hidden).clamp(LOG_STD_MIN, LOG_STD_MAX)
        return self.mu(self.mu.seen(hidden, features)), deviation, {}


class GainSACPolicy(SACPolicy):
    """Networks of SAC with a GainActor.

    Args:
        space, actions, rate: as for SACPolicy. error: where the observation has the tip error.
        arguments: of SACPolicy.
    """

    def __init__(self, space: Any, actions: Any, rate: Schedule, error: ObservedError, **arguments: Any) -> None:
        self.error = error
        super().__init__(space, actions, rate, **arguments)

    def make_actor(self, features_extractor: Any = None) -> GainActor:
        """A new actor."""
        arguments = self._update_features_extractor(self.actor_kwargs, features_extractor)
        return GainActor(error=self.error, **arguments).to(self.device)


class KeptZeros(RunningMeanStd):
    """Running statistics of observations in which some entries keep their zero and their unit.

    Args:
        shape: of an observation. places: of these entries.
    """

    def __init__(self, shape: tuple[int, ...], places: tuple[int, ...]) -> None:
        super().__init__(shape=shape)
        self.places = list(places)

    def update_from_moments(self, batch_mean: Any, batch_var: NDArray[np.float64], batch_count: float) -> None:
        """Learn from a batch, (entries,) each and its size; the places stay at mean 0 and variance 1."""
        super().update_from_moments(batch_mean, batch_var, batch_count)
        self.mean[self.places], self.var[self.places] = 0.0, 1.0


def keep_zero(normaliser: Any, error: ObservedError) -> None:
    """Have a fresh VecNormalize leave the entries of the tip error as they are."""
    normaliser.obs_rms = KeptZeros(normaliser.obs_rms.mean.shape, error.places)
