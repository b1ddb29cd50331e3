"""Policies of our own learners as Stable-Baselines3 keeps policies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import Schedule

from agents.learners.feed_forward import FeedForwardActor
from agents.learners.muon import Muon
from agents.learners.recurrent import WIDTH, RecurrentActor
from agents.learners.tape import Tape
from rj_gym.core.task import ObservedError


class EpisodePolicy(BasePolicy):
    """An actor that learns from whole episodes, with its optimiser.

    Args:
        observation_space: vectors. action_space: within [-1, 1].
        actor: from normalised observations to actions. memory: number of entries of its memory.
        hidden: how many hidden numbers `readout` estimates from the memory, in training.
    """

    optimizer: torch.optim.Optimizer

    def __init__(
        self,
        observation_space: spaces.Box,
        action_space: spaces.Box,
        actor: RecurrentActor | FeedForwardActor,
        memory: int,
        hidden: int,
    ) -> None:
        super().__init__(observation_space, action_space)
        self.actor = actor
        self.readout = torch.nn.Linear(memory, hidden) if memory else torch.nn.Identity()

    def forward(self, observation: torch.Tensor, memory: torch.Tensor | None) -> tuple[torch.Tensor, torch.Tensor]:
        """One step: actions before clipping (B, m), and the memory after it, from normalised observations."""
        return self.actor.step(observation, memory)

    def tape(self, steps: int, lanes: int) -> Tape:
        """A record of so many steps of so many episodes, which begin now, for their gradients."""
        return self.actor.tape(steps, lanes)

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: NDArray[Any] | None = None,
        deterministic: bool = False,
    ) -> tuple[Any, Any]:
        """Clipped actions and the memory after them: see RecurrentActor.predict."""
        return self.actor.predict(observation, state, episode_start, deterministic)

    def _predict(self, observation: torch.Tensor, deterministic: bool = False) -> torch.Tensor:
        return self.actor.step(observation, None)[0].clamp(-1.0, 1.0)

    def _optimise(self, optimizer: str, rate: float, betas: tuple[float, float], gates: Sequence[torch.Tensor]) -> None:
        """Make the optimiser: "adam", or "muon" (agents.learners.muon); gates: matrices of three, one above another."""
        if optimizer == "adam":
            self.optimizer = torch.optim.Adam(self.parameters(), rate, betas=betas)
            return
        others = [parameter for parameter in self.parameters() if not any(parameter is gate for gate in gates)]
        groups = [{"params": gates, "blocks": 3}, {"params": others}] if gates else [{"params": others}]
        self.optimizer = Muon(groups, rate, betas=betas)


class RecurrentPolicy(EpisodePolicy):
    """A RecurrentActor with its optimiser.

    Args:
        observation_space: vectors. action_space: within [-1, 1].
        lr_schedule: learning rate over the share of training that remains.
        width: of the actor's layers.
        hidden: how many hidden numbers `readout` estimates from the memory, in training.
        betas: of Adam. optimizer: "adam", or "muon" (agents.learners.muon).
    """

    actor: RecurrentActor

    def __init__(
        self,
        observation_space: spaces.Box,
        action_space: spaces.Box,
        lr_schedule: Schedule,
        width: int = WIDTH,
        hidden: int = 1,
        betas: tuple[float, float] = (0.9, 0.999),
        optimizer: str = "adam",
        **_: Any,
    ) -> None:
        actor = RecurrentActor(observation_space.shape[0], action_space.shape[0], width)
        with torch.no_grad():  # the first actions are small
            actor.head[-1].weight.mul_(0.1)
            actor.head[-1].bias.zero_()
        super().__init__(observation_space, action_space, actor, width, hidden)
        gates = [self.actor.cell.weight_ih_l0, self.actor.cell.weight_hh_l0]
        self._optimise(optimizer, lr_schedule(1), betas, gates)


class FeedForwardPolicy(EpisodePolicy):
    """A FeedForwardActor with its optimiser.

    Args:
        observation_space: vectors. action_space: within [-1, 1].
        lr_schedule: learning rate over the share of training that remains.
        layers: widths of the hidden layers. activation: class of the activation between layers.
        error: where the observation has the tip error, for actions that vanish with it; None: any actions.
        betas: of Adam. optimizer: "adam", or "muon" (agents.learners.muon).
    """

    actor: FeedForwardActor

    def __init__(
        self,
        observation_space: spaces.Box,
        action_space: spaces.Box,
        lr_schedule: Schedule,
        layers: Sequence[int] = (64, 64),
        activation: type[torch.nn.Module] = torch.nn.Tanh,
        error: ObservedError | None = None,
        betas: tuple[float, float] = (0.9, 0.999),
        optimizer: str = "adam",
        **_: Any,
    ) -> None:
        actor = FeedForwardActor(observation_space.shape[0], action_space.shape[0], layers, activation, error)
        if error is None:
            with torch.no_grad():  # the first actions are small
                actor.head.weight.mul_(0.1)
                actor.head.bias.zero_()
        super().__init__(observation_space, action_space, actor, 0, 0)
        self._optimise(optimizer, lr_schedule(1), betas, [])
