"""The solver of steps with friction, lane by lane."""

from __future__ import annotations

import numpy as np

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import kernel, part
from rollingjoint._numba.pins import carve_tuple, size_of
from rollingjoint.kernels.shared.arrays import TendonLaw
from rollingjoint.kernels.shared.friction import friction_of, history_of, valid_friction
from rollingjoint.kernels.shared.lane import valid
from rollingjoint.kernels.shared.rubbed_chain import Memory, MemorySizes, remember
from rollingjoint.kernels.shared.rubbed_lanes import begin_each, stiffness_each
from rollingjoint.kernels.spatial.arrays import N_COLUMNS, design, new_hinge_state
from rollingjoint.kernels.spatial.batch import STIFFNESSES, solve_invalid, store
from rollingjoint.kernels.spatial.solve import step_hinges


@kernel(nogil=True, lapack=True, title="the arm's solver with friction")
def step_hinge_lanes(chain, designs, laws, loads, starts, results, friction, first, last):
    """Solve the steps of lanes first to last - 1; all inputs carry a leading lane axis."""
    sizes = MemorySizes(starts.shape[1], laws.command.shape[1])
    memory, state = np.zeros(size_of(Memory, sizes)), new_hinge_state(sizes.J, sizes.m)
    _step_each(chain, designs, laws, loads, starts, results, friction, first, last, state, memory, sizes)


@part
def _step_each(chain, designs, laws, loads, starts, results, friction, first, last, state, space, sizes):
    laws, loads, starts, state = borrow(laws), borrow(loads), borrow(starts), borrow(state)
    results, friction = borrow(results), borrow(friction)
    memory = carve_tuple(borrow(space), 0, Memory, sizes)
    for lane in range(first, last):
        one = design(chain, designs[lane])
        law = TendonLaw(laws.command[lane], laws.stiffness[lane], laws.low[lane], laws.high[lane])
        coefficients, before = friction_of(friction.law, lane), history_of(friction.before, lane)
        known = valid(law, loads[lane], starts[lane], STIFFNESSES) and valid_friction(coefficients, before)
        if known:
            outcome = step_hinges(one, coefficients, before, law, loads[lane], starts[lane], state, memory)
        else:
            outcome = solve_invalid(one, starts[lane], state)
        store(state, outcome, results, lane)
        friction.work[lane] = remember(one, before, memory, outcome[0], state, history_of(friction.after, lane))
        for i in range(state.angle.size):
            for j in range(state.tension.size):
                friction.tension[lane, i, j] = memory.now.tension[i, j] if known else 0.0
                if known and i < one.tendon_joints[j]:
                    results.torques[lane, i, j] = memory.now.lever[i, j] * memory.now.passed[i, j]


@kernel(title="the arm's solver with friction")
def begin_hinge_histories(chain, designs, law, tensions, angles, history):
    """Fill the histories of lanes that have never slipped, at joint angles (B, J) under tensions (B, m)."""
    sizes = MemorySizes(angles.shape[1], tensions.shape[1])
    memory, state = np.zeros(size_of(Memory, sizes)), new_hinge_state(sizes.J, sizes.m)
    begin_each(chain, designs, law, tensions, angles, history, state, memory, sizes, np.zeros((0, N_COLUMNS)))


@kernel(title="the arm's solver with friction")
def rubbed_hinge_stiffness_of(chain, designs, law, tensions, elastic, loads, angles, history, A, torques):
    """Fill A, (B, J, J), and d residual / d tension, (B, J, m), at the angles after a step that left this history."""
    sizes = MemorySizes(history.angles.shape[1], tensions.shape[1])
    memory, state = np.zeros(size_of(Memory, sizes)), new_hinge_state(sizes.J, sizes.m)
    stiffness_each(chain, designs, law, tensions, elastic, loads, angles, history, A, torques, state, memory, sizes)
