"""Histories of motors followed by many hidden numbers at once, compiled: what would have been measured, and its rates.

A row is a vector of hidden numbers (hidden.py) that is followed along the history of an episode, from its start. At
every step its tendons are where the play operator takes them, its equilibrium is solved, and all that is measured is
differentiated by all hidden numbers: exactly at the equilibrium of the nominal surfaces, which displaced ones change
linearly. Symbols: r residual, H stiffness, g gap; T tension, l length, c command, k stiffness of a tendon.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint.chain.status import Status
from rollingjoint.compiled import (
    PENDING,
    Floats,
    Integers,
    PinnedBatch,
    borrow,
    call_range,
    kernel,
    part,
    play_contact,
    play_place,
    play_step,
    sheath_ratio,
    unstretched_length,
)
from rollingjoint.estimate.hidden import PER_JOINT, HiddenLayout
from rollingjoint.estimate.surfaces import SurfaceTables
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import NEGLIGIBLE
from rollingjoint.kernels.batch import stiffness_at
from rollingjoint.kernels.rolling import Chain, State
from rollingjoint.load import LOAD_COLUMNS

AT_LIMIT = int(Status.AT_LIMIT)  # the last status of a usable equilibrium
LINK, FX = LOAD_COLUMNS.index("link"), LOAD_COLUMNS.index("fx")
NARROW = 1e-6  # mm: half the width of a play that is none
LOST = 100.0  # cost of a step without a usable equilibrium
YIELD = 1e-6  # mm: a motor that is farther from where it was asked to go has given way


class MeasurementLaw(NamedTuple):
    """What is known of the measurements, and how far they may be off; numbers.

    start_tension: of all tendons before the load acts [N]. start_sd: of the lengths that follow from it, where motors
    were set without their offsets [mm]; inf: they were not. shown_sd: of that tension, where load cells showed it when
    motors were set, which a first, unloaded step of the history stands for [N]; inf: there is none.
    low, high: tensions at which motors take their tendons along; inf: not known [N]. limit_sd: of these tensions; inf:
    they are not used. cells_at_tendons: whether load cells are behind the sheath.
    memory: share of the force that stays from step to step; 1: all of it.
    angle_sd, position_sd: of the links in a picture [rad, mm].
    tension_sd: of a measured tension [N]. tension_share: the same in proportion to it. robust: standard deviations
    beyond which a residual counts linearly.
    """

    start_tension: float
    start_sd: float
    shown_sd: float
    low: float
    high: float
    limit_sd: float
    cells_at_tendons: bool
    tension_sd: float
    tension_share: float
    robust: float
    memory: float = 1.0
    angle_sd: float = 0.01
    position_sd: float = 0.5


class Model(NamedTuple):
    """The nominal chain, the law of its measurements, and the standard deviations of the hidden numbers."""

    chain: Chain
    tables: SurfaceTables
    law: MeasurementLaw
    at: HiddenLayout
    stiffnesses: Annotated[Floats, "m"]
    means: Annotated[Floats, "K"]
    sds: Annotated[Floats, "K"]


class MotorHistory(NamedTuple):
    """What N episodes have measured in up to T steps."""

    counts: Annotated[Integers, "N"]  # of the steps
    motors: Annotated[Floats, "N", "T", "m"]  # their positions, mm
    shifts: Annotated[Floats, "N", "T", "m"]  # how far motors have given way in a step, mm
    tensions: Annotated[Floats, "N", "T", "m"]  # measured, N
    pictures: Annotated[Floats, "N", "T", "links", 3]  # x, y, angle of the moving links, mm, rad; NaN where none is


class Track(NamedTuple):
    """Rows of hidden numbers, how far they have been followed, and the normal equations of what was measured.

    Changes of hidden numbers are in units of their standard deviations in the normal equations.
    """

    episodes: Annotated[Integers, "R"]
    links: Annotated[Integers, "R"]  # the loaded ones
    numbers: Annotated[Floats, "R", "K"]
    steps: Annotated[Integers, "R"]  # that have been followed
    played: Annotated[Floats, "R", "m"]  # commands of the tendons behind the play, mm
    by_width: Annotated[Floats, "R", "m"]  # their derivatives by half the width,
    by_place: Annotated[Floats, "R", "m"]  # and by where the motor began
    angles: Annotated[Floats, "R", "J"]  # of the equilibrium, from which the next solve starts, rad
    information: Annotated[Floats, "R", "K", "K"]  # lower triangle
    slope: Annotated[Floats, "R", "K"]
    cost: Annotated[Floats, "R"]
    misfit: Annotated[Floats, "R"]  # the part of the cost that measurements have
    tip: Annotated[Floats, "R", 2]  # mm
    tip_by: Annotated[Floats, "R", 2, "K"]
    tensions: Annotated[Floats, "R", "m"]  # N
    tensions_by: Annotated[Floats, "R", "m", "K"]
    volume: Annotated[Floats, "R"]  # half the logarithm of the determinant of the eliminated information
    forces: Annotated[Floats, "R", "times", 2]  # in every step, NaN where not known; none where it stays as it is, N
    forward: Annotated[Floats, "R", "times", 2, "K"]  # the change of a force by those of the next one and all others,
    alone: Annotated[Floats, "R", "times", 2]  # and without any


class Scratch(NamedTuple):
    """Room for the derivatives of one row."""

    state: State
    H: Annotated[Floats, "J", "J"]
    causes: Annotated[Floats, "J", "causes"]  # torques by force, commands and surfaces; then joint angles
    values: Annotated[Floats, "J", "rates"]  # of the surface tables,
    slopes: Annotated[Floats, "J", "rates"]  # and their derivatives by the joint's angle
    rates: Annotated[Floats, "m", "causes"]  # of tensions; of lengths before
    column: Annotated[Floats, "K"]  # of one measurement, by the hidden numbers


@kernel(nogil=True, title="the smoother")
def advance(model, history, track, batch, solver, pins, pending):
    """Follow all rows to the last measurements of their episodes.

    Args:
        batch: BatchArrays of the rows. solver, pins: entry and pins of their PinnedRange.
        pending: whether the step of the last call is to be ended first, its equilibria solved meanwhile.
    Returns:
        0, or how many rows of a step the solver has left.
    """
    model, history, track, batch = borrow(model), borrow(history), borrow(track), borrow(batch)
    n_joints, m, K = track.angles.shape[1], track.played.shape[1], track.slope.shape[1]
    scratch = _new_scratch(model, n_joints, m, K)
    return _follow(model, history, track, batch, scratch, solver, pins, pending)


@part
def _new_scratch(model, n_joints, m, K):
    n_rates = model.tables.values.shape[2] if model.at.surfaces < K else 0
    n_causes = 2 + m + K - model.at.surfaces
    return Scratch(
        formulas.new_state(model.chain, n_joints, m),
        np.empty((n_joints, n_joints)),
        np.empty((n_joints, n_causes)),
        np.empty((n_joints, n_rates)),
        np.empty((n_joints, n_rates)),
        np.empty((m, n_causes)),
        np.empty(K),
    )


@part
def _follow(model, history, track, batch, scratch, solver, pins, pending):
    """`advance`, with room for its numbers."""
    scratch = borrow(scratch)
    n_rows = track.steps.size
    chain = formulas.design(model.chain, 0)
    while True:
        if not pending:
            going = 0
            for row in range(n_rows):
                if track.steps[row] < history.counts[track.episodes[row]]:
                    _prepare(model, history, track, batch, row)
                    going += 1
            if going == 0:
                return 0
            left = n_rows if solver == 0 else call_range(solver, pins, PinnedBatch, 0, n_rows)
            if left != 0:
                if left < 0:
                    for row in range(n_rows):
                        batch.results.status[row] = PENDING
                return n_rows if left < 0 else left
        for row in range(n_rows):
            if track.steps[row] < history.counts[track.episodes[row]]:
                usable = batch.results.status[row] <= AT_LIMIT
                if not (usable and _take_in(model, chain, history, track, batch, scratch, row)):
                    track.cost[row] += LOST
                    track.misfit[row] += LOST
                track.steps[row] += 1
        pending = False


@part(inline=True)
def _prepare(model, history, track, batch, row):
    """Move the tendons of a row on by a step; fill its commands, loads and start."""
    at, numbers, step, episode = model.at, track.numbers[row], track.steps[row], track.episodes[row]
    if track.forces.shape[1] > 0:
        _look_up_force(model, track, row)
    if step == 0:
        _begin(model, track, row)
    for j in range(track.played.shape[1]):
        motor, shift = history.motors[episode, step, j], history.shifts[episode, step, j]
        half, place, played = numbers[at.half_widths + j], numbers[at.places + j], track.played[row, j]
        if step == 0:
            played = motor - 2.0 * place * half
            track.by_width[row, j], track.by_place[row, j] = -2.0 * place, -2.0 * half
        else:
            side = play_contact(played, motor - shift, half)
            if side != 0.0:
                track.by_width[row, j], track.by_place[row, j] = side, 0.0
            played = play_step(played, motor - shift, half) + shift
        track.played[row, j] = played
        batch.laws.command[row, j] = played + numbers[at.offsets + j]
        batch.laws.stiffness[row, j] = model.stiffnesses[j] * numbers[at.stiffnesses + j]
    batch.loads[row, 0, LINK] = track.links[row]
    acts = _load_acts(model, step)
    batch.loads[row, 0, FX], batch.loads[row, 0, FX + 1] = acts * numbers[0], acts * numbers[1]
    for i in range(track.angles.shape[1]):
        batch.starts[row, i] = track.angles[row, i]


@part(inline=True)
def _look_up_force(model, track, row):
    """The force of this step; where it is not known, its mean after that of the last one, which leaves the unknowns."""
    step, memory = track.steps[row], model.law.memory
    for axis in range(2):
        if not math.isfinite(track.forces[row, step, axis]):
            track.forces[row, step, axis] = memory * track.forces[row, step - 1, axis] if step > 0 else 0.0
        track.numbers[row, axis] = track.forces[row, step, axis]
    if step > 0:
        _leave_force(model, track, row)


@part(inline=True)
def _leave_force(model, track, row):
    """Eliminate the force of the last step from the normal equations, and take that of this step in.

    Their changes x and y: y = memory x + misses + a normal number of variance 1 - memory^2, in standard deviations.
    """
    information, slope, K = track.information[row], track.slope[row], track.slope.shape[1]
    step, memory = track.steps[row], model.law.memory
    forward, alone = track.forward[row, step - 1], track.alone[row, step - 1]
    certainty = 1.0 / (1.0 - memory * memory)
    pull = memory * certainty
    a, b, c = information[0, 0] + memory * pull, information[1, 0], information[1, 1] + memory * pull
    per_determinant = 1.0 / (a * c - b * b)
    track.volume[row] -= 0.5 * math.log(per_determinant) if per_determinant > 0.0 else 0.0
    for axis in range(2):
        misses = memory * track.forces[row, step - 1, axis] - track.forces[row, step, axis]
        misses = misses / model.sds[axis] if model.sds[axis] > 0.0 else 0.0
        track.cost[row] += 0.5 * certainty * misses * misses
        slope[axis] -= pull * misses
        alone[axis] = certainty * misses  # for a while
    first, second = (c * slope[0] - b * slope[1]) * per_determinant, (a * slope[1] - b * slope[0]) * per_determinant
    slope[0], slope[1] = alone[0] + pull * first, alone[1] + pull * second
    alone[0], alone[1] = first, second
    forward[0, 0], forward[0, 1] = -pull * c * per_determinant, pull * b * per_determinant
    forward[1, 0], forward[1, 1] = pull * b * per_determinant, -pull * a * per_determinant
    for k in range(2, K):
        x, y = information[k, 0], information[k, 1]
        forward[0, k], forward[1, k] = (c * x - b * y) * per_determinant, (a * y - b * x) * per_determinant
    for i in range(2, K):
        x, y = information[i, 0], information[i, 1]
        for k in range(2, i + 1):
            information[i, k] -= x * forward[0, k] + y * forward[1, k]
        slope[i] -= x * first + y * second
        information[i, 0] = -(x * forward[0, 0] + y * forward[1, 0])
        information[i, 1] = -(x * forward[0, 1] + y * forward[1, 1])
    information[0, 0] = certainty + pull * forward[0, 0]
    information[1, 0] = pull * forward[1, 0]
    information[1, 1] = certainty + pull * forward[1, 1]


@part(inline=True)
def _load_acts(model, step):
    """1 where the load acts in a step, else 0."""
    return 0.0 if step == 0 and model.law.shown_sd < math.inf else 1.0


@part(inline=True)
def _take_in(model, chain, history, track, batch, scratch, row):
    """Take the measurements of a step in, at the equilibrium of a row; False where its stiffness is singular."""
    results, loads = batch.results, batch.loads[row]
    for i in range(track.angles.shape[1]):
        track.angles[row, i] = results.joint_angles[row, i]
    stiffness_at(chain, results.tensions[row], results.elastic[row], loads, track.angles[row], scratch.state, scratch.H)
    _fill_causes(model, chain, track, batch, scratch, row)
    if not _eliminate(scratch.H, scratch.causes):
        return False
    _fill_rates(model, track, batch, scratch, row)
    if track.steps[row] == 0:
        _take_start(model, track, scratch, row)
    _take_tensions(model, history, track, scratch, row)
    if history.pictures.shape[2] > 0:
        _take_picture(model, history, track, batch, scratch, row)
    return True


@part(inline=True)
def _fill_causes(model, chain, track, batch, scratch, row):
    """Fill the torques at joints by a change of the force, the commands and the surfaces; joints at a limit stay."""
    state, causes, results = scratch.state, scratch.causes, batch.results
    n_joints, m = state.angle.size, state.length.size
    link = track.links[row]
    x, y, acts = state.pose[link, 0], state.pose[link, 1], _load_acts(model, track.steps[row])
    for i in range(n_joints):
        carries = acts if i < link else 0.0
        causes[i, 0] = carries * (state.contact[i, 1] - y)
        causes[i, 1] = carries * (x - state.contact[i, 0])
        for j in range(m):
            rate = state.gap[i, j, 1] if i < chain.tendon_joints[j] else 0.0
            causes[i, 2 + j] = results.elastic[row, j] * rate
        for c in range(2 + m, causes.shape[1]):
            causes[i, c] = 0.0
    if causes.shape[1] > 2 + m:
        _evaluate_tables(model.tables, state.angle, scratch)
        _add_surfaces(chain, track, batch, scratch, row)
    for i in range(n_joints):
        if not chain.joints[i, 0] < state.angle[i] < chain.joints[i, 1]:
            for c in range(causes.shape[1]):
                causes[i, c] = 0.0
            for k in range(n_joints):
                scratch.H[i, k] = scratch.H[k, i] = 0.0
            scratch.H[i, i] = 1.0


@part(inline=True)
def _evaluate_tables(tables, angle, scratch):
    """Fill the rates by the surfaces and their derivatives, of every joint."""
    n_points, n_rates = tables.values.shape[1], tables.values.shape[2]
    for i in range(angle.size):
        place = min(max((angle[i] - tables.lowest[i]) * tables.per_radian[i], 0.0), n_points - 1.0)
        point = min(int(place), n_points - 2)
        share = place - point
        for k in range(n_rates):
            value, slope = tables.values[i, point, k], tables.slopes[i, point, k]
            scratch.values[i, k] = value + share * (tables.values[i, point + 1, k] - value)
            scratch.slopes[i, k] = slope + share * (tables.slopes[i, point + 1, k] - slope)


@part(inline=True)
def _add_surfaces(chain, track, batch, scratch, row):
    """Add the torques by the surfaces: -dr/ds = -T dg'/ds - k g' dl/ds + F d(dx/dphi)/ds."""
    state, causes, results = scratch.state, scratch.causes, batch.results
    n_joints, m, link = state.angle.size, state.length.size, track.links[row]
    fx, fy = batch.loads[row, 0, FX], batch.loads[row, 0, FX + 1]
    for below in range(n_joints):
        cos, sin = state.pose[below, 3], state.pose[below, 4]
        for number in range(PER_JOINT):
            c, first = 2 + m + PER_JOINT * below + number, number * (m + 2)
            for j in range(m):
                pull = results.elastic[row, j] * scratch.values[below, first + j]
                for i in range(chain.tendon_joints[j]):
                    causes[i, c] -= pull * state.gap[i, j, 1]
                if below < chain.tendon_joints[j]:
                    causes[below, c] -= results.tensions[row, j] * scratch.slopes[below, first + j]
            if below < link:
                dx, dy = scratch.values[below, first + m], scratch.values[below, first + m + 1]
                x, y = cos * dx - sin * dy, sin * dx + cos * dy
                for i in range(below):
                    causes[i, c] += fy * x - fx * y
                dx, dy = scratch.slopes[below, first + m], scratch.slopes[below, first + m + 1]
                causes[below, c] += fx * (cos * dx - sin * dy) + fy * (sin * dx + cos * dy)


@part(inline=True)
def _eliminate(H, columns):
    """Solve H X = columns in place, H symmetric; False where it is not positive definite."""
    n, width = columns.shape
    for i in range(n):
        if not H[i, i] > NEGLIGIBLE:
            return False
        for k in range(i + 1, n):
            factor = H[k, i] / H[i, i]
            for c in range(i + 1, n):
                H[k, c] -= factor * H[i, c]
            for c in range(width):
                columns[k, c] -= factor * columns[i, c]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            factor = H[i, k]
            for c in range(width):
                columns[i, c] -= factor * columns[k, c]
        for c in range(width):
            columns[i, c] /= H[i, i]
    return True


@part(inline=True)
def _fill_rates(model, track, batch, scratch, row):
    """Fill tip and tensions with their derivatives by all hidden numbers; displaced surfaces change both linearly."""
    state, turns, at, results = scratch.state, scratch.causes, model.at, batch.results
    n_joints, m = state.angle.size, state.length.size
    n_causes, tip_by, tensions_by = turns.shape[1], track.tip_by[row], track.tensions_by[row]
    for k in range(at.total):
        tip_by[0, k] = tip_by[1, k] = 0.0
        for j in range(m):
            tensions_by[j, k] = 0.0
    track.tip[row, 0], track.tip[row, 1] = state.pose[n_joints, 0], state.pose[n_joints, 1]
    for j in range(m):
        rates, elastic = scratch.rates[j], results.elastic[row, j]
        track.tensions[row, j] = results.tensions[row, j]
        for c in range(n_causes):
            rates[c] = 0.0
        for c in range(2 + m, n_causes):
            below, number = divmod(c - 2 - m, PER_JOINT)
            rates[c] = scratch.values[below, number * (m + 2) + j]
        for i in range(n_joints):
            rate = state.gap[i, j, 1] if i < model.chain.tendon_joints[j] else 0.0
            for c in range(n_causes):
                rates[c] += rate * turns[i, c]
        rates[2 + j] -= 1.0
        for c in range(n_causes):
            rates[c] *= elastic
        _spread(model, track, batch, rates, row, tensions_by[j])
    for axis in range(2):
        _fill_place(scratch, n_joints, m, axis)
        _spread(model, track, batch, scratch.rates[0], row, tip_by[axis])
    for c in range(at.surfaces, at.total):
        displacement = track.numbers[row, c]
        for axis in range(2):
            track.tip[row, axis] += tip_by[axis, c] * displacement
        for j in range(m):
            track.tensions[row, j] += tensions_by[j, c] * displacement


@part(inline=True)
def _fill_place(scratch, link, m, axis):
    """Fill the first rates with those of a link's origin along an axis, by force, commands and surfaces."""
    state, turns, rates = scratch.state, scratch.causes, scratch.rates[0]
    x, y = state.pose[link, 0], state.pose[link, 1]
    for c in range(turns.shape[1]):
        rates[c] = 0.0
    for i in range(link):
        lever = state.contact[i, 1] - y if axis == 0 else x - state.contact[i, 0]
        for c in range(turns.shape[1]):
            rates[c] += lever * turns[i, c]
    for c in range(2 + m, turns.shape[1]):
        below, number = divmod(c - 2 - m, PER_JOINT)
        if below < link:
            cos, sin = state.pose[below, 3], state.pose[below, 4]
            dx, dy = scratch.values[below, number * (m + 2) + m], scratch.values[below, number * (m + 2) + m + 1]
            rates[c] += cos * dx - sin * dy if axis == 0 else sin * dx + cos * dy


@part(inline=True)
def _spread(model, track, batch, rates, row, by):
    """From the derivatives of a quantity by force, commands and surfaces to those by all hidden numbers."""
    at, m = model.at, track.played.shape[1]
    by[0], by[1] = rates[0], rates[1]
    for j in range(m):
        by_command = rates[2 + j]
        factor = track.numbers[row, at.stiffnesses + j]
        stretch = batch.results.tensions[row, j] / (model.stiffnesses[j] * factor)
        by[at.offsets + j] = by_command
        by[at.stiffnesses + j] = -by_command * stretch / factor
        by[at.half_widths + j] = by_command * track.by_width[row, j]
        by[at.places + j] = by_command * track.by_place[row, j]
    for c in range(at.total - at.surfaces):
        by[at.surfaces + c] = rates[2 + m + c]


@part(inline=True)
def _begin(model, track, row):
    """Begin the normal equations with the prior."""
    information, slope = track.information[row], track.slope[row]
    cost = 0.0
    for k in range(slope.size):
        for i in range(slope.size):
            information[k, i] = 0.0
        information[k, k] = 1.0
        off = (model.means[k] - track.numbers[row, k]) / model.sds[k] if model.sds[k] > 0.0 else 0.0
        slope[k] = off
        cost += 0.5 * off * off
    track.cost[row], track.misfit[row], track.volume[row] = cost, 0.0, 0.0


@part(inline=True)
def _take_start(model, track, scratch, row):
    """Take in that tendons begin at the start tension; where one is at a limit then, only on which side it lies."""
    law, at, numbers, column = model.law, model.at, track.numbers[row], scratch.column
    if not law.start_sd < math.inf:
        return
    for j in range(track.played.shape[1]):
        factor = numbers[at.stiffnesses + j]
        stiffness = model.stiffnesses[j] * factor
        length = model.tables.start_lengths[j]
        for k in range(column.size):
            column[k] = 0.0
        for c in range(at.total - at.surfaces):
            rate = model.tables.start_rates[j, c]
            length += rate * numbers[at.surfaces + c]
            column[at.surfaces + c] = -rate
        off = unstretched_length(length, law.start_tension, stiffness) - track.played[row, j]
        column[at.stiffnesses + j] = -law.start_tension / (stiffness * factor)
        column[at.half_widths + j] = track.by_width[row, j]
        column[at.places + j] = track.by_place[row, j]
        tension = track.tensions[row, j]
        yielded = (tension <= law.low + 3.0 * law.tension_sd and off > 0.0) or (
            tension >= law.high - 3.0 * law.tension_sd and off < 0.0
        )
        if not yielded:
            _add(model, track, column, off, law.start_sd, row)


@part(inline=True)
def _take_tensions(model, history, track, scratch, row):
    """Take the measured tensions of a step in, and that a motor which gives way is at its limit."""
    law, at, numbers, column = model.law, model.at, track.numbers[row], scratch.column
    episode, step = track.episodes[row], track.steps[row]
    for j in range(track.played.shape[1]):
        half, gain = numbers[at.half_widths + j], numbers[at.gains + j]
        friction = 0.0 if law.cells_at_tendons else numbers[at.frictions + j]
        shift = history.shifts[episode, step, j]
        width = half if half > NARROW else 0.0
        place = min(max(play_place(track.played[row, j], history.motors[episode, step, j], width), -1.0), 1.0)
        tension, ratio = track.tensions[row, j], gain * sheath_ratio(friction, place)
        expected = ratio * tension + numbers[at.zeros + j]
        for k in range(column.size):
            column[k] = ratio * track.tensions_by[row, j, k]
        if width > 0.0 and -1.0 < place < 1.0:
            pull = ratio * tension * friction / half
            column[at.half_widths + j] += pull * (track.by_width[row, j] - place)
            column[at.places + j] += pull * track.by_place[row, j]
        if not law.cells_at_tendons:
            column[at.frictions + j] += ratio * tension * place
        column[at.gains + j] += ratio * tension / gain
        column[at.zeros + j] += 1.0
        off = history.tensions[episode, step, j] - expected
        if math.isfinite(off):
            spread = math.hypot(law.tension_sd, law.tension_share * expected)
            if _load_acts(model, step) == 0.0:
                spread = law.shown_sd
            _add(model, track, column, off, spread, row)
        limit = law.high if shift > 0.0 else law.low
        if abs(shift) > YIELD and law.limit_sd < math.inf and limit < math.inf:
            for k in range(column.size):
                column[k] = track.tensions_by[row, j, k]
            _add(model, track, column, limit - tension, law.limit_sd, row)


@part(inline=True)
def _take_picture(model, history, track, batch, scratch, row):
    """Take a picture of a step in, if there is one: place and angle of every moving link."""
    law, at, numbers, column = model.law, model.at, track.numbers[row], scratch.column
    episode, step, state, turns = track.episodes[row], track.steps[row], scratch.state, scratch.causes
    for link in range(1, history.pictures.shape[2] + 1):
        for axis in range(3):
            measured = history.pictures[episode, step, link - 1, axis]
            if not math.isfinite(measured):
                continue
            if axis < 2:
                _fill_place(scratch, link, track.played.shape[1], axis)
            else:
                for c in range(turns.shape[1]):
                    scratch.rates[0, c] = 0.0
                    for i in range(link):
                        scratch.rates[0, c] += turns[i, c]
            for k in range(column.size):
                column[k] = 0.0
            _spread(model, track, batch, scratch.rates[0], row, column)
            expected = state.pose[link, axis]
            for c in range(at.surfaces, at.total):
                expected += column[c] * numbers[c]
            _add(model, track, column, measured - expected, law.position_sd if axis < 2 else law.angle_sd, row)


@part(inline=True)
def _add(model, track, column, off, sd, row):
    """Add a measurement to the normal equations: it is `off` from what a row expects, with these derivatives."""
    information, slope, robust, sds = track.information[row], track.slope[row], model.law.robust, model.sds
    residual = abs(off) / sd
    weight = 1.0 if residual <= robust else robust / residual
    cost = 0.5 * residual * residual if residual <= robust else robust * (residual - 0.5 * robust)
    track.cost[row] += cost
    track.misfit[row] += cost
    for k in range(column.size):
        column[k] *= sds[k] / sd
    for i in range(column.size):
        pull = weight * column[i]
        if pull != 0.0:
            slope[i] += pull * off / sd
            for k in range(i + 1):
                information[i, k] += pull * column[k]


@kernel(nogil=True, title="the smoother")
def propose(track, sds, damping, farthest, numbers, volumes):
    """Fill numbers (R, K): the minimum of the normal equations, at most `farthest` standard deviations away in each.

    Args:
        damping: share of its diagonal added to the information, (R,). A row whose equations cannot be solved stays.
        volumes: to be filled with half the logarithm of the determinant of that sum, (R,).
    """
    n_rows, K = track.slope.shape
    L, x = np.empty((K, K)), np.empty(K)
    for row in range(n_rows):
        information, slope = track.information[row], track.slope[row]
        usable, volumes[row] = True, 0.0
        for i in range(K):
            for k in range(i + 1):
                L[i, k] = information[i, k]
            L[i, i] *= 1.0 + damping[row]
            x[i] = slope[i]
        for i in range(K):  # column by column: the inner loops run along rows
            for k in range(i):
                factor = L[i, k]
                for c in range(k):
                    factor -= L[i, c] * L[k, c]
                L[i, k] = factor / L[k, k]
            pivot = L[i, i]
            for c in range(i):
                pivot -= L[i, c] * L[i, c]
            usable = usable and pivot > 0.0
            L[i, i] = math.sqrt(pivot) if pivot > 0.0 else 1.0
            volumes[row] += math.log(L[i, i])
        for i in range(K):
            for c in range(i):
                x[i] -= L[i, c] * x[c]
            x[i] /= L[i, i]
        for i in range(K - 1, -1, -1):
            for c in range(i + 1, K):
                x[i] -= L[c, i] * x[c]
            x[i] /= L[i, i]
        for i in range(K):
            change = min(max(x[i], -farthest), farthest) if usable and math.isfinite(x[i]) else 0.0
            numbers[row, i] = track.numbers[row, i] + change * sds[i]


@kernel(nogil=True, title="the smoother")
def recall(track, sds, farthest, numbers, forces):
    """Fill the forces (R, T, 2) of all steps where the numbers are changed to these, (R, K)."""
    n_rows, K = numbers.shape
    x = np.empty(K)
    for row in range(n_rows):
        for k in range(K):
            x[k] = (numbers[row, k] - track.numbers[row, k]) / sds[k] if sds[k] > 0.0 else 0.0
        last = track.steps[row] - 1
        forces[row] = math.nan
        for step in range(last, -1, -1):
            if step < last:
                first, second = track.alone[row, step, 0], track.alone[row, step, 1]
                for k in range(K):
                    first -= track.forward[row, step, 0, k] * x[k]
                    second -= track.forward[row, step, 1, k] * x[k]
                x[0], x[1] = min(max(first, -farthest), farthest), min(max(second, -farthest), farthest)
            for axis in range(2):
                forces[row, step, axis] = track.forces[row, step, axis] + x[axis] * sds[axis]


def empty_track(
    episodes: np.ndarray, links: np.ndarray, numbers: np.ndarray, angles: np.ndarray, m: int, forces: np.ndarray
) -> Track:
    """Rows of hidden numbers (R, K) and forces (R, T, 2), to be followed from the start."""
    (R, K), times = numbers.shape, forces.shape[1]
    return Track(
        episodes, links, numbers, np.zeros(R, np.int64),
        np.zeros((R, m)), np.zeros((R, m)), np.zeros((R, m)), angles,
        np.zeros((R, K, K)), np.zeros((R, K)), np.zeros(R), np.zeros(R),
        np.zeros((R, 2)), np.zeros((R, 2, K)), np.zeros((R, m)), np.zeros((R, m, K)),
        np.zeros(R), forces, np.zeros((R, times, 2, K)), np.zeros((R, times, 2)),
    )  # fmt: skip
