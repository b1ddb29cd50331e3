"""Histories of motors followed by many hidden numbers at once, compiled: what would have been measured, and its rates.

A row is a vector of hidden numbers (hidden.py) that is followed along the history of an episode, from its start. At
every step its tendons are where the play operator takes them, its equilibrium is solved, and all that is measured is
differentiated by all hidden numbers: exactly at the equilibrium of the nominal surfaces, which displaced ones change
linearly. Symbols: r residual, H stiffness, g gap; T tension, l length, c command, k stiffness of a tendon.
"""

from __future__ import annotations

import math

import numpy as np

from rollingjoint.compiled import (
    NARROW,
    PENDING,
    PinnedBatch,
    borrow,
    call_range,
    kernel,
    part,
    play_contact,
    play_step,
    sheath_direction,
    sheath_ratio,
    unstretched_length,
)
from rollingjoint.estimate.arrays import Scratch
from rollingjoint.estimate.derivatives import (
    FX,
    fill_causes,
    fill_place,
    fill_rates,
    load_acts,
    spread,
)
from rollingjoint.estimate.equations import add, eliminate
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import AT_LIMIT
from rollingjoint.kernels.batch import stiffness_at
from rollingjoint.load import LOAD_COLUMNS

LINK = LOAD_COLUMNS.index("link")
LOST = 100.0  # cost of a step without a usable equilibrium
YIELD = 1e-6  # mm: a motor that is farther from where it was asked to go has given way


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
    scratch = new_scratch(model, n_joints, m, K)
    return _follow(model, history, track, batch, scratch, solver, pins, pending)


@part
def new_scratch(model, n_joints, m, K):
    """Room for the derivatives of one row."""
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
                    prepare(model, history, track, batch, row)
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
def prepare(model, history, track, batch, row):
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
    acts = load_acts(model, step)
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
    step, memory, sds = track.steps[row], model.law.memory, model.sds[track.priors[row]]
    forward, alone = track.forward[row, step - 1], track.alone[row, step - 1]
    certainty = 1.0 / (1.0 - memory * memory)
    pull = memory * certainty
    a, b, c = information[0, 0] + memory * pull, information[1, 0], information[1, 1] + memory * pull
    per_determinant = 1.0 / (a * c - b * b)
    track.volume[row] -= 0.5 * math.log(per_determinant) if per_determinant > 0.0 else 0.0
    for axis in range(2):
        misses = memory * track.forces[row, step - 1, axis] - track.forces[row, step, axis]
        misses = misses / sds[axis] if sds[axis] > 0.0 else 0.0
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
def _take_in(model, chain, history, track, batch, scratch, row):
    """Take the measurements of a step in, at the equilibrium of a row; False where its stiffness is singular."""
    results, loads = batch.results, batch.loads[row]
    for i in range(track.angles.shape[1]):
        track.angles[row, i] = results.joint_angles[row, i]
    stiffness_at(chain, results.tensions[row], results.elastic[row], loads, track.angles[row], scratch.state, scratch.H)
    fill_causes(model, chain, track, batch, scratch, row)
    if not eliminate(scratch.H, scratch.causes):
        return False
    fill_rates(model, track, batch, scratch, row)
    if track.steps[row] == 0:
        _take_start(model, track, scratch, row)
    take_tensions(model, history, track, scratch, row)
    if history.pictures.shape[2] > 0:
        take_picture(model, history, track, batch, scratch, row)
    return True


@part(inline=True)
def _begin(model, track, row):
    """Begin the normal equations with the prior of the row."""
    information, slope = track.information[row], track.slope[row]
    means, sds = model.means[track.priors[row]], model.sds[track.priors[row]]
    cost = 0.0
    for k in range(slope.size):
        for i in range(slope.size):
            information[k, i] = 0.0
        information[k, k] = 1.0
        off = (means[k] - track.numbers[row, k]) / sds[k] if sds[k] > 0.0 else 0.0
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
            add(model, track, column, off, law.start_sd, row)


@part(inline=True)
def take_tensions(model, history, track, scratch, row):
    """Take the measured tensions of a step in, and that a motor which gives way is at its limit."""
    law, at, numbers, column = model.law, model.at, track.numbers[row], scratch.column
    episode, step = track.episodes[row], track.steps[row]
    for j in range(track.played.shape[1]):
        half, gain = numbers[at.half_widths + j], numbers[at.gains + j]
        friction = 0.0 if law.cells_at_tendons else numbers[at.frictions + j]
        shift = history.shifts[episode, step, j]
        width = half if half > NARROW else 0.0
        place = sheath_direction(track.played[row, j], history.motors[episode, step, j], width)
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
            if load_acts(model, step) == 0.0:
                spread = law.shown_sd
            add(model, track, column, off, spread, row)
        limit = law.high if shift > 0.0 else law.low
        if abs(shift) > YIELD and law.limit_sd < math.inf and limit < math.inf:
            for k in range(column.size):
                column[k] = track.tensions_by[row, j, k]
            add(model, track, column, limit - tension, law.limit_sd, row)


@part(inline=True)
def take_picture(model, history, track, batch, scratch, row):
    """Take a picture of a step in, if there is one: place and angle of every moving link."""
    law, at, numbers, column = model.law, model.at, track.numbers[row], scratch.column
    episode, step, state, turns = track.episodes[row], track.steps[row], scratch.state, scratch.causes
    for link in range(1, history.pictures.shape[2] + 1):
        for axis in range(3):
            measured = history.pictures[episode, step, link - 1, axis]
            if not math.isfinite(measured):
                continue
            if axis < 2:
                fill_place(scratch, link, track.played.shape[1], axis)
            else:
                for c in range(turns.shape[1]):
                    scratch.rates[0, c] = 0.0
                    for i in range(link):
                        scratch.rates[0, c] += turns[i, c]
            for k in range(column.size):
                column[k] = 0.0
            spread(model, track, batch, scratch.rates[0], row, column)
            expected = state.pose[link, axis]
            for c in range(at.surfaces, at.total):
                expected += column[c] * numbers[c]
            add(model, track, column, measured - expected, law.position_sd if axis < 2 else law.angle_sd, row)
