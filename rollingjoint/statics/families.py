"""The two families of mechanisms at the front door: what differs between them, and what may enter their solvers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.checks import as_floats
from rollingjoint.errors import InvalidInput
from rollingjoint.load import (
    LOAD_COLUMNS,
    SPATIAL_LOAD_COLUMNS,
    Load,
    filled_up,
    load_table,
    spatial_load_table,
    wrong_links,
)
from rollingjoint.planar.batch import Chain, Problem, TendonLaw, designs_of, distinct, new_results, solve_range
from rollingjoint.planar.chain import RollingChain
from rollingjoint.planar.equilibrium import Equilibrium, pack, solve_lane
from rollingjoint.solution import Solution
from rollingjoint.spatial.chain import HingeChain
from rollingjoint.spatial.equilibrium import hinge_designs_of, solve_hinge_batch, solve_hinge_lane
from rollingjoint.threads import run_lanes

Array = NDArray[np.float64]

Mechanism = RollingChain | HingeChain
Start = ArrayLike | Solution | None


def _solve_rolling_batch(
    mechanism: Any, chain: Chain, designs: NDArray[np.int64], laws: TendonLaw, tables: Array, starts: Array
) -> Equilibrium:
    """The equilibria of lanes of planar chains."""
    results = new_results(len(starts), starts.shape[1], laws.low.shape[1])
    problem = Problem(chain, designs, laws, tables, starts, results)

    def work(first: int, last: int) -> None:
        solve_range(problem, first, last)

    run_lanes(work, len(starts), starts.shape[1])
    return pack(mechanism, tables, results)


class Family(NamedTuple):
    """What differs between planar rolling chains and spatial hinge chains."""

    load_columns: tuple[str, ...]
    load_table: Callable[[Sequence[Load], int], Array]
    designs_of: Callable[[Any, int], tuple[Any, NDArray[np.int64]]]
    solve_lane: Callable[[Any, TendonLaw, Array, Array], Any]
    solve_batch: Callable[[Any, Any, NDArray[np.int64], TendonLaw, Array, Array], Any]


_ROLLING = Family(LOAD_COLUMNS, load_table, designs_of, solve_lane, _solve_rolling_batch)
_HINGED = Family(SPATIAL_LOAD_COLUMNS, spatial_load_table, hinge_designs_of, solve_hinge_lane, solve_hinge_batch)


def family_of(mechanism: Mechanism) -> Family:
    """The family of one mechanism.

    Raises:
        InvalidInput: anything else.
    """
    if isinstance(mechanism, RollingChain):
        return _ROLLING
    if isinstance(mechanism, HingeChain):
        return _HINGED
    allowed = "a RollingChain or a HingeChain"
    raise InvalidInput("mechanism", mechanism, allowed, "rollingjoint.preset(name) makes a named one.")


@dataclass(frozen=True)
class Batch:
    """Lanes that are solved in one call: the inputs of each, (B, m), and its mechanism."""

    mechanism: Mechanism | tuple[Mechanism, ...]
    family: Family
    chains: tuple[Mechanism, ...]  # the different ones
    arrays: Any
    designs: NDArray[np.int64]
    inputs: Array

    @classmethod
    def of(cls, mechanism: Mechanism | Sequence[Mechanism], what: str, inputs: ArrayLike) -> Batch:
        """The batch, checked."""
        every = mechanism if isinstance(mechanism, Mechanism) else _mechanisms(mechanism)
        chains = distinct(every) if isinstance(every, tuple) else (every,)
        family = family_of(chains[0])
        array = _lanes(what, inputs, chains[0].n_tendons)
        return cls(every, family, chains, *family.designs_of(every, len(array)), array)

    def per_lane(self, values: Sequence[Array]) -> Array:
        """What each different mechanism has, for every lane, (B, ...)."""
        return np.take(values, self.designs, axis=0)

    def solve(self, laws: TendonLaw, loads: Sequence[Load] | Array, starts: Start) -> Any:
        """The equilibria."""
        tables, phi = self._tables(loads), self._starts(starts)
        return self.family.solve_batch(self.mechanism, self.arrays, self.designs, laws, tables, phi)

    def _tables(self, loads: Sequence[Load] | Array) -> Array:
        """Load tables of all lanes, (B, rows, columns)."""
        n_lanes, n_links, columns = len(self.inputs), self.chains[0].n_links, self.family.load_columns
        if not isinstance(loads, np.ndarray):
            return every_lane(self.family.load_table(loads, n_links), n_lanes)
        tables = filled_up(loads, columns, _with_zeros) if loads.ndim == 3 and loads.shape[0] == n_lanes else None
        if tables is None:
            raise InvalidInput("shape of the load table", loads.shape, f"({n_lanes}, rows, {len(columns)})")
        tables = as_floats("load table", tables, "numbers")
        links = wrong_links(tables, columns, n_links)
        if links is not None:
            raise InvalidInput("links of the load table", links, f"whole numbers from 0 to {n_links - 1}")
        return tables

    def _starts(self, starts: Start) -> Array:
        if starts is None:
            return self.per_lane([chain.neutral_angles for chain in self.chains])
        angles = starts.joint_angles if isinstance(starts, Solution) else starts
        phi = _lanes("starts", angles, self.chains[0].n_joints)
        if len(phi) != len(self.inputs):
            raise InvalidInput("number of starts", len(phi), f"{len(self.inputs)}, one per lane")
        return phi


def _with_zeros(tables: Array, missing: int) -> Array:
    return np.pad(tables, ((0, 0), (0, 0), (0, missing)))


def _mechanisms(mechanisms: Iterable[Mechanism]) -> tuple[Mechanism, ...]:
    allowed = "a RollingChain or a HingeChain, or a list of at least one, all of one kind"
    chains = tuple(mechanisms) if isinstance(mechanisms, Iterable) else ()
    if not chains or not any(all(isinstance(each, kind) for each in chains) for kind in (RollingChain, HingeChain)):
        raise InvalidInput("mechanism", mechanisms, allowed, "rollingjoint.preset(name) makes a named one.")
    return chains


def every_lane(values: Array, n_lanes: int) -> Array:
    """The same values for every lane, (B, ...)."""
    return np.repeat(values[None], n_lanes, axis=0)


def start_of(mechanism: Mechanism, start: Start) -> Array:
    """Joint angles to start from, (n - 1,)."""
    if start is None:
        return mechanism.neutral_angles.copy()
    angles = start.joint_angles if isinstance(start, Solution) else start
    return vector("start", angles, mechanism.n_joints, "joint angles [rad], one per joint")


def tension_limits_of(limits: tuple[ArrayLike, ArrayLike], n_tendons: int) -> Array:
    """Lowest and highest tension of every tendon, (2, m)."""
    allowed = f"(lowest, highest), numbers or {n_tendons} values each"
    both = np.empty((2, n_tendons))
    try:
        for side, values in zip(both, limits, strict=True):
            array = as_floats("tension_limits", values, allowed)
            if array.shape not in ((), (n_tendons,)):
                raise InvalidInput("tension_limits", limits, allowed)
            side[:] = array
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput("tension_limits", limits, allowed) from None
    return both


def vector(what: str, values: ArrayLike, size: int, meaning: str) -> Array:
    """The values, (size,); InvalidInput for anything else."""
    array = as_floats(what, values, f"{size} numbers, {meaning}")
    if array.shape != (size,):
        raise InvalidInput(what, values, f"{size} numbers, {meaning}")
    return array


def _lanes(what: str, values: ArrayLike, size: int) -> Array:
    array = as_floats(what, values, f"numbers of shape (B, {size}), one row per lane")
    if array.ndim != 2 or array.shape[1] != size:
        raise InvalidInput(f"shape of {what}", array.shape, f"(B, {size}), one row per lane")
    return array
