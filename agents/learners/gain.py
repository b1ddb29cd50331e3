"""The last layer of policies whose actions vanish with the tip error, as a torch module."""

from __future__ import annotations

import torch
from torch import nn

from rj_gym.core.task import ObservedError

GAIN_MM = 5.0  # error at which an entry of M is an action
SCALE_MM = 1.5  # error at which half of b is left


class GainHead(nn.Module):
    """Actions before clipping, M e / GAIN_MM + b |e| / (|e| + SCALE_MM), of d error coordinates e [mm].

    M and b are linear in the last hidden layer. The head sees that layer and, behind it, the observation's entries of
    the error, which a normaliser must not shift. agents.policies.gain.GainForm is the same in NumPy.

    Args:
        width: of the last hidden layer. actions: m. error: where the observation has the tip error.
    """

    def __init__(self, width: int, actions: int, error: ObservedError) -> None:
        super().__init__()
        self.error, self.actions, self.dimension = error, actions, len(error.places)
        self.gain_mm, self.scale_mm = GAIN_MM, SCALE_MM
        self.layer = nn.Linear(width, actions * (self.dimension + 1))
        with torch.no_grad():  # the first actions are small
            self.layer.weight.mul_(0.1)
            self.layer.bias.zero_()

    def seen(self, hidden: torch.Tensor, observation: torch.Tensor) -> torch.Tensor:
        """The input of the head (..., width + d): the last hidden layer, and the entries of the error behind it."""
        return torch.cat([hidden, observation[..., list(self.error.places)]], -1)

    def forward(self, seen: torch.Tensor) -> torch.Tensor:
        """Actions before clipping (..., m), for inputs (..., width + d) as `seen` gives them."""
        hidden, entries = seen[..., : -self.dimension], seen[..., -self.dimension :]
        gains, offsets = self.layer(hidden).split([self.actions * self.dimension, self.actions], -1)
        error = self.error.unit_mm * entries
        linear = (gains.unflatten(-1, (self.actions, self.dimension)) * error[..., None, :]).sum(-1)
        size = (error.square().sum(-1, keepdim=True) + 1e-12).sqrt()
        return linear / self.gain_mm + offsets * size / (size + self.scale_mm)
