"""The base class of all mechanisms: chains of joints with one angle each."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import Any, ClassVar, Generic, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.checks import as_floats
from rollingjoint.errors import InvalidInput, MechanismError
from rollingjoint.friction import NO_FRICTION, ROLLING_PRESLIDING, CapstanFriction, friction_coefficients
from rollingjoint.load import Gravity, Load, checked_springs

Array = NDArray[np.float64]
S = TypeVar("S", covariant=True)  # the equilibrium of the mechanism
_T = TypeVar("_T")

_SEARCHED = 101  # angles of a joint that a search for the shortest path tries


class Spares(dict[tuple[Any, ...], list[Any]]):
    """Memory that is kept for the next use; copies and pickles of it are empty, since kernels know where it lies."""

    def __reduce__(self) -> tuple[type[Spares], tuple[()]]:
        return Spares, ()


@dataclasses.dataclass(frozen=True, eq=False)
class Kernels:
    """The compiled code of a class of chains, which solves its batches in SIMD lanes.

    Rows that the lanes leave go to the general solver (kernels.batch), which knows the class by its arrays.

    Attributes:
        batch_arrays: NamedTuple of problems, and of arrays for their results: chain, from `stack`; designs: index of
            each row's mechanism in the stack, (B,); laws: (B, m) each; loads: load tables, (B, rows, columns);
            starts: joint angles, (B, J) [rad]; results: from `new_results`. All arrays are contiguous.
        new_results: empty outputs of (rows, joints, tendons).
        torques: the output that holds d residual / d tension without friction.
        pivots: the output that holds the points about which joints turn; "": the origins of the links below.
        pinned_batch: NamedTuple of a batch and the memory of `memory`; address for both kernels below.
        solve, solve_alone: of (address, first, last), eight rows side by side or one by one; number of rows left.
        memory: of a batch, the memory in which a batch of one row is solved.
        most_joints: longer chains are left to the general solver.
        step: of the fields of a batch, FrictionArrays, first and last; number of rows left.
        most_with_friction: longer chains take steps with friction in the general solver; 0: all do.
    """

    batch_arrays: type[Any]
    new_results: Callable[..., Any]
    torques: str
    pinned_batch: type[Any]
    solve: Any
    solve_alone: Any
    memory: Callable[[Any], Array]
    most_joints: int
    step: Any = None
    most_with_friction: int = 0
    pivots: str = ""


class Chain(ABC, Generic[S]):
    """A mechanism: a chain of joints with one angle each, base first, pulled by tendons.

    Each class of chains is a frozen dataclass on top.

    Attributes:
        tendons: at least one; each has a stiffness and last_link(n_links).
        name: for tables and pictures.
        friction: default of the tendons.
        springs: loads that belong to the mechanism and act in every solve; their kinds are load.SPRINGS.

    Attributes of its class:
        title: name of such a mechanism in messages.
        dimension: coordinates of a point, 2 or 3.
        joint: name of a joint in messages.
        load_columns: columns of its load tables.
        kernels: the compiled code that solves it. equilibrium: the class of its solutions.
        slips: True where its joints are contacts, which may slip.
    """

    title: ClassVar[str]
    dimension: ClassVar[int]
    joint: ClassVar[str] = "joint"
    load_columns: ClassVar[tuple[str, ...]]
    kernels: ClassVar[Kernels]
    equilibrium: ClassVar[type[Any]]
    slips: ClassVar[bool] = False

    tendons: Any
    name: str
    friction: CapstanFriction | None = None
    springs: Sequence[Load] = ()

    def __repr__(self) -> str:
        kind = type(self).__name__
        return f"<{kind} {self.name!r}: {self.parts}, {self.n_tendons} tendons, {self.length:g} mm>"

    @property
    @abstractmethod
    def parts(self) -> str:
        """Number of its parts, in words, such as "5 links"."""

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
        """True if any coefficient of friction is not zero."""
        chain = self.friction or NO_FRICTION
        return chain.rolling > 0.0 or any(friction.acts for friction in self._frictions)

    @cached_property
    def friction_coefficients(self) -> Array:
        """Columns of the kernels' FrictionLaw.tendons, (m, 5)."""
        return read_only(np.array([friction_coefficients(friction) for friction in self._frictions]))

    @cached_property
    def rolling_coefficients(self) -> Array:
        """Arm [mm] of the rolling resistance, and the turn over which it builds up [rad]."""
        return read_only(np.array([(self.friction or NO_FRICTION).rolling, ROLLING_PRESLIDING]))

    @cached_property
    def spares(self) -> Spares:
        """Memory that solves leave for the next ones, by its class and the number of load rows."""
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

        A path is a sum of functions of one joint angle each, so every joint is searched by itself, at angles a
        hundredth of its range apart.
        """
        low, high = self.arrays.joints[0, :, :2].T
        joints = np.arange(self.n_joints)  # the joint that turns, the last axis but one
        angles = np.tile(self.neutral_angles, (_SEARCHED, self.n_joints, 1))
        angles[:, joints, joints] = np.linspace(low, high, _SEARCHED)
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

    @property
    @abstractmethod
    def travel(self) -> str:
        """Range of the joints, in words."""

    @abstractmethod
    def load_table(self, loads: Sequence[Load]) -> Array:
        """Load table of external loads, (rows, columns); InvalidInput for loads that it cannot have."""

    def _checked_springs(self) -> tuple[Load, ...]:
        """Its springs, with plain numbers in their fields; MechanismError where one of them is not possible."""
        try:
            springs = checked_springs(self.springs, self.n_links, self.dimension)
            self.load_table(springs)
        except InvalidInput as error:
            raise MechanismError(error.what, error.value, error.allowed) from None
        return springs

    def start_angles(self, values: Sequence[float]) -> Array:
        """Joint angles [rad] of joints at places given in the unit of `joint_limits`, (n - 1,)."""
        return self.per_joint("start", values)

    def own_weight(self, direction: Any) -> Gravity | None:
        """Its weight along a direction; None where its parts have no weights."""
        return None

    @staticmethod
    @abstractmethod
    def join(parts: Sequence[Any]) -> Any:
        """The arrays of several mechanisms with the same numbers of links, tendons and crossed joints, as one stack."""

    def replace(self, **changes: Any) -> Self:
        """A copy with other fields, checked anew."""
        return dataclasses.replace(self, **changes)  # type: ignore[type-var]  # each class is a dataclass

    def per_joint(self, what: str, values: ArrayLike) -> Array:
        """The values as floats, one per joint in the last axis; InvalidInput for anything else."""
        allowed = f"{self.n_joints} numbers in the last axis, one per joint"
        array = as_floats(what, values, allowed)
        if array.ndim == 0 or array.shape[-1] != self.n_joints:
            raise InvalidInput(what, values, allowed)
        return array


AnyChain = Chain[Any]


def kinds() -> str:
    """The classes of chains, for messages."""
    return " or ".join(f"a {kind.__name__}" for kind in sorted(Chain.__subclasses__(), key=lambda kind: kind.dimension))


def check_chain(mechanism: object) -> None:
    """Raise InvalidInput unless it is a mechanism."""
    if not hasattr(type(mechanism), "kernels"):  # isinstance takes five times as long with an abstract class
        raise InvalidInput("mechanism", mechanism, kinds(), "rollingjoint.preset(name) makes a named one.")


def members(what: str, values: object, kind: type[_T], minimum: int = 1, note: str = "") -> tuple[_T, ...]:
    """The values as a tuple; MechanismError unless they are a list of at least `minimum` objects of that kind."""
    if not isinstance(values, Iterable):
        raise MechanismError(what, values, f"a list of {kind.__name__} objects")
    checked = tuple(values)
    for i, member in enumerate(checked):
        if not isinstance(member, kind):
            raise MechanismError(f"{what}[{i}]", member, f"a {kind.__name__}")
    if len(checked) < minimum:
        raise MechanismError(f"number of {what}", len(checked), f"{minimum} or more{note}")
    return checked


def read_only(array: Array) -> Array:
    """The array, write-protected: results of a mechanism are shared by its callers."""
    array.setflags(write=False)
    return array


def with_equal_rows(parts: Sequence[Any]) -> list[Any]:
    """Arrays of mechanisms, tables of springs padded to the same number of rows; rows of zeros have no effect."""
    rows = max(part.standing.shape[1] for part in parts)
    return [
        part._replace(standing=np.pad(part.standing, ((0, 0), (0, rows - part.standing.shape[1]), (0, 0))))
        if part.standing.shape[1] < rows
        else part
        for part in parts
    ]
