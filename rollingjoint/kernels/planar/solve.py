"""One equilibrium from one start: Newton's method, and the fallbacks for a non-converged or indeterminate pose."""

from __future__ import annotations

import numpy as np

from rollingjoint._numba.jit import part
from rollingjoint.kernels.planar.loads import generator_columns, has_potential
from rollingjoint.kernels.shared.arrays import INDETERMINATE, UNSTABLE
from rollingjoint.kernels.shared.bounds import begin, moved
from rollingjoint.kernels.shared.long_chain import DENSE_JOINTS, new_sweep
from rollingjoint.kernels.shared.newton import minimise
from rollingjoint.kernels.shared.relaxation import relax

_MOST_ESCAPES = 8  # from saddles
_PROXIMAL_PATH = (0.0, 1e-2, 1e-4, 1e-6, 1e-8, 0.0)  # weights of the way back to the start, over k g'²


@part
def solve(chain, law, loads, start, state):
    """Equilibrium from joint angles `start`; fills the state; returns (status, iterations, largest free |r|).

    Where slack tendons leave the pose open, the minimum of V + prox/2 |phi - start|² is followed from the start as prox
    falls to 0: it ends at the admissible pose nearest the start.
    """
    conservative = has_potential(chain.standing, loads)
    last = len(_PROXIMAL_PATH) - 1
    n = start.size if conservative and start.size > DENSE_JOINTS else 0
    sweep = new_sweep(n, generator_columns(chain.standing, loads) + law.low.size)
    H = np.empty((start.size - n, start.size - n))
    count, phase, size = 0, 0, 0.0
    begin(chain, start, state.angle)
    while True:
        prox = size * _PROXIMAL_PATH[phase]
        found = minimise(chain, law, loads, conservative, _MOST_ESCAPES, prox, start, state, H, sweep)
        status, iterations, worst = found
        count += iterations
        if phase == last:
            break
        if phase > 0:
            phase += 1
        elif status == INDETERMINATE and moved(state.angle, start):
            for i in range(start.size):
                for j in range(law.stiffness.size):
                    size = max(size, law.stiffness[j] * state.gap[i, j, 1] ** 2)
            begin(chain, start, state.angle)
            phase = 1
        elif status >= UNSTABLE and not conservative:
            begin(chain, start, state.angle)
            count += relax(chain, law, loads, state, H, sweep)
            phase = last
        else:
            break
    return status, count, worst
