"""Networks that see the newest observations at once, in plain NumPy: SB3's VecFrameStack and a network behind it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from agents.policies.errors import PolicyError
from agents.policies.layers import ACTIVATIONS, Vectors, through
from agents.policies.network import Network
from rollingjoint.checks import as_integer

MOST_FRAMES = 1000


@dataclass(frozen=True)
class StackedNetwork(Network):
    """Fully connected layers that see `frames` observations at once, older ones first, zeros before an episode began.

    Args:
        frames: number of observations. mean, scale, clip: the normaliser of all of them, (frames · entries,) each.
            The others are those of Network, of an observation that is a vector.
    Raises:
        PolicyError: as Network; or an observation in parts, or a normaliser that is not of whole observations.
    """

    KIND = "stacked"
    DESCRIBED: ClassVar[tuple[str, ...]] = (*Network.DESCRIBED, "frames")

    frames: int

    def __post_init__(self) -> None:
        as_integer("frames", self.frames, low=2, high=MOST_FRAMES, error=PolicyError)
        if self.inputs or self.mean.size % self.frames:
            raise PolicyError("mean", self.mean.shape, f"{self.frames} observations, each in one part")
        super().__post_init__()

    def description(self) -> dict[str, Any]:
        """Plain values, ready for JSON: the network without its arrays."""
        return {"kind": self.KIND} | super().description()

    @property
    def entries(self) -> int:
        """Number of entries of one observation."""
        return self.mean.size // self.frames

    def _head_entries(self) -> int:
        return self.mean.size

    def start(self, episodes: int) -> Vectors:  # type: ignore[override]
        """The memory with which this many episodes begin: zeros, (episodes, (frames - 1) · entries)."""
        return np.zeros((episodes, (self.frames - 1) * self.entries), np.float32)

    def advance(self, observation: Any, memory: Vectors | None) -> tuple[Vectors, Vectors]:  # type: ignore[override]
        """The action, (m,) or (B, m), each within [low, high], and the newest frames - 1 observations after this step.

        Args:
            observation: (entries,) or (B, entries).
            memory: after the step before; None begins one episode per observation.
        Raises:
            PolicyError: another shape, numbers that are not finite, or another number of observations than the memory
                has rows.
        """
        x = self.vector(observation)
        rows = x.reshape(-1, self.entries).astype(np.float32)
        memory = self.start(len(rows)) if memory is None else memory
        self._check_rows(rows, memory)
        stacked = np.concatenate([memory, rows], axis=1)
        actions = self._bounded(through(self.layers, ACTIVATIONS[self.activation], self._scaled(stacked)))
        return actions.reshape(*x.shape[:-1], -1), stacked[:, self.entries :]

    def __call__(self, observation: Any) -> Vectors:
        """The action at the beginning of an episode; raises PolicyError as advance does."""
        return self.advance(observation, None)[0]
