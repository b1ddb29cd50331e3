"""The memory of eight lanes side by side: inputs, state and scratch space, and its way in and out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rollingjoint._numba.borrowed import as_rows, carve, numbers
from rollingjoint._numba.jit import part
from rollingjoint.kernels.planar.arrays import State, carve_state, state_size
from rollingjoint.kernels.planar.chain import contact_forces
from rollingjoint.kernels.planar.loads import N_DEAD, fill_dead_loads
from rollingjoint.kernels.shared.arrays import AT_LIMIT, CONVERGED, TendonLaw
from rollingjoint.kernels.shared.lane import resolvable
from rollingjoint.kernels.shared.tolerances import LARGEST_INPUT

# Columns of Block.search: energy, its magnitude and |r| where the line search began, part of the step that is tried,
# steps taken, passes, whether a joint is held, phase
ENERGY, MAGNITUDE, WORST, PART, STEPS, PASSES, HELD, PHASE = range(8)
# Phases of a lane
IDLE, RUNNING, ARRIVED, LEFT = 0.0, 1.0, 2.0, 3.0


class Block(NamedTuple):
    """Inputs, state and scratch space of eight lanes, borrowed arrays of Lanes."""

    state: State
    law: TendonLaw
    loads: np.ndarray  # (rows, N_DEAD): columns in loads.py
    limits: np.ndarray  # (J, 2): smallest and largest angle
    holes: np.ndarray  # (J, m, 4)
    channels: np.ndarray  # (m,)
    L: np.ndarray  # (J, J): factor of the stiffness L D Lᵀ
    vectors: np.ndarray  # (6, J): solution, step, 1 / D, angles and residual where the line search began, 1 if free
    search: np.ndarray  # (8,): columns above
    forces: np.ndarray  # (J, 4): contact forces and tangents
    responses: np.ndarray  # (m, J): d angle / d command
    rows: np.ndarray  # one row of a joint table per lane


@part(inline=True)
def block_size(n_joints, n_tendons, n_loads):
    """How many Lanes a Block takes."""
    inputs = 5 * n_tendons + N_DEAD * n_loads + n_joints * (2 + 4 * n_tendons)
    return state_size(n_joints, n_tendons, 4) + inputs + n_joints * (n_joints + 6 + 4 + n_tendons) + 8 + 8


@part(inline=True)
def carve_block(memory, n_joints, n_tendons, n_loads):
    """A Block in memory of Lanes."""
    law = state_size(n_joints, n_tendons, 4)
    loads = law + 4 * n_tendons
    limits = loads + N_DEAD * n_loads
    holes = limits + 2 * n_joints
    channels = holes + 4 * n_joints * n_tendons
    L = channels + n_tendons
    vectors = L + n_joints * n_joints
    search = vectors + 6 * n_joints
    forces = search + 8
    responses = forces + 4 * n_joints
    rows = responses + n_tendons * n_joints
    return Block(
        carve_state(memory, 0, n_joints, n_tendons, 4),
        TendonLaw(
            carve(memory, law, (n_tendons,)),
            carve(memory, law + n_tendons, (n_tendons,)),
            carve(memory, law + 2 * n_tendons, (n_tendons,)),
            carve(memory, law + 3 * n_tendons, (n_tendons,)),
        ),
        carve(memory, loads, (n_loads, N_DEAD)),
        carve(memory, limits, (n_joints, 2)),
        carve(memory, holes, (n_joints, n_tendons, 4)),
        carve(memory, channels, (n_tendons,)),
        carve(memory, L, (n_joints, n_joints)),
        carve(memory, vectors, (6, n_joints)),
        carve(memory, search, (8,)),
        carve(memory, forces, (n_joints, 4)),
        carve(memory, responses, (n_tendons, n_joints)),
        as_rows(carve(memory, rows, (8,))),
    )


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
    law, table, limits, angle = block.law, numbers(block.loads), numbers(block.limits), numbers(block.state.angle)
    commands, stiffnesses, lows, highs = (
        numbers(law.command),
        numbers(law.stiffness),
        numbers(law.low),
        numbers(law.high),
    )
    usual = True
    for j in range(commands.shape[0]):
        command, k, low, high = (
            laws.command[source, j],
            laws.stiffness[source, j],
            laws.low[source, j],
            laws.high[source, j],
        )
        usual = usual and resolvable(command) and k > 0.0 and 0.0 <= low <= min(high, LARGEST_INPUT)
        commands[j, lane], stiffnesses[j, lane], lows[j, lane], highs[j, lane] = command, k, low, high
    usual = usual and fill_dead_loads(standing, loads[source], table, lane)
    for i in range(limits.shape[0]):
        phi = starts[source, i]
        usual = usual and resolvable(phi)
        angle[i, lane] = min(max(phi, limits[i, 0, lane]), limits[i, 1, lane])
    return usual


@part(inline=True)
def begin_lane(block, lane):
    """Let a lane run: its first evaluation counts as a step that is accepted."""
    search = numbers(block.search)
    search[ENERGY, lane], search[MAGNITUDE, lane], search[WORST, lane] = np.inf, 0.0, 0.0
    search[PART, lane], search[STEPS, lane], search[PASSES, lane] = 1.0, -1.0, 0.0
    search[PHASE, lane] = RUNNING


@part(inline=True)
def fill_forces(block, tendon_joints):
    """Fill contact forces and tangents."""
    forces = block.forces
    for i in range(block.state.angle.size):
        along, across, ex, ey = contact_forces(tendon_joints, block.state, i)
        forces[i, 0], forces[i, 1], forces[i, 2], forces[i, 3] = along, across, ex, ey


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
