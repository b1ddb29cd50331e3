"""The solver for all cases and the stiffness that it leaves, row by row, of every family of mechanisms."""

from __future__ import annotations

import numpy as np

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import kernel, part
from rollingjoint.kernels.shared import formulas
from rollingjoint.kernels.shared.arrays import INVALID_INPUT, TendonLaw
from rollingjoint.kernels.shared.lane import evaluate_unloaded, stiffness_at, valid
from rollingjoint.kernels.shared.tolerances import LARGEST_INPUT


@part
def solve_invalid(chain, start, state):
    """The start pose, without tensions and loads; an angle that is not a number is that of `formulas.middle`."""
    for i in range(start.size):
        angle = start[i] if abs(start[i]) <= LARGEST_INPUT else formulas.middle(chain, i)
        state.angle[i] = min(max(angle, chain.joints[i, 0]), chain.joints[i, 1])
    evaluate_unloaded(chain, state)
    return INVALID_INPUT, 0, np.inf, 0


@kernel(nogil=True, lapack=True, title="the solver for special cases")
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
        one = formulas.design(chain, designs[lane])
        law = TendonLaw(laws.command[lane], laws.stiffness[lane], laws.low[lane], laws.high[lane])
        if valid(law, loads[lane], starts[lane], formulas.stiffness_columns(one)):
            outcome = formulas.solve(one, law, loads[lane], starts[lane], state)
        else:
            outcome = solve_invalid(one, starts[lane], state)
        formulas.store(one, state, outcome, results, lane)


@kernel(short_loops=True, title="the stiffness of solutions")
def stiffness_of(chain, designs, tensions, elastic, loads, angles, H):
    """Fill H, (B, J, J), at joint angles under tensions and their rates d tension / d length, (B, m) both."""
    state = formulas.new_state(chain, angles.shape[1], tensions.shape[1])
    for lane in range(angles.shape[0]):
        one = formulas.design(chain, designs[lane])
        stiffness_at(one, tensions[lane], elastic[lane], loads[lane], angles[lane], state, H[lane])
