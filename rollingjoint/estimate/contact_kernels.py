"""Histories of motors followed among walls, compiled: as kernels.py, with equilibria that are solved outside.

The numbers of the wall are where other hidden numbers have displaced surfaces, which a chain among walls has none of.
"""

from __future__ import annotations

import numpy as np

from rollingjoint.compiled import borrow, kernel, part
from rollingjoint.estimate.arrays import Scratch
from rollingjoint.estimate.derivatives import fill_causes, fill_rates
from rollingjoint.estimate.equations import eliminate
from rollingjoint.estimate.kernels import LOST, new_scratch, prepare, take_picture, take_tensions
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import AT_LIMIT
from rollingjoint.kernels.batch import stiffness_at


@kernel(nogil=True, title="the estimates of contacts")
def prepare_rows(model, history, track, batch):
    """Move the tendons of all rows on by a step, and fill the batch; how many rows have a step left."""
    model, history, track, batch = borrow(model), borrow(history), borrow(track), borrow(batch)
    going = 0
    for row in range(track.steps.size):
        if track.steps[row] < history.counts[track.episodes[row]]:
            prepare(model, history, track, batch, row)
            going += 1
    return going


@kernel(nogil=True, title="the estimates of contacts")
def take_in_rows(model, history, track, batch, stiffnesses, by_wall):
    """Take the measurements of a step in, of all rows that have one left.

    Args:
        batch: BatchArrays of the rows, with their equilibria.
        stiffnesses: d residual / d joint angle, the wall's included, (R, J, J) [N·mm/rad].
        by_wall: torques at joints by the numbers of the wall, (R, J, W).
    """
    model, history, track, batch = borrow(model), borrow(history), borrow(track), borrow(batch)
    n_joints, m, K = track.angles.shape[1], track.played.shape[1], track.slope.shape[1]
    scratch = new_scratch(model, n_joints, m, K)
    scratch.values[:], scratch.slopes[:] = 0.0, 0.0
    without = Scratch(
        scratch.state,
        scratch.H,
        np.empty((n_joints, 2 + m)),
        scratch.values,
        scratch.slopes,
        scratch.rates,
        scratch.column,
    )
    kept, chain = np.empty(by_wall.shape[2]), formulas.design(model.chain, 0)
    for row in range(track.steps.size):
        if track.steps[row] >= history.counts[track.episodes[row]]:
            continue
        first = model.at.surfaces
        for c in range(kept.size):  # rates act from here on: these numbers have no effect beside them
            kept[c] = track.numbers[row, first + c]
            track.numbers[row, first + c] = 0.0
        usable = batch.results.status[row] <= AT_LIMIT
        if not (usable and _take_in(model, chain, history, track, batch, scratch, without, stiffnesses, by_wall, row)):
            track.cost[row] += LOST
            track.misfit[row] += LOST
        for c in range(kept.size):
            track.numbers[row, first + c] = kept[c]
        track.steps[row] += 1


@part
def _take_in(model, chain, history, track, batch, scratch, without, stiffnesses, by_wall, row):
    """Take the measurements of a step of a row in; False where its stiffness is singular."""
    results, causes, angles = batch.results, scratch.causes, track.angles[row]
    for i in range(angles.size):
        angles[i] = results.joint_angles[row, i]
    loads, m = batch.loads[row], track.played.shape[1]
    stiffness_at(chain, results.tensions[row], results.elastic[row], loads, angles, scratch.state, scratch.H)
    for i in range(angles.size):
        for k in range(angles.size):
            scratch.H[i, k] = stiffnesses[row, i, k]
    fill_causes(model, chain, track, batch, without, row)
    for i in range(angles.size):
        free = chain.joints[i, 0] < angles[i] < chain.joints[i, 1]
        for c in range(2 + m):
            causes[i, c] = without.causes[i, c]
        for c in range(by_wall.shape[2]):
            causes[i, 2 + m + c] = by_wall[row, i, c] if free else 0.0
    if not eliminate(scratch.H, causes):
        return False
    fill_rates(model, track, batch, scratch, row)
    take_tensions(model, history, track, scratch, row)
    if history.pictures.shape[2] > 0:
        take_picture(model, history, track, batch, scratch, row)
    return True
