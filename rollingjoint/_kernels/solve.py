"""One equilibrium from one start: Newton, and what follows where it ends nowhere, or nowhere in particular."""

from __future__ import annotations

import numpy as np

from rollingjoint._jit import kernel
from rollingjoint._kernels.arrays import ANGLE, INDETERMINATE, UNSTABLE
from rollingjoint._kernels.chain import evaluate, stiffness
from rollingjoint._kernels.joint import arc_length
from rollingjoint._kernels.linear import cholesky, largest
from rollingjoint._kernels.long_chain import DENSE_JOINTS, new_sweep
from rollingjoint._kernels.newton import MAX_ITERATIONS, RESIDUAL_GOAL, mark_free, minimise, move, newton_step

_PROXIMAL_PATH = (0.0, 1e-2, 1e-4, 1e-6, 1e-8, 0.0)  # weights of the way back to the start, over k g'²


@kernel
def _relax(chain, law, loads, s, state, H, sweep):
    """From s, follow the overdamped motion dphi/dt = -r with implicit steps of growing length; returns the steps taken.

    Follower forces have no potential to descend; this motion still leads from the start to a stable equilibrium where
    there is one.
    """
    n = s.size
    free, step, L = np.ones(n, np.bool_), np.empty(n), np.empty((n, n))
    rate, worst = -1.0, 0.0
    for count in range(MAX_ITERATIONS):
        evaluate(chain, law, loads, s, state)
        new_worst = mark_free(chain, state, 0.0, state.residual, free)
        if new_worst <= RESIDUAL_GOAL:
            return count
        stiffness(chain, state, H)
        rate = 0.1 * largest(H, free) if count == 0 else rate * min(2.0, max(0.3, new_worst / worst))
        worst = new_worst
        while cholesky(0.5 * (H + H.T), free, rate, L) <= 1e-10 and rate > 0.0:
            rate *= 2.0
        for i in range(n):
            H[i, i] += rate
        newton_step(chain, state, H, sweep, False, 0.0, free, state.residual, L, step)
        move(chain, state.joint[:, ANGLE].copy(), step, 1.0, s)
    return MAX_ITERATIONS


@kernel
def _begin(chain, start, s):
    for i in range(s.size):
        s[i] = arc_length(chain, i, start[i])


@kernel
def solve(chain, law, loads, start, s, state):
    """Equilibrium from joint angles `start`; fills s and state; returns (status, iterations, largest free |r|).

    Where slack tendons leave the pose open, the minimum of V + prox/2 |phi - start|² is followed from the start as prox
    falls to 0: it ends at the admissible pose nearest the start.
    """
    conservative = not np.any(loads[:, 5:7] != 0.0)
    last = len(_PROXIMAL_PATH) - 1
    n = start.size if conservative and start.size > DENSE_JOINTS else 0
    sweep = new_sweep(n, law.low.size, np.any(loads[:, 8] != 0.0))
    H = np.empty((start.size - n, start.size - n))
    count, phase, size = 0, 0, 0.0
    _begin(chain, start, s)
    while True:
        prox = size * _PROXIMAL_PATH[phase]
        status, iterations, worst = minimise(chain, law, loads, conservative, prox, start, s, state, H, sweep)
        count += iterations
        if phase == last:
            break
        if phase > 0:
            phase += 1
        elif status == INDETERMINATE and np.max(np.abs(state.joint[:, ANGLE] - start)) > 1e-12:
            for j in range(law.stiffness.size):
                size = max(size, law.stiffness[j] * np.max(state.gap[:, j, 1] ** 2))
            _begin(chain, start, s)
            phase = 1
        elif status >= UNSTABLE and not conservative:
            _begin(chain, start, s)
            count += _relax(chain, law, loads, s, state, H, sweep)
            phase = last
        else:
            break
    return status, count, worst
