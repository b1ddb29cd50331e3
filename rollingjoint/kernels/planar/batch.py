"""The solver for all cases, lane by lane, and the outputs that it shares with the one of eight lanes (block.py)."""

from __future__ import annotations

import numpy as np

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import kernel, part
from rollingjoint.kernels.planar.arrays import design, new_state
from rollingjoint.kernels.planar.chain import contact_forces
from rollingjoint.kernels.planar.loads import N_COLUMNS, STIFFNESSES
from rollingjoint.kernels.planar.solve import solve
from rollingjoint.kernels.shared.arrays import INVALID_INPUT, TendonLaw
from rollingjoint.kernels.shared.lane import evaluate_unloaded, stiffness_at, valid
from rollingjoint.kernels.shared.tolerances import LARGEST_INPUT


@part
def solve_invalid(chain, start, state):
    """The start pose (the middle of a joint where it is not a number), no tension and no load."""
    for i in range(start.size):
        lowest, highest = chain.joints[i, 0], chain.joints[i, 1]
        known = abs(start[i]) <= LARGEST_INPUT
        state.angle[i] = min(max(start[i], lowest), highest) if known else 0.5 * (lowest + highest)
    evaluate_unloaded(chain, N_COLUMNS, state)
    return INVALID_INPUT, 0, np.inf


@part
def store(chain, state, outcome, results, lane):
    """Copy a solved state and its outcome (status, iterations, residual) into the results."""
    for i in range(state.angle.size):
        results.joint_angles[lane, i] = state.angle[i]
        if results.contacts.shape[0] > 0:
            along, across, ex, ey = contact_forces(chain.tendon_joints, state, state.tension, i)
            results.contact_forces[lane, i, 0], results.contact_forces[lane, i, 1] = along, across
            results.contacts[lane, i, 0], results.contacts[lane, i, 1] = state.contact[i, 0], state.contact[i, 1]
            results.contacts[lane, i, 2], results.contacts[lane, i, 3] = ex, ey
            for j in range(state.tension.size):
                results.rates[lane, i, j] = state.gap[i, j, 1]
        if results.responses.shape[0] > 0:
            for j in range(state.tension.size):
                results.responses[lane, i, j] = 0.0
    for i in range(state.angle.size + 1):
        for k in range(3):
            results.poses[lane, i, k] = state.pose[i, k]
    for j in range(state.tension.size):
        results.tensions[lane, j], results.lengths[lane, j] = state.tension[j], state.length[j]
        results.elastic[lane, j] = state.elastic[j]
    results.status[lane], results.iterations[lane], results.residual[lane] = outcome


@kernel(nogil=True, lapack=True, short_loops=True, title="the planar solver for special cases")
def solve_lanes(chain, designs, laws, loads, starts, results, lanes):
    """Solve the given lanes; all inputs and the arrays of laws carry a leading lane axis."""
    _solve_each(chain, designs, laws, loads, starts, results, lanes, new_state(starts.shape[1], laws.command.shape[1]))


@part
def _solve_each(chain, designs, laws, loads, starts, results, lanes, state):
    chain, laws, results, state = borrow(chain), borrow(laws), borrow(results), borrow(state)
    designs, loads, starts, lanes = borrow(designs), borrow(loads), borrow(starts), borrow(lanes)
    for place in range(lanes.size):
        lane = lanes[place]
        one = design(chain, designs[lane])
        law = TendonLaw(laws.command[lane], laws.stiffness[lane], laws.low[lane], laws.high[lane])
        if valid(law, loads[lane], starts[lane], STIFFNESSES):
            outcome = solve(one, law, loads[lane], starts[lane], state)
        else:
            outcome = solve_invalid(one, starts[lane], state)
        store(one, state, outcome, results, lane)


@kernel(short_loops=True, title="the planar solver for special cases")
def stiffness_of(chain, designs, tensions, elastic, loads, angles, H):
    """Fill H, (B, J, J), at joint angles under tensions and their rates d tension / d length, (B, m) both."""
    state = new_state(angles.shape[1], tensions.shape[1])
    for lane in range(angles.shape[0]):
        one = design(chain, designs[lane])
        stiffness_at(one, tensions[lane], elastic[lane], loads[lane], angles[lane], state, H[lane])
