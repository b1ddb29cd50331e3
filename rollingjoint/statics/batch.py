"""Checked inputs of many solves, and their solution as one batch."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.batch import solve_batch, step_batch
from rollingjoint.chain.chain import AnyChain, Chain, kinds
from rollingjoint.chain.friction_step import friction_laws, no_friction
from rollingjoint.chain.solution import Solution, stacked
from rollingjoint.chain.stacks import Variations, designs_of, distinct
from rollingjoint.chain.status import Status
from rollingjoint.chain.wall_step import new_wall_arrays
from rollingjoint.checks import as_floats
from rollingjoint.errors import InvalidInput
from rollingjoint.friction import FrictionState
from rollingjoint.kernels.arrays import TendonLaw
from rollingjoint.load import Load, with_all_columns, wrong_links
from rollingjoint.statics.among import (
    ORIGIN,
    Around,
    equilibrium_among,
    fill_memory,
    has_wall_friction,
    walls_around,
)
from rollingjoint.statics.inputs import History, Start, checked_history, start_of
from rollingjoint.statics.parts import in_parts, row_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Batch:
    """Rows that are solved in one call: their inputs, (B, m), and their mechanisms."""

    mechanism: AnyChain | tuple[AnyChain, ...]
    kind: type[AnyChain]  # of the mechanisms
    chains: tuple[AnyChain, ...]  # the distinct mechanisms; of variations the nominal one
    arrays: Any
    designs: NDArray[np.int64]
    inputs: Array
    variations: Variations[AnyChain] | None = None

    @classmethod
    def of(cls, mechanism: AnyChain | Sequence[AnyChain], what: str, inputs: ArrayLike) -> Batch:
        """The batch with checked inputs."""
        if isinstance(mechanism, Variations):
            nominal: AnyChain = mechanism.nominal
            array = _rows(what, inputs, nominal.n_tendons)
            stacked_arrays = designs_of(mechanism, len(array))
            return cls(mechanism.members(), type(nominal), (nominal,), *stacked_arrays, array, mechanism)
        every = mechanism if isinstance(mechanism, Chain) else _mechanisms(mechanism)
        chains = distinct(every) if isinstance(every, tuple) else (every,)
        array = _rows(what, inputs, chains[0].n_tendons)
        return cls(every, type(chains[0]), chains, *designs_of(every, len(array)), array)

    def per_row(self, name: str) -> Array:
        """An array that every mechanism has, such as its stiffnesses, of every row, (B, ...)."""
        if self.variations is not None:
            values: Array = getattr(self.variations, name)
            return values
        return np.take([getattr(chain, name) for chain in self.chains], self.designs, axis=0)

    def repeated(self, values: Array) -> Array:
        """The same values for every row, (B, ...)."""
        return np.repeat(values[None], len(self.inputs), axis=0)

    def solve(
        self,
        laws: TendonLaw,
        loads: Sequence[Load] | Array,
        starts: Start,
        history: History,
        surroundings: Around | Sequence[Around] = None,
        base: ArrayLike = ORIGIN,
    ) -> Any:
        """The equilibria."""
        tables, phi = self.tables(loads), self.starts(start_of(starts, history))
        inputs = self.kind, self.mechanism, self.arrays, self.designs, laws, tables, phi
        if surroundings is not None:
            return self.solve_among(laws, tables, phi, (starts, history), surroundings, base)
        rub = [chain.has_friction for chain in self.chains]
        if history is None or not any(rub):
            return solve_batch(*inputs)
        before = checked_history(self.mechanism, history, len(self.inputs))
        if all(rub):
            mechanism = self.mechanism if self.variations is None else self.chains[0]
            return step_batch(*inputs, before, friction_laws(mechanism, len(self.inputs)))
        return self._solve_apart(np.array(rub)[self.designs], laws, tables, phi, before)

    def solve_among(
        self,
        laws: TendonLaw,
        tables: Array,
        angles: Array,
        before: tuple[Start, History],
        surroundings: Around | Sequence[Around],
        base: ArrayLike,
    ) -> Any:
        """The equilibria among walls; angles: to start from, (B, n - 1); before: what they are of, and the history.

        Steps from equilibria among walls that pass through an obstacle are done again in parts, or else refused.
        """
        rows, mechanism = len(self.inputs), self.mechanism if self.variations is None else self.chains[0]
        at = equilibrium_among(*before, self.chains[0].n_links)
        walls = walls_around(mechanism, surroundings, base, rows, at)
        solution = self._step_among(laws, tables, angles, before[1], walls)
        if all(each is None for each in before):  # the mechanism at rest promises no pose
            solution = replace(solution, walls=replace(solution.walls, jumped=np.zeros(rows, bool)))
        passed = np.flatnonzero(solution.status == Status.PASSED_THROUGH)
        if not passed.size:
            return solution
        each = [solution.row(row) for row in range(rows)]
        for row in passed.tolist():
            law = TendonLaw(*(values[row] for values in laws))
            history = row_of(before[1], row)
            each[row] = in_parts(_take_part, row_of(at, row), history, each[row], law, tables[row])
        return replace(stacked(each), mechanism=solution.mechanism)

    def _step_among(self, laws: TendonLaw, tables: Array, starts: Array, history: History, walls: Any) -> Any:
        """The equilibria among walls, obstacles that they pass through or not."""
        rows = len(self.inputs)
        inputs = self.kind, self.mechanism, self.arrays, self.designs, laws, tables, starts
        in_chain = any(chain.has_friction for chain in self.chains)
        if history is None or not (in_chain or has_wall_friction(walls.walls)):
            return solve_batch(*inputs, walls)
        fill_memory(walls, (self.arrays, self.designs), history)
        if in_chain:
            return step_batch(*inputs, checked_history(self.mechanism, history, rows), None, walls)
        law, before = no_friction(starts, self.inputs.shape[1])
        return step_batch(*inputs, FrictionState(*before), law, walls)

    def _solve_apart(
        self, rub: NDArray[np.bool_], laws: TendonLaw, tables: Array, phi: Array, before: FrictionState
    ) -> Any:
        """The equilibria where only some rows have friction: rows with and without friction in separate batches."""
        every = cast("tuple[AnyChain, ...]", self.mechanism)
        solutions: dict[int, Any] = {}
        for kind in (True, False):
            rows = np.flatnonzero(rub == kind)
            mechanisms = tuple(every[row] for row in rows)
            law = TendonLaw(*(values[rows] for values in laws))
            inputs = self.kind, mechanisms, *designs_of(mechanisms, len(rows)), law, tables[rows], phi[rows]
            past = FrictionState(*(values[rows] for values in before))
            solved = step_batch(*inputs, past) if kind else solve_batch(*inputs)
            solutions |= {int(row): solved.row(place) for place, row in enumerate(rows)}
        return replace(stacked([solutions[row] for row in range(len(rub))]), mechanism=every)

    def tables(self, loads: Sequence[Load] | Array) -> Array:
        """Load tables of all rows, (B, rows, columns)."""
        count, n_links, columns = len(self.inputs), self.chains[0].n_links, self.kind.load_columns
        if not isinstance(loads, np.ndarray):
            return self.repeated(self.chains[0].load_table(loads))
        tables = with_all_columns(loads, columns, _with_zeros) if loads.ndim == 3 and loads.shape[0] == count else None
        if tables is None:
            raise InvalidInput("shape of the load table", loads.shape, f"({count}, rows, {len(columns)})")
        tables = as_floats("load table", tables, "numbers")
        links = wrong_links(tables, columns, n_links)
        if links is not None:
            raise InvalidInput("links of the load table", links, f"integers from 0 to {n_links - 1}")
        return tables

    def starts(self, angles: ArrayLike | None) -> Array:
        """Joint angles to start from of all rows, (B, n - 1), default at rest."""
        if angles is None:
            return self.per_row("neutral_angles")
        if np.ndim(angles) == 1 and np.shape(angles) == (self.chains[0].n_joints,):
            angles = self.repeated(as_floats("starts", angles, "numbers"))
        phi = _rows("starts", angles, self.chains[0].n_joints)
        if len(phi) != len(self.inputs):
            raise InvalidInput("number of starts", len(phi), f"{len(self.inputs)}, one per row of the batch")
        return phi


def solve_one_among(
    mechanism: AnyChain,
    law: TendonLaw,
    table: Array,
    angles: Array,
    before: tuple[Start, History],
    surroundings: Around,
    base: ArrayLike,
) -> Any:
    """The equilibrium of one mechanism among walls; law: (m,) each; table: (rows, columns); angles: to start from."""
    batch = Batch.of(mechanism, "tensions", np.zeros((1, mechanism.n_tendons)))
    laws = TendonLaw(*(values[None] for values in law))
    return batch.solve_among(laws, table[None].copy(), angles[None].copy(), before, surroundings, base).row(0)


def _take_part(mechanism: AnyChain, law: TendonLaw, table: Array, at: Solution, history: History, walls: Any) -> Any:
    """A part of a step, (WallStep, pose of the base) being the walls, from an equilibrium."""
    batch = Batch.of(mechanism, "tensions", np.zeros((1, mechanism.n_tendons)))
    laws, angles = TendonLaw(*(values[None] for values in law)), at.joint_angles[None].copy()
    step, base = walls
    way = at.poses[None].copy(), np.array([at.base_among_walls])
    which, bases = np.array([step.which]), base[None].copy()
    arrays = new_wall_arrays(step.walls, which, bases, mechanism.n_joints, None, way)
    return batch._step_among(laws, table[None].copy(), angles, history, arrays).row(0)


def prescribed(tensions: Array) -> TendonLaw:
    """The law of tendons under given tensions, (..., m) [N]."""
    return TendonLaw(np.zeros_like(tensions), np.ones_like(tensions), tensions, tensions)


def _with_zeros(tables: Array, missing: int) -> Array:
    return np.pad(tables, ((0, 0), (0, 0), (0, missing)))


def _mechanisms(mechanisms: Iterable[AnyChain]) -> tuple[AnyChain, ...]:
    chains = tuple(mechanisms) if isinstance(mechanisms, Iterable) else ()
    kernels = {getattr(kind, "kernels", None) for kind in set(map(type, chains))}
    if len(kernels) != 1 or None in kernels:
        allowed = f"{kinds()}, or a list of at least one, all of one kind"
        raise InvalidInput("mechanism", mechanisms, allowed, "rollingjoint.preset(name) makes a named one.")
    return chains


def _rows(what: str, values: ArrayLike, size: int) -> Array:
    array = as_floats(what, values, f"numbers of shape (B, {size})")
    if array.ndim != 2 or array.shape[1] != size:
        raise InvalidInput(f"shape of {what}", array.shape, f"(B, {size})")
    return array
