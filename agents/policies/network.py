"""The forward pass of a trained policy in plain NumPy: what Stable-Baselines3 computes for its deterministic action."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.errors import InvalidInput

Vectors = NDArray[np.float32]


class PolicyError(InvalidInput):
    """A policy that cannot be exported, loaded or used."""


def _elu(x: Vectors) -> Vectors:
    return np.where(x > 0, x, np.expm1(np.minimum(x, 0)))


ACTIVATIONS: dict[str, Callable[[Vectors], Vectors]] = {
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0),
    "elu": _elu,
}
OUTPUTS = ("clip", "tanh")


@dataclass(frozen=True)
class Network:
    """A normaliser, fully connected layers and a bounded output, with m actions.

    An observation that is a dictionary is concatenated first. Entry i becomes
    clip((x_i - mean_i) / scale_i, -clip_i, clip_i) in float64; from there on all is float32.

    Args:
        inputs: number of entries by key, in the order of concatenation; empty for an observation that is a vector.
        mean, scale, clip: the normaliser, (entries,) float64 each.
        layers: weights (outputs, inputs) and biases (outputs,) of every layer, float32.
        activation: of the hidden layers: "tanh", "relu" or "elu".
        output: "clip" to [low, high], or "tanh", which is then scaled from [-1, 1] to [low, high].
        low, high: bounds of the action, (m,) float32 each.
    Raises:
        PolicyError: numbers that are not finite, shapes that do not fit together, an unknown activation or output.
    """

    inputs: Mapping[str, int]
    mean: NDArray[np.float64]
    scale: NDArray[np.float64]
    clip: NDArray[np.float64]
    layers: Sequence[tuple[Vectors, Vectors]]
    activation: str
    output: str
    low: Vectors
    high: Vectors

    def __post_init__(self) -> None:
        if self.activation not in ACTIVATIONS:
            raise PolicyError("activation", self.activation, f"one of {', '.join(ACTIVATIONS)}")
        if self.output not in OUTPUTS:
            raise PolicyError("output", self.output, f"one of {', '.join(OUTPUTS)}")
        for name, array in self.tensors().items():
            _check_numbers(name, array, np.float64 if name in ("mean", "scale", "clip") else np.float32)
        self._check_shapes()
        if not np.all(self.scale > 0) or not np.all(self.clip > 0):
            raise PolicyError(
                "normaliser", float(min(self.scale.min(), self.clip.min())), "scales and clips above zero"
            )
        if not np.all(self.low < self.high):
            raise PolicyError("low", self.low.tolist(), f"less than high = {self.high.tolist()}")

    def _check_shapes(self) -> None:
        if not self.layers:
            raise PolicyError("layers", 0, "at least one")
        if self.inputs and sum(self.inputs.values()) != self.entries:
            raise PolicyError("mean", self.mean.shape, f"one number per entry of {dict(self.inputs)}")
        width = self.entries
        for i, (weights, biases) in enumerate(self.layers):
            if weights.ndim != 2 or weights.shape[1] != width or biases.shape != weights.shape[:1]:
                raise PolicyError(f"layer {i}", (weights.shape, biases.shape), f"weights (n, {width}) and biases (n,)")
            width = len(biases)
        expected = dict.fromkeys(("mean", "scale", "clip"), self.entries) | dict.fromkeys(("low", "high"), width)
        for name, count in expected.items():
            if count == 0 or getattr(self, name).shape != (count,):
                raise PolicyError(name, getattr(self, name).shape, f"the shape ({count},), not empty")

    @property
    def entries(self) -> int:
        """Number of entries of an observation, those of a dictionary taken together."""
        return self.mean.size

    @property
    def hidden(self) -> list[int]:
        """Widths of the hidden layers."""
        return [len(biases) for _, biases in self.layers[:-1]]

    def tensors(self) -> dict[str, NDArray[Any]]:
        """All arrays by name: what a policy file stores."""
        arrays: dict[str, NDArray[Any]] = {name: getattr(self, name) for name in ("mean", "scale", "clip")}
        for i, (weights, biases) in enumerate(self.layers):
            arrays |= {f"weights.{i}": weights, f"biases.{i}": biases}
        return arrays | {"low": self.low, "high": self.high}

    @classmethod
    def from_tensors(
        cls, tensors: Mapping[str, NDArray[Any]], inputs: Mapping[str, int], activation: str, output: str
    ) -> Network:
        """The network whose tensors() these are; raises PolicyError for a missing or an unknown one."""
        names = ["mean", "scale", "clip", "low", "high"]
        count = max(1, sum(name.startswith("weights.") for name in tensors))
        pairs = [(f"weights.{i}", f"biases.{i}") for i in range(count)]
        expected = sorted([*names, *(name for pair in pairs for name in pair)])
        if sorted(tensors) != expected:
            raise PolicyError("tensors", sorted(tensors), ", ".join(expected))
        layers = [(tensors[weights], tensors[biases]) for weights, biases in pairs]
        arrays = {name: tensors[name] for name in names}
        return cls(inputs=inputs, layers=layers, activation=activation, output=output, **arrays)

    def __call__(self, observation: Any) -> Vectors:
        """The deterministic action, (m,) or (B, m), each within [low, high].

        Args:
            observation: (entries,) or (B, entries), or a dictionary of such arrays by key.
        Raises:
            PolicyError: another shape, a missing key, or numbers that are not finite.
        """
        x = ((self.vector(observation) - self.mean) / self.scale).clip(-self.clip, self.clip).astype(np.float32)
        *hidden, (weights, biases) = self.layers
        activate = ACTIVATIONS[self.activation]
        for hidden_weights, hidden_biases in hidden:
            x = activate(x @ hidden_weights.T + hidden_biases)
        x = x @ weights.T + biases
        if self.output == "clip":
            return x.clip(self.low, self.high)
        return self.low + np.float32(0.5) * (np.tanh(x) + np.float32(1.0)) * (self.high - self.low)

    def vector(self, observation: Any) -> NDArray[Any]:
        """The observation as one array (entries,) or (B, entries); raises PolicyError as __call__ does."""
        if not self.inputs:
            return _checked_part("observation", observation, self.entries)
        if not isinstance(observation, Mapping) or not self.inputs.keys() <= observation.keys():
            raise PolicyError("observation", observation, f"a dictionary with the keys {', '.join(self.inputs)}")
        parts = [_checked_part(f"observation[{key!r}]", observation[key], n) for key, n in self.inputs.items()]
        if len({part.shape[:-1] for part in parts}) > 1:
            raise PolicyError("observation", [part.shape for part in parts], "as many rows under every key")
        return np.concatenate(parts, axis=-1)


def _checked_part(what: str, values: Any, entries: int) -> NDArray[Any]:
    allowed = f"finite numbers ({entries},) or (B, {entries})"
    try:
        array = np.asarray(values)
        fits = array.ndim in (1, 2) and array.shape[-1] == entries and bool(np.isfinite(array).all())
    except (TypeError, ValueError):
        raise PolicyError(what, values, allowed) from None
    if not fits:
        raise PolicyError(what, array.shape if array.shape[-1:] != (entries,) else values, allowed)
    return array


def _check_numbers(name: str, array: NDArray[Any], kind: type) -> None:
    if array.dtype != kind:
        raise PolicyError(name, str(array.dtype), np.dtype(kind).name)
    if not np.isfinite(array).all():
        raise PolicyError(name, "NaN or infinity", "finite numbers")
