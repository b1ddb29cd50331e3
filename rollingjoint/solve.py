"""The solvers: equilibria under given tendon tensions or given tendon lengths, one or many."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint._kernels.arrays import TendonLaw
from rollingjoint._kernels.batch import new_results, solve_lanes
from rollingjoint._kernels.least_squares import solve_least_squares
from rollingjoint._threads import run_lanes
from rollingjoint.equilibrium import Equilibrium, pack, pack_one
from rollingjoint.errors import InvalidInput, as_floats
from rollingjoint.load import LOAD_COLUMNS, Load, load_table
from rollingjoint.rolling_chain import RollingChain

Array = NDArray[np.float64]

Start = ArrayLike | Equilibrium | None


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
    return _solve_one(mechanism, law, load_table(loads, mechanism.n_links), _start(mechanism, start))


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
    law = TendonLaw(command, mechanism.stiffnesses.copy(), low, high)
    table, phi = load_table(loads, mechanism.n_links), _start(mechanism, start)
    if method == "elastic":
        return _solve_one(mechanism, law, table, phi)
    if method == "least_squares":
        results = new_results(1, mechanism.n_joints, mechanism.n_tendons)
        solve_least_squares(mechanism.arrays, law, table, phi, results)
        return pack_one(mechanism, table, results)
    raise InvalidInput("method", method, '"elastic" or "least_squares"')


def solve_tensions_batch(
    mechanism: RollingChain, tensions: ArrayLike, loads: Sequence[Load] | Array = (), starts: Start = None
) -> Equilibrium:
    """Equilibria under given tensions, lane by lane.

    Args:
        mechanism: the chain.
        tensions: (B, m) [N].
        loads: loads shared by all lanes, or a table (B, rows, 11) with columns load.LOAD_COLUMNS.
        starts: joint angles (B, n - 1) [rad], or a batch to start from; default s = 0.
    Returns:
        Equilibrium whose arrays have a leading axis B.
    Raises:
        InvalidInput: wrong shapes or types.
    """
    tau = _lanes("tensions", tensions, _checked(mechanism).n_tendons)
    laws = TendonLaw(np.zeros_like(tau), np.ones_like(tau), tau, tau)
    return _solve_many(mechanism, laws, loads, starts)


def solve_lengths_batch(
    mechanism: RollingChain,
    lengths: ArrayLike,
    loads: Sequence[Load] | Array = (),
    starts: Start = None,
    tension_limits: tuple[ArrayLike, ArrayLike] = (0.0, np.inf),
) -> Equilibrium:
    """Equilibria under given lengths (elastic tendons), lane by lane.

    Args:
        mechanism: the chain.
        lengths: (B, m) unstretched lengths [mm].
        loads: loads shared by all lanes, or a table (B, rows, 11) with columns load.LOAD_COLUMNS.
        starts: joint angles (B, n - 1) [rad], or a batch to start from; default s = 0.
        tension_limits: lowest and highest tension, numbers or (m,) [N].
    Returns:
        Equilibrium whose arrays have a leading axis B.
    Raises:
        InvalidInput: wrong shapes or types.
    """
    command = _lanes("lengths", lengths, _checked(mechanism).n_tendons)
    low, high = _tension_limits(tension_limits, mechanism.n_tendons)
    shared = (_every_lane(values, len(command)) for values in (mechanism.stiffnesses, low, high))
    return _solve_many(mechanism, TendonLaw(command, *shared), loads, starts)


def _checked(mechanism: RollingChain) -> RollingChain:
    if not isinstance(mechanism, RollingChain):
        raise InvalidInput("mechanism", mechanism, "a RollingChain", "rollingjoint.preset(name) makes a named one.")
    return mechanism


def _solve_one(mechanism: RollingChain, law: TendonLaw, table: Array, phi: Array) -> Equilibrium:
    results = new_results(1, mechanism.n_joints, mechanism.n_tendons)
    laws = TendonLaw(law.command[None], law.stiffness[None], law.low[None], law.high[None])
    solve_lanes(mechanism.arrays, laws, table[None], phi[None], results, 0, 1)
    return pack_one(mechanism, table, results)


def _solve_many(mechanism: RollingChain, laws: TendonLaw, loads: Sequence[Load] | Array, starts: Start) -> Equilibrium:
    n_lanes, n_joints = len(laws.command), mechanism.n_joints
    if isinstance(loads, np.ndarray):
        if loads.ndim != 3 or loads.shape[0] != n_lanes or loads.shape[2] != len(LOAD_COLUMNS):
            raise InvalidInput("shape of the load table", loads.shape, f"({n_lanes}, rows, {len(LOAD_COLUMNS)})")
        table = as_floats("load table", loads, "numbers")
        _check_links(table, mechanism.n_links)
    else:
        table = _every_lane(load_table(loads, mechanism.n_links), n_lanes)
    if starts is None:
        phi = _every_lane(mechanism.neutral_angles, n_lanes)
    else:
        phi = _lanes("starts", starts.joint_angles if isinstance(starts, Equilibrium) else starts, n_joints)
        if len(phi) != n_lanes:
            raise InvalidInput("number of starts", len(phi), f"{n_lanes}, one per lane")
    results = new_results(n_lanes, n_joints, mechanism.n_tendons)
    arrays = mechanism.arrays
    run_lanes(lambda first, last: solve_lanes(arrays, laws, table, phi, results, first, last), n_lanes)
    return pack(mechanism, table, results)


def _every_lane(values: Array, n_lanes: int) -> Array:
    return np.repeat(values[None], n_lanes, axis=0)


def _start(mechanism: RollingChain, start: Start) -> Array:
    if start is None:
        return mechanism.neutral_angles.copy()
    angles = start.joint_angles if isinstance(start, Equilibrium) else start
    return _vector("start", angles, mechanism.n_joints, "joint angles [rad], one per joint")


def _tension_limits(limits: tuple[ArrayLike, ArrayLike], n_tendons: int) -> tuple[Array, Array]:
    allowed = f"(lowest, highest), numbers or {n_tendons} values each"
    try:
        low, high = (as_floats("tension_limits", side, allowed) for side in limits)
    except (TypeError, ValueError):
        raise InvalidInput("tension_limits", limits, allowed) from None
    if {low.shape, high.shape} - {(), (n_tendons,)}:
        raise InvalidInput("tension_limits", limits, allowed)
    return np.full(n_tendons, low), np.full(n_tendons, high)


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


def _check_links(table: Array, n_links: int) -> None:
    links = table[..., 0]
    if not np.all((links >= 0) & (links < n_links) & (links == np.floor(links))):
        raise InvalidInput("links of the load table", links, f"whole numbers from 0 to {n_links - 1}")
