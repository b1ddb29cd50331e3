"""The solver of hinge chains and their stiffness, lane by lane."""

from __future__ import annotations

import numpy as np

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import kernel, part
from rollingjoint.kernels.shared.arrays import INVALID_INPUT, TendonLaw
from rollingjoint.kernels.shared.lane import evaluate_unloaded, stiffness_at, valid
from rollingjoint.kernels.shared.tolerances import LARGEST_INPUT
from rollingjoint.kernels.spatial.arrays import (
    N_COLUMNS,
    PX,
    SPRING,
    design,
    new_hinge_state,
)
from rollingjoint.kernels.spatial.solve import solve_hinges

STIFFNESSES = (SPRING,)  # columns of a load table


@part
def solve_invalid(chain, start, state):
    """The start pose (at rest where it is not a number), no tension and no load."""
    for i in range(start.size):
        angle = start[i] if abs(start[i]) <= LARGEST_INPUT else chain.joints[i, 2]
        state.angle[i] = min(max(angle, chain.joints[i, 0]), chain.joints[i, 1])
    evaluate_unloaded(chain, N_COLUMNS, state)
    return INVALID_INPUT, 0, np.inf, 0


@part
def store(state, outcome, results, lane):
    """Copy a solved state and its outcome into the results."""
    for i in range(state.angle.size):
        results.joint_angles[lane, i] = state.angle[i]
        for j in range(state.length.size):
            results.rates[lane, i, j] = state.gap[i, j, 1]
            results.torques[lane, i, j] = state.torque[i, j]
    for k in range(state.angle.size + 1):
        for a in range(3):
            for b in range(3):
                results.poses[lane, k, a, b] = state.pose[k, 3 * a + b]
            results.poses[lane, k, a, 3] = state.pose[k, PX + a]
            results.poses[lane, k, 3, a] = 0.0
        results.poses[lane, k, 3, 3] = 1.0
    for j in range(state.length.size):
        results.tensions[lane, j], results.lengths[lane, j] = state.tension[j], state.length[j]
        results.elastic[lane, j] = state.elastic[j]
    results.status[lane], results.iterations[lane], results.residual[lane], results.escapes[lane] = outcome


@kernel(nogil=True, lapack=True, title="the arm's solver for special cases")
def solve_hinge_lanes(chain, designs, laws, loads, starts, results, lanes):
    """Solve the given lanes; all inputs and the arrays of laws carry a leading lane axis."""
    n_joints, n_tendons = starts.shape[1], laws.low.shape[1]
    memory = new_hinge_state(n_joints, n_tendons), np.empty(n_joints)
    _solve_each(chain, designs, laws, loads, starts, results, lanes, *memory)


@part
def _solve_each(chain, designs, laws, loads, starts, results, lanes, state, rest):
    laws, loads, starts, state, lanes = borrow(laws), borrow(loads), borrow(starts), borrow(state), borrow(lanes)
    results = borrow(results)
    for place in range(lanes.size):
        lane = lanes[place]
        one = design(chain, designs[lane])
        law = TendonLaw(laws.command[lane], laws.stiffness[lane], laws.low[lane], laws.high[lane])
        if valid(law, loads[lane], starts[lane], STIFFNESSES):
            for i in range(rest.size):
                rest[i] = one.joints[i, 2]
            outcome = solve_hinges(one, law, loads[lane], starts[lane], rest, state)
        else:
            outcome = solve_invalid(one, starts[lane], state)
        store(state, outcome, results, lane)


@kernel(title="the arm's solver of single chains")
def hinge_stiffness_of(chain, designs, tensions, elastic, loads, angles, H):
    """Fill H, (B, J, J), at joint angles under tensions and their rates d tension / d length, (B, m) both."""
    state = new_hinge_state(angles.shape[1], tensions.shape[1])
    for lane in range(angles.shape[0]):
        one = design(chain, designs[lane])
        stiffness_at(one, tensions[lane], elastic[lane], loads[lane], angles[lane], state, H[lane])
