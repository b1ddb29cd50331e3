"""The random generators of many lanes, from which a kernel draws for all of them at once."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.kernels import fill_uniforms


class Generators:
    """One generator per lane, or None where a lane has none yet.

    `fill` gives the numbers that each generator's `random` would give, without a call of Python per lane.
    """

    def __init__(self, each: Sequence[np.random.Generator | None]) -> None:
        self._each = list(each)
        self._sources = np.array([_source(rng) for rng in self._each], np.int64).reshape(-1, 2)

    def __len__(self) -> int:
        return len(self._each)

    def __getitem__(self, lane: int) -> np.random.Generator | None:
        return self._each[lane]

    def __setitem__(self, lane: int, rng: np.random.Generator | None) -> None:
        self._each[lane], self._sources[lane] = rng, _source(rng)

    def of(self, lanes: NDArray[np.int64]) -> Generators:
        """The generators of these lanes."""
        chosen = Generators(())
        chosen._each, chosen._sources = [self._each[lane] for lane in lanes], self._sources[lanes]
        return chosen

    def fill(self, rows: NDArray[np.float64]) -> None:
        """Fill row i, (len(self), K), with the next uniform numbers in [0, 1) of generator i."""
        fill_uniforms(self._sources, rows)

    def __getstate__(self) -> dict[str, Any]:
        return {"each": self._each}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(state["each"])  # type: ignore[misc]


Random = Sequence[np.random.Generator] | Generators
"""One generator per episode."""


def _source(rng: np.random.Generator | None) -> tuple[int, int]:
    """Addresses of the function that gives a generator's next number, and of the state that it works on."""
    if rng is None:
        return 0, 0
    interface = rng.bit_generator.ctypes
    return ctypes.cast(interface.next_double, ctypes.c_void_p).value or 0, interface.state_address
