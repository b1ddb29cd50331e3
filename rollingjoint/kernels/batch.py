"""The general solver and the stiffness of its solutions, row by row, of every class of chains."""

from __future__ import annotations

import numpy as np

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import kernel, part
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import INVALID_INPUT, LARGEST_INPUT, TendonLaw, all_resolvable
from rollingjoint.kernels.formulas import evaluate, load_columns, stiffness


@part
def valid(law, loads, start, stiffnesses):
    """True for finite values up to LARGEST_INPUT, tension limits in order and no pushing tendon.

    stiffnesses: the columns of the load table in which a number must not be negative.
    """
    if not (all_resolvable(law.command) and all_resolvable(start)):
        return False
    for row in range(loads.shape[0]):
        if not all_resolvable(loads[row]):
            return False
        for column in stiffnesses:
            if loads[row, column] < 0.0:
                return False
    for j in range(law.low.size):
        low, high = law.low[j], law.high[j]
        if not (0.0 <= low <= LARGEST_INPUT and low <= high and law.stiffness[j] > 0.0):
            return False
    return True


@part
def evaluate_unloaded(chain, state):
    """Fill the state at its angles without tensions and without loads."""
    zero = np.zeros(state.length.size)
    evaluate(chain, TendonLaw(zero, np.ones(zero.size), zero, zero), np.zeros((0, load_columns(chain))), state)


@part
def evaluate_at(chain, tensions, elastic, loads, angles, state):
    """Fill the state at joint angles under tensions and their rates d tension / d length."""
    for i in range(angles.size):
        state.angle[i] = angles[i]
    evaluate(chain, TendonLaw(state.length, np.ones(state.length.size), tensions, tensions), loads, state)
    for j in range(elastic.size):
        state.elastic[j] = elastic[j]


@part
def stiffness_at(chain, tensions, elastic, loads, angles, state, H):
    """Fill H at joint angles under tensions and their rates d tension / d length; overwrites the state."""
    evaluate_at(chain, tensions, elastic, loads, angles, state)
    stiffness(chain, loads, state, H)


@part
def solve_invalid(chain, start, state):
    """The start pose, without tensions and loads; an angle that is not a number becomes `formulas.middle`."""
    for i in range(start.size):
        angle = start[i] if abs(start[i]) <= LARGEST_INPUT else formulas.middle(chain, i)
        state.angle[i] = min(max(angle, chain.joints[i, 0]), chain.joints[i, 1])
    evaluate_unloaded(chain, state)
    return INVALID_INPUT, 0, np.inf, 0


@kernel(nogil=True, lapack=True, title="the general solver")
def solve_lanes(chain, designs, laws, loads, starts, results, lanes):
    """Solve the given lanes; all inputs and the arrays of laws carry a leading lane axis."""
    state = formulas.new_state(chain, starts.shape[1], laws.command.shape[1])
    _solve_each(chain, designs, laws, loads, starts, results, lanes, state)


@part
def _solve_each(chain, designs, laws, loads, starts, results, lanes, state):
    chain, laws, results, state = borrow(chain), borrow(laws), borrow(results), borrow(state)
    designs, loads, starts, lanes = borrow(designs), borrow(loads), borrow(starts), borrow(lanes)
    for place in range(lanes.size):
        lane = lanes[place]
        mechanism = formulas.design(chain, designs[lane])
        law = TendonLaw(laws.command[lane], laws.stiffness[lane], laws.low[lane], laws.high[lane])
        if valid(law, loads[lane], starts[lane], formulas.stiffness_columns(mechanism)):
            outcome = formulas.solve(mechanism, law, loads[lane], starts[lane], state)
        else:
            outcome = solve_invalid(mechanism, starts[lane], state)
        formulas.store(mechanism, state, outcome, results, lane)


@kernel(short_loops=True, title="the stiffness of solutions")
def stiffness_of(chain, designs, tensions, elastic, loads, angles, H):
    """Fill H, (B, J, J), at joint angles under tensions and their rates d tension / d length, (B, m) both."""
    state = formulas.new_state(chain, angles.shape[1], tensions.shape[1])
    for lane in range(angles.shape[0]):
        mechanism = formulas.design(chain, designs[lane])
        stiffness_at(mechanism, tensions[lane], elastic[lane], loads[lane], angles[lane], state, H[lane])
