"""The base class of networks of policies: normalised observations, bounded actions, arrays for files."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from agents.policies.errors import PolicyError
from agents.policies.layers import ACTIVATIONS, Layers, Vectors, check_layers

NORMALISER = ("mean", "scale", "clip")
BOUNDS = ("low", "high")


class PolicyNetwork(ABC):
    """The network of a policy: normalised observations, m bounded actions, arrays for files.

    An observation that is a dictionary is concatenated first. Entry i becomes
    clip((x_i - mean_i) / scale_i, -clip_i, clip_i) in float64; from there on all is float32.
    """

    KIND: ClassVar[str]
    DESCRIBED: ClassVar[tuple[str, ...]]  # arguments of from_tensors besides the arrays

    inputs: Mapping[str, int]
    mean: NDArray[np.float64]
    scale: NDArray[np.float64]
    clip: NDArray[np.float64]
    layers: Layers
    activation: str
    low: Vectors
    high: Vectors

    @abstractmethod
    def tensors(self) -> dict[str, NDArray[Any]]:
        """All arrays of a policy file, by name."""

    @classmethod
    @abstractmethod
    def from_tensors(cls, tensors: Mapping[str, NDArray[Any]], **described: Any) -> Self:
        """The network with these tensors() and description(); raises PolicyError if they do not fit together."""

    @property
    @abstractmethod
    def hidden(self) -> list[int]:
        """Widths of the hidden layers."""

    @abstractmethod
    def start(self, episodes: int) -> Vectors | None:
        """The memory with which this many episodes begin; None without memory."""

    @abstractmethod
    def advance(self, observation: Any, memory: Vectors | None) -> tuple[Vectors, Vectors | None]:
        """The action, (m,) or (B, m), each within [low, high], and the memory after this step.

        Args:
            observation: (entries,) or (B, entries), or a dictionary of such arrays by key.
            memory: after the step before; None begins one episode per observation.
        Raises:
            PolicyError: another shape, a missing key, or numbers that are not finite.
        """

    def description(self) -> dict[str, Any]:
        """Plain values, ready for JSON: the network without its arrays."""
        values = {name: getattr(self, name) for name in self.DESCRIBED}
        return values | {"inputs": dict(self.inputs)}

    @property
    def entries(self) -> int:
        """Number of entries of an observation, of a dictionary their sum."""
        return self.mean.size

    def normalised(self, observation: Any) -> Vectors:
        """The normalised observation, (entries,) or (B, entries); raises PolicyError as advance does."""
        return self._scaled(self.vector(observation))

    def _scaled(self, vectors: NDArray[Any]) -> Vectors:
        """Vectors (..., mean.size) through the normaliser."""
        scaled = (vectors - self.mean) / self.scale
        return scaled.clip(-self.clip, self.clip).astype(np.float32)

    def vector(self, observation: Any) -> NDArray[Any]:
        """The observation as one array (entries,) or (B, entries); raises PolicyError as advance does."""
        if not self.inputs:
            return _checked_part("observation", observation, self.entries)
        if not isinstance(observation, Mapping) or not self.inputs.keys() <= observation.keys():
            raise PolicyError("observation", observation, f"a dictionary with the keys {', '.join(self.inputs)}")
        parts = [_checked_part(f"observation[{key!r}]", observation[key], n) for key, n in self.inputs.items()]
        if len({part.shape[:-1] for part in parts}) > 1:
            raise PolicyError("observation", [part.shape for part in parts], "as many rows under every key")
        return np.concatenate(parts, axis=-1)

    @staticmethod
    def _check_rows(rows: Vectors, memory: Vectors) -> None:
        """Raise PolicyError unless there are as many observations as episodes in the memory."""
        if len(memory) != len(rows):
            hint = "reset() begins other episodes."
            raise PolicyError("observations", len(rows), f"{len(memory)}, one of every episode in the memory", hint)

    def _check(self) -> None:
        """Raise PolicyError for numbers that are not finite, an unknown activation, or shapes that do not fit."""
        if self.activation not in ACTIVATIONS:
            raise PolicyError("activation", self.activation, f"one of {', '.join(ACTIVATIONS)}")
        for name, array in self.tensors().items():
            _check_numbers(name, array, np.float64 if name in NORMALISER else np.float32)
        self._check_shapes()
        if not np.all(self.scale > 0) or not np.all(self.clip > 0):
            raise PolicyError(
                "normaliser", float(min(self.scale.min(), self.clip.min())), "scales and clips above zero"
            )
        if not np.all(self.low < self.high):
            raise PolicyError("low", self.low.tolist(), f"less than high = {self.high.tolist()}")

    def _check_shapes(self) -> None:
        if self.inputs and sum(self.inputs.values()) != self.entries:
            raise PolicyError("mean", self.mean.shape, f"one number per entry of {dict(self.inputs)}")
        if not self.layers:
            raise PolicyError("layers", 0, "at least one")
        width = check_layers("layer", self.layers, self._head_entries())
        expected = dict.fromkeys(NORMALISER, self.mean.size) | dict.fromkeys(BOUNDS, self._actions(width))
        for name, count in expected.items():
            if count == 0 or getattr(self, name).shape != (count,):
                raise PolicyError(name, getattr(self, name).shape, f"the shape ({count},), not empty")

    def _actions(self, width: int) -> int:
        """Number of actions that so many outputs of the last layer become."""
        return width

    @abstractmethod
    def _head_entries(self) -> int:
        """Number of entries that the first of `layers` sees; raises PolicyError if earlier parts do not fit."""


def memory_after_reset(network: PolicyNetwork, memory: Vectors | None, mask: NDArray[np.bool_]) -> Vectors | None:
    """The memory (B, width), restarted where the mask (B,) is true; None without memory."""
    start = network.start(len(mask))
    return start if start is None or memory is None or mask.all() else np.where(mask[:, None], start, memory)


def arrays_of(part: Any, names: Sequence[str]) -> dict[str, NDArray[Any]]:
    """These attributes of a part, by name."""
    return {name: getattr(part, name) for name in names}


def _checked_part(name: str, values: Any, entries: int) -> NDArray[Any]:
    allowed = f"finite numbers ({entries},) or (B, {entries})"
    try:
        array = np.asarray(values)
        fits = array.ndim in (1, 2) and array.shape[-1] == entries and bool(np.isfinite(array).all())
    except (TypeError, ValueError):
        raise PolicyError(name, values, allowed) from None
    if not fits:
        raise PolicyError(name, array.shape if array.shape[-1:] != (entries,) else values, allowed)
    return array


def _check_numbers(name: str, array: NDArray[Any], kind: type) -> None:
    if array.dtype != kind:
        raise PolicyError(name, str(array.dtype), np.dtype(kind).name)
    if not np.isfinite(array).all():
        raise PolicyError(name, "NaN or infinity", "finite numbers")
