"""The solvers: equilibria under given tendon tensions or given tendon lengths, one or many."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.batch import solve_one
from rollingjoint.chain.chain import AnyChain, Chain, check_chain, read_only
from rollingjoint.checks import seen_as_vector
from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.arrays import TendonLaw
from rollingjoint.load import Load
from rollingjoint.statics.among import ORIGIN, Around, base_of, has_wall_friction, walls_of
from rollingjoint.statics.batch import Batch, prescribed, solve_one_among
from rollingjoint.statics.inputs import History, Start, angles_of, broadcast_limits, checked_history, tension_limits_of
from rollingjoint.statics.least_squares import solve_least_squares
from rollingjoint.statics.slot import Law, full_law, spare_slot

Array = NDArray[np.float64]
S = TypeVar("S")  # Equilibrium of a RollingChain, HingeEquilibrium of a HingeChain

__all__ = ["History", "Start", "solve_lengths", "solve_lengths_batch", "solve_tensions", "solve_tensions_batch"]


def solve_tensions(
    mechanism: Chain[S],
    tensions: ArrayLike,
    loads: Sequence[Load] = (),
    start: Start = None,
    history: History = None,
    surroundings: Around = None,
    base: ArrayLike = ORIGIN,
) -> S:
    """Equilibrium under given tendon tensions.

    Args:
        mechanism: a RollingChain or a HingeChain.
        tensions: (m,) [N], not negative.
        loads: external loads.
        start: joint angles (n - 1,) [rad] or an equilibrium to start from; default s = 0, or hinges at rest.
        history: for a mechanism with friction, the equilibrium before this step, or its friction_state. Without it the
            result is the pose without friction, before any slip. Default start: its joint angles.
        surroundings: walls around the mechanism; None: none. base: pose of its base among them, x, y [mm], angle [rad],
            in space x, y, z [mm], and after them a rotation vector [rad] if it is turned; the results and loads are in
            the frame of the base.
    Returns:
        Equilibrium or HingeEquilibrium; look at its status. NaN, huge or negative numbers give Status.INVALID_INPUT.
    Raises:
        InvalidInput: wrong shapes or types, a load on a link that does not exist.
    Source: docs/theory.md, section 3.
    """
    check_chain(mechanism)
    tau = seen_as_vector("tensions", tensions, mechanism.n_tendons, "one per tendon")
    table = mechanism.load_table(loads)
    return _solve_one(mechanism, (0.0, 1.0, tau, tau), table, start, history, surroundings, base)


def solve_lengths(
    mechanism: Chain[S],
    lengths: ArrayLike,
    loads: Sequence[Load] = (),
    start: Start = None,
    method: str = "elastic",
    tension_limits: tuple[ArrayLike, ArrayLike] = (0.0, np.inf),
    history: History = None,
    surroundings: Around = None,
    base: ArrayLike = ORIGIN,
) -> S:
    """Equilibrium under given tendon lengths.

    Args:
        mechanism: a RollingChain or a HingeChain.
        lengths: (m,) unstretched length that the motors leave in the channels [mm] ("elastic"), or desired lengths
            ("least_squares").
        loads: external loads.
        start: joint angles (n - 1,) [rad] or an equilibrium to start from; default s = 0, or hinges at rest.
        method: "elastic": tension = clip(stiffness × stretch, *tension_limits), unique and well posed while a tendon is
            taut. "least_squares": tensions within the limits that bring the lengths nearest the desired ones.
        tension_limits: minimum and maximum tendon tension, numbers or (m,) [N]. With "least_squares" an infinite
            maximum stands for 1000 N.
        history: for a mechanism with friction, the equilibrium before this step, or its friction_state. Without it the
            result is the pose without friction, before any slip. Default start: its joint angles.
        surroundings: walls around the mechanism; None: none. base: pose of its base among them, x, y [mm], angle [rad],
            in space x, y, z [mm], and after them a rotation vector [rad] if it is turned; the results and loads are in
            the frame of the base.
    Returns:
        Equilibrium or HingeEquilibrium; look at its status.
    Raises:
        InvalidInput: wrong shapes or types, an unknown method, a load on a link that does not exist.
    Source: docs/theory.md, section 4; least squares: rolling-contact paper, eq. 29.
    """
    check_chain(mechanism)
    command = seen_as_vector("lengths", lengths, mechanism.n_tendons, "one per tendon")
    low, high = broadcast_limits(tension_limits, mechanism.n_tendons)
    table = mechanism.load_table(loads)
    if method == "elastic":
        return _solve_one(
            mechanism, (command, mechanism.stiffnesses, low, high), table, start, history, surroundings, base
        )
    if method != "least_squares":
        raise InvalidInput("method", method, '"elastic" or "least_squares"')
    if surroundings is not None:
        raise InvalidInput("surroundings", surroundings, 'None with method "least_squares"', 'Use "elastic".')
    if history is not None and mechanism.has_friction:
        raise InvalidInput("history", history, 'None with method "least_squares"', 'Use "elastic" with friction.')
    phi = angles_of(mechanism, start, history).copy()
    lowest, highest = tension_limits_of(tension_limits, mechanism.n_tendons)
    return solve_least_squares(mechanism, command.copy(), lowest, highest, table, phi)


def solve_tensions_batch(
    mechanism: Chain[S] | Sequence[Chain[S]],
    tensions: ArrayLike,
    loads: Sequence[Load] | Array = (),
    starts: Start = None,
    history: History = None,
    surroundings: Around | Sequence[Around] = None,
    base: ArrayLike = ORIGIN,
) -> S:
    """Equilibria under given tensions, row by row.

    Args:
        mechanism: the chain, or one per row, all with equal numbers of links, tendons and crossed joints.
        tensions: (B, m) [N].
        loads: loads shared by all rows, or a table (B, rows, columns) with columns load.LOAD_COLUMNS, or
            load.SPATIAL_LOAD_COLUMNS for a HingeChain.
        starts: joint angles (B, n - 1) [rad], or a batch to start from; default s = 0, or hinges at rest.
        history: for mechanisms with friction, the batch of equilibria before this step, or one for all rows.
        surroundings: walls around the mechanisms: for all rows, or a list, one per row; None: none. base: pose of the
            base among them, (3,) or (B, 3), x, y [mm], angle [rad]; in space (B, 3 or 6) x, y, z [mm], rotation vector.
    Returns:
        Equilibrium or HingeEquilibrium, a leading axis B on its arrays; each row is the single solve to the last bit.
    Raises:
        InvalidInput: wrong shapes or types, mechanisms with different numbers of links, tendons or crossed joints.
    """
    batch = Batch.of(mechanism, "tensions", tensions)
    return batch.solve(prescribed(batch.inputs), loads, starts, history, surroundings, base)


def solve_lengths_batch(
    mechanism: Chain[S] | Sequence[Chain[S]],
    lengths: ArrayLike,
    loads: Sequence[Load] | Array = (),
    starts: Start = None,
    tension_limits: tuple[ArrayLike, ArrayLike] = (0.0, np.inf),
    history: History = None,
    surroundings: Around | Sequence[Around] = None,
    base: ArrayLike = ORIGIN,
) -> S:
    """Equilibria under given lengths (elastic tendons), row by row.

    Args:
        mechanism: the chain, or one per row, all with equal numbers of links, tendons and crossed joints.
        lengths: (B, m) unstretched lengths [mm].
        loads: loads shared by all rows, or a table (B, rows, columns) with columns load.LOAD_COLUMNS, or
            load.SPATIAL_LOAD_COLUMNS for a HingeChain.
        starts: joint angles (B, n - 1) [rad], or a batch to start from; default s = 0, or hinges at rest.
        tension_limits: minimum and maximum tendon tension, numbers or (m,) [N].
        history: for mechanisms with friction, the batch of equilibria before this step, or one for all rows.
        surroundings: walls around the mechanisms: for all rows, or a list, one per row; None: none. base: pose of the
            base among them, (3,) or (B, 3), x, y [mm], angle [rad]; in space (B, 3 or 6) x, y, z [mm], rotation vector.
    Returns:
        Equilibrium or HingeEquilibrium, a leading axis B on its arrays; each row is the single solve to the last bit.
    Raises:
        InvalidInput: wrong shapes or types, mechanisms with different numbers of links, tendons or crossed joints.
    """
    batch = Batch.of(mechanism, "lengths", lengths)
    limits = tension_limits_of(tension_limits, batch.inputs.shape[1])
    low, high = map(batch.repeated, limits)
    stiffnesses = batch.per_row("stiffnesses")
    return batch.solve(TendonLaw(batch.inputs, stiffnesses, low, high), loads, starts, history, surroundings, base)


def _solve_one(
    mechanism: AnyChain, law: Law, table: Array, start: Start, history: History, surroundings: Around, base: ArrayLike
) -> Any:
    """The equilibrium of one mechanism, with friction if it has any and there is a history."""
    angles = angles_of(mechanism, start, history)
    if surroundings is not None:
        return _solve_among(mechanism, law, table, angles, (start, history), surroundings, base)
    if history is None or not mechanism.has_friction:
        slot, spares = spare_slot(mechanism, len(table))
        slot.enter(law, table, angles)
        equilibrium = slot.solve(mechanism, read_only(table))
        spares.append(slot)
        return equilibrium
    before = checked_history(mechanism, history, None)
    return solve_one(mechanism, full_law(law, mechanism.n_tendons), table, angles.copy(), before)


def _solve_among(
    mechanism: AnyChain,
    law: Law,
    table: Array,
    angles: Array,
    before: tuple[Start, History],
    surroundings: Around,
    base: ArrayLike,
) -> Any:
    """The equilibrium of one mechanism among walls; without friction in a slot, if it passes through none."""
    walls = walls_of(surroundings, mechanism)
    frictionless = before[1] is None or not (mechanism.has_friction or has_wall_friction(walls))
    if frictionless and len(walls.rigid) == 1:
        slot, spares = spare_slot(mechanism, len(table), walls=walls)
        slot.enter(law, table, angles)
        slot.enter_way(base_of(base, mechanism.dimension), *before)
        equilibrium = slot.solve(mechanism, read_only(table), before[0] is not None or before[1] is not None)
        spares.append(slot)
        if equilibrium is not None:
            return equilibrium
    return solve_one_among(mechanism, full_law(law, mechanism.n_tendons), table, angles, before, surroundings, base)
