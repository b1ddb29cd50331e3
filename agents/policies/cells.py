"""Recurrent cells in plain NumPy, with the equations and the order of rows of torch.nn.GRU and torch.nn.LSTM."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from agents.policies.errors import PolicyError
from agents.policies.layers import Vectors

NAMES = ("input_weights", "memory_weights", "input_biases", "memory_biases")
PREFIX = "cell."


@dataclass(frozen=True)
class Cell(ABC):
    """One recurrent layer of width w that sees e entries; its arrays have one block of w rows per gate.

    Args:
        input_weights: (gates · w, e) float32. memory_weights: (gates · w, w).
        input_biases, memory_biases: (gates · w,) each.
    """

    KIND: ClassVar[str]
    GATES: ClassVar[int]
    STATES: ClassVar[int]  # vectors of w numbers in the memory, the output first

    input_weights: Vectors
    memory_weights: Vectors
    input_biases: Vectors
    memory_biases: Vectors

    @property
    def width(self) -> int:
        """Number of entries of the output."""
        return self.input_biases.size // self.GATES

    def check(self, entries: int) -> None:
        """Raise PolicyError unless the arrays fit to each other and to `entries`, the inputs of the cell."""
        rows = self.GATES * self.width
        shapes = ((rows, entries), (rows, self.width), (rows,), (rows,))
        for name, shape in zip(NAMES, shapes, strict=True):
            actual = getattr(self, name).shape
            if actual != shape or rows == 0:
                raise PolicyError(f"{PREFIX}{name}", actual, f"the shape {shape}, not empty")

    def tensors(self) -> dict[str, NDArray[Any]]:
        """All arrays of the cell in a policy file, by name."""
        return {f"{PREFIX}{name}": getattr(self, name) for name in NAMES}

    @abstractmethod
    def step(self, x: Vectors, memory: Vectors) -> Vectors:
        """The memory (B, STATES · w) after seeing x (B, e); its first w entries are the output."""

    def _rows(self, x: Vectors, h: Vectors) -> tuple[Vectors, Vectors]:
        """W x + b for all gates, (B, gates · w) each: of the input, and of the last output."""
        return x @ self.input_weights.T + self.input_biases, h @ self.memory_weights.T + self.memory_biases


@dataclass(frozen=True)
class Gru(Cell):
    """A gated recurrent unit.

    r = σ(W_ir x + b_ir + W_hr h + b_hr), z = σ(W_iz x + b_iz + W_hz h + b_hz),
    n = tanh(W_in x + b_in + r (W_hn h + b_hn)), h' = (1 - z) n + z h; the rows are in the order r, z, n.
    """

    KIND, GATES, STATES = "gru", 3, 1

    def step(self, x: Vectors, memory: Vectors) -> Vectors:
        """The output h' (B, w) after seeing x (B, e), which is all of the memory."""
        inputs, remembered = self._rows(x, memory)
        w = self.width
        gates = _sigmoid(inputs[:, : 2 * w] + remembered[:, : 2 * w])
        n = np.tanh(inputs[:, 2 * w :] + gates[:, :w] * remembered[:, 2 * w :])
        return n + gates[:, w:] * (memory - n)


@dataclass(frozen=True)
class Lstm(Cell):
    """Long short-term memory.

    i, f, o = σ(W x + b + W' h + b') and g = tanh(...) likewise, c' = f c + i g, h' = o tanh(c'); the rows are in the
    order i, f, g, o.
    """

    KIND, GATES, STATES = "lstm", 4, 2

    def step(self, x: Vectors, memory: Vectors) -> Vectors:
        """The output and the cell state [h', c'] (B, 2 w) after seeing x (B, e)."""
        w = self.width
        inputs, remembered = self._rows(x, memory[:, :w])
        i, f, g, o = np.split(inputs + remembered, self.GATES, axis=-1)
        c = _sigmoid(f) * memory[:, w:] + _sigmoid(i) * np.tanh(g)
        return np.concatenate([_sigmoid(o) * np.tanh(c), c], axis=-1)


CELLS: dict[str, type[Cell]] = {cell.KIND: cell for cell in (Gru, Lstm)}


def cell_in(tensors: Mapping[str, NDArray[Any]], kind: str) -> Cell:
    """The cell of this kind from its arrays among the tensors; a missing array is empty."""
    if kind not in CELLS:
        raise PolicyError("cell", kind, f"one of {', '.join(CELLS)}")
    missing = np.zeros(0, np.float32)
    return CELLS[kind](*(tensors.get(f"{PREFIX}{name}", missing) for name in NAMES))


def _sigmoid(x: Vectors) -> Vectors:
    half = np.float32(0.5)
    return half + half * np.tanh(half * x)
