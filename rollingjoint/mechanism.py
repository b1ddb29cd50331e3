"""The base class of all mechanisms, and stacks of several mechanisms of one family."""

from __future__ import annotations

import dataclasses
import functools
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from typing import Any, Generic, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.checks import as_floats
from rollingjoint.errors import InvalidInput, MechanismError
from rollingjoint.friction import NO_FRICTION, ROLLING_PRESLIDING, CapstanFriction, friction_coefficients

Array = NDArray[np.float64]
S = TypeVar("S", covariant=True)  # what a solve of the mechanism returns
_T = TypeVar("_T")

_SEARCHED = 101  # angles of a joint at which a shortest path is looked for


class Spares(dict[int, list[Any]]):
    """Memory that is kept for the next use; copies and pickles of it are empty, since kernels know where it lies."""

    def __reduce__(self) -> tuple[type[Spares], tuple[()]]:
        return Spares, ()


class Mechanism(ABC, Generic[S]):
    """A chain of joints with one angle each, base first, pulled by tendons; each family is a frozen dataclass on top.

    Attributes:
        tendons: at least one; each has a stiffness and last_link(n_links).
        name: for tables and pictures.
        friction: that of the tendons that have none of their own.
    """

    tendons: Any
    name: str
    friction: CapstanFriction | None = None

    def __repr__(self) -> str:
        kind = type(self).__name__
        return f"<{kind} {self.name!r}: {self.parts}, {self.n_tendons} tendons, {self.length:g} mm>"

    @property
    @abstractmethod
    def parts(self) -> str:
        """How many parts it consists of, in words, such as "5 links"."""

    @property
    @abstractmethod
    def n_links(self) -> int:
        """Number of links, the base included."""

    @cached_property
    def n_joints(self) -> int:
        """Number of joints."""
        return self.n_links - 1

    @cached_property
    def n_tendons(self) -> int:
        """Number of tendons."""
        return len(self.tendons)

    @property
    @abstractmethod
    def length(self) -> float:
        """Length of the mechanism at rest [mm]."""

    @cached_property
    def stiffnesses(self) -> Array:
        """Tendon stiffnesses, (m,) [N/mm]."""
        return read_only(np.array([tendon.stiffness for tendon in self.tendons]))

    @cached_property
    def has_friction(self) -> bool:
        """Whether friction changes anything."""
        chain = self.friction or NO_FRICTION
        return chain.rolling > 0.0 or any(each.acts for each in self._frictions)

    @cached_property
    def friction_coefficients(self) -> Array:
        """Columns of the kernels' FrictionLaw.tendons, (m, 5)."""
        return read_only(np.array([friction_coefficients(each) for each in self._frictions]))

    @cached_property
    def rolling_coefficients(self) -> Array:
        """Arm [mm] of the rolling resistance, and the turn over which it builds up [rad]."""
        return read_only(np.array([(self.friction or NO_FRICTION).rolling, ROLLING_PRESLIDING]))

    @cached_property
    def spares(self) -> Spares:
        """Memory that solves leave for the next ones, by the number of load rows."""
        return Spares()

    @property
    def _frictions(self) -> list[CapstanFriction]:
        return [tendon.friction or self.friction or NO_FRICTION for tendon in self.tendons]

    @cached_property
    def last_links(self) -> tuple[int, ...]:
        """The link where each tendon ends, counted from 0, (m,)."""
        return tuple(tendon.last_link(self.n_links) for tendon in self.tendons)

    @property
    @abstractmethod
    def joint_limits(self) -> Array:
        """Range of every joint, (n - 1, 2): of its contact's arc length [mm] or of its angle [rad]."""

    @property
    @abstractmethod
    def neutral_angles(self) -> Array:
        """Joint angles at rest, (n - 1,) [rad]."""

    @cached_property
    def neutral_lengths(self) -> Array:
        """Tendon lengths at rest, (m,) [mm]."""
        return read_only(self.tendon_lengths(self.neutral_angles))

    @cached_property
    def shortest_lengths(self) -> Array:
        """Shortest path of every tendon in any pose within the joints' limits, (m,) [mm].

        A path is a sum over the joints of what depends on one angle each, so every joint is searched by itself, at
        angles a hundredth of its range apart.
        """
        low, high = self.arrays.joints[0, :, :2].T
        each = np.arange(self.n_joints)  # the joint that turns, the last axis but one
        angles = np.tile(self.neutral_angles, (_SEARCHED, self.n_joints, 1))
        angles[:, each, each] = np.linspace(low, high, _SEARCHED)
        changes = self.tendon_lengths(angles) - self.neutral_lengths
        return read_only(self.neutral_lengths + changes.min(axis=0).sum(axis=0))

    @property
    @abstractmethod
    def arrays(self) -> Any:
        """Tables for the kernels, a stack of one design."""

    @abstractmethod
    def poses(self, joint_angles: ArrayLike) -> Array:
        """Link poses in the base frame, (..., n, 3) or (..., n, 4, 4)."""

    @abstractmethod
    def tendon_lengths(self, joint_angles: ArrayLike) -> Array:
        """Length of every tendon: gaps plus channels inside the links, (..., m) [mm]."""

    @abstractmethod
    def tendon_polyline(self, poses: ArrayLike) -> list[Array]:
        """World points of every tendon's holes, base to end, a list of (k, 2 or 3) [mm]."""

    @staticmethod
    @abstractmethod
    def join(parts: Sequence[Any]) -> Any:
        """The arrays of several mechanisms with the same numbers of links, tendons and crossed joints, as one stack."""

    def replace(self, **changes: Any) -> Self:
        """A copy with other fields, checked anew."""
        return dataclasses.replace(self, **changes)  # type: ignore[type-var]  # each family is a dataclass

    def per_joint(self, what: str, values: ArrayLike) -> Array:
        """The values as floats, one per joint in the last axis; InvalidInput for anything else."""
        allowed = f"{self.n_joints} numbers in the last axis, one per joint"
        array = as_floats(what, values, allowed)
        if array.ndim == 0 or array.shape[-1] != self.n_joints:
            raise InvalidInput(what, values, allowed)
        return array


AnyMechanism = Mechanism[Any]
M = TypeVar("M", bound=AnyMechanism)


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
        """Replace what a family has of its own."""

    @abstractmethod
    def _build(self, place: int) -> M:
        """One of them, as a mechanism of its own."""


def designs_of(mechanism: AnyMechanism | Sequence[AnyMechanism], n_rows: int) -> tuple[Any, NDArray[np.int64]]:
    """The arrays of the distinct mechanisms as one stack, and which of them each row of a batch has, (B,).

    Raises:
        InvalidInput: more or fewer than one mechanism per row, or what `stack` refuses.
    """
    if isinstance(mechanism, Mechanism):
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


def stack(mechanisms: Sequence[AnyMechanism]) -> Any:
    """The arrays of several mechanisms of one family as one stack; the rows of a batch choose theirs by its index.

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


def members(what: str, values: object, kind: type[_T], least: int = 1, note: str = "") -> tuple[_T, ...]:
    """The values as a tuple; MechanismError unless they are a list of at least `least` objects of that kind."""
    if not isinstance(values, Iterable):
        raise MechanismError(what, values, f"a list of {kind.__name__} objects")
    found = tuple(values)
    for i, member in enumerate(found):
        if not isinstance(member, kind):
            raise MechanismError(f"{what}[{i}]", member, f"a {kind.__name__}")
    if len(found) < least:
        raise MechanismError(f"number of {what}", len(found), f"{least} or more{note}")
    return found


def read_only(array: Array) -> Array:
    """The array, write-protected: what a mechanism computes once must not be changed by a caller."""
    array.setflags(write=False)
    return array
