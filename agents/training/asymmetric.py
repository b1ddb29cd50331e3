"""Policies with a critic that sees more than they do: the privileged state, which only a simulator knows.

Source: Pinto et al., Asymmetric Actor Critic for Image-Based Robot Learning, 2018.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import torch
from gymnasium import spaces
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, CombinedExtractor, MlpExtractor
from stable_baselines3.common.type_aliases import Schedule
from torch import nn

ACTOR = "observation"  # the part of the observation that the policy sees
_APART: dict[str, Any] = {
    "features_extractor_class": CombinedExtractor,
    "features_extractor_kwargs": {},
    "share_features_extractor": False,
}


class ActorsPart(BaseFeaturesExtractor):
    """The policy's view of an observation in parts: the vector under "observation"."""

    def __init__(self, space: spaces.Dict) -> None:
        super().__init__(space, spaces.flatdim(space[ACTOR]))

    def forward(self, observation: dict[str, torch.Tensor]) -> torch.Tensor:
        """The vector (B, entries)."""
        return observation[ACTOR]


class ValueApart(nn.Module):
    """Hidden layers of policy and value function, which see features of their own: an MlpExtractor of two sizes.

    Args:
        policy_entries, value_entries: number of features.
        arguments: of MlpExtractor.
    """

    def __init__(self, policy_entries: int, value_entries: int, **arguments: Any) -> None:
        super().__init__()
        of_policy, of_value = (MlpExtractor(entries, **arguments) for entries in (policy_entries, value_entries))
        self.policy_net, self.value_net = of_policy.policy_net, of_value.value_net
        self.latent_dim_pi, self.latent_dim_vf = of_policy.latent_dim_pi, of_value.latent_dim_vf

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        """The last hidden layer of the policy, (B, latent_dim_pi)."""
        hidden: torch.Tensor = self.policy_net(features)
        return hidden

    def forward_critic(self, features: torch.Tensor) -> torch.Tensor:
        """The last hidden layer of the value function, (B, latent_dim_vf)."""
        hidden: torch.Tensor = self.value_net(features)
        return hidden


class AsymmetricPolicy(ActorCriticPolicy):
    """Networks of PPO for a Dict observation, of which the policy sees "observation" and the value function all.

    Args:
        space, actions, rate: the spaces and the learning rate's schedule, as for ActorCriticPolicy.
        arguments: of ActorCriticPolicy; `features_extractor_class` is the policy's.
    """

    def __init__(self, space: spaces.Dict, actions: spaces.Box, rate: Schedule, **arguments: Any) -> None:
        kind, more = arguments.get("features_extractor_class", ActorsPart), arguments.get("features_extractor_kwargs")
        self.actors_part = partial(kind, space, **(more or {}))
        super().__init__(space, actions, rate, **(arguments | _APART))

    def _build_mlp_extractor(self) -> None:
        _see_apart(self, self.actors_part())
        self.mlp_extractor = ValueApart(
            self.features_dim,
            self.vf_features_extractor.features_dim,
            net_arch=self.net_arch,
            activation_fn=self.activation_fn,
            device=self.device,
        )


class AsymmetricRecurrentPolicy(RecurrentActorCriticPolicy):
    """The same for RecurrentPPO; only the policy has a memory, for the critic sees the state."""

    def __init__(self, space: spaces.Dict, actions: spaces.Box, rate: Schedule, **arguments: Any) -> None:
        super().__init__(space, actions, rate, **(arguments | _APART | {"enable_critic_lstm": False}))
        entries = self.vf_features_extractor.features_dim
        self.critic = nn.Linear(entries, self.lstm_output_dim)
        self.optimizer = self.optimizer_class(self.parameters(), **({"lr": rate(1)} | self.optimizer_kwargs))

    def _build_mlp_extractor(self) -> None:
        _see_apart(self, ActorsPart(self.observation_space))  # type: ignore[arg-type]
        super()._build_mlp_extractor()


def _see_apart(policy: ActorCriticPolicy, extractor: BaseFeaturesExtractor) -> None:
    """Let the policy see its own part alone, by this extractor; the value function keeps all."""
    policy.features_extractor = policy.pi_features_extractor = extractor
    policy.features_dim = extractor.features_dim
