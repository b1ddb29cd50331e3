"""Policies whose parameters are one vector: what co-design optimises beside the vector of a design."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FlatPolicy:
    """A network of tanh layers from observations to actions in (-1, 1), its parameters in one vector, (size,).

    Args:
        observations, actions: their numbers.
        hidden: widths of the hidden layers; without any, actions are tanh of an affine function of the observation.
    """

    observations: int
    actions: int
    hidden: tuple[int, ...] = ()

    @property
    def _widths(self) -> tuple[int, ...]:
        return self.observations, *self.hidden, self.actions

    @property
    def size(self) -> int:
        """Number of parameters."""
        return sum((inputs + 1) * outputs for inputs, outputs in pairwise(self._widths))

    def initial(self, seed: int) -> Array:
        """Parameters to begin with, (size,): hidden layers are random, and all actions are 0."""
        rng, parts = np.random.default_rng(seed), list[Array]()
        for layer, (inputs, outputs) in enumerate(pairwise(self._widths)):
            scale = 0.0 if layer == len(self.hidden) else inputs**-0.5
            parts += [scale * rng.standard_normal(inputs * outputs), np.zeros(outputs)]
        return np.concatenate(parts)

    def __call__(self, parameters: Tensor, observations: Tensor) -> Tensor:
        """Actions (..., actions) for observations (..., observations)."""
        values, first = observations, 0
        for inputs, outputs in pairwise(self._widths):
            middle, last = first + inputs * outputs, first + (inputs + 1) * outputs
            weights = parameters[first:middle].reshape(inputs, outputs)
            values = torch.tanh(values @ weights + parameters[middle:last])
            first = last
        return values
