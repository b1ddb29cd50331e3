"""Contact with walls at an equilibrium."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint._numba.jit import machine_code
from rollingjoint._numba.layout import Floats, Integers
from rollingjoint.chain.friction_step import check_shape
from rollingjoint.chain.se3 import rotation
from rollingjoint.kernels.friction import FrictionLaw, History
from rollingjoint.kernels.spatial_wall_contacts import N_PLACE as N_PLACE_IN_SPACE
from rollingjoint.kernels.spatial_wall_contacts import SpatialTouched, SpatialWallArrays, spatial_sizes
from rollingjoint.kernels.spatial_walls import SpatialWalls
from rollingjoint.kernels.wall_contacts import N_PLACE, Touched, contact_sizes
from rollingjoint.kernels.walled_solve import WallArrays, touch_again, walled_stiffness_of
from rollingjoint.kernels.walls import MU, N_LAW, Walls

Array = NDArray[np.float64]

_SLIPS = 1e-12  # so near to 1 a contact in space slips: its state is a vector scaled to length 1
_INTEGERS, _MATRIX, _CUBE = Annotated[Integers, "B"], Annotated[Floats, "B", "i"], Annotated[Floats, "B", "i", "k"]
_LAW, _HISTORY = Annotated[FrictionLaw, "B"], Annotated[History, "B"]

KINDS = ("plane", "lumen", "disc", "capsule", "sphere", "tube")
"""Kinds of walls, by the numbers of `candidate_table`."""


class WallContact(NamedTuple):
    """One place where a link presses on a wall; places and directions in the base frame.

    Attributes:
        link: number of the link. kind, wall: kind of the wall, and its number among those (spheres among capsules).
        place: where they touch [mm]. normal: unit normal of the wall there, to the link.
        gap: negative where a compliant wall gives way [mm]. force: normal force N by its law [N].
        friction: -mu N state, positive to the right of the normal; in space its size, mu N state [N].
        state: friction state, -1 to 1; in space its size, 0 to 1. sticks: whether its size is below 1; False where
            the wall or the step is without friction.
        force_on_link: as it is in the balance, (2,) or (3,) [N]: those of a link add up to its wall_forces. Its parts
            along the normal and the wall are force and friction, but for small shares of them where a lumen tapers (the
            square of the slope, in the plane the slope times the friction too) and, in the plane, where a bent wall
            gives way (depth over bend radius).
        candidate: number of the pair (kernels.walls.Walls).
    """

    link: int
    kind: str
    wall: int
    place: Array
    normal: Array
    gap: float
    force: float
    friction: float
    state: float
    sticks: bool
    force_on_link: Array
    candidate: int


@dataclass(frozen=True, eq=False)
class WallStep:
    """Contact with walls at an equilibrium, or at many with a leading axis B on all arrays but the walls.

    Attributes:
        walls: stack of the walls and outlines. which: index of the walls in it. base: pose of the base in the world,
            (3,) x, y, angle, in space (6,) x, y, z, rotation vector [mm, rad].
        gaps: (C,) of every candidate that presses; of others a lower bound [mm]. normals: (C,) normal forces [N].
        states: (C,) friction states, -1 to 1; in space (C, 3), in the world.
        forces: (n, 3) wall force on every link, x, y, and moment about its origin, base frame [N, N·mm]; (n, 6) in
            space.
        work: dissipated at the walls in the step [N·mm].
        jumped: whether a joint moved much farther than the tangent at the start promises: a snap-through.
        memory: of contacts, for the next step; None where the step was without friction.
        parts: in which the step was taken: more than one where the whole would have passed through an obstacle.
    """

    motions: ClassVar[int] = 3  # numbers of a pose of the base
    arrays_class: ClassVar[type[Any]] = WallArrays
    memory_class: ClassVar[type[Any]] = Touched
    place_columns: ClassVar[int] = N_PLACE

    walls: Any  # Walls or SpatialWalls
    which: int | NDArray[np.int64]
    base: Array
    gaps: Array
    normals: Array
    states: Array
    forces: Array
    work: float | Array
    jumped: bool | NDArray[np.bool_]
    memory: Any = None  # Touched or SpatialTouched
    parts: int | NDArray[np.int64] = 1

    @classmethod
    def of(cls, arrays: Any, remembers: bool) -> WallStep:
        """The results of a batch, from its outputs; remembers: whether its steps have left a memory."""
        for array in (arrays.gaps, arrays.forces, arrays.work, *arrays.after):
            array.setflags(write=False)
        after = arrays.after
        memory = after if remembers else None
        outputs = arrays.gaps, after.normals, after.states, arrays.forces, arrays.work, arrays.jumped.astype(bool)
        parts = np.ones(len(arrays.which), np.int64)
        return step_class(arrays.walls)(arrays.walls, arrays.which, arrays.bases, *outputs, memory, parts)

    def row(self, index: int) -> WallStep:
        """The results of one row of a batch."""
        memory = None if self.memory is None else self.memory_class(*(values[index] for values in self.memory))
        names = "base", "gaps", "normals", "states", "forces"
        values = {name: getattr(self, name)[index] for name in names}
        values |= {name: getattr(self, name)[index].item() for name in ("which", "work", "jumped", "parts")}
        return replace(self, memory=memory, **values)

    def check(self, rows: tuple[int, ...], n_links: int) -> None:
        """Raise InvalidInput unless its arrays have the shapes of a mechanism, with these leading axes."""
        candidates = (*rows, n_candidates(self.walls))
        forces = *rows, n_links, self.motions
        for name, shape in (("gaps", candidates), ("normals", candidates), ("forces", forces)):
            check_shape(f"walls.{name}", getattr(self, name), shape)

    @classmethod
    def stacked(cls, steps: Sequence[WallStep]) -> WallStep:
        """Results for one pair of walls and outline as one with a leading axis."""
        first = steps[0]
        names = "which", "base", "gaps", "normals", "states", "forces", "work", "jumped", "parts"
        values: dict[str, Any] = {name: np.array([getattr(step, name) for step in steps]) for name in names}
        memory = None
        if all(step.memory is not None for step in steps):
            memory = first.memory_class(*map(np.array, zip(*(step.memory for step in steps), strict=True)))
        return replace(first, memory=memory, **values)

    def arrays(self, n_joints: int) -> Any:
        """What kernels take of all rows, with room for outputs; it begins with the memory and with these forces."""
        which, base = np.array(self.which, np.int64).reshape(-1), np.array(self.base, float).reshape(-1, self.motions)
        arrays = new_wall_arrays(self.walls, which, base, n_joints)
        for values, mine in zip(arrays.before, self.memory or (), strict=False):
            values[:] = mine
        arrays.before.normals[:] = self.normals
        return arrays

    def touched(self, designs: tuple[Any, NDArray[np.int64]], angles: Array) -> tuple[Any, Array]:
        """Every candidate at joint angles (..., n - 1), before any slip, and its place (kernels.wall_contacts)."""
        rows = angles.reshape(-1, angles.shape[-1]).copy()
        arrays = self.arrays(rows.shape[1])
        return arrays, touch(designs, rows, arrays)

    def stiffness(
        self,
        designs: tuple[Any, NDArray[np.int64]],
        law: FrictionLaw,
        tendons: tuple[Array, Array],
        loads: Array,
        angles: Array,
        history: History,
        outputs: tuple[Array, Array, Array, Array],
    ) -> None:
        """Fill the derivatives of kernels.walled_solve.walled_stiffness_of; tendons: tensions and their rates."""
        chain, rows = designs
        kinds = _LAW, _MATRIX, _MATRIX, _CUBE, _MATRIX, _HISTORY, float, self.arrays_class, *[_CUBE] * 4
        fill = machine_code(walled_stiffness_of, type(chain), _INTEGERS, *kinds)
        rubs, arrays = float(self.memory is not None), self.arrays(angles.shape[1])
        fill(chain, rows, law, *tendons, loads, angles, history, rubs, arrays, *outputs)

    def contacts(self, designs: tuple[Any, NDArray[np.int64]], angles: Array) -> list[list[WallContact]]:
        """The candidates that press, of every row."""
        _, places = self.touched(designs, angles)
        which, shape = np.reshape(self.which, -1), places.shape[:2]
        gaps, normals = (np.reshape(values, shape) for values in (self.gaps, self.normals))
        states = np.reshape(self.states, (*shape, *np.shape(self.states)[np.ndim(self.gaps) :]))
        bases = np.reshape(self.base, (-1, self.motions))
        return [
            self._pressing(index, bases[lane], places[lane], gaps[lane], normals[lane], states[lane])
            for lane, index in enumerate(which)
        ]

    def _pressing(
        self, which: int, base: Array, places: Array, gaps: Array, normals: Array, states: Array
    ) -> list[WallContact]:
        """The candidates that press, of one row; the arrays are of all candidates."""
        table, mu = candidate_table(self.walls, which)
        of_gap, of_way = places[:, 2:4], places[:, 4:]
        friction = -mu * normals * states
        forces = normals[:, None] * of_gap + friction[:, None] * of_way
        return _listed(table, places[:, :2], of_gap, gaps, normals, (friction, states, self._rubs(mu, states), forces))

    def _rubs(self, mu: Array, states: Array) -> NDArray[np.bool_]:
        """(C,) whether candidates of a row rub: a wall with friction in a step with a history.

        A path has no memory, as its first step has none: there, states tell which rows are steps with friction.
        """
        return (mu > 0.0) & (self.memory is not None or bool(states.any()))


class SpatialWallStep(WallStep):
    """Contact with walls in space."""

    motions: ClassVar[int] = 6
    arrays_class: ClassVar[type[Any]] = SpatialWallArrays
    memory_class: ClassVar[type[Any]] = SpatialTouched
    place_columns: ClassVar[int] = N_PLACE_IN_SPACE

    def _pressing(
        self, which: int, base: Array, places: Array, gaps: Array, normals: Array, states: Array
    ) -> list[WallContact]:
        """The candidates that press, of one row; the arrays are of all candidates."""
        table, mu = candidate_table(self.walls, which)
        of_gap, drag = places[:, 3:], (mu * normals)[:, None] * (states @ rotation(base[3:]))
        sizes = np.linalg.norm(states, axis=1)
        sizes = np.where(sizes > 1.0 - _SLIPS, 1.0, sizes)
        forces = normals[:, None] * of_gap - drag
        rubbing = mu * normals * sizes, sizes, self._rubs(mu, states), forces
        return _listed(table, places[:, :3], of_gap, gaps, normals, rubbing)


def _listed(
    table: NDArray[np.int64],
    places: Array,
    gradients: Array,
    gaps: Array,
    normals: Array,
    rubbing: tuple[Array, Array, NDArray[np.bool_], Array],
) -> list[WallContact]:
    """The candidates that press; rubbing: friction, its states, whether they rub, and forces on the links."""
    friction, states, rubs, forces = rubbing
    return [
        WallContact(
            link=int(table[c, 0]),
            kind=KINDS[table[c, 1]],
            wall=int(table[c, 2]),
            place=places[c],
            normal=gradients[c] / np.linalg.norm(gradients[c]),
            gap=float(gaps[c]),
            force=float(normals[c]),
            friction=float(friction[c]),
            state=float(states[c]),
            sticks=bool(rubs[c] and abs(states[c]) < 1.0),
            force_on_link=forces[c],
            candidate=int(c),
        )
        for c in np.flatnonzero(normals > 0.0)
    ]


def step_class(walls: Any) -> type[WallStep]:
    """The class of results among walls of the plane or in space, by their tables."""
    return SpatialWallStep if isinstance(walls, SpatialWalls) else WallStep


def touch(designs: tuple[Any, NDArray[np.int64]], angles: Array, arrays: Any) -> Array:
    """Evaluate every candidate at joint angles (B, n - 1), before any slip, into the arrays; their places."""
    places = np.zeros((*arrays.gaps.shape, step_class(arrays.walls).place_columns))
    chain, rows = designs
    kinds = type(chain), _INTEGERS, _MATRIX, type(arrays), _CUBE
    machine_code(touch_again, *kinds)(chain, rows, angles, arrays, places)
    return places


def n_candidates(walls: Walls | SpatialWalls | Any) -> int:
    """Number of the pairs that may touch; walls: tables of this form."""
    count: int = (spatial_sizes if isinstance(walls, SpatialWalls) else contact_sizes.py_func)(walls, 0).C
    return count


def candidate_table(walls: Any, which: int) -> tuple[NDArray[np.int64], Array]:
    """Link, kind of wall and number of the wall of every candidate, (C, 3), and its coefficient of friction, (C,)."""
    if isinstance(walls, SpatialWalls):
        return _table_in_space(walls, which)
    planes, discs, capsules, _, lumens = (array.shape[1] for array in walls[2:-1])
    of_points = [(0, w) for w in range(planes)] + [(1, w) for w in range(lumens)]
    of_bars = [(2, w) for w in range(discs)] + [(3, w) for w in range(capsules) for _ in range(4)]
    rows = [
        (int(outline[which, q, 0]), *wall)
        for outline, pairs in ((walls.points, of_points), (walls.bars, of_bars))
        for q in range(outline.shape[1])
        for wall in pairs
    ]
    laws = walls.planes, walls.lumens, walls.discs, walls.capsules
    mu = [laws[kind][which, wall, MU - N_LAW] for _, kind, wall in rows]
    return np.array(rows, np.int64).reshape(-1, 3), np.array(mu)


def _table_in_space(walls: SpatialWalls, which: int) -> tuple[NDArray[np.int64], Array]:
    """`candidate_table` of walls in space."""
    of_points = [(0, w) for w in range(walls.planes.shape[1])] + [(5, w) for w in range(walls.tubes.shape[1])]
    round_ones = (walls.capsules[which, :, :3] == walls.capsules[which, :, 3:6]).all(axis=1)
    of_bars = [(4 if is_round else 3, w) for w, is_round in enumerate(round_ones)]
    laws = {0: walls.planes, 3: walls.capsules, 4: walls.capsules, 5: walls.tubes}
    rows = [
        (int(link), *wall)
        for links, pairs in ((walls.points[which, :, 0], of_points), (walls.bars[which, :, 0], of_bars))
        for link in links
        for wall in pairs
    ]
    mu = [laws[kind][which, wall, MU - N_LAW] for _, kind, wall in rows]
    return np.array(rows, np.int64).reshape(-1, 3), np.array(mu)


WALL_OUTPUTS = ("wall_base", "wall_gaps", "wall_normals", "wall_states", "wall_forces")
"""Names of the outputs of one equilibrium of which a WallStep is made."""


def wall_outputs(arrays: Any) -> tuple[Array, ...]:
    """The arrays of WALL_OUTPUTS."""
    return arrays.bases, arrays.gaps, arrays.after.normals, arrays.after.states, arrays.forces


def with_outputs(arrays: Any, outputs: Sequence[Array]) -> Any:
    """The arrays with others in place of WALL_OUTPUTS."""
    bases, gaps, normals, states, forces = outputs
    after = arrays.after._replace(normals=normals, states=states)
    return arrays._replace(bases=bases, gaps=gaps, after=after, forces=forces)


def new_wall_arrays(
    walls: Any,
    which: NDArray[np.int64],
    bases: Array,
    n_joints: int,
    before: Any = None,
    at: tuple[Array, Array] | None = None,
) -> Any:
    """Walls of B lanes with empty outputs.

    at: the equilibria before the steps, poses of the links in the base frame, (B, n, 3), and of the base, (B, 3), in
    space (B, n, 4, 4) and (B, 6); NaN where there is none. Steps that pass through a wall on the way from there end as
    PASSED_THROUGH; None: none does.
    """
    if isinstance(walls, SpatialWalls):
        return _new_arrays_in_space(walls, which, bases, n_joints, before, at)
    count, candidates = len(which), n_candidates(walls)
    every = np.zeros((9, count, candidates))
    before = before or Touched(*every[:4])
    forces, work = np.zeros((count, n_joints + 1, 3)), np.zeros(count)
    counts = np.zeros((2, count), np.int64)
    at = at or (np.zeros((0, n_joints + 1, 3)), np.zeros((0, 3)))
    return WallArrays(walls, which, bases, *at, before, Touched(*every[4:8]), every[8], forces, work, *counts)


def _new_arrays_in_space(
    walls: SpatialWalls,
    which: NDArray[np.int64],
    bases: Array,
    n_joints: int,
    before: SpatialTouched | None,
    at: tuple[Array, Array] | None,
) -> SpatialWallArrays:
    """`new_wall_arrays` of walls in space."""
    count, candidates, n = len(which), n_candidates(walls), n_joints + 1

    def memory() -> SpatialTouched:
        shapes = (count, candidates, 3), (count, candidates), (count, n, 12)
        return SpatialTouched(*map(np.zeros, shapes))

    at = at or (np.zeros((0, n, 4, 4)), np.zeros((0, 6)))
    outputs = np.zeros((count, candidates)), np.zeros((count, n, 6)), np.zeros(count)
    counts = np.zeros((2, count), np.int64)
    return SpatialWallArrays(walls, which, bases, *at, before or memory(), memory(), *outputs, *counts)
