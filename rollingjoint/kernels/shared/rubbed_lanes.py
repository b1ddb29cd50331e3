"""Lanes with friction, one by one: what begins their histories, and the stiffness that a step has left."""

from __future__ import annotations

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import part
from rollingjoint._numba.pins import carve_tuple
from rollingjoint.kernels.shared.formulas import design
from rollingjoint.kernels.shared.friction import friction_of, history_of
from rollingjoint.kernels.shared.lane import evaluate_at
from rollingjoint.kernels.shared.rubbed_chain import Memory, begin_history, rubbed_stiffness


@part
def begin_each(chain, designs, law, tensions, angles, history, state, space, sizes, no_loads):
    """Fill the histories of lanes that have never slipped; state, space, sizes: memory for one lane."""
    chain, law, history, state = borrow(chain), borrow(law), borrow(history), borrow(state)
    designs, tensions, angles = borrow(designs), borrow(tensions), borrow(angles)
    memory = carve_tuple(borrow(space), 0, Memory, sizes)
    for lane in range(angles.shape[0]):
        one = design(chain, designs[lane])
        evaluate_at(one, tensions[lane], tensions[lane], no_loads, angles[lane], state)
        begin_history(one, friction_of(law, lane), state, memory, history_of(history, lane))


@part
def stiffness_each(chain, designs, law, tensions, elastic, loads, angles, history, A, torques, state, space, sizes):
    """Fill A and d residual / d tension of lanes; state, space, sizes: memory for one lane."""
    chain, law, history, state = borrow(chain), borrow(law), borrow(history), borrow(state)
    designs, tensions, elastic, loads = borrow(designs), borrow(tensions), borrow(elastic), borrow(loads)
    angles, A, torques = borrow(angles), borrow(A), borrow(torques)
    memory = carve_tuple(borrow(space), 0, Memory, sizes)
    for lane in range(tensions.shape[0]):
        one, past = design(chain, designs[lane]), history_of(history, lane)
        evaluate_at(one, tensions[lane], elastic[lane], loads[lane], angles[lane], state)
        rubbed_stiffness(one, friction_of(law, lane), loads[lane], state, memory, past, A[lane], torques[lane])
