"""The general solver of steps with friction, row by row, first histories, and the stiffness after a step."""

from __future__ import annotations

import numpy as np

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import kernel, part
from rollingjoint._numba.pins import carve_tuple, size_of
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import TendonLaw
from rollingjoint.kernels.batch import evaluate_at, solve_invalid, valid
from rollingjoint.kernels.friction import friction_of, history_of, valid_friction
from rollingjoint.kernels.rubbed_chain import StepFriction, StepFrictionSizes, begin_history, remember, rubbed_stiffness


@kernel(nogil=True, lapack=True, short_loops=True, title="the general solver with friction")
def step_lanes(chain, designs, laws, loads, starts, results, friction, lanes):
    """Solve the steps of the given lanes; all inputs carry a leading lane axis."""
    sizes = StepFrictionSizes(starts.shape[1], laws.command.shape[1])
    memory, state = np.zeros(size_of(StepFriction, sizes)), formulas.new_state(chain, sizes.J, sizes.m)
    _step_each(chain, designs, laws, loads, starts, results, friction, lanes, state, memory, sizes)


@part
def _step_each(chain, designs, laws, loads, starts, results, friction, lanes, state, space, sizes):
    chain, laws, results, state = borrow(chain), borrow(laws), borrow(results), borrow(state)
    designs, loads, starts, lanes = borrow(designs), borrow(loads), borrow(starts), borrow(lanes)
    friction, memory = borrow(friction), carve_tuple(borrow(space), 0, StepFriction, sizes)
    for place in range(lanes.size):
        lane = lanes[place]
        mechanism = formulas.design(chain, designs[lane])
        law = TendonLaw(laws.command[lane], laws.stiffness[lane], laws.low[lane], laws.high[lane])
        coefficients, before = friction_of(friction.law, lane), history_of(friction.before, lane)
        solvable = valid(law, loads[lane], starts[lane], formulas.stiffness_columns(mechanism))
        solvable = solvable and valid_friction(coefficients, before)
        if solvable:
            outcome = formulas.solve_step(
                mechanism, coefficients, before, law, loads[lane], starts[lane], state, memory
            )
        else:
            outcome = solve_invalid(mechanism, starts[lane], state)
        formulas.store(mechanism, state, outcome, results, lane)
        friction.work[lane] = remember(mechanism, before, memory, outcome[0], state, history_of(friction.after, lane))
        for i in range(state.angle.size):
            for j in range(state.tension.size):
                friction.tension[lane, i, j] = memory.now.tension[i, j] if solvable else 0.0
        if solvable:
            formulas.store_friction(mechanism, state, memory, results, lane)


@kernel(short_loops=True, title="the histories of friction")
def begin_histories(chain, designs, law, tensions, angles, history):
    """Fill the histories of lanes before any slip, at joint angles (B, J) under tensions (B, m)."""
    sizes = StepFrictionSizes(angles.shape[1], tensions.shape[1])
    memory, state = np.zeros(size_of(StepFriction, sizes)), formulas.new_state(chain, sizes.J, sizes.m)
    _begin_each(chain, designs, law, tensions, angles, history, state, memory, sizes)


@part
def _begin_each(chain, designs, law, tensions, angles, history, state, space, sizes):
    chain, law, history, state = borrow(chain), borrow(law), borrow(history), borrow(state)
    designs, tensions, angles = borrow(designs), borrow(tensions), borrow(angles)
    memory = carve_tuple(borrow(space), 0, StepFriction, sizes)
    no_loads = np.zeros((0, formulas.load_columns(chain)))
    for lane in range(angles.shape[0]):
        mechanism = formulas.design(chain, designs[lane])
        evaluate_at(mechanism, tensions[lane], tensions[lane], no_loads, angles[lane], state)
        begin_history(mechanism, friction_of(law, lane), state, memory, history_of(history, lane))


@kernel(short_loops=True, title="the stiffness of steps with friction")
def rubbed_stiffness_of(chain, designs, law, tensions, elastic, loads, angles, history, A, torques):
    """Fill A, (B, J, J), and d residual / d tension, (B, J, m), at the angles after a step that left this history."""
    sizes = StepFrictionSizes(history.angles.shape[1], tensions.shape[1])
    memory, state = np.zeros(size_of(StepFriction, sizes)), formulas.new_state(chain, sizes.J, sizes.m)
    _stiffness_each(chain, designs, law, tensions, elastic, loads, angles, history, A, torques, state, memory, sizes)


@part
def _stiffness_each(chain, designs, law, tensions, elastic, loads, angles, history, A, torques, state, space, sizes):
    chain, law, history, state = borrow(chain), borrow(law), borrow(history), borrow(state)
    designs, tensions, elastic, loads = borrow(designs), borrow(tensions), borrow(elastic), borrow(loads)
    angles, A, torques = borrow(angles), borrow(A), borrow(torques)
    memory = carve_tuple(borrow(space), 0, StepFriction, sizes)
    for lane in range(tensions.shape[0]):
        mechanism, past = formulas.design(chain, designs[lane]), history_of(history, lane)
        evaluate_at(mechanism, tensions[lane], elastic[lane], loads[lane], angles[lane], state)
        rubbed_stiffness(mechanism, friction_of(law, lane), loads[lane], state, memory, past, A[lane], torques[lane])
