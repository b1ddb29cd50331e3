"""One equilibrium of a planar chain from one start, and one step with friction."""

from __future__ import annotations

import numpy as np

from rollingjoint._numba.jit import part
from rollingjoint.kernels.planar.loads import generator_columns, has_potential
from rollingjoint.kernels.shared.arrays import UNSTABLE
from rollingjoint.kernels.shared.descent import most_descent_steps
from rollingjoint.kernels.shared.long_chain import new_sweep
from rollingjoint.kernels.shared.newton import MAX_ITERATIONS
from rollingjoint.kernels.shared.rubbed_chain import settle_rubbed
from rollingjoint.kernels.shared.settle import MOST_ESCAPES, long_joints, settle


@part
def solve(chain, law, loads, start, state):
    """Equilibrium from joint angles `start`; fills the state; returns (status, iterations, largest free |r|)."""
    conservative = has_potential(chain.standing, loads)
    n = long_joints(start.size, conservative)
    sweep = new_sweep(n, generator_columns(chain.standing, loads) + law.low.size)
    H = np.empty((start.size - n, start.size - n))
    found = settle(chain, conservative, MOST_ESCAPES, MAX_ITERATIONS, False, law, loads, start, state, H, sweep)
    if found[0] < UNSTABLE or most_descent_steps(start.size) == 0:
        return found
    how = chain, conservative, MOST_ESCAPES, MAX_ITERATIONS, True
    status, count, worst = settle(*how, law, loads, start, state, H, sweep)
    return status, found[1] + count, worst


@part
def solve_step(chain, friction, before, law, loads, start, state, memory):
    """The step with friction; fills the state and the memory (shared.rubbed_chain); returns what `solve` returns."""
    columns = generator_columns(chain.standing, loads) + law.low.size
    conservative = has_potential(chain.standing, loads)
    how = conservative, MOST_ESCAPES, columns
    return settle_rubbed(chain, friction, before, *how, law, loads, start, state, memory)
