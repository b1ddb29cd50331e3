"""Networks with memory in plain NumPy: an encoder, one recurrent cell, a head."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from agents.policies.base import BOUNDS, NORMALISER, PolicyNetwork, arrays_of
from agents.policies.cells import Cell, cell_in
from agents.policies.errors import PolicyError
from agents.policies.layers import (
    ACTIVATIONS,
    Layers,
    Vectors,
    arrays_of_layers,
    check_layers,
    check_names,
    layers_in,
    through,
)
from rollingjoint.checks import as_boolean

ENCODER = "encoder."


@dataclass(frozen=True)
class RecurrentNetwork(PolicyNetwork):
    """A network that remembers the episode: action = clip(head(h), low, high) with h the output of the cell.

    With x the normalised observation, f the activation and z = f(W_e x + b_e), or z = x without an encoder, the cell
    sees z, and the head sees h, or [h; z] with a shortcut; between the layers of the head, too, is f.

    Args:
        inputs: number of entries by key, in the order of concatenation; empty for an observation that is a vector.
        mean, scale, clip: the normaliser, (entries,) float64 each.
        encoder: weights (outputs, inputs) and biases (outputs,) of every layer before the cell, float32; may be empty.
        cell: the recurrent layer, with the memory.
        layers: the head, from the output of the cell to the actions.
        activation: of the encoder and of the hidden layers of the head: "tanh", "relu" or "elu".
        shortcut: whether the head sees the input of the cell, too.
        low, high: bounds of the action, (m,) float32 each.
    Raises:
        PolicyError: numbers that are not finite, shapes that do not fit together, an unknown activation.
    """

    KIND = "recurrent"
    DESCRIBED = ("inputs", "cell", "activation", "shortcut")

    inputs: Mapping[str, int]
    mean: NDArray[np.float64]
    scale: NDArray[np.float64]
    clip: NDArray[np.float64]
    encoder: Layers
    cell: Cell
    layers: Layers
    activation: str
    shortcut: bool
    low: Vectors
    high: Vectors

    def __post_init__(self) -> None:
        as_boolean("shortcut", self.shortcut, error=PolicyError)
        self._check()

    def _head_entries(self) -> int:
        entries = check_layers("encoder layer", self.encoder, self.entries)
        self.cell.check(entries)
        return self.cell.width + (entries if self.shortcut else 0)

    @property
    def hidden(self) -> list[int]:
        """Widths of the encoder, the cell and the hidden layers of the head."""
        widths = [len(biases) for _, biases in [*self.encoder, *self.layers[:-1]]]
        return [*widths[: len(self.encoder)], self.cell.width, *widths[len(self.encoder) :]]

    def description(self) -> dict[str, Any]:
        """Plain values, ready for JSON: the network without its arrays."""
        return {"kind": self.KIND} | super().description() | {"cell": self.cell.KIND}

    def tensors(self) -> dict[str, NDArray[Any]]:
        """All arrays of a policy file, by name."""
        before = arrays_of(self, NORMALISER) | arrays_of_layers(ENCODER, self.encoder) | self.cell.tensors()
        return before | arrays_of_layers("", self.layers) | arrays_of(self, BOUNDS)

    @classmethod
    def from_tensors(cls, tensors: Mapping[str, NDArray[Any]], **described: Any) -> Self:
        """The network of these arrays and of `inputs`, `cell`, `activation` and `shortcut`; raises PolicyError."""
        cell = cell_in(tensors, described.pop("cell"))
        encoder, layers = layers_in(tensors, ENCODER), layers_in(tensors, "", at_least=1)
        names = [*arrays_of_layers(ENCODER, encoder), *cell.tensors(), *arrays_of_layers("", layers)]
        check_names(tensors, [*NORMALISER, *names, *BOUNDS])
        described |= {name: tensors[name] for name in NORMALISER + BOUNDS}
        return cls(encoder=encoder, cell=cell, layers=layers, **described)

    def start(self, episodes: int) -> Vectors:
        """The memory with which this many episodes begin: zeros, (episodes, memory)."""
        return np.zeros((episodes, self.cell.STATES * self.cell.width), np.float32)

    def advance(self, observation: Any, memory: Vectors | None) -> tuple[Vectors, Vectors]:
        """The action, (m,) or (B, m), each within [low, high], and the memory after this step, (B, memory).

        Args:
            observation: (entries,) or (B, entries), or a dictionary of such arrays by key.
            memory: after the step before; None begins one episode per observation.
        Raises:
            PolicyError: another shape, a missing key, numbers that are not finite, or another number of observations
                than the memory has rows.
        """
        x = self.normalised(observation)
        rows = x.reshape(-1, self.entries)
        if memory is None:
            memory = self.start(len(rows))
        self._check_rows(rows, memory)
        actions, memory = self._step(rows, memory)
        return actions.reshape(*x.shape[:-1], -1), memory

    def _step(self, x: Vectors, memory: Vectors) -> tuple[Vectors, Vectors]:
        """Actions (B, m) and memory after seeing the normalised observations x (B, entries)."""
        activate = ACTIVATIONS[self.activation]
        if self.encoder:
            x = activate(through(self.encoder, activate, x))
        memory = self.cell.step(x, memory)
        output = memory[:, : self.cell.width]
        head_input = np.concatenate([output, x], axis=-1) if self.shortcut else output
        return through(self.layers, activate, head_input).clip(self.low, self.high), memory
