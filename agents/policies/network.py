"""The network without memory in plain NumPy, for the deterministic action of Stable-Baselines3."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from agents.policies.base import BOUNDS, NORMALISER, PolicyNetwork, arrays_of
from agents.policies.errors import PolicyError
from agents.policies.layers import ACTIVATIONS, Layers, Vectors, arrays_of_layers, check_names, layers_in, through

__all__ = ["Network", "PolicyError"]

OUTPUTS = ("clip", "tanh", "clipped tanh")
CLIP = 2.0  # of "clipped tanh", the output of Stable-Baselines3 with state-dependent exploration


@dataclass(frozen=True)
class Network(PolicyNetwork):
    """Fully connected layers without memory, for the deterministic action of Stable-Baselines3.

    Args:
        inputs: number of entries by key, in the order of concatenation; empty for an observation that is a vector.
        mean, scale, clip: the normaliser, (entries,) float64 each.
        layers: weights (outputs, inputs) and biases (outputs,) of every layer, float32.
        activation: of the hidden layers: "tanh", "relu" or "elu".
        output: "clip" to [low, high]; or "tanh", scaled from [-1, 1] to [low, high]; or "clipped tanh", the
            same after a clip to [-2, 2].
        low, high: bounds of the action, (m,) float32 each.
    Raises:
        PolicyError: numbers that are not finite, shapes that do not fit together, an unknown activation or output.
    """

    KIND = "feedforward"
    DESCRIBED: ClassVar[tuple[str, ...]] = ("inputs", "activation", "output")

    inputs: Mapping[str, int]
    mean: NDArray[np.float64]
    scale: NDArray[np.float64]
    clip: NDArray[np.float64]
    layers: Layers
    activation: str
    output: str
    low: Vectors
    high: Vectors

    def __post_init__(self) -> None:
        if self.output not in OUTPUTS:
            raise PolicyError("output", self.output, f"one of {', '.join(OUTPUTS)}")
        self._check()

    def _head_entries(self) -> int:
        return self.entries

    @property
    def hidden(self) -> list[int]:
        """Widths of the hidden layers."""
        return [len(biases) for _, biases in self.layers[:-1]]

    def tensors(self) -> dict[str, NDArray[Any]]:
        """All arrays of a policy file, by name."""
        return arrays_of(self, NORMALISER) | arrays_of_layers("", self.layers) | arrays_of(self, BOUNDS)

    @classmethod
    def from_tensors(cls, tensors: Mapping[str, NDArray[Any]], **described: Any) -> Self:
        """The network of these arrays and of `inputs`, `activation` and `output`; raises PolicyError."""
        layers = layers_in(tensors, "", at_least=1)
        check_names(tensors, [*NORMALISER, *arrays_of_layers("", layers), *BOUNDS])
        described |= {name: tensors[name] for name in NORMALISER + BOUNDS}
        return cls(layers=layers, **described)

    def start(self, episodes: int) -> None:
        """None: it has no memory."""

    def advance(self, observation: Any, memory: Vectors | None) -> tuple[Vectors, None]:
        """The action, (m,) or (B, m), and None for the memory; raises PolicyError as __call__ does."""
        return self(observation), None

    def __call__(self, observation: Any) -> Vectors:
        """The deterministic action, (m,) or (B, m), each within [low, high].

        Args:
            observation: (entries,) or (B, entries), or a dictionary of such arrays by key.
        Raises:
            PolicyError: another shape, a missing key, or numbers that are not finite.
        """
        return self._bounded(through(self.layers, ACTIVATIONS[self.activation], self.normalised(observation)))

    def _bounded(self, x: Vectors) -> Vectors:
        """Actions within [low, high]."""
        if self.output == "clip":
            return x.clip(self.low, self.high)
        if self.output == "clipped tanh":
            x = x.clip(-CLIP, CLIP)
        return self.low + np.float32(0.5) * (np.tanh(x) + np.float32(1.0)) * (self.high - self.low)
