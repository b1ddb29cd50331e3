"""A policy without memory as a torch module: agents.policies.network.Network, or GainNetwork, with gradients."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from agents.learners.gain import GainHead
from agents.learners.tape import StepTape
from rj_gym.core.task import ObservedError


class FeedForwardActor(nn.Module):
    """Hidden layers and a head, from normalised observations to actions, which are clipped to [-1, 1].

    Its methods are those of a RecurrentActor, with a memory of no entries.

    Args:
        entries: of the observation. actions: m. layers: widths of the hidden layers. activation: between all layers.
        error: where the observation has the tip error, for a GainHead; None: the head is linear.
    """

    def __init__(
        self,
        entries: int,
        actions: int,
        layers: Sequence[int],
        activation: type[nn.Module] = nn.Tanh,
        error: ObservedError | None = None,
    ) -> None:
        super().__init__()
        linear = (nn.Linear(before, after) for before, after in pairwise([entries, *layers]))
        self.hidden = nn.Sequential(*(part for layer in linear for part in (layer, activation())))
        self.head: nn.Module = nn.Linear(layers[-1], actions) if error is None else GainHead(layers[-1], actions, error)

    def forward(self, x: torch.Tensor, memory: torch.Tensor | None = None) -> tuple[torch.Tensor, torch.Tensor]:
        """Actions before clipping (..., m) for normalised observations x (..., entries), and the memory (..., 0)."""
        hidden = self.hidden(x)
        seen = self.head.seen(hidden, x) if isinstance(self.head, GainHead) else hidden
        return self.head(seen), x[..., :0]

    def step(self, x: torch.Tensor, memory: torch.Tensor | None) -> tuple[torch.Tensor, torch.Tensor]:
        """The same of one step: actions before clipping (B, m) and memory (B, 0), for x (B, entries)."""
        return self(x)

    def tape(self, steps: int, lanes: int) -> StepTape:
        """A record of steps of episodes, which begin now, for their gradients."""
        return StepTape(self)

    def predict(
        self, observation: NDArray[Any], state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], None]:
        """One step, as models of Stable-Baselines3 take it: the actions for normalised observations, and no memory."""
        with torch.no_grad():
            actions, _ = self(torch.as_tensor(np.asarray(observation, np.float32)))
        return actions.clamp(-1, 1).numpy(), None
