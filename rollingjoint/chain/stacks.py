"""Several mechanisms of one class: as one stack of arrays, built when asked for, or variations of a nominal one."""

from __future__ import annotations

import functools
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.chain import AnyChain, Chain
from rollingjoint.errors import InvalidInput

Array = NDArray[np.float64]
M = TypeVar("M", bound=AnyChain)
_T = TypeVar("_T")


class Deferred(tuple[M, ...]):
    """A tuple of mechanisms, each of which is built when it is asked for.

    Args:
        count: number of mechanisms. build: makes the one at an index, always the same one.
    """

    _build: Callable[[int], M]

    def __new__(cls, count: int, build: Callable[[int], M]) -> Self:
        """A tuple of `count` mechanisms, none of them built yet."""
        deferred = super().__new__(cls, [None] * count)  # type: ignore[list-item]
        deferred._build = functools.cache(build)
        return deferred

    def __getitem__(self, place: Any) -> Any:
        places = range(len(self))[place]
        return tuple(map(self._build, places)) if isinstance(place, slice) else self._build(places)

    def __iter__(self) -> Iterator[M]:
        return map(self._build, range(len(self)))

    def __contains__(self, mechanism: object) -> bool:
        return mechanism in tuple(self)

    def __eq__(self, other: object) -> bool:
        return self is other or tuple(self) == other

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __hash__(self) -> int:
        return hash(tuple(self))

    def __repr__(self) -> str:
        return repr(tuple(self))

    def __reduce__(self) -> tuple[type[tuple[M, ...]], tuple[tuple[M, ...]]]:
        return tuple, (tuple(self),)


class Variations(Sequence[M]):
    """D variations of one nominal mechanism: arrays filled all at once, mechanisms built when asked for.

    `solve_tensions_batch` and `solve_lengths_batch` take them as they are, one per row.

    Attributes:
        nominal: the mechanism. Variations have its names, friction and numbers of links, tendons and crossed joints.
        stiffnesses: of their tendons, (D, m) [N/mm].
        arrays: of all of them, as one stack. designs: index of each one's design in the stack, (D,).
        neutral_angles: (D, n - 1) [rad].
    """

    arrays: Any
    designs: NDArray[np.int64]
    neutral_angles: Array

    def __init__(self, nominal: M, count: int, stiffnesses: Array) -> None:
        self.nominal, self.stiffnesses = nominal, stiffnesses
        self._built: list[M | None] = [None] * count

    def __len__(self) -> int:
        return len(self._built)

    def __getitem__(self, place: Any) -> Any:
        if isinstance(place, slice):
            return [self[index] for index in range(*place.indices(len(self)))]
        built = self._built[place]
        if built is None:
            built = self._built[place] = self._build(place)
        return built

    def take(self, rows: NDArray[np.int64], other: Variations[M], places: NDArray[np.int64]) -> bool:
        """Replace the variations in these rows by others, in place; False where that is not possible."""
        if other.nominal is not self.nominal or not self._take(rows, other, places):
            return False
        self.stiffnesses[rows] = other.stiffnesses[places]
        self.neutral_angles[rows] = other.neutral_angles[places]
        for row, place in zip(rows.tolist(), places.tolist(), strict=True):
            self._built[row] = other._built[place]
        return True

    @abstractmethod
    def get_state(self) -> dict[str, Array]:
        """Arguments that make them again from the nominal mechanism: arrays by name, copied."""

    @abstractmethod
    def members(self) -> Deferred[M]:
        """Their present values, unchanged by a later `take`."""

    @abstractmethod
    def _take(self, rows: NDArray[np.int64], other: Any, places: NDArray[np.int64]) -> bool:
        """Replace the arrays that a class adds; False where that is not possible."""

    @abstractmethod
    def _build(self, place: int) -> M:
        """The mechanism of one variation."""


def designs_of(mechanism: AnyChain | Sequence[AnyChain], n_rows: int) -> tuple[Any, NDArray[np.int64]]:
    """The arrays of the distinct mechanisms as one stack, and the index of each row's among them, (B,).

    Raises:
        InvalidInput: more or fewer than one mechanism per row, or mechanisms that do not `stack`.
    """
    if isinstance(mechanism, Chain):
        return mechanism.arrays, np.zeros(n_rows, np.int64)
    if len(mechanism) != n_rows:
        raise InvalidInput("number of mechanisms", len(mechanism), f"{n_rows}, one per row of the batch")
    if isinstance(mechanism, Variations):
        return mechanism.arrays, mechanism.designs
    different = distinct(mechanism)
    places = {chain: place for place, chain in enumerate(different)}
    return stack(different), np.array([places[chain] for chain in mechanism], np.int64)


def distinct(mechanisms: Iterable[_T]) -> tuple[_T, ...]:
    """The distinct mechanisms, in the order of their first occurrence."""
    return tuple(dict.fromkeys(mechanisms))


def stack(mechanisms: Sequence[AnyChain]) -> Any:
    """The arrays of several mechanisms of one class as one stack; the rows of a batch choose theirs by its index.

    Raises:
        InvalidInput: mechanisms with different numbers of links, tendons or crossed joints.
    """
    if isinstance(mechanisms, Variations):
        return mechanisms.arrays
    first = mechanisms[0]
    for chain in mechanisms[1:]:
        if (chain.n_links, chain.last_links) != (first.n_links, first.last_links):
            allowed = "as many links and tendons, crossing as many joints, as the first"
            raise InvalidInput("mechanism", chain, allowed)
    return first.arrays if len(mechanisms) == 1 else first.join([chain.arrays for chain in mechanisms])
