"""Steps with friction for all cases, row by row: the solver, what begins histories, and the stiffness after a step."""

from __future__ import annotations

import numpy as np

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import kernel, part
from rollingjoint._numba.pins import carve_tuple, size_of
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import TendonLaw
from rollingjoint.kernels.batch import evaluate_at, solve_invalid, valid
from rollingjoint.kernels.friction import friction_of, history_of, valid_friction
from rollingjoint.kernels.rubbed_chain import Memory, MemorySizes, begin_history, remember, rubbed_stiffness


@kernel(nogil=True, lapack=True, short_loops=True, title="the solver with friction for special cases")
def step_lanes(chain, designs, laws, loads, starts, results, friction, lanes):
    """Solve the steps of the given lanes; all inputs carry a leading lane axis."""
    sizes = MemorySizes(starts.shape[1], laws.command.shape[1])
    memory, state = np.zeros(size_of(Memory, sizes)), formulas.new_state(chain, sizes.J, sizes.m)
    _step_each(chain, designs, laws, loads, starts, results, friction, lanes, state, memory, sizes)


@part
def _step_each(chain, designs, laws, loads, starts, results, friction, lanes, state, space, sizes):
    chain, laws, results, state = borrow(chain), borrow(laws), borrow(results), borrow(state)
    designs, loads, starts, lanes = borrow(designs), borrow(loads), borrow(starts), borrow(lanes)
    friction, memory = borrow(friction), carve_tuple(borrow(space), 0, Memory, sizes)
    for place in range(lanes.size):
        lane = lanes[place]
        one = formulas.design(chain, designs[lane])
        law = TendonLaw(laws.command[lane], laws.stiffness[lane], laws.low[lane], laws.high[lane])
        coefficients, before = friction_of(friction.law, lane), history_of(friction.before, lane)
        known = valid(law, loads[lane], starts[lane], formulas.stiffness_columns(one))
        known = known and valid_friction(coefficients, before)
        if known:
            outcome = formulas.solve_step(one, coefficients, before, law, loads[lane], starts[lane], state, memory)
        else:
            outcome = solve_invalid(one, starts[lane], state)
        formulas.store(one, state, outcome, results, lane)
        friction.work[lane] = remember(one, before, memory, outcome[0], state, history_of(friction.after, lane))
        for i in range(state.angle.size):
            for j in range(state.tension.size):
                friction.tension[lane, i, j] = memory.now.tension[i, j] if known else 0.0
        if known:
            formulas.store_friction(one, state, memory, results, lane)


@kernel(short_loops=True, title="the histories of friction")
def begin_histories(chain, designs, law, tensions, angles, history):
    """Fill the histories of lanes that have never slipped, at joint angles (B, J) under tensions (B, m)."""
    sizes = MemorySizes(angles.shape[1], tensions.shape[1])
    memory, state = np.zeros(size_of(Memory, sizes)), formulas.new_state(chain, sizes.J, sizes.m)
    _begin_each(chain, designs, law, tensions, angles, history, state, memory, sizes)


@part
def _begin_each(chain, designs, law, tensions, angles, history, state, space, sizes):
    chain, law, history, state = borrow(chain), borrow(law), borrow(history), borrow(state)
    designs, tensions, angles = borrow(designs), borrow(tensions), borrow(angles)
    memory = carve_tuple(borrow(space), 0, Memory, sizes)
    no_loads = np.zeros((0, formulas.load_columns(chain)))
    for lane in range(angles.shape[0]):
        one = formulas.design(chain, designs[lane])
        evaluate_at(one, tensions[lane], tensions[lane], no_loads, angles[lane], state)
        begin_history(one, friction_of(law, lane), state, memory, history_of(history, lane))


@kernel(short_loops=True, title="the stiffness of steps with friction")
def rubbed_stiffness_of(chain, designs, law, tensions, elastic, loads, angles, history, A, torques):
    """Fill A, (B, J, J), and d residual / d tension, (B, J, m), at the angles after a step that left this history."""
    sizes = MemorySizes(history.angles.shape[1], tensions.shape[1])
    memory, state = np.zeros(size_of(Memory, sizes)), formulas.new_state(chain, sizes.J, sizes.m)
    _stiffness_each(chain, designs, law, tensions, elastic, loads, angles, history, A, torques, state, memory, sizes)


@part
def _stiffness_each(chain, designs, law, tensions, elastic, loads, angles, history, A, torques, state, space, sizes):
    chain, law, history, state = borrow(chain), borrow(law), borrow(history), borrow(state)
    designs, tensions, elastic, loads = borrow(designs), borrow(tensions), borrow(elastic), borrow(loads)
    angles, A, torques = borrow(angles), borrow(A), borrow(torques)
    memory = carve_tuple(borrow(space), 0, Memory, sizes)
    for lane in range(tensions.shape[0]):
        one, past = formulas.design(chain, designs[lane]), history_of(history, lane)
        evaluate_at(one, tensions[lane], elastic[lane], loads[lane], angles[lane], state)
        rubbed_stiffness(one, friction_of(law, lane), loads[lane], state, memory, past, A[lane], torques[lane])
