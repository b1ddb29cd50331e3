"""A policy with memory as a torch module: agents.policies.recurrent.RecurrentNetwork with gradients."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

WIDTH = 128


class RecurrentActor(nn.Module):
    """Encoder, gated recurrent unit and head, from normalised observations to actions.

    z = tanh(W_e x + b_e), h' = GRU(z, h), y = W_2 tanh(W_1 [h'; z] + b_1) + b_2; the action is y clipped to [-1, 1].

    Args:
        entries: of the observation. actions: m. width: of the encoder, the memory h and the hidden layer of the head.
    """

    def __init__(self, entries: int, actions: int, width: int = WIDTH) -> None:
        super().__init__()
        self.encoder = nn.Sequential(nn.Linear(entries, width), nn.Tanh())
        self.cell = nn.GRU(width, width, batch_first=True)
        self.head = nn.Sequential(nn.Linear(2 * width, width), nn.Tanh(), nn.Linear(width, actions))

    def forward(self, x: torch.Tensor, memory: torch.Tensor | None = None) -> tuple[torch.Tensor, torch.Tensor]:
        """Actions before clipping (B, T, m) for T steps x (B, T, entries), and the memory (1, B, width) after them.

        Args:
            memory: that before the first step; None where episodes begin.
        """
        z = self.encoder(x)
        output, memory = self.cell(z, memory)
        return self.head(torch.cat([output, z], -1)), memory

    def step(self, x: torch.Tensor, memory: torch.Tensor | None) -> tuple[torch.Tensor, torch.Tensor]:
        """One step of `forward`: actions before clipping (B, m) and memory (B, width), for x (B, entries)."""
        cell, z = self.cell, self.encoder(x)
        before = torch.zeros(len(x), self.cell.hidden_size) if memory is None else memory
        memory = torch.gru_cell(z, before, cell.weight_ih_l0, cell.weight_hh_l0, cell.bias_ih_l0, cell.bias_hh_l0)
        return self.head(torch.cat([memory, z], -1)), memory

    def predict(
        self,
        observation: NDArray[Any],
        state: NDArray[Any] | None = None,
        episode_start: NDArray[Any] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """One step, as models of Stable-Baselines3 take it: the actions and the memory after it.

        Args:
            observation: normalised, (entries,) or (B, entries).
            state: the memory before, (B, width); None where all episodes begin.
            episode_start: (B,), where an episode begins, and forgets its memory.
            deterministic: has no effect; the policy is deterministic.
        """
        rows = np.asarray(observation, np.float32).reshape(-1, np.shape(observation)[-1])
        if state is not None and episode_start is not None:
            state = np.where(np.asarray(episode_start, bool)[:, None], np.float32(0), state)
        memory = None if state is None else torch.as_tensor(state)[None]
        with torch.no_grad():
            actions, memory = self(torch.as_tensor(rows)[:, None], memory)
        clipped = actions[:, 0].clamp(-1, 1).numpy()
        return clipped.reshape(*np.shape(observation)[:-1], -1), memory[0].numpy()
