"""The solvers: equilibria under given tendon tensions or given tendon lengths, one or many."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.errors import InvalidInput
from rollingjoint.load import Load
from rollingjoint.planar.batch import TendonLaw
from rollingjoint.planar.chain import RollingChain
from rollingjoint.planar.equilibrium import Equilibrium
from rollingjoint.spatial.chain import HingeChain
from rollingjoint.spatial.equilibrium import HingeEquilibrium
from rollingjoint.statics.families import (
    Batch,
    Mechanism,
    Start,
    every_lane,
    family_of,
    start_of,
    tension_limits_of,
    vector,
)
from rollingjoint.statics.least_squares import solve_least_squares

Array = NDArray[np.float64]

Rolling = RollingChain | Sequence[RollingChain]
Hinged = HingeChain | Sequence[HingeChain]


@overload
def solve_tensions(
    mechanism: RollingChain, tensions: ArrayLike, loads: Sequence[Load] = (), start: Start = None
) -> Equilibrium: ...


@overload
def solve_tensions(
    mechanism: HingeChain, tensions: ArrayLike, loads: Sequence[Load] = (), start: Start = None
) -> HingeEquilibrium: ...


def solve_tensions(mechanism: Mechanism, tensions: ArrayLike, loads: Sequence[Load] = (), start: Start = None) -> Any:
    """Equilibrium under given tendon tensions.

    Args:
        mechanism: a RollingChain or a HingeChain.
        tensions: (m,) [N], not negative.
        loads: external loads.
        start: joint angles (n - 1,) [rad] or an equilibrium to start from; default s = 0, or hinges at rest.
    Returns:
        Equilibrium or HingeEquilibrium; look at its status. NaN, huge or negative numbers give Status.INVALID_INPUT.
    Raises:
        InvalidInput: wrong shapes or types, a load on a link that does not exist.
    Source: docs/theory.md, section 3.
    """
    family = family_of(mechanism)
    tau = vector("tensions", tensions, mechanism.n_tendons, "one per tendon")
    law = TendonLaw(np.zeros_like(tau), np.ones_like(tau), tau, tau)
    return family.solve_lane(mechanism, law, family.load_table(loads, mechanism.n_links), start_of(mechanism, start))


@overload
def solve_lengths(
    mechanism: RollingChain,
    lengths: ArrayLike,
    loads: Sequence[Load] = (),
    start: Start = None,
    method: str = "elastic",
    tension_limits: tuple[ArrayLike, ArrayLike] = (0.0, np.inf),
) -> Equilibrium: ...


@overload
def solve_lengths(
    mechanism: HingeChain,
    lengths: ArrayLike,
    loads: Sequence[Load] = (),
    start: Start = None,
    method: str = "elastic",
    tension_limits: tuple[ArrayLike, ArrayLike] = (0.0, np.inf),
) -> HingeEquilibrium: ...


def solve_lengths(
    mechanism: Mechanism,
    lengths: ArrayLike,
    loads: Sequence[Load] = (),
    start: Start = None,
    method: str = "elastic",
    tension_limits: tuple[ArrayLike, ArrayLike] = (0.0, np.inf),
) -> Any:
    """Equilibrium under given tendon lengths.

    Args:
        mechanism: a RollingChain or a HingeChain.
        lengths: (m,) unstretched length that the motors leave in the channels [mm] ("elastic"), or desired lengths
            ("least_squares").
        loads: external loads.
        start: joint angles (n - 1,) [rad] or an equilibrium to start from; default s = 0, or hinges at rest.
        method: "elastic": tension = clip(stiffness × stretch, *tension_limits), unique and well posed while a tendon is
            taut. "least_squares" (of a RollingChain): tensions within the limits that bring the lengths nearest the
            desired ones.
        tension_limits: lowest and highest tension, numbers or (m,) [N]; a motor that holds at least the first and gives
            way at the second. With "least_squares" an infinite highest tension stands for 1000 N.
    Returns:
        Equilibrium or HingeEquilibrium; look at its status.
    Raises:
        InvalidInput: wrong shapes or types, an unknown method, a load on a link that does not exist.
    Source: docs/theory.md, section 4; least squares: rolling-contact paper, eq. 29.
    """
    family = family_of(mechanism)
    command = vector("lengths", lengths, mechanism.n_tendons, "one per tendon")
    low, high = tension_limits_of(tension_limits, mechanism.n_tendons)
    table, phi = family.load_table(loads, mechanism.n_links), start_of(mechanism, start)
    if method == "elastic":
        return family.solve_lane(mechanism, TendonLaw(command, mechanism.stiffnesses.copy(), low, high), table, phi)
    if method == "least_squares" and isinstance(mechanism, RollingChain):
        return solve_least_squares(mechanism, command, low, high, table, phi)
    raise InvalidInput("method", method, '"elastic", or "least_squares" for a RollingChain')


@overload
def solve_tensions_batch(
    mechanism: Rolling, tensions: ArrayLike, loads: Sequence[Load] | Array = (), starts: Start = None
) -> Equilibrium: ...


@overload
def solve_tensions_batch(
    mechanism: Hinged, tensions: ArrayLike, loads: Sequence[Load] | Array = (), starts: Start = None
) -> HingeEquilibrium: ...


def solve_tensions_batch(
    mechanism: Rolling | Hinged, tensions: ArrayLike, loads: Sequence[Load] | Array = (), starts: Start = None
) -> Any:
    """Equilibria under given tensions, lane by lane.

    Args:
        mechanism: the chain, or one per lane, each with as many links, tendons and crossed joints as the others.
        tensions: (B, m) [N].
        loads: loads shared by all lanes, or a table (B, rows, columns) with columns
            load.LOAD_COLUMNS, or load.SPATIAL_LOAD_COLUMNS for a HingeChain.
        starts: joint angles (B, n - 1) [rad], or a batch to start from; default s = 0, or hinges at rest.
    Returns:
        Equilibrium or HingeEquilibrium, a leading axis B on its arrays; each lane is the single solve to the last bit.
    Raises:
        InvalidInput: wrong shapes or types, mechanisms that differ in their numbers.
    """
    batch = Batch.of(mechanism, "tensions", tensions)
    tau = batch.inputs
    return batch.solve(TendonLaw(np.zeros_like(tau), np.ones_like(tau), tau, tau), loads, starts)


@overload
def solve_lengths_batch(
    mechanism: Rolling,
    lengths: ArrayLike,
    loads: Sequence[Load] | Array = (),
    starts: Start = None,
    tension_limits: tuple[ArrayLike, ArrayLike] = (0.0, np.inf),
) -> Equilibrium: ...


@overload
def solve_lengths_batch(
    mechanism: Hinged,
    lengths: ArrayLike,
    loads: Sequence[Load] | Array = (),
    starts: Start = None,
    tension_limits: tuple[ArrayLike, ArrayLike] = (0.0, np.inf),
) -> HingeEquilibrium: ...


def solve_lengths_batch(
    mechanism: Rolling | Hinged,
    lengths: ArrayLike,
    loads: Sequence[Load] | Array = (),
    starts: Start = None,
    tension_limits: tuple[ArrayLike, ArrayLike] = (0.0, np.inf),
) -> Any:
    """Equilibria under given lengths (elastic tendons), lane by lane.

    Args:
        mechanism: the chain, or one per lane, each with as many links, tendons and crossed joints as the others.
        lengths: (B, m) unstretched lengths [mm].
        loads: loads shared by all lanes, or a table (B, rows, columns) with columns
            load.LOAD_COLUMNS, or load.SPATIAL_LOAD_COLUMNS for a HingeChain.
        starts: joint angles (B, n - 1) [rad], or a batch to start from; default s = 0, or hinges at rest.
        tension_limits: lowest and highest tension, numbers or (m,) [N].
    Returns:
        Equilibrium or HingeEquilibrium, a leading axis B on its arrays; each lane is the single solve to the last bit.
    Raises:
        InvalidInput: wrong shapes or types, mechanisms that differ in their numbers.
    """
    batch = Batch.of(mechanism, "lengths", lengths)
    limits = tension_limits_of(tension_limits, batch.inputs.shape[1])
    low, high = (every_lane(side, len(batch.inputs)) for side in limits)
    stiffnesses = batch.per_lane([chain.stiffnesses for chain in batch.chains])
    return batch.solve(TendonLaw(batch.inputs, stiffnesses, low, high), loads, starts)
