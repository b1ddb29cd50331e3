"""Entry points: one equilibrium, or many side by side. Lanes do not see each other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rollingjoint._jit import kernel
from rollingjoint._kernels.arrays import ANGLE, INVALID_INPUT, TendonLaw, new_state
from rollingjoint._kernels.chain import contact_forces, evaluate, stiffness
from rollingjoint._kernels.joint import arc_length
from rollingjoint._kernels.solve import solve

LARGEST_INPUT = 1e12  # beyond it (or NaN) an input cannot be resolved


class Results(NamedTuple):
    """Outputs of B lanes."""

    joint_angles: np.ndarray  # (B, J)
    arc_lengths: np.ndarray  # (B, J)
    poses: np.ndarray  # (B, n, 3)
    contacts: np.ndarray  # (B, J, 4) point and unit tangent, world frame
    tensions: np.ndarray  # (B, m)
    lengths: np.ndarray  # (B, m)
    rates: np.ndarray  # (B, J, m) d length / d joint angle
    elastic: np.ndarray  # (B, m) d tension / d length
    contact_forces: np.ndarray  # (B, J, 2)
    residual: np.ndarray  # (B,)
    iterations: np.ndarray  # (B,)
    status: np.ndarray  # (B,)


def new_results(n_lanes: int, n_joints: int, n_tendons: int) -> Results:
    """Empty outputs."""
    return Results(
        np.empty((n_lanes, n_joints)),
        np.empty((n_lanes, n_joints)),
        np.empty((n_lanes, n_joints + 1, 3)),
        np.empty((n_lanes, n_joints, 4)),
        np.empty((n_lanes, n_tendons)),
        np.empty((n_lanes, n_tendons)),
        np.empty((n_lanes, n_joints, n_tendons)),
        np.empty((n_lanes, n_tendons)),
        np.empty((n_lanes, n_joints, 2)),
        np.empty(n_lanes),
        np.empty(n_lanes, np.int64),
        np.empty(n_lanes, np.int64),
    )


@kernel
def _resolvable(values):
    for value in values.flat:
        if not abs(value) <= LARGEST_INPUT:
            return False
    return True


@kernel
def valid(law, loads, start):
    """True when every number can be solved with: no NaN, nothing huge, tension limits in order, no pushing tendon."""
    if not (_resolvable(law.command) and _resolvable(loads) and _resolvable(start)):
        return False
    for j in range(law.low.size):
        low, high = law.low[j], law.high[j]
        if not (0.0 <= low <= LARGEST_INPUT and low <= high and law.stiffness[j] > 0.0):
            return False
    for row in range(loads.shape[0]):
        if loads[row, 8] < 0.0:
            return False
    return True


@kernel
def solve_invalid(chain, n_tendons, start, s, state):
    """The start pose (s = 0 where it is not a number), no tension and no load."""
    for i in range(start.size):
        s[i] = arc_length(chain, i, start[i]) if abs(start[i]) <= LARGEST_INPUT else 0.0
    zero = np.zeros(n_tendons)
    evaluate(chain, TendonLaw(zero, np.ones(n_tendons), zero, zero), np.zeros((0, 11)), s, state)
    return INVALID_INPUT, 0, np.inf


@kernel
def store(chain, state, outcome, results, lane):
    """Copy a solved state and its outcome (status, iterations, residual) into the results."""
    contact_forces(chain, state, results.contact_forces, lane)
    results.joint_angles[lane] = state.joint[:, ANGLE]
    results.poses[lane] = state.pose[:, :3]
    results.contacts[lane] = state.contact
    results.tensions[lane] = state.tension
    results.lengths[lane] = state.length
    results.rates[lane] = state.gap[:, :, 1]
    results.elastic[lane] = state.elastic
    results.status[lane], results.iterations[lane], results.residual[lane] = outcome


@kernel
def solve_lane(chain, law, loads, start, results, lane):
    """Solve one lane into the results."""
    state = new_state(start.size, law.command.size)
    s = results.arc_lengths[lane]
    if valid(law, loads, start):
        outcome = solve(chain, law, loads, start, s, state)
    else:
        outcome = solve_invalid(chain, law.command.size, start, s, state)
    store(chain, state, outcome, results, lane)


@kernel(nogil=True)
def solve_lanes(chain, laws, loads, starts, results, first, last):
    """Solve lanes first to last - 1; all inputs and the arrays of laws carry a leading lane axis."""
    for lane in range(first, last):
        law = TendonLaw(laws.command[lane], laws.stiffness[lane], laws.low[lane], laws.high[lane])
        solve_lane(chain, law, loads[lane], starts[lane], results, lane)


@kernel
def stiffness_of(chain, tensions, elastic, loads, s, H):
    """Fill H, (B, J, J), at arc lengths s under tensions and their rates d tension / d length, (B, m) both."""
    state = new_state(s.shape[1], tensions.shape[1])
    for lane in range(s.shape[0]):
        fixed = TendonLaw(state.length, np.ones(state.length.size), tensions[lane], tensions[lane])
        evaluate(chain, fixed, loads[lane], s[lane], state)
        state.elastic[:] = elastic[lane]
        stiffness(chain, state, H[lane])
