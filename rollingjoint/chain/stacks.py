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
        count: how many. build: makes the one at a place, always the same one.
    """

    _build: Callable[[int], M]

    def __new__(cls, count: int, build: Callable[[int], M]) -> Self:
        """Keep a place for every mechanism."""
        made = super().__new__(cls, [None] * count)  # type: ignore[list-item]
        made._build = functools.cache(build)
        return made

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
    """D variations of one nominal mechanism, whose arrays are filled all at once and which are built when asked for.

    `solve_tensions_batch` and `solve_lengths_batch` take them as they are, one per row.

    Attributes:
        nominal: what they vary. They have its names, friction and numbers of links, tendons and crossed joints.
        stiffnesses: of their tendons, (D, m) [N/mm].
        arrays: of all of them, as one stack. designs: which of the stacked designs each has, (D,).
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
            return [self[each] for each in range(*place.indices(len(self)))]
        built = self._built[place]
        if built is None:
            built = self._built[place] = self._build(place)
        return built

    def take(self, rows: NDArray[np.int64], other: Variations[M], places: NDArray[np.int64]) -> bool:
        """Replace those in these rows by others, in place; whether that could be done."""
        if other.nominal is not self.nominal or not self._take(rows, other, places):
            return False
        self.stiffnesses[rows] = other.stiffnesses[places]
        self.neutral_angles[rows] = other.neutral_angles[places]
        for row, place in zip(rows.tolist(), places.tolist(), strict=True):
            self._built[row] = other._built[place]
        return True

    @abstractmethod
    def get_state(self) -> dict[str, Array]:
        """What makes them again from the nominal mechanism: arrays by the name of their argument, copied."""

    @abstractmethod
    def members(self) -> Deferred[M]:
        """What they are now, whatever `take` replaces later."""

    @abstractmethod
    def _take(self, rows: NDArray[np.int64], other: Any, places: NDArray[np.int64]) -> bool:
        """Replace what a class has of its own."""

    @abstractmethod
    def _build(self, place: int) -> M:
        """One of them, as a mechanism of its own."""


def designs_of(mechanism: AnyChain | Sequence[AnyChain], n_rows: int) -> tuple[Any, NDArray[np.int64]]:
    """The arrays of the distinct mechanisms as one stack, and which of them each row of a batch has, (B,).

    Raises:
        InvalidInput: more or fewer than one mechanism per row, or what `stack` refuses.
    """
    if isinstance(mechanism, Chain):
        return mechanism.arrays, np.zeros(n_rows, np.int64)
    if len(mechanism) != n_rows:
        raise InvalidInput("number of mechanisms", len(mechanism), f"{n_rows}, one per row of the batch")
    if isinstance(mechanism, Variations):
        return mechanism.arrays, mechanism.designs
    different = distinct(mechanism)
    places = {each: place for place, each in enumerate(different)}
    return stack(different), np.array([places[each] for each in mechanism], np.int64)


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
    for each in mechanisms[1:]:
        if (each.n_links, each.last_links) != (first.n_links, first.last_links):
            allowed = "as many links and tendons, crossing as many joints, as the first"
            raise InvalidInput("mechanism", each, allowed)
    return first.arrays if len(mechanisms) == 1 else first.join([each.arrays for each in mechanisms])
