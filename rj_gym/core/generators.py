"""The random generators of many lanes, their states, and uniform numbers that a kernel draws from all at once."""

from __future__ import annotations

import ctypes
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.arguments import HINT, checked_parts
from rollingjoint.compiled import kernel, next_uniform
from rollingjoint.errors import InvalidInput

Array = NDArray[np.float64]
Shapes = dict[str, tuple[int, ...]]
"""Shapes of the uniform numbers of an episode, by name."""


class Generators:
    """One generator per lane, or None where a lane has none yet.

    `fill` gives the numbers that each generator's `random` would give, without a call of Python per lane.
    """

    def __init__(self, generators: Sequence[np.random.Generator | None]) -> None:
        self._each = list(generators)
        self._sources = np.array([_source(rng) for rng in self._each], np.int64).reshape(-1, 2)

    def __len__(self) -> int:
        return len(self._each)

    def __getitem__(self, lane: int) -> np.random.Generator | None:
        return self._each[lane]

    def __setitem__(self, lane: int, rng: np.random.Generator | None) -> None:
        self._each[lane], self._sources[lane] = rng, _source(rng)

    def of(self, lanes: NDArray[np.int64]) -> Generators:
        """The generators of these lanes."""
        subset = Generators(())
        subset._each, subset._sources = [self._each[lane] for lane in lanes], self._sources[lanes]
        return subset

    def fill(self, rows: Array) -> None:
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


class UniformBlock(NamedTuple):
    """Where one quantity's uniform numbers stand in the row of an episode, and their shape."""

    start: int
    stop: int
    shape: tuple[int, ...]


class Uniforms:
    """Uniform numbers in [0, 1): one row per episode, the blocks of it by name, (B, *shape) each, read-only.

    Args:
        blocks: from blocks_of.
        rngs: one generator per episode; each is asked once.
    """

    def __init__(self, blocks: dict[str, UniformBlock], rngs: Random) -> None:
        self._blocks = blocks
        self._rows: Array = np.empty((len(rngs), next(reversed(blocks.values())).stop))
        if isinstance(rngs, Generators):
            rngs.fill(self._rows)
        else:
            for rng, row in zip(rngs, self._rows, strict=True):
                rng.random(out=row)

    def __getitem__(self, name: str) -> Array:
        start, stop, shape = self._blocks[name]
        block = self._rows[:, start:stop]
        return block if len(shape) == 1 else block.reshape(-1, *shape)

    def __len__(self) -> int:
        return len(self._rows)


def blocks_of(shapes: Shapes) -> dict[str, UniformBlock]:
    """Blocks of these shapes, one after the other."""
    stops = list(itertools.accumulate(map(math.prod, shapes.values())))
    return dict(zip(shapes, map(UniformBlock, [0, *stops], stops, shapes.values()), strict=False))


def generator_states(generators: Generators) -> list[dict[str, Any] | None]:
    """The states of the random generators, None for a lane that has none yet."""
    single = (generators[lane] for lane in range(len(generators)))
    return [None if rng is None else dict(rng.bit_generator.state) for rng in single]


def check_generator_states(states: object, lanes: int) -> None:
    """Raise InvalidInput unless these are states, or None, of `lanes` generators, as NumPy's PCG64 can have them."""
    where, template = "state: generators", np.random.PCG64(0).state
    if not isinstance(states, Sequence) or len(states) != lanes:
        raise InvalidInput(where, states, f"a list of {lanes} states", HINT)
    limits = {"state": 2**128, "inc": 2**128, "uinteger": 2**32, "has_uint32": 2}
    for state in states:
        if state is None:
            continue
        checked_parts(checked_parts(state, tuple(template), where)["state"], ("state", "inc"), where)
        for name, value in {**state, **state["state"]}.items():
            if name in limits and not (type(value) is int and 0 <= value < limits[name]):
                raise InvalidInput(f"{where}: {name}", value, f"an integer from 0 to {limits[name] - 1}", HINT)
        if state["bit_generator"] != template["bit_generator"]:
            raise InvalidInput(where, state["bit_generator"], template["bit_generator"], HINT)


def set_generator_states(generators: Generators, states: Sequence[Mapping[str, Any] | None]) -> None:
    """Give generators states that were checked; lanes get one where they had none."""
    for lane, state in enumerate(states):
        rng = generators[lane]
        if state is None or rng is None:
            generators[lane] = rng = None if state is None else np.random.Generator(np.random.PCG64(0))
        if rng is not None and state is not None:
            rng.bit_generator.state = state


@kernel(short_loops=True, title="the environments")
def fill_uniforms(sources: Any, rows: Any) -> None:
    """Fill rows (B, K) with numbers in [0, 1) from bit generators: (B, 2), next_double and the state it works on."""
    for row in range(len(rows)):
        entry, source = sources[row, 0], sources[row, 1]
        for column in range(rows.shape[1]):
            rows[row, column] = next_uniform(entry, source)  # type: ignore[call-arg]
