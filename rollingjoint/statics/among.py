"""Checked surroundings of the solvers: walls around one mechanism or the rows of a batch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.rolling import planar
from rollingjoint.chain.solution import Solution
from rollingjoint.chain.wall_step import new_wall_arrays, touch
from rollingjoint.checks import as_floats, seen_as_vector
from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.walled_solve import WallArrays
from rollingjoint.kernels.walls import MU, N_LAW, Walls
from rollingjoint.surroundings import Surroundings

Array = NDArray[np.float64]

Around = Surroundings | Walls | None
"""Surroundings, their arrays for one mechanism (kernels.walls.Walls, once or for every row of a batch), or None."""

ORIGIN = (0.0, 0.0, 0.0)
"""The pose of the base in the world: x, y [mm], angle [rad]."""


def walls_of(surroundings: Around, mechanism: AnyChain) -> Walls:
    """The walls and the outline of a mechanism, as kernels take them: a stack of one, or a stack that was given."""
    if type(surroundings) is Surroundings and (kept := surroundings.arrays_of(mechanism)) is not None:
        return kept
    chain = planar(mechanism, "Surroundings are for planar chains.")
    if isinstance(surroundings, Walls):
        return surroundings
    if not isinstance(surroundings, Surroundings):
        raise InvalidInput("surroundings", surroundings, "Surroundings or None", "Surroundings([Disc((20, 50), 5)])")
    return surroundings.arrays(chain)


def walls_around(
    mechanism: AnyChain | Sequence[AnyChain],
    surroundings: Around | Sequence[Around],
    base: ArrayLike,
    rows: int,
    at: Any = None,
) -> WallArrays:
    """The walls around every row of a batch; surroundings: of all rows, or a list or a stack with those of each.

    at: equilibria among walls before a step, or one for all rows: steps that pass through a wall are marked.
    """
    single = isinstance(surroundings, Walls) or not isinstance(surroundings, Sequence)
    every: Sequence[Around] = [surroundings] if single else surroundings  # type: ignore[list-item, assignment]
    if not single and len(every) != rows:
        raise InvalidInput("number of surroundings", len(every), f"{rows}, one per row of the batch")
    places: dict[tuple[int, int], int] = {}
    different: list[Walls] = []
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
        shapes = (at.poses, (rows, first.n_links, 3)), (at.base_among_walls, (rows, 3))
        at = tuple(np.broadcast_to(values, shape).copy() for values, shape in shapes)
    stack = surroundings if isinstance(surroundings, Walls) and len(surroundings.rigid) > 1 else None
    if stack is not None and len(stack.rigid) != rows:
        raise InvalidInput("number of surroundings", len(stack.rigid), f"{rows}, one per row of the batch")
    walls, which = (stacked_walls(different), which) if stack is None else (stack, np.arange(rows))
    return new_wall_arrays(walls, which, bases_of(base, rows), first.n_joints, None, at)


def equilibrium_among(start: Any, history: Any, n_links: int) -> Any:
    """The equilibrium among walls from which a step begins, the start or else the history; None if neither is one."""
    for each in (start, history):
        if isinstance(each, Solution) and each.base_among_walls is not None and each.poses.shape[-2] == n_links:
            return each
    return None


def has_wall_friction(walls: Walls) -> bool:
    """True if any wall rubs."""
    laws = walls.planes, walls.discs, walls.capsules, walls.lumens
    return any(bool((law[..., MU - N_LAW] > 0.0).any()) for law in laws)


def fill_memory(walls: WallArrays, designs: tuple[Any, NDArray[np.int64]], history: Any) -> None:
    """Fill the memory of contacts before a step: that of its history; before any slip, where the history has none."""
    rows, step = len(walls.which), getattr(history, "walls", None)
    memory = None if step is None else step.memory
    if memory is not None and np.shape(memory.states)[-1:] == walls.gaps.shape[1:]:
        for values, before in zip(walls.before, memory, strict=True):
            values[:] = before
        return
    angles = history.joint_angles if isinstance(history, Solution) else np.asarray(history.angles)
    bases = walls.bases if step is None else np.broadcast_to(step.base, (rows, 3)).copy()
    at = new_wall_arrays(walls.walls, walls.which, bases, angles.shape[-1])
    touch(designs, np.ascontiguousarray(np.broadcast_to(angles, (rows, angles.shape[-1]))), at)
    for values, before in zip(walls.before, at.after, strict=True):
        values[:] = before


def stacked_walls(every: Sequence[Walls]) -> Walls:
    """Several stacks as one, padded by rows without effect."""
    if len(every) == 1:
        return every[0]
    joined = []
    for arrays in zip(*every, strict=True):
        if arrays[0].ndim > 1:
            most = max(array.shape[1] for array in arrays)
            arrays = tuple(np.pad(array, ((0, 0), (0, most - array.shape[1]), (0, 0))) for array in arrays)
        joined.append(np.concatenate(arrays))
    return Walls(*joined)


def base_of(base: ArrayLike) -> ArrayLike:
    """The pose of the base, (3,); the default stays as it is."""
    return base if base is ORIGIN else seen_as_vector("base", base, 3, "x, y [mm] and angle [rad]")


def bases_of(base: ArrayLike, rows: int) -> Array:
    """Poses of the base, (rows, 3)."""
    allowed = f"x, y [mm] and angle [rad], once or for {rows} rows"
    array = as_floats("base", base, allowed)
    if array.shape not in ((3,), (rows, 3)):
        raise InvalidInput("base", base, allowed)
    return np.repeat(array[None], rows, axis=0) if array.ndim == 1 else array.copy()
