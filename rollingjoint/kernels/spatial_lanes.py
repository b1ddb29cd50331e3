"""Chains in space in lanes under dead forces: all that arms and chains with contacts share.

A block of theirs has the fields `state`, `law`, `loads`, `limits` and `springs` of hinge_lanes.HingeBlock.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint._numba.jit import part
from rollingjoint._numba.layout import size
from rollingjoint._numba.simd import where
from rollingjoint._numba.views import numbers
from rollingjoint.kernels.arrays import AT_LIMIT, CONVERGED
from rollingjoint.kernels.hinges import N_DEAD_SUMS, PX, evaluate_hinges
from rollingjoint.kernels.joints import aligned
from rollingjoint.kernels.lanes import HELD, STEPS, WORST, fill_law, fill_start
from rollingjoint.kernels.spatial_loads import any_spring, dead_moment, evaluate_dead_loads, fill_dead_loads, lever
from rollingjoint.kernels.tendons import evaluate_tendons, fill_residual
from rollingjoint.kernels.vectors import dot, in_space


class SpatialBlockSizes(NamedTuple):
    """Lengths of the axes of a block."""

    J: int
    n: int
    m: int
    rows: int
    sums: int
    held: int


@part(inline=True)
def sizes_of(batch):
    """Sizes of the block of a batch."""
    n_joints = batch.starts.shape[1]
    rows = batch.loads.shape[1]
    return SpatialBlockSizes(n_joints, n_joints + 1, batch.chain.tendon_joints.size, rows, N_DEAD_SUMS, 0)


def lone_memory(layout: type, batch: Any) -> NDArray[np.float64]:
    """The memory of a single lane of a block of this class, for a batch."""
    (_, n_joints), rows, m = batch.starts.shape, batch.loads.shape[1], len(batch.chain.tendon_joints)
    lengths = SpatialBlockSizes(n_joints, n_joints + 1, m, rows, N_DEAD_SUMS, 0)._asdict()
    return aligned(np.zeros(size(layout, lengths) + 2))


@part(inline=True)
def evaluate_forces(block, tendon_joints):
    """Fill tensions, sums of loads and residual where poses are known; returns as `evaluate_lanes`."""
    state = block.state
    energy, magnitude = evaluate_tendons(block.law, state)
    load_energy, load_magnitude = evaluate_dead_loads(block.loads, state)
    spring_energy = evaluate_hinges(block.limits, block.springs, state)
    scale = 0.0 * state.angle[0]
    for i in range(state.angle.size):
        moment = dot(in_space(state.axis, i, 0), dead_moment(state, i))
        spring = block.springs[i] * (state.angle[i] - block.limits[i, 2])
        size = fill_residual(tendon_joints, state, i, spring, moment)
        scale = where(size > scale, size, scale)
    magnitude = magnitude + (load_magnitude + spring_energy)
    return energy + (load_energy + spring_energy), magnitude, scale


def fill_row_of_loads(block, i, H):
    """Fill row i of H with the terms of dead forces; returns their term on the diagonal."""
    axis, w = block.state.axis, lever(block.state, i)
    for m in range(i):
        H[i, m] = -dot(in_space(axis, m, 0), w)
    return -dot(in_space(axis, i, 0), w)


@part(inline=True)
def fill_dead_inputs(batch, block, lane, row):
    """Copy one row's inputs into a lane; False where they need the general solver."""
    supported = not any_spring(batch.chain.standing[batch.designs[row]])
    supported = supported and fill_law(batch.laws, block, lane, row)
    supported = supported and fill_dead_loads(batch.loads[row], numbers(block.loads), lane)
    return supported and fill_start(batch.starts, block, lane, row)


@part(inline=True)
def store_equilibrium(block, results, lane, row):
    """Copy an equilibrium into its row of the results, torques left out."""
    search, state = numbers(block.search), block.state
    angle, pose, gap = numbers(state.angle), numbers(state.pose), numbers(state.gap)
    tension, length, elastic = numbers(state.tension), numbers(state.length), numbers(state.elastic)
    for i in range(angle.shape[0]):
        results.joint_angles[row, i] = angle[i, lane]
        for j in range(tension.shape[0]):
            results.rates[row, i, j] = gap[i, j, 1, lane]
    for k in range(pose.shape[0]):
        for a in range(3):
            for b in range(3):
                results.poses[row, k, a, b] = pose[k, 3 * a + b, lane]
            results.poses[row, k, a, 3], results.poses[row, k, 3, a] = pose[k, PX + a, lane], 0.0
        results.poses[row, k, 3, 3] = 1.0
    for j in range(tension.shape[0]):
        results.tensions[row, j], results.lengths[row, j] = tension[j, lane], length[j, lane]
        results.elastic[row, j] = elastic[j, lane]
    results.residual[row], results.iterations[row] = search[WORST, lane], int(search[STEPS, lane])
    results.status[row] = AT_LIMIT if search[HELD, lane] > 0.0 else CONVERGED
    results.escapes[row] = 0
