"""Checked surroundings of the solvers: walls around one mechanism or the rows of a batch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.solution import Solution
from rollingjoint.chain.wall_step import new_wall_arrays, touch
from rollingjoint.checks import as_floats, seen_as_vector
from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.spatial_walls import SpatialWalls
from rollingjoint.kernels.walls import MU, N_LAW, Walls
from rollingjoint.surroundings import Surroundings, wrong_walls

Array = NDArray[np.float64]

Around = Surroundings | Walls | SpatialWalls | None
"""Surroundings, their arrays for one mechanism (tables of kernels, once or for every row of a batch), or None."""

ORIGIN = (0.0, 0.0, 0.0)
"""The pose of the base in the world: x, y [mm], angle [rad]; in space x, y, z [mm], and no turn."""

_TABLES = {2: Walls, 3: SpatialWalls}  # by the dimension of chains
_POSES = {
    2: "x, y [mm] and angle [rad]",
    3: "x, y, z [mm], or x, y, z [mm] and the three numbers of a rotation vector [rad]",
}


def walls_of(surroundings: Around, mechanism: AnyChain) -> Any:
    """The walls and the outline of a mechanism, as kernels take them: a stack of one, or a stack that was given."""
    if type(surroundings) is Surroundings and (kept := surroundings.arrays_of(mechanism)) is not None:
        return kept
    if isinstance(surroundings, _TABLES[mechanism.dimension]):
        return surroundings
    if isinstance(surroundings, Walls | SpatialWalls):
        raise wrong_walls(surroundings, mechanism)
    if not isinstance(surroundings, Surroundings):
        raise InvalidInput("surroundings", surroundings, "Surroundings or None", "Surroundings([Disc((20, 50), 5)])")
    return surroundings.arrays(mechanism)


def walls_around(
    mechanism: AnyChain | Sequence[AnyChain],
    surroundings: Around | Sequence[Around],
    base: ArrayLike,
    rows: int,
    at: Any = None,
) -> Any:
    """The walls around every row of a batch; surroundings: of all rows, or a list or a stack with those of each.

    at: equilibria among walls before a step, or one for all rows: steps that pass through a wall are marked.
    """
    single = isinstance(surroundings, Walls | SpatialWalls) or not isinstance(surroundings, Sequence)
    every: Sequence[Around] = [surroundings] if single else surroundings  # type: ignore[list-item, assignment]
    if not single and len(every) != rows:
        raise InvalidInput("number of surroundings", len(every), f"{rows}, one per row of the batch")
    places: dict[tuple[int, int], int] = {}
    different: list[Any] = []
    which = np.zeros(rows, np.int64)
    for row in range(rows):
        chain = mechanism[row] if isinstance(mechanism, Sequence) else mechanism
        around = every[0 if single else row]
        place = places.setdefault((id(chain), id(around)), len(different))
        if place == len(different):
            different.append(walls_of(around, chain))
        which[row] = place
        if single and not isinstance(mechanism, Sequence):
            break
    first = mechanism[0] if isinstance(mechanism, Sequence) else mechanism
    if at is not None:
        each = (at.poses, first.dimension), (at.base_among_walls, 1)  # and their axes: (n, 3) or (n, 4, 4)
        at = tuple(np.broadcast_to(values, (rows, *values.shape[-axes:])).copy() for values, axes in each)
    stack = None
    if isinstance(surroundings, Walls | SpatialWalls) and len(surroundings.rigid) > 1:
        stack = surroundings
    if stack is not None and len(stack.rigid) != rows:
        raise InvalidInput("number of surroundings", len(stack.rigid), f"{rows}, one per row of the batch")
    walls, which = (stacked_walls(different), which) if stack is None else (stack, np.arange(rows))
    return new_wall_arrays(walls, which, bases_of(base, rows, first.dimension), first.n_joints, None, at)


def equilibrium_among(start: Any, history: Any, n_links: int) -> Any:
    """The equilibrium among walls from which a step begins, the start or else the history; None if neither is one."""
    for each in (start, history):
        if (
            isinstance(each, Solution)
            and each.base_among_walls is not None
            and each.joint_angles.shape[-1] == n_links - 1
        ):
            return each
    return None


def has_wall_friction(walls: Any) -> bool:
    """True if any wall rubs."""
    laws = [getattr(walls, name) for name in ("planes", "discs", "capsules", "lumens", "tubes") if hasattr(walls, name)]
    return any(bool((law[..., MU - N_LAW] > 0.0).any()) for law in laws)


def fill_memory(walls: Any, designs: tuple[Any, NDArray[np.int64]], history: Any) -> None:
    """Fill the memory of contacts before a step: that of its history; before any slip, where the history has none."""
    rows, step = len(walls.which), getattr(history, "walls", None)
    memory = None if step is None else step.memory
    if memory is not None and np.shape(memory.normals)[-1:] == walls.gaps.shape[1:]:
        for values, before in zip(walls.before, memory, strict=True):
            values[:] = before
        return
    angles = history.joint_angles if isinstance(history, Solution) else np.asarray(history.angles)
    bases = walls.bases if step is None else np.broadcast_to(step.base, walls.bases.shape).copy()
    at = new_wall_arrays(walls.walls, walls.which, bases, angles.shape[-1])
    touch(designs, np.ascontiguousarray(np.broadcast_to(angles, (rows, angles.shape[-1]))), at)
    for values, before in zip(walls.before, at.after, strict=True):
        values[:] = before


def stacked_walls(every: Sequence[Any]) -> Any:
    """Several stacks as one, padded by rows without effect."""
    if len(every) == 1:
        return every[0]
    joined = []
    for arrays in zip(*every, strict=True):
        if arrays[0].ndim > 1:
            most = max(array.shape[1] for array in arrays)
            arrays = tuple(np.pad(array, ((0, 0), (0, most - array.shape[1]), (0, 0))) for array in arrays)
        joined.append(np.concatenate(arrays))
    return type(every[0])(*joined)


def base_of(base: ArrayLike, dimension: int = 2) -> ArrayLike:
    """The pose of the base, (3,), in space (6,); the default stays as it is."""
    if base is ORIGIN:
        return base
    return seen_as_vector("base", base, 3, _POSES[2]) if dimension == 2 else bases_of(base, 1, dimension)[0]


def bases_of(base: ArrayLike, rows: int, dimension: int = 2) -> Array:
    """Poses of the base, (rows, 3), in space (rows, 6)."""
    allowed = f"{_POSES[dimension]}, once or for {rows} rows"
    array = as_floats("base", base, allowed)
    sizes = (3,) if dimension == 2 else (3, 6)
    if array.shape not in [shape for size in sizes for shape in ((size,), (rows, size))]:
        raise InvalidInput("base", base, allowed)
    if dimension == 3 and array.shape[-1] == 3:
        array = np.concatenate([array, np.zeros_like(array)], axis=-1)
    return np.repeat(array[None], rows, axis=0) if array.ndim == 1 else array.copy()
