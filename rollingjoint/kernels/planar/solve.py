"""One equilibrium from one start: Newton, and what follows where it ends nowhere, or nowhere in particular."""

from __future__ import annotations

import numpy as np

from rollingjoint._numba.jit import part
from rollingjoint.kernels.planar.arrays import INDETERMINATE, UNSTABLE
from rollingjoint.kernels.planar.chain import evaluate, stiffness
from rollingjoint.kernels.shared.linear import cholesky, largest
from rollingjoint.kernels.shared.long_chain import DENSE_JOINTS, new_sweep
from rollingjoint.kernels.shared.newton import MAX_ITERATIONS, mark_free, minimise, move, newton_step
from rollingjoint.kernels.shared.tolerances import RESIDUAL_GOAL, SMALLEST_PIVOT

_PROXIMAL_PATH = (0.0, 1e-2, 1e-4, 1e-6, 1e-8, 0.0)  # weights of the way back to the start, over k g'²


@part
def _relax(chain, law, loads, state, H, sweep):
    """From the state's angles, follow the overdamped motion dphi/dt = -r with implicit steps of growing length.

    Returns the steps taken. Follower forces have no potential to descend; this motion still leads from the start to a
    stable equilibrium where there is one.
    """
    n = state.angle.size
    free, step, L = np.ones(n, np.bool_), np.empty(n), np.empty((n, n))
    rate, worst = -1.0, 0.0
    for count in range(MAX_ITERATIONS):
        evaluate(chain, law, loads, state)
        new_worst = mark_free(chain, state, 0.0, state.residual, free)
        if new_worst <= RESIDUAL_GOAL:
            return count
        stiffness(chain, state, H)
        rate = 0.1 * largest(H, free) if count == 0 else rate * min(2.0, max(0.3, new_worst / worst))
        worst = new_worst
        while cholesky(H, free, rate, L) <= SMALLEST_PIVOT and rate > 0.0:
            rate *= 2.0
        for i in range(n):
            H[i, i] += rate
        newton_step(chain, state, H, sweep, False, 0.0, free, state.residual, L, step)
        move(chain, state.angle, step, 1.0, state.angle)
    return MAX_ITERATIONS


@part
def begin(chain, start, angle):
    """Fill angle with the start, clipped to the surface limits."""
    for i in range(angle.size):
        angle[i] = min(max(start[i], chain.joints[i, 0]), chain.joints[i, 1])


@part
def _moved(angle, start):
    for i in range(angle.size):
        if abs(angle[i] - start[i]) > 1e-12:
            return True
    return False


@part
def solve(chain, law, loads, start, state):
    """Equilibrium from joint angles `start`; fills the state; returns (status, iterations, largest free |r|).

    Where slack tendons leave the pose open, the minimum of V + prox/2 |phi - start|² is followed from the start as prox
    falls to 0: it ends at the admissible pose nearest the start.
    """
    conservative, springs = True, False
    for row in range(loads.shape[0]):
        conservative = conservative and loads[row, 5] == 0.0 and loads[row, 6] == 0.0
        springs = springs or loads[row, 8] != 0.0
    last = len(_PROXIMAL_PATH) - 1
    n = start.size if conservative and start.size > DENSE_JOINTS else 0
    sweep = new_sweep(n, law.low.size, springs)
    H = np.empty((start.size - n, start.size - n))
    count, phase, size = 0, 0, 0.0
    begin(chain, start, state.angle)
    while True:
        prox = size * _PROXIMAL_PATH[phase]
        status, iterations, worst = minimise(chain, law, loads, conservative, prox, start, state, H, sweep)
        count += iterations
        if phase == last:
            break
        if phase > 0:
            phase += 1
        elif status == INDETERMINATE and _moved(state.angle, start):
            for i in range(start.size):
                for j in range(law.stiffness.size):
                    size = max(size, law.stiffness[j] * state.gap[i, j, 1] ** 2)
            begin(chain, start, state.angle)
            phase = 1
        elif status >= UNSTABLE and not conservative:
            begin(chain, start, state.angle)
            count += _relax(chain, law, loads, state, H, sweep)
            phase = last
        else:
            break
    return status, count, worst
