"""The overdamped motion from a start towards equilibrium, where Newton's method finds none."""

from __future__ import annotations

import numpy as np

from rollingjoint._numba.jit import part
from rollingjoint.kernels.shared.bounds import mark_free, move
from rollingjoint.kernels.shared.formulas import evaluate, stiffness
from rollingjoint.kernels.shared.linear import cholesky, largest
from rollingjoint.kernels.shared.newton import most_iterations, newton_step
from rollingjoint.kernels.shared.tolerances import RESIDUAL_GOAL, SMALLEST_PIVOT


@part
def relax(chain, law, loads, state, H, sweep):
    """From the state's angles, follow the overdamped motion dphi/dt = -r with implicit steps of growing length.

    Returns the steps taken. Follower forces have no potential to descend; this motion still leads from the start to a
    stable equilibrium where there is one.
    """
    n = state.angle.size
    free, step, L = np.ones(n, np.bool_), np.empty(n), np.empty((n, n))
    rate, worst = -1.0, 0.0
    most = most_iterations(n)
    for count in range(most):
        evaluate(chain, law, loads, state)
        new_worst = mark_free(chain, state, 0.0, state.residual, free)
        if new_worst <= RESIDUAL_GOAL:
            return count
        stiffness(chain, loads, state, H)
        rate = 0.1 * largest(H, free) if count == 0 else rate * min(2.0, max(0.3, new_worst / worst))
        worst = new_worst
        while cholesky(H, free, rate, L) <= SMALLEST_PIVOT and rate > 0.0:
            rate *= 2.0
        for i in range(n):
            H[i, i] += rate
        newton_step(chain, state, H, sweep, False, 0.0, free, state.residual, L, step)
        move(chain, state.angle, step, 1.0, state.angle)
    return most
