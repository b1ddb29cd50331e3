"""The last layer of policies whose actions vanish with the tip error, as a torch module."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import nn

from rj_gym.core.task import ObservedError

GAIN_MM = 5.0  # error at which an entry of M is an action
SCALE_MM = 1.5  # error at which half of b is left


class Combined(NamedTuple):
    """What the derivative of a GainHead's actions needs."""

    gains: torch.Tensor  # M, (..., m, d)
    offsets: torch.Tensor  # b, (..., m)
    error: torch.Tensor  # e, (..., d) [mm]
    size: torch.Tensor  # |e|, (..., 1) [mm]
    share: torch.Tensor  # |e| / (|e| + SCALE_MM), (..., 1)


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
        return self.combined(self.layer(hidden), entries)[0]

    def combined(self, coefficients: torch.Tensor, entries: torch.Tensor) -> tuple[torch.Tensor, Combined]:
        """Actions before clipping (..., m), and what their derivative needs.

        Args:
            coefficients: M, row by row, and b behind it, (..., m d + m). entries: of the error, (..., d).
        """
        gains, offsets = coefficients.split([self.actions * self.dimension, self.actions], -1)
        gains, error = gains.unflatten(-1, (self.actions, self.dimension)), self.error.unit_mm * entries
        size = (error.square().sum(-1, keepdim=True) + 1e-12).sqrt()
        share = size / (size + self.scale_mm)
        actions = (gains * error[..., None, :]).sum(-1) / self.gain_mm + offsets * share
        return actions, Combined(gains, offsets, error, size, share)

    def back(self, by_actions: torch.Tensor, parts: Combined) -> tuple[torch.Tensor, torch.Tensor]:
        """Gradients by coefficients (..., m d + m) and by entries (..., d), from that by the actions (..., m)."""
        by_gains = (by_actions / self.gain_mm)[..., None] * parts.error[..., None, :]
        by_share = (by_actions * parts.offsets).sum(-1, keepdim=True)
        slope = self.scale_mm / ((parts.size + self.scale_mm).square() * parts.size)
        by_error = (by_actions[..., None] * parts.gains).sum(-2) / self.gain_mm + by_share * slope * parts.error
        return torch.cat([by_gains.flatten(-2), by_actions * parts.share], -1), self.error.unit_mm * by_error
