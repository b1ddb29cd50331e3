"""The solvers: equilibria under given tendon tensions or given tendon lengths, one or many, and what may enter them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint._threads import run_lanes
from rollingjoint.equilibrium import Equilibrium, pack, solve_lane
from rollingjoint.errors import InvalidInput, as_floats
from rollingjoint.lanes import Chain, Problem, TendonLaw, designs_of, distinct, new_results, solve_range
from rollingjoint.least_squares import solve_least_squares
from rollingjoint.load import LOAD_COLUMNS, Load, load_table
from rollingjoint.rolling_chain import RollingChain

Array = NDArray[np.float64]

Start = ArrayLike | Equilibrium | None
Mechanisms = RollingChain | Sequence[RollingChain]


def solve_tensions(
    mechanism: RollingChain, tensions: ArrayLike, loads: Sequence[Load] = (), start: Start = None
) -> Equilibrium:
    """Equilibrium under given tendon tensions.

    Args:
        mechanism: the chain.
        tensions: (m,) [N], not negative.
        loads: external loads.
        start: joint angles (n - 1,) [rad] or an Equilibrium to start from; default s = 0 in every joint.
    Returns:
        Equilibrium; look at its status. NaN, huge or negative numbers give Status.INVALID_INPUT.
    Raises:
        InvalidInput: wrong shapes or types, a load on a link that does not exist.
    Source: docs/theory.md, section 3.
    """
    tau = _vector("tensions", tensions, _checked(mechanism).n_tendons, "one per tendon")
    law = TendonLaw(np.zeros_like(tau), np.ones_like(tau), tau, tau)
    return solve_lane(mechanism, law, load_table(loads, mechanism.n_links), _start(mechanism, start))


def solve_lengths(
    mechanism: RollingChain,
    lengths: ArrayLike,
    loads: Sequence[Load] = (),
    start: Start = None,
    method: str = "elastic",
    tension_limits: tuple[ArrayLike, ArrayLike] = (0.0, np.inf),
) -> Equilibrium:
    """Equilibrium under given tendon lengths.

    Args:
        mechanism: the chain.
        lengths: (m,) unstretched length that the motors leave in the channels [mm] ("elastic"), or desired lengths
            ("least_squares").
        loads: external loads.
        start: joint angles (n - 1,) [rad] or an Equilibrium to start from; default s = 0 in every joint.
        method: "elastic": tension = clip(stiffness × stretch, *tension_limits), unique and well posed while a tendon is
            taut. "least_squares": tensions within the limits that bring the lengths nearest the desired ones.
        tension_limits: lowest and highest tension, numbers or (m,) [N]; a motor that holds at least the first and gives
            way at the second. With "least_squares" an infinite highest tension stands for 1000 N.
    Returns:
        Equilibrium; look at its status.
    Raises:
        InvalidInput: wrong shapes or types, an unknown method, a load on a link that does not exist.
    Source: docs/theory.md, section 4; least squares: rolling-contact paper, eq. 29.
    """
    command = _vector("lengths", lengths, _checked(mechanism).n_tendons, "one per tendon")
    low, high = _tension_limits(tension_limits, mechanism.n_tendons)
    table, phi = load_table(loads, mechanism.n_links), _start(mechanism, start)
    if method == "elastic":
        return solve_lane(mechanism, TendonLaw(command, mechanism.stiffnesses.copy(), low, high), table, phi)
    if method == "least_squares":
        return solve_least_squares(mechanism, command, low, high, table, phi)
    raise InvalidInput("method", method, '"elastic" or "least_squares"')


def solve_tensions_batch(
    mechanism: Mechanisms, tensions: ArrayLike, loads: Sequence[Load] | Array = (), starts: Start = None
) -> Equilibrium:
    """Equilibria under given tensions, lane by lane.

    Args:
        mechanism: the chain, or one per lane, each with as many links, tendons and crossed joints as the others.
        tensions: (B, m) [N].
        loads: loads shared by all lanes, or a table (B, rows, 11) with columns load.LOAD_COLUMNS.
        starts: joint angles (B, n - 1) [rad], or a batch to start from; default s = 0.
    Returns:
        Equilibrium whose arrays have a leading axis B; each lane is the single solve to the last bit.
    Raises:
        InvalidInput: wrong shapes or types, mechanisms that differ in their numbers.
    """
    batch = _Batch.of(mechanism, "tensions", tensions)
    tau = batch.inputs
    return batch.solve(TendonLaw(np.zeros_like(tau), np.ones_like(tau), tau, tau), loads, starts)


def solve_lengths_batch(
    mechanism: Mechanisms,
    lengths: ArrayLike,
    loads: Sequence[Load] | Array = (),
    starts: Start = None,
    tension_limits: tuple[ArrayLike, ArrayLike] = (0.0, np.inf),
) -> Equilibrium:
    """Equilibria under given lengths (elastic tendons), lane by lane.

    Args:
        mechanism: the chain, or one per lane, each with as many links, tendons and crossed joints as the others.
        lengths: (B, m) unstretched lengths [mm].
        loads: loads shared by all lanes, or a table (B, rows, 11) with columns load.LOAD_COLUMNS.
        starts: joint angles (B, n - 1) [rad], or a batch to start from; default s = 0.
        tension_limits: lowest and highest tension, numbers or (m,) [N].
    Returns:
        Equilibrium whose arrays have a leading axis B; each lane is the single solve to the last bit.
    Raises:
        InvalidInput: wrong shapes or types, mechanisms that differ in their numbers.
    """
    batch = _Batch.of(mechanism, "lengths", lengths)
    limits = _tension_limits(tension_limits, batch.inputs.shape[1])
    low, high = (_every_lane(side, len(batch.inputs)) for side in limits)
    stiffnesses = batch.per_lane([chain.stiffnesses for chain in batch.chains])
    return batch.solve(TendonLaw(batch.inputs, stiffnesses, low, high), loads, starts)


def _checked(mechanism: RollingChain) -> RollingChain:
    if not isinstance(mechanism, RollingChain):
        raise InvalidInput("mechanism", mechanism, "a RollingChain", "rollingjoint.preset(name) makes a named one.")
    return mechanism


@dataclass(frozen=True)
class _Batch:
    """Lanes that are solved in one call: the inputs of each, (B, m), and its mechanism."""

    mechanism: RollingChain | tuple[RollingChain, ...]
    chains: tuple[RollingChain, ...]  # the different ones
    arrays: Chain
    designs: NDArray[np.int64]
    inputs: Array

    @classmethod
    def of(cls, mechanism: Mechanisms, what: str, inputs: ArrayLike) -> _Batch:
        """The batch, checked."""
        every = mechanism if isinstance(mechanism, RollingChain) else _mechanisms(mechanism)
        chains = distinct(every)
        array = _lanes(what, inputs, chains[0].n_tendons)
        return cls(every, chains, *designs_of(every, len(array)), array)

    def per_lane(self, values: Sequence[Array]) -> Array:
        """What each different mechanism has, for every lane, (B, ...)."""
        return np.take(values, self.designs, axis=0)

    def solve(self, laws: TendonLaw, loads: Sequence[Load] | Array, starts: Start) -> Equilibrium:
        n_lanes, chain = len(self.inputs), self.chains[0]
        table, phi = _tables(loads, n_lanes, chain.n_links), self._starts(starts)
        results = new_results(n_lanes, chain.n_joints, chain.n_tendons)
        problem = Problem(self.arrays, self.designs, laws, table, phi, results)

        def work(first: int, last: int) -> None:
            solve_range(problem, first, last)

        run_lanes(work, n_lanes, phi.shape[1])
        return pack(self.mechanism, table, results)

    def _starts(self, starts: Start) -> Array:
        if starts is None:
            return self.per_lane([chain.neutral_angles for chain in self.chains])
        angles = starts.joint_angles if isinstance(starts, Equilibrium) else starts
        phi = _lanes("starts", angles, self.chains[0].n_joints)
        if len(phi) != len(self.inputs):
            raise InvalidInput("number of starts", len(phi), f"{len(self.inputs)}, one per lane")
        return phi


def _mechanisms(mechanisms: Iterable[RollingChain]) -> tuple[RollingChain, ...]:
    allowed = "a RollingChain, or a list of at least one"
    chains = tuple(mechanisms) if isinstance(mechanisms, Iterable) else ()
    if not chains or not all(isinstance(chain, RollingChain) for chain in chains):
        raise InvalidInput("mechanism", mechanisms, allowed, "rollingjoint.preset(name) makes a named one.")
    return chains


def _tables(loads: Sequence[Load] | Array, n_lanes: int, n_links: int) -> Array:
    """Load tables of all lanes, (B, rows, 11)."""
    if not isinstance(loads, np.ndarray):
        return _every_lane(load_table(loads, n_links), n_lanes)
    if loads.ndim != 3 or loads.shape[0] != n_lanes or loads.shape[2] != len(LOAD_COLUMNS):
        raise InvalidInput("shape of the load table", loads.shape, f"({n_lanes}, rows, {len(LOAD_COLUMNS)})")
    tables = as_floats("load table", loads, "numbers")
    links = tables[..., 0]
    if not np.all((links >= 0) & (links < n_links) & (links == np.floor(links))):
        raise InvalidInput("links of the load table", links, f"whole numbers from 0 to {n_links - 1}")
    return tables


def _every_lane(values: Array, n_lanes: int) -> Array:
    return np.repeat(values[None], n_lanes, axis=0)


def _start(mechanism: RollingChain, start: Start) -> Array:
    if start is None:
        return mechanism.neutral_angles.copy()
    angles = start.joint_angles if isinstance(start, Equilibrium) else start
    return _vector("start", angles, mechanism.n_joints, "joint angles [rad], one per joint")


def _tension_limits(limits: tuple[ArrayLike, ArrayLike], n_tendons: int) -> Array:
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


def _vector(what: str, values: ArrayLike, size: int, meaning: str) -> Array:
    array = as_floats(what, values, f"{size} numbers, {meaning}")
    if array.shape != (size,):
        raise InvalidInput(what, values, f"{size} numbers, {meaning}")
    return array


def _lanes(what: str, values: ArrayLike, size: int) -> Array:
    array = as_floats(what, values, f"numbers of shape (B, {size}), one row per lane")
    if array.ndim != 2 or array.shape[1] != size:
        raise InvalidInput(f"shape of {what}", array.shape, f"(B, {size}), one row per lane")
    return array
