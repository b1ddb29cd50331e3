"""Steps among walls that would pass through an obstacle: done again in parts, or refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.friction_step import FrictionStep
from rollingjoint.chain.solution import Solution
from rollingjoint.chain.status import Status
from rollingjoint.chain.wall_step import WallStep
from rollingjoint.kernels.arrays import TendonLaw
from rollingjoint.kernels.planar_loads import LINK_COLUMNS, LOAD_COLUMNS

Array = NDArray[np.float64]

PARTS = (4, 16, 64)
"""Numbers of equal parts in which a step is tried, the one after the other."""
_LINKS = [LOAD_COLUMNS.index(name) for name in LINK_COLUMNS]


def row_of(state: Any, row: int) -> Any:
    """One row of an equilibrium or a FrictionState of a batch, or of one for all rows."""
    if state is None or np.ndim(state.joint_angles if isinstance(state, Solution) else state.angles) == 1:
        return state
    return state.row(row)


def in_parts(take: Callable[..., Any], before: Any, history: Any, whole: Any, law: TendonLaw, table: Array) -> Any:
    """The equilibrium at the end of a step, reached in parts none of which passes through an obstacle.

    Where there is none, the one before, with the status PASSED_THROUGH.

    Args:
        take: solves a part.
        before: the equilibrium before the step. history: as given for the step. whole: the result in one step.
        law, table: tendon law and loads of the step.
    """
    stretched = before.lengths - before.tensions / law.stiffness
    low, high = (np.where(law.low == law.high, before.tensions, limit) for limit in (law.low, law.high))
    from_law, loads = TendonLaw(stretched, law.stiffness, low, high), before.loads
    if loads.shape != table.shape or not np.array_equal(loads[:, _LINKS], table[:, _LINKS]):
        loads = table
    for count in PARTS:
        at, past, steps = before, history, list[Any]()
        for share in np.arange(1, count + 1) / count:
            part = TendonLaw(*(_between(first, last, share) for first, last in zip(from_law, law, strict=True)))
            place = whole.walls, _between(before.walls.base, whole.walls.base, share)
            step = take(whole.mechanism, part, _between(loads, table, share), at, past, place)
            if not step.ok:
                break
            steps, at, past = [*steps, step], step, None if past is None else step
        else:
            return _joined(steps, whole)
    return _refused(before, whole, table)


def _between(first: Array, last: Array, share: float) -> Array:
    """Numbers at a share of the way from the first to the last ones, to the last bit where that is 1."""
    way = np.subtract(last, first, out=np.zeros_like(last), where=first != last)
    return last + (share - 1.0) * way


def _joined(steps: list[Any], whole: Any) -> Any:
    """Several steps as one."""
    last, friction = steps[-1], steps[-1].friction
    if friction is not None:
        slip, work = sum(step.friction.slip for step in steps), sum(step.friction.work for step in steps)
        friction = replace(friction, slip=slip, work=work)
    walls = replace(
        last.walls, work=sum(step.walls.work for step in steps), jumped=any(step.walls.jumped for step in steps)
    )
    walls = replace(walls, walls=whole.walls.walls, which=whole.walls.which, parts=len(steps))
    return _changed(last, friction=friction, walls=walls, iterations=sum(step.iterations for step in steps))


def _refused(before: Any, whole: Any, table: Array) -> Any:
    """The equilibrium before a step that is refused, in the form of the step's result."""
    friction, at = None, replace(before.walls, work=0.0, jumped=False, parts=1)
    if whole.friction is not None:
        slip = np.zeros_like(whole.friction.slip)
        friction = FrictionStep(before.gap_tensions, slip, 0.0, before.friction_state)
    if at.gaps.shape != whole.walls.gaps.shape:  # other walls than before
        arrays, _ = replace(whole.walls, base=at.base, memory=None).touched(before._designs, before.joint_angles)
        at = WallStep.of(arrays, True).row(0)
    memory = at.memory if whole.walls.memory is not None else None
    walls = replace(at, walls=whole.walls.walls, which=whole.walls.which, memory=memory)
    return _changed(before, loads=table, friction=friction, walls=walls, status=Status.PASSED_THROUGH)


def _changed(solution: Any, **changes: Any) -> Any:
    """The solution with other fields."""
    values = {entry.name: getattr(solution, entry.name) for entry in fields(solution)}
    return solution.filled(values | changes)
