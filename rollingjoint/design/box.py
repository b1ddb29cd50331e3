"""Design spaces: vectors in a box to physical numbers and back, many at a time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from functools import cached_property
from typing import Any, NamedTuple, TypeVar

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from rollingjoint.checks import as_floats
from rollingjoint.differentiable.parameters import ChainTensors
from rollingjoint.errors import InvalidInput, MechanismError

Array = NDArray[np.float64]
Range = tuple[float, float]
T = TypeVar("T", NDArray[np.float64], Tensor)

_DRAWN = 256  # designs drawn at a time
_MOST_DRAWN = 100_000


class NumberGroup(NamedTuple):
    """Numbers of a design with one range: their labels, and the range."""

    labels: tuple[str, ...]
    range: Range

    @property
    def free(self) -> int:
        """Number of dimensions of the vector that they take."""
        return len(self.labels) if self.range[0] < self.range[1] else 0


class DesignBox(ABC):
    """Designs as vectors in the box [-1, 1]^d; each class of them is a frozen dataclass of ranges on top.

    A range (low, high) with low == high is a constant and adds no dimension. In the vector, -1 is low and 1 is high.
    Coordinates beyond the box count as its border.

    """

    @property
    @abstractmethod
    def margin_names(self) -> tuple[str, ...]:
        """Names of the margins of a design."""

    @property
    @abstractmethod
    def tensors(self) -> type[ChainTensors]:
        """The class of its designs."""

    @cached_property
    def plain(self) -> ChainTensors:
        """The design of `reference()`: its numbers of links and tendons are those of all designs."""
        with torch.no_grad():
            return self.chain(torch.as_tensor(self.reference()))

    @property
    def dimension(self) -> int:
        """Of the room in which its designs move, 2 or 3."""
        return int(self.plain.holes.shape[-1])

    @property
    def length(self) -> float:
        """Length of the mechanism of `reference()`, to scale by [mm]."""
        return float(self.plain.mechanism().length)

    @property
    @abstractmethod
    def groups(self) -> Mapping[str, NumberGroup]:
        """The numbers of a design, in the order of the vector."""

    @property
    def dimensions(self) -> int:
        """Length d of a vector."""
        return sum(part.free for part in self.groups.values())

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the entries of a vector, with units."""
        return tuple(label for part in self.groups.values() if part.free for label in part.labels)

    @property
    def low(self) -> Array:
        """Physical values at -1, (d,)."""
        return np.array([part.range[0] for part in self.groups.values() for _ in range(part.free)])

    @property
    def high(self) -> Array:
        """Physical values at 1, (d,)."""
        return np.array([part.range[1] for part in self.groups.values() for _ in range(part.free)])

    def physical(self, x: T) -> T:
        """Physical values of vectors, (..., d); an array for an array, a tensor for a tensor."""
        low, high = _like(x, self.low), _like(x, self.high)
        return 0.5 * (low + high) + 0.5 * (high - low) * x

    def unit(self, values: T) -> T:
        """Vectors of physical values, (..., d)."""
        low, high = _like(values, self.low), _like(values, self.high)
        return (2.0 * values - low - high) / (high - low)

    @abstractmethod
    def chain(self, x: Tensor) -> ChainTensors:
        """The designs (..., d) as mechanisms that can be differentiated; a row that is not finite is the reference.

        Raises:
            InvalidInput: a wrong length of the last axis.
        """

    @abstractmethod
    def reference(self) -> Array:
        """The vector of a plain design, (d,)."""

    def margins(self, x: Tensor) -> Tensor:
        """Margins of the designs (..., d), (..., len(margin_names)): 0 or more for a valid design; no unit.

        They can be differentiated. A row that is not finite has margins of -1.

        Raises:
            InvalidInput: a wrong length of the last axis.
        """
        rows = self._vectors(x)
        values = self._margins(rows.reshape(-1, self.dimensions))
        return torch.where(
            torch.isfinite(rows).all(-1, keepdim=True), values.reshape(*rows.shape[:-1], len(self.margin_names)), -1.0
        )

    @abstractmethod
    def _margins(self, x: Tensor) -> Tensor:
        """Margins of the designs (B, d), (B, len(margin_names))."""

    def mechanism(self, x: ArrayLike) -> Any:
        """The design (d,) as a mechanism.

        Raises:
            MechanismError: the design is not valid.
            InvalidInput: a vector outside the box.
        """
        vector = as_floats("x", x, f"{self.dimensions} numbers in [-1, 1]")
        if vector.shape != (self.dimensions,) or not np.all(np.abs(vector) <= 1.0 + 1e-9):
            raise InvalidInput("x", x, f"{self.dimensions} numbers in [-1, 1]", "Clip it, or see unit().")
        mechanism = self.chain(torch.as_tensor(vector)).mechanism()
        messages = self.faults(mechanism)
        if messages:
            values = self.margins(torch.as_tensor(vector)).numpy()
            worst = int(np.argmin(values))
            raise MechanismError(
                f"margin {self.margin_names[worst]!r} of the design",
                float(values[worst]),
                "0 or more",
                "; ".join(messages),
            )
        return mechanism

    @abstractmethod
    def faults(self, mechanism: Any) -> list[str]:
        """Faults of a mechanism, checked without the margins and without torch; empty for a valid mechanism."""

    def sample(self, count: int, generator: np.random.Generator, valid: bool = True) -> Array:
        """Vectors uniform in the box, (count, d), of valid designs alone unless `valid` is False.

        Raises:
            InvalidInput: hardly any design is valid.
        """
        if not valid:
            return generator.uniform(-1.0, 1.0, (count, self.dimensions))
        samples, drawn = np.empty((0, self.dimensions)), 0
        while len(samples) < count:
            x = generator.uniform(-1.0, 1.0, (_DRAWN, self.dimensions))
            with torch.no_grad():
                good = (self.margins(torch.as_tensor(x)) >= 0).all(-1).numpy()
            samples, drawn = np.concatenate([samples, x[good]]), drawn + _DRAWN
            if drawn >= _MOST_DRAWN and len(samples) < 1e-3 * drawn:
                raise InvalidInput(
                    "designs",
                    f"{len(samples)} valid of {drawn} drawn",
                    "at least 1 in 1000",
                    "Narrow the ranges around designs that are valid.",
                )
        return samples[:count]

    def _with_values(self, values: Mapping[str, ArrayLike]) -> Array:
        """The vector with these numbers by the names of groups, all else as in the reference, (d,).

        Raises:
            InvalidInput: a name without a range that is free, numbers outside it.
        """
        numbers, begin = self.physical(self.reference()), 0
        free = {name: part for name, part in self.groups.items() if part.free}
        for name in values:
            if name not in free:
                raise InvalidInput("number of the design", name, f"one of {', '.join(free)}")
        for name, part in free.items():
            if name in values:
                allowed = f"numbers in [{part.range[0]:g}, {part.range[1]:g}], one or {part.free}"
                entries = as_floats(name, values[name], allowed)
                if entries.shape not in ((), (part.free,)) or not _within(entries, part.range):
                    raise InvalidInput(name, values[name], allowed)
                numbers[begin : begin + part.free] = entries
            begin += part.free
        return self.unit(numbers)

    def _vectors(self, x: Tensor) -> Tensor:
        x = torch.as_tensor(x).to(torch.float64)
        if x.ndim == 0 or x.shape[-1] != self.dimensions:
            raise InvalidInput("shape of x", tuple(x.shape), f"(..., {self.dimensions})")
        return x

    def _blocks(self, x: Tensor) -> dict[str, Tensor]:
        """The physical numbers of vectors (B, d) by group, (B, numbers) each; constants broadcast."""
        finite = torch.isfinite(x).all(-1, keepdim=True)
        values = self.physical(torch.where(finite, x, torch.as_tensor(self.reference())).clamp(-1.0, 1.0))
        blocks, begin = {}, 0
        for name, part in self.groups.items():
            if part.free:
                blocks[name] = values[:, begin : begin + part.free]
                begin += part.free
            else:
                blocks[name] = values.new_full((1, 1), part.range[0]).expand(len(x), len(part.labels))
        return blocks


def _within(values: Array, ends: Range) -> bool:
    return bool(((values >= ends[0]) & (values <= ends[1])).all())


def _like(x: T, values: Array) -> T:
    return torch.as_tensor(values) if isinstance(x, Tensor) else values
