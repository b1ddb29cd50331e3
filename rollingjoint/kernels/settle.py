"""One equilibrium from one start: Newton's method, and the fallbacks for a non-converged or indeterminate pose."""

from __future__ import annotations

from rollingjoint._numba.jit import part
from rollingjoint.kernels.arrays import INDETERMINATE, UNSTABLE
from rollingjoint.kernels.bounds import begin, moved
from rollingjoint.kernels.descent import descend, relax
from rollingjoint.kernels.long_chain import DENSE_JOINTS
from rollingjoint.kernels.newton import minimise

MOST_ESCAPES = 8  # from saddles
_PROXIMAL_PATH = (0.0, 1e-2, 1e-4, 1e-6, 1e-8, 0.0)  # weights of the way back to the start, over k g'²


@part
def long_joints(n_joints, conservative):
    """Number of joints that take the O(n) steps: all of a long chain under conservative loads, else 0."""
    return n_joints if conservative and n_joints > DENSE_JOINTS else 0


@part
def settle(chain, conservative, most_escapes, max_iterations, careful, law, loads, start, state, H, sweep):
    """Equilibrium from joint angles `start`; fills the state; returns (status, iterations, largest free |r|).

    Where slack tendons leave the pose open, the minimum of V + prox/2 |phi - start|² is followed from the start as prox
    falls to 0: it ends at the admissible pose nearest the start.

    careful: whether Newton's method begins where the slow descent (descent.py) ends.
    """
    last = len(_PROXIMAL_PATH) - 1
    count, phase, size = 0, 0, 0.0
    begin(chain, start, state.angle)
    while True:
        prox = size * _PROXIMAL_PATH[phase]
        if careful:
            count += descend(chain, law, loads, conservative, prox, start, state)
        status, iterations, worst = minimise(
            chain, law, loads, conservative, most_escapes, max_iterations, prox, start, state, H, sweep
        )
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
        elif status >= UNSTABLE and not conservative and not careful:
            begin(chain, start, state.angle)
            count += relax(chain, law, loads, state, H, sweep)
            phase = last
        else:
            break
    return status, count, worst
