"""Fully connected layers in plain NumPy: their activations, checks and arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.policies.errors import PolicyError

Vectors = NDArray[np.float32]
Layers = Sequence[tuple[Vectors, Vectors]]  # weights (outputs, inputs) and biases (outputs,) of each


def _elu(x: Vectors) -> Vectors:
    return np.where(x > 0, x, np.expm1(np.minimum(x, 0)))


ACTIVATIONS: dict[str, Callable[[Vectors], Vectors]] = {
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0),
    "elu": _elu,
}


def through(layers: Layers, activate: Callable[[Vectors], Vectors], x: Vectors) -> Vectors:
    """The outputs of linear layers, with the activation between them, for the inputs x."""
    *hidden, (weights, biases) = layers
    for hidden_weights, hidden_biases in hidden:
        x = activate(x @ hidden_weights.T + hidden_biases)
    return x @ weights.T + biases


def check_layers(name: str, layers: Layers, entries: int) -> int:
    """The width of the last layer; raises PolicyError unless they fit to each other and to their entries."""
    width = entries
    for i, (weights, biases) in enumerate(layers):
        if weights.ndim != 2 or weights.shape[1] != width or biases.shape != weights.shape[:1]:
            raise PolicyError(f"{name} {i}", (weights.shape, biases.shape), f"weights (n, {width}) and biases (n,)")
        width = len(biases)
    return width


def arrays_of_layers(prefix: str, layers: Layers) -> dict[str, NDArray[Any]]:
    """The arrays of layers by name: "weights.0", "biases.0" and so on, after the prefix."""
    arrays: dict[str, NDArray[Any]] = {}
    for i, (weights, biases) in enumerate(layers):
        arrays |= {f"{prefix}weights.{i}": weights, f"{prefix}biases.{i}": biases}
    return arrays


def layers_in(tensors: Mapping[str, NDArray[Any]], prefix: str, at_least: int = 0) -> list[tuple[Vectors, Vectors]]:
    """The layers from their arrays among the tensors; missing arrays are empty."""
    count = max(at_least, sum(name.startswith(f"{prefix}weights.") for name in tensors))
    missing = np.zeros(0, np.float32)
    names = [(f"{prefix}weights.{i}", f"{prefix}biases.{i}") for i in range(count)]
    return [(tensors.get(weights, missing), tensors.get(biases, missing)) for weights, biases in names]


def check_names(tensors: Mapping[str, NDArray[Any]], expected: Sequence[str]) -> None:
    """Raise PolicyError unless these, and no others, are the names of the tensors."""
    if sorted(tensors) != sorted(expected):
        raise PolicyError("tensors", sorted(tensors), ", ".join(sorted(expected)))
