"""The memory of eight lanes side by side: inputs, state and scratch space, and its way in and out."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from rollingjoint._numba.jit import part
from rollingjoint._numba.layout import Floats
from rollingjoint._numba.views import numbers
from rollingjoint.kernels.planar.arrays import State
from rollingjoint.kernels.planar.chain import contact_forces
from rollingjoint.kernels.planar.loads import N_DEAD, fill_dead_loads
from rollingjoint.kernels.shared.arrays import AT_LIMIT, CONVERGED, TendonLaw
from rollingjoint.kernels.shared.lanes import HELD, STEPS, WORST, fill_law, fill_start


class Block(NamedTuple):
    """Inputs, state and scratch space of eight lanes, borrowed arrays of SIMD lanes."""

    state: State
    law: TendonLaw
    loads: Annotated[Floats, "rows", N_DEAD]  # columns in loads.py
    limits: Annotated[Floats, "J", 2]  # smallest and largest angle
    holes: Annotated[Floats, "J", "m", 4]
    channels: Annotated[Floats, "m"]
    L: Annotated[Floats, "J", "J"]  # factor of the stiffness L D Lᵀ
    vectors: Annotated[Floats, 6, "J"]  # solution, step, 1 / D, start of the line search: angles, residual; 1 if free
    search: Annotated[Floats, 8]  # columns in shared/lanes.py
    forces: Annotated[Floats, "J", 4]  # contact forces and tangents
    responses: Annotated[Floats, "m", "J"]  # d angle / d command
    rows: Annotated[Floats, 8]  # memory of one row of a joint table per lane


class BlockSizes(NamedTuple):
    """Lengths of the axes of a Block."""

    J: int
    n: int
    m: int
    rows: int
    sums: int


@part(inline=True)
def block_sizes(n_joints, n_tendons, n_loads):
    """Sizes of a Block for chains under dead forces and moments."""
    return BlockSizes(n_joints, n_joints + 1, n_tendons, n_loads, 4)


@part(inline=True)
def fill_design(chain, block, lane, design):
    """Copy what a lane needs of its design."""
    limits, holes, channels = numbers(block.limits), numbers(block.holes), numbers(block.channels)
    for i in range(limits.shape[0]):
        limits[i, 0, lane], limits[i, 1, lane] = chain.joints[design, i, 0], chain.joints[design, i, 1]
        for j in range(channels.shape[0]):
            for k in range(4):
                holes[i, j, k, lane] = chain.holes[design, i, j, k]
    for j in range(channels.shape[0]):
        channels[j, lane] = chain.channels[design, j]


@part(inline=True)
def fill_inputs(laws, standing, loads, starts, block, lane, source):
    """Copy one lane's inputs into the block; False where they need the solver for all cases."""
    usual = fill_law(laws, block, lane, source)
    usual = usual and fill_dead_loads(standing, loads[source], numbers(block.loads), lane)
    return usual and fill_start(starts, block, lane, source)


@part(inline=True)
def fill_force(block, tendon_joints, tension, i):
    """Fill contact force and tangent of joint i; tension: of every tendon in its gap, (m,)."""
    forces = block.forces
    forces[i, 0], forces[i, 1], forces[i, 2], forces[i, 3] = contact_forces(tendon_joints, block.state, tension, i)


@part(inline=True)
def store_lane(block, lane, results, row):
    """Copy an equilibrium into its row of the results."""
    search, state, forces, responses = (
        numbers(block.search),
        block.state,
        numbers(block.forces),
        numbers(block.responses),
    )
    angle, contact, gap, pose = numbers(state.angle), numbers(state.contact), numbers(state.gap), numbers(state.pose)
    tension, length, elastic = numbers(state.tension), numbers(state.length), numbers(state.elastic)
    for i in range(angle.shape[0]):
        results.joint_angles[row, i] = angle[i, lane]
        if results.contacts.shape[0] > 0:
            results.contacts[row, i, 0], results.contacts[row, i, 1] = contact[i, 0, lane], contact[i, 1, lane]
            results.contacts[row, i, 2], results.contacts[row, i, 3] = forces[i, 2, lane], forces[i, 3, lane]
            results.contact_forces[row, i, 0] = forces[i, 0, lane]
            results.contact_forces[row, i, 1] = forces[i, 1, lane]
            for j in range(tension.shape[0]):
                results.rates[row, i, j] = gap[i, j, 1, lane]
        if results.responses.shape[0] > 0:
            for j in range(tension.shape[0]):
                results.responses[row, i, j] = responses[j, i, lane]
    for i in range(pose.shape[0]):
        for k in range(3):
            results.poses[row, i, k] = pose[i, k, lane]
    for j in range(tension.shape[0]):
        results.tensions[row, j], results.lengths[row, j] = tension[j, lane], length[j, lane]
        results.elastic[row, j] = elastic[j, lane]
    results.residual[row], results.iterations[row] = search[WORST, lane], int(search[STEPS, lane])
    results.status[row] = AT_LIMIT if search[HELD, lane] > 0.0 else CONVERGED
