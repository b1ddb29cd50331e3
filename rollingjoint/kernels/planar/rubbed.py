"""The solver of steps with friction for all cases, lane by lane."""

from __future__ import annotations

import numpy as np

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import kernel, part
from rollingjoint._numba.pins import carve_tuple, size_of
from rollingjoint.kernels.planar.arrays import design, new_state
from rollingjoint.kernels.planar.batch import solve_invalid, store
from rollingjoint.kernels.planar.chain import contact_forces
from rollingjoint.kernels.planar.loads import N_COLUMNS, STIFFNESSES
from rollingjoint.kernels.planar.solve import solve_step
from rollingjoint.kernels.shared.arrays import TendonLaw
from rollingjoint.kernels.shared.friction import friction_of, history_of, valid_friction
from rollingjoint.kernels.shared.lane import valid
from rollingjoint.kernels.shared.rubbed_chain import Memory, MemorySizes, remember
from rollingjoint.kernels.shared.rubbed_lanes import begin_each, stiffness_each


@kernel(nogil=True, lapack=True, short_loops=True, title="the planar solver with friction")
def step_lanes(chain, designs, laws, loads, starts, results, friction, lanes):
    """Solve the steps of the given lanes; all inputs carry a leading lane axis."""
    sizes = MemorySizes(starts.shape[1], laws.command.shape[1])
    memory, state = np.zeros(size_of(Memory, sizes)), new_state(sizes.J, sizes.m)
    _step_each(chain, designs, laws, loads, starts, results, friction, lanes, state, memory, sizes)


@part
def _step_each(chain, designs, laws, loads, starts, results, friction, lanes, state, space, sizes):
    chain, laws, results, state = borrow(chain), borrow(laws), borrow(results), borrow(state)
    designs, loads, starts, lanes, friction = (
        borrow(designs),
        borrow(loads),
        borrow(starts),
        borrow(lanes),
        borrow(friction),
    )
    memory = carve_tuple(borrow(space), 0, Memory, sizes)
    for place in range(lanes.size):
        lane = lanes[place]
        one = design(chain, designs[lane])
        law = TendonLaw(laws.command[lane], laws.stiffness[lane], laws.low[lane], laws.high[lane])
        coefficients, before = friction_of(friction.law, lane), history_of(friction.before, lane)
        known = valid(law, loads[lane], starts[lane], STIFFNESSES) and valid_friction(coefficients, before)
        if known:
            outcome = solve_step(one, coefficients, before, law, loads[lane], starts[lane], state, memory)
        else:
            outcome = solve_invalid(one, starts[lane], state)
        store(one, state, outcome, results, lane)
        friction.work[lane] = remember(one, before, memory, outcome[0], state, history_of(friction.after, lane))
        tension = memory.now.tension
        for i in range(state.angle.size):
            for j in range(state.tension.size):
                friction.tension[lane, i, j] = tension[i, j] if known else 0.0
            if known and results.contacts.shape[0] > 0:
                along, across, _, _ = contact_forces(one.tendon_joints, state, tension[i], i)
                results.contact_forces[lane, i, 0], results.contact_forces[lane, i, 1] = along, across


@kernel(short_loops=True, title="the planar solver with friction")
def begin_histories(chain, designs, law, tensions, angles, history):
    """Fill the histories of lanes that have never slipped, at joint angles (B, J) under tensions (B, m)."""
    sizes = MemorySizes(angles.shape[1], tensions.shape[1])
    memory, state = np.zeros(size_of(Memory, sizes)), new_state(sizes.J, sizes.m)
    begin_each(chain, designs, law, tensions, angles, history, state, memory, sizes, np.zeros((0, N_COLUMNS)))


@kernel(short_loops=True, title="the planar solver with friction")
def rubbed_stiffness_of(chain, designs, law, tensions, elastic, loads, angles, history, A, torques):
    """Fill A, (B, J, J), and d residual / d tension, (B, J, m), at the angles after a step that left this history."""
    sizes = MemorySizes(history.angles.shape[1], tensions.shape[1])
    memory, state = np.zeros(size_of(Memory, sizes)), new_state(sizes.J, sizes.m)
    stiffness_each(chain, designs, law, tensions, elastic, loads, angles, history, A, torques, state, memory, sizes)
