"""The base class of all equilibria: stiffness, stability and friction."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cache, cached_property
from typing import Any, ClassVar, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.chain import read_only
from rollingjoint.chain.friction_step import FrictionStep, check_shape, friction_laws, no_friction, virgin_state
from rollingjoint.chain.stacks import designs_of
from rollingjoint.chain.status import STATUSES, Status, codes_of
from rollingjoint.chain.wall_step import WALL_OUTPUTS, WallStep, step_class
from rollingjoint.errors import InvalidInput, SolverError
from rollingjoint.friction import FrictionState
from rollingjoint.kernels.batch import stiffness_of
from rollingjoint.kernels.friction import History
from rollingjoint.kernels.rubbed import rubbed_stiffness_of
from rollingjoint.load import check_table
from rollingjoint.tables import Column

Array = NDArray[np.float64]
_S = TypeVar("_S")


_APART = ("mechanism", "loads", "status", "friction", "walls")  # fields that are no outputs of kernels, or may be None
_AT_LIMIT = 1e-12  # rad: so near to its limit a joint is at it
_FAR = 1e15  # eigenvalue assigned to joints that are held


def strictly_within(angles: Array, low: Array, high: Array) -> NDArray[np.bool_]:
    """True where joint angles are between their limits and not at them, arrays of one shape [rad]."""
    return (angles > low + _AT_LIMIT) & (angles < high - _AT_LIMIT)


def stacked(solutions: Sequence[Any]) -> Any:
    """Equilibria of one mechanism as one with a leading axis; tables of fewer loads are padded with rows of zeros."""
    first = solutions[0]
    rows = max(len(solution.loads) for solution in solutions)
    tables = [np.pad(solution.loads, ((0, rows - len(solution.loads)), (0, 0))) for solution in solutions]
    names = [entry.name for entry in fields(first) if entry.name not in _APART]
    arrays = {name: np.array([getattr(solution, name) for solution in solutions]) for name in names}
    arrays["status"] = np.array([int(solution.status) for solution in solutions])
    friction = None
    if any(solution.friction is not None for solution in solutions):
        steps = [solution.friction or _no_friction(solution) for solution in solutions]
        state = FrictionState(*map(np.array, zip(*(step.state for step in steps), strict=True)))
        gap_tensions, slip, work = (np.array([getattr(s, n) for s in steps]) for n in ("gap_tensions", "slip", "work"))
        friction = FrictionStep(gap_tensions, slip, work, state)
    walls = None if first.walls is None else type(first.walls).stacked([solution.walls for solution in solutions])
    return replace(first, loads=np.array(tables), friction=friction, walls=walls, **arrays)


def _no_friction(solution: Solution) -> FrictionStep:
    return FrictionStep(solution.gap_tensions, solution.slip, solution.dissipated_work, solution.friction_state)


Outputs = tuple[Array, bytes, dict[str, tuple[tuple[int, ...], int]]]
"""The arrays of one equilibrium: joint angles, the memory of all, and the shape and first byte of each.

A plain tuple: a NamedTuple takes four times as long to make.
"""


class _LazyField:
    """A field that is made from the outputs at its first use, which saves a third of the time of a solve."""

    def __init__(self, field: str, part: str, columns: slice | None) -> None:
        self.field, self.part, self.columns = field, part, columns

    def __get__(self, solution: Any, owner: type) -> Any:
        if solution is None:
            return self
        values = solution.__dict__
        _, memory, places = values["_outputs"]
        shape, first = places[self.part]
        array = np.ndarray(shape, float, memory, first)
        values[self.field] = array if self.columns is None else array[..., self.columns]
        return values[self.field]


class _LazyWalls:
    """The field `walls`, likewise."""

    def __get__(self, solution: Any, owner: type) -> Any:
        if solution is None:
            return None
        values = solution.__dict__
        if "_around" not in values:
            return None
        (walls, jumped), (_, memory, places) = values["_around"], values["_outputs"]
        base, gaps, normals, states, forces = (
            np.ndarray(places[name][0], float, memory, places[name][1]) for name in WALL_OUTPUTS
        )
        values["walls"] = step_class(walls)(walls, 0, base, gaps, normals, states, forces, 0.0, jumped)
        return values["walls"]


def lazy_fields(**places: str | tuple[str, slice]) -> Callable[[type[_S]], type[_S]]:
    """Decorator of a dataclass with fields that come from Outputs unless given: by name there, or name and columns."""

    def add(cls: type[_S]) -> type[_S]:
        lazy = {}
        for name, place in places.items():
            part, columns = (place, None) if isinstance(place, str) else place
            lazy[name] = _LazyField(name, part, columns)
            setattr(cls, name, lazy[name])
        cls._lazy_fields = getattr(cls, "_lazy_fields", {}) | lazy  # type: ignore[attr-defined]
        return cls

    return add


@lazy_fields(poses="poses", tensions="tensions", lengths="lengths", tendon_rates="rates", tendon_stiffness="elastic")
@dataclass(frozen=True, eq=False, repr=False)
class Solution(ABC):
    """One equilibrium, or many with a leading axis B on every array, all read-only; each class of chains adds to it.

    Attributes:
        mechanism: the mechanism, or a tuple of mechanisms, one per row.
        loads: load table, (rows, columns), columns as of the mechanism.
        joint_angles: (n - 1,) angle of every joint [rad].
        poses: of every link in the base frame: (n, 3) x, y, angle [mm, rad], or (n, 4, 4) frames [mm].
        tensions: (m,) [N]. lengths: (m,) tendon lengths [mm].
        tendon_rates: (n - 1, m) d length / d joint angle [mm/rad].
        tendon_stiffness: (m,) d tension / d length [N/mm]: zero for a prescribed tension, a slack or a yielding tendon.
        residual: largest joint moment that is not balanced, joints at their limit left out [N·mm].
        iterations: Newton steps. status: Status, or (B,) integers.
        friction: results of friction; None for a solve without a history, or of a mechanism without friction.
        walls: contact with walls; None for a solve without surroundings.
    """

    mechanism: Any
    loads: Array
    joint_angles: Array
    poses: Array
    tensions: Array
    lengths: Array
    tendon_rates: Array
    tendon_stiffness: Array
    residual: float | Array
    iterations: int | NDArray[np.int64]
    status: Status | NDArray[np.int64]
    friction: FrictionStep | None = field(default=None, kw_only=True)
    walls: WallStep | None = field(default=None, kw_only=True)

    _lazy_fields: ClassVar[dict[str, _LazyField]]  # by the names of their fields
    _NUMBER: ClassVar[str]  # a field that is a number, which a class adds

    def __post_init__(self) -> None:
        """Check the fields, from a caller or `dataclasses.replace`: kernels use these arrays unchecked."""
        mechanism, rows = self._one, self._codes.shape
        for name, shape in self._shapes(mechanism.n_joints, mechanism.n_tendons).items():
            check_shape(name, getattr(self, name), (*rows, *shape))
        if self.friction is not None:
            self.friction.check(rows, mechanism.n_joints, mechanism.n_tendons)
        if self.walls is not None:
            self.walls.check(rows, mechanism.n_links)
        if np.ndim(self.loads) != len(rows) + 2 or np.shape(self.loads)[:-2] != rows:
            raise InvalidInput("shape of loads", np.shape(self.loads), f"{(*rows, 'rows', 'columns')}")
        check_table(self.loads, mechanism.load_columns, mechanism.n_links)
        for name, value in list(vars(self).items()):
            if isinstance(value, np.ndarray) and value.flags.writeable:
                object.__setattr__(self, name, read_only(value.copy()))

    @classmethod
    def of_results(
        cls,
        mechanism: Any,
        table: Array,
        results: Any,
        friction: FrictionStep | None = None,
        walls: WallStep | None = None,
    ) -> Self:
        """The equilibria in the outputs of a batch; mechanism: one, or one per row."""
        for array in (table, *results):
            array.setflags(write=False)
        values = {"mechanism": mechanism, "loads": table, "friction": friction, "walls": walls}
        for name, place, columns in cls._places(results._fields):
            values[name] = results[place] if columns is None else results[place][..., columns]
        return cls.filled(values)

    @classmethod
    @cache
    def _places(cls, outputs: tuple[str, ...]) -> list[tuple[str, int, slice | None]]:
        """Places of the fields in outputs of these names: name, number of the output, its columns."""
        apart = set(_APART) - {"status"}
        names = [entry.name for entry in fields(cls) if entry.name not in apart]
        lazy = [cls._lazy_fields.get(name) or _LazyField(name, name, None) for name in names]
        return [(part.field, outputs.index(part.part), part.columns) for part in lazy]

    @classmethod
    def of_outputs(
        cls,
        mechanism: Any,
        table: Array,
        outputs: Outputs,
        residual: float,
        iterations: int,
        status: int,
        number: int | None = None,
        around: tuple[Any, bool] | None = None,
    ) -> Self:
        """One equilibrium, its arrays made from its outputs at their first use.

        number: value of the field that the class adds. around: walls around the mechanism, and whether it jumped.
        """
        values = {
            "mechanism": mechanism,
            "loads": table,
            "joint_angles": outputs[0],
            "residual": residual,
            "iterations": iterations,
            "status": STATUSES[status],
            "friction": None,
            "_outputs": outputs,
        }
        if around is None:
            values["walls"] = None
        else:
            values["_around"] = around
        if number is not None:
            values[cls._NUMBER] = number
        return cls.filled(values)

    @classmethod
    def filled(cls, values: dict[str, Any]) -> Self:
        """The equilibrium of these fields, which kernels have filled: it keeps them, unchecked and uncopied."""
        solution = object.__new__(cls)
        object.__setattr__(solution, "__dict__", values)  # as it is: copying it takes a microsecond
        return solution

    def __getstate__(self) -> dict[str, Any]:
        """All fields, arrays of the outputs included."""
        state = vars(self) | {entry.name: getattr(self, entry.name) for entry in fields(self)}
        return {name: value for name, value in state.items() if name not in ("_outputs", "_around")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the fields, arrays read-only: unpickled ones are writable."""
        for value in state.values():
            if isinstance(value, np.ndarray):
                read_only(value)
        vars(self).update(state)

    @property
    def base_among_walls(self) -> Array | None:
        """Pose of the base among walls: (3,) x, y [mm], angle [rad], in space (6,) x, y, z [mm], rotation vector [rad].

        None without surroundings.
        """
        if "_around" not in self.__dict__ or "walls" in self.__dict__:
            return None if self.walls is None else self.walls.base
        _, memory, places = self.__dict__["_outputs"]  # its walls have not been asked for yet
        return np.ndarray(places["wall_base"][0], float, memory, places["wall_base"][1])

    @property
    def ok(self) -> bool | NDArray[np.bool_]:
        """True for a stable equilibrium (Status CONVERGED or AT_LIMIT)."""
        stable = Status.usable(self.status)
        return bool(stable) if stable.ndim == 0 else stable

    @property
    def _codes(self) -> NDArray[np.int64]:
        """(B,) or () status as integers."""
        return codes_of(self.status)

    def row(self, index: int) -> Self:
        """One equilibrium of many."""
        names = [entry.name for entry in fields(self) if entry.name not in _APART]
        values = {name: getattr(self, name)[index] for name in names}
        plain = {name: value.item() if np.ndim(value) == 0 else value for name, value in values.items()}
        mechanism = self.mechanism[index] if isinstance(self.mechanism, tuple) else self.mechanism
        friction = None if self.friction is None else self.friction.row(index)
        status = Status(int(self._codes[index]))
        walls = None if self.walls is None else self.walls.row(index)
        plain |= {"mechanism": mechanism, "loads": self.loads[index], "status": status}
        plain |= {"friction": friction, "walls": walls}
        return self.filled(plain)

    def with_rows(self, rows: NDArray[np.int64], others: Self) -> Self:
        """Many equilibria without friction or walls, of which those of some rows are replaced."""
        arrays = {}
        for name in (entry.name for entry in fields(self) if entry.name not in ("mechanism", "friction", "walls")):
            arrays[name] = getattr(self, name).copy()
            arrays[name][rows] = getattr(others, name)
            read_only(arrays[name])
        return replace(self, **arrays)

    @property
    @abstractmethod
    def positions(self) -> Array:
        """Origins of the links, (n, 2 or 3) [mm]."""

    @property
    def tip(self) -> Array:
        """Origin of the last link, (2,) or (3,) [mm]."""
        return self.positions[..., -1, :]

    @property
    def pose_jacobian(self) -> Array:
        """(n, 3 or 6, n - 1) d link poses / d joint angles [mm/rad, 1].

        Poses are (x, y, angle) in the plane; in space (x, y, z, rotation vector), base frame.
        """
        n = self.positions.shape[-2]
        arms = self.positions[..., :, None, :] - self._pivots[..., None, :, :]
        return self._twists(arms) * np.tri(n, n - 1, -1)[:, None]  # joint i moves link k > i

    @property
    def torques_per_tension(self) -> Array:
        """(n - 1, m) d residual / d tension at the motor [mm]: without friction the rates of the lengths."""
        if self.friction is not None:
            return self._with_friction[1] if self.walls is None else self._among_walls[1]
        return self.tendon_rates

    @property
    def gap_tensions(self) -> Array:
        """(n - 1, m) tension of every tendon in every gap, 0 beyond its end [N]; `tensions` are at the motor."""
        if self.friction is not None:
            return self.friction.gap_tensions
        return np.where(self._crossed, self.tensions[..., None, :], 0.0)

    @cached_property
    def friction_state(self) -> FrictionState:
        """State of friction, the history of a next step. After a solve without history: before any slip."""
        if self.friction is not None:
            return self.friction.state
        return virgin_state(self.mechanism, self._designs, self.tensions, self.joint_angles)

    @property
    def friction_states(self) -> Array:
        """(n - 1, m) friction state of every tendon in links 0 to n - 2: 1 slips to the motor, -1 to the tip."""
        return np.zeros_like(self.tendon_rates) if self.friction is None else self.friction.state.states

    @property
    def sticking(self) -> NDArray[np.bool_]:
        """(n - 1, m) True where a tendon sticks in a link's holes: its friction state is between -1 and 1."""
        return self._crossed & (np.abs(self.friction_states) < 1.0)

    @property
    def slip(self) -> Array:
        """(n - 1, m) slip of every tendon in links 0 to n - 2 since the history, towards the tip positive [mm]."""
        return np.zeros_like(self.tendon_rates) if self.friction is None else self.friction.slip

    @property
    def dissipated_work(self) -> float | Array:
        """Work of friction in the step from the history to here [N·mm]; the sum over a path is its loss.

        Slightly negative where holes give back energy that they stored before they slipped.
        """
        work: float | Array = 0.0 if self._codes.ndim == 0 else np.zeros(self._codes.size)
        if self.friction is not None:
            work = self.friction.work
        return work if self.walls is None else work + self.walls.work

    @property
    def wall_forces(self) -> Array:
        """(n, 3) force of the walls on every link, x, y, and moment about its origin, base frame [N, N·mm].

        In space (n, 6): x, y, z, and the three of the moment.
        """
        if self.walls is not None:
            return self.walls.forces
        return np.zeros((*self._codes.shape, self._one.n_links, self._motions))

    @cached_property
    def wall_contacts(self) -> list[Any]:
        """The places where links press on walls, WallContacts; of many equilibria a list of them for each."""
        every = [] if self.walls is None else self.walls.contacts(self._designs, self.joint_angles)
        if self._codes.ndim:
            return every or [[] for _ in range(self._codes.size)]
        return every[0] if every else []

    @property
    def wall_gaps(self) -> Array:
        """(candidates,) gap of every pair of outline and wall, negative where the wall gives way [mm]."""
        if self.walls is None:
            return np.zeros((*self._codes.shape, 0))
        gaps = self.walls.touched(self._designs, self.joint_angles)[0].gaps
        return gaps.reshape(*self._codes.shape, -1)

    @property
    def insertion_force(self) -> float | Array:
        """Force that drives the base forwards against the walls, along its y axis, in space along its z axis [N]."""
        force = -self.wall_forces[..., self._one.dimension - 1].sum(axis=-1)
        return float(force) if force.ndim == 0 else force

    @property
    def base_torques(self) -> Array:
        """(n - 1, 3) d residual / d motion of the base in its own frame: x, y, turn about its origin [N, N·mm/rad].

        In space (n - 1, 6): x, y, z, and the three of the turn.
        """
        return self._around[0]

    @property
    def wall_force_rates(self) -> Array:
        """(2, n + 2) d force of all walls, x and y / d joint angles and motion of the base [N/rad, N/mm, N/rad].

        In space (3, n + 5).
        """
        return self._around[1]

    @property
    def _around(self) -> tuple[Array, Array]:
        if self.walls is not None:
            return self._among_walls[2:]
        motions, rows = self._motions, self._codes.shape
        rates = np.zeros((*rows, self._one.dimension, self._one.n_joints + motions))
        return np.zeros((*self.joint_angles.shape, motions)), rates

    @property
    def _motions(self) -> int:
        """Numbers of a motion of the base: three in the plane, six in space."""
        return 3 if self._one.dimension == 2 else 6

    @property
    def jumped(self) -> bool | NDArray[np.bool_]:
        """True where a joint moved farther than 0.05 rad and thrice the tangent at the start: a snap-through at walls.

        It means something where the start was an equilibrium nearby; False without a start, and without surroundings.
        """
        if self.walls is not None:
            return self.walls.jumped
        return False if self._codes.ndim == 0 else np.zeros(self._codes.size, bool)

    @property
    def remark(self) -> str:
        """Addition to the status in reports, with a leading comma, or an empty text."""
        return ""

    @abstractmethod
    def link_columns(self) -> list[Column]:
        """Poses of the links of one equilibrium, for reports."""

    @abstractmethod
    def joint_columns(self, friction: float) -> list[Column]:
        """Joints of one equilibrium, for reports; friction: coefficient for slip margins."""

    @abstractmethod
    def figures(self, friction: float) -> dict[str, Any]:
        """Further entries of one equilibrium in reports in JSON."""

    def point_jacobian(self, link: int, point: Sequence[float] | None = None) -> Array:
        """(3 or 6, n - 1) d pose of a frame at a body point [mm], default the link's origin, / d joint angles."""
        at = self.positions[..., link, :] if point is None else self._placed(link, np.asarray(point, float))
        jacobian = self._twists(at[..., None, :] - self._pivots)
        jacobian[..., link:] = 0.0
        return jacobian

    @cached_property
    def free_joints(self) -> NDArray[np.bool_]:
        """(n - 1,) False where a joint is at its limit."""
        chain, designs = self._designs
        low, high = np.moveaxis(chain.joints[designs, :, :2], -1, 0).reshape(2, *self.joint_angles.shape)
        return strictly_within(self.joint_angles, low, high)

    @cached_property
    def stiffness(self) -> Array:
        """(n - 1, n - 1) d residual / d joint angle, tendon stretch included for given lengths [N·mm/rad]."""
        if self.walls is not None:
            return self._among_walls[0]
        if self.friction is not None:
            return self._with_friction[0]
        valid = self._codes != int(Status.INVALID_INPUT)
        loads = np.where(valid[..., None, None], self.loads, 0.0)
        angles = self._rows(self.joint_angles)
        H = np.empty((*angles.shape, angles.shape[1]))
        tendons = self._rows(self.tensions), self._rows(self.tendon_stiffness)
        stiffness_of(*self._designs, *tendons, self._rows(loads, axes=2), angles, H)
        return H.reshape(*self.joint_angles.shape, angles.shape[1])

    @cached_property
    def smallest_eigenvalue(self) -> float | Array:
        """Smallest real part of the eigenvalues of the stiffness over the free joints [N·mm/rad]; inf if none is free.

        Positive: stable; its size is the distance from snap-through.
        """
        free = self.free_joints
        masked = np.where(free[..., :, None] & free[..., None, :], self.stiffness, 0.0)
        values = np.linalg.eigvals(masked + np.eye(free.shape[-1]) * np.where(free, 0.0, _FAR)[..., None, :])
        smallest = values.real.min(axis=-1)
        smallest = np.where(free.any(axis=-1), smallest, np.inf)
        return float(smallest) if smallest.ndim == 0 else smallest

    def require(self) -> Self:
        """This equilibrium.

        Raises:
            SolverError: when it is not a stable equilibrium.
        """
        if not np.all(self.ok):
            statuses = sorted({Status(int(code)) for code in self._codes.flat} - {Status.CONVERGED, Status.AT_LIMIT})
            raise SolverError("; ".join(f"{status.name}: {status.message}" for status in statuses))
        return self

    def __repr__(self) -> str:
        kind = type(self).__name__
        name = repr("several mechanisms" if isinstance(self.mechanism, tuple) else self.mechanism.name)
        if self._codes.ndim:
            codes, counts = np.unique(self._codes, return_counts=True)
            counted = ", ".join(f"{n} {Status(code).name}" for code, n in zip(codes, counts, strict=True))
            return f"<{kind} of {name}, {self._codes.size} rows: {counted or 'none'}>"
        point = ", ".join(f"{x:.3f}" for x in self.tip)
        return f"<{kind} of {name}: {Status(int(self._codes)).name}, tip at ({point}) mm>"

    @property
    @abstractmethod
    def _pivots(self) -> Array:
        """Points about which the joints turn, (n - 1, 2 or 3) [mm]."""

    @abstractmethod
    def _placed(self, link: int, point: Array) -> Array:
        """A body point of a link in the base frame, (2,) or (3,) [mm]."""

    @abstractmethod
    def _twists(self, arms: Array) -> Array:
        """Velocity at the ends of arms from every joint, (..., n - 1, 2 or 3), and turn, (..., 3 or 6, n - 1)."""

    @property
    def _one(self) -> Any:
        """The mechanism, or the first one."""
        return self.mechanism[0] if isinstance(self.mechanism, tuple) else self.mechanism

    @cached_property
    def _designs(self) -> tuple[Any, NDArray[np.int64]]:
        """The arrays of the distinct mechanisms, and the index of each row's among them."""
        return designs_of(self.mechanism, self._codes.size)

    @abstractmethod
    def _shapes(self, n_joints: int, n_tendons: int) -> dict[str, tuple[int, ...]]:
        """Shape of every field with numbers, of one row; classes add to it."""
        joints, tendons, gaps = (n_joints,), (n_tendons,), (n_joints, n_tendons)
        return {
            "joint_angles": joints,
            "tensions": tendons,
            "lengths": tendons,
            "tendon_rates": gaps,
            "tendon_stiffness": tendons,
            "residual": (),
            "iterations": (),
        }

    @cached_property
    def _crossed(self) -> NDArray[np.bool_]:
        """(n - 1, m) True where a tendon crosses a joint."""
        chain, _ = self._designs
        return np.arange(self.joint_angles.shape[-1])[:, None] < chain.tendon_joints

    @cached_property
    def _with_friction(self) -> tuple[Array, Array]:
        """(n - 1, n - 1) d residual / d joint angle, (n - 1, m) d residual / d tension, after a step with friction."""
        assert self.friction is not None
        valid = self._codes != int(Status.INVALID_INPUT)
        loads = self._rows(np.where(valid[..., None, None], self.loads, 0.0), axes=2)
        angles, state = self._rows(self.joint_angles), self.friction.state
        states, slips, grips = (self._rows(values, axes=2) for values in (state.states, state.slips, state.grips))
        history = History(states, slips, grips, self._rows(state.angles), self._rows(state.rolling))
        A, torques = np.empty((*angles.shape, angles.shape[1])), np.empty_like(states)
        tendons = self._rows(self.tensions), self._rows(self.tendon_stiffness)
        law = friction_laws(self.mechanism, len(angles))
        rubbed_stiffness_of(*self._designs, law, *tendons, loads, angles, history, A, torques)
        return A.reshape(*self.joint_angles.shape, angles.shape[1]), torques.reshape(self.tendon_rates.shape)

    @cached_property
    def _among_walls(self) -> tuple[Array, Array, Array, Array]:
        """d residual / d joint angle, (n - 1, n - 1), / d tension, (n - 1, m), / d motion of the base, (n - 1, 3 or 6).

        And d force of all walls / d joint angle and motion of the base, (2, n + 2), in space (3, n + 5).
        """
        assert self.walls is not None
        valid = self._codes != int(Status.INVALID_INPUT)
        loads = self._rows(np.where(valid[..., None, None], self.loads, 0.0), axes=2)
        angles, state = self._rows(self.joint_angles), None if self.friction is None else self.friction.state
        law, history = no_friction(angles, self.tensions.shape[-1])
        if state is not None:
            law = friction_laws(self.mechanism, len(angles))
            history = History(*(self._rows(array, axes=array.ndim - self._codes.ndim) for array in state))
        H, torques = np.empty((*angles.shape, angles.shape[1])), np.empty((*angles.shape, self.tensions.shape[-1]))
        motions, axes = self._motions, self._one.dimension
        S, F = np.empty((*angles.shape, motions)), np.empty((len(angles), axes, angles.shape[1] + motions))
        tendons = self._rows(self.tensions), self._rows(self.tendon_stiffness)
        self.walls.stiffness(self._designs, law, tendons, loads, angles, history, (H, torques, S, F))
        shape = self.joint_angles.shape
        joined = H.reshape(*shape, -1), torques.reshape(*shape, -1), S.reshape(*shape, motions)
        return *joined, F.reshape(*self._codes.shape, axes, -1)

    def _rows(self, values: Array, axes: int = 1) -> Array:
        """A copy with a leading axis of rows, in the form that kernels are compiled for."""
        return np.array(values, float, order="C").reshape(self._codes.size, *values.shape[values.ndim - axes :])


Solution.walls = _LazyWalls()  # type: ignore[assignment]
