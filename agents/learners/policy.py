"""A policy with memory as Stable-Baselines3 keeps policies."""

from __future__ import annotations

from typing import Any

import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import Schedule

from agents.learners.muon import Muon
from agents.learners.recurrent import WIDTH, RecurrentActor


class RecurrentPolicy(BasePolicy):
    """A RecurrentActor with its optimiser.

    Args:
        observation_space: vectors. action_space: within [-1, 1].
        lr_schedule: learning rate over the share of training that remains.
        width: of the actor's layers.
        hidden: how many hidden numbers `readout` estimates from the memory, in training.
        betas: of Adam. optimizer: "adam", or "muon" (agents.learners.muon).
    """

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
        super().__init__(observation_space, action_space)
        self.actor = RecurrentActor(observation_space.shape[0], action_space.shape[0], width)
        with torch.no_grad():  # the first actions are small
            self.actor.head[-1].weight.mul_(0.1)
            self.actor.head[-1].bias.zero_()
        self.readout = torch.nn.Linear(width, hidden)
        if optimizer == "muon":
            gates = [self.actor.cell.weight_ih_l0, self.actor.cell.weight_hh_l0]
            others = [parameter for parameter in self.parameters() if not any(parameter is gate for gate in gates)]
            groups = [{"params": gates, "blocks": 3}, {"params": others}]
            self.optimizer: torch.optim.Optimizer = Muon(groups, lr_schedule(1), betas=betas)
        else:
            self.optimizer = torch.optim.Adam(self.parameters(), lr_schedule(1), betas=betas)

    def forward(self, observation: torch.Tensor, memory: torch.Tensor | None) -> tuple[torch.Tensor, torch.Tensor]:
        """One step: actions before clipping (B, m), and the memory after it, from normalised observations."""
        return self.actor.step(observation, memory)

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
