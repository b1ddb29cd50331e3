"""Desired tendon lengths in the least-squares sense: bounded Levenberg-Marquardt on the tensions.

min over tensions in [low, high] of 1/2 |l(tau) - l_des|², where l(tau) is the length at the equilibrium under tau and
dl/dtau = -Gᵀ H⁻¹ G. Source: rolling-contact paper, eq. 29 (its own algorithm takes fixed gradient steps).
"""

from __future__ import annotations

import numpy as np

from rollingjoint._jit import kernel
from rollingjoint._kernels.arrays import ANGLE, NOT_CONVERGED, TendonLaw, new_state
from rollingjoint._kernels.batch import solve_invalid, store, valid
from rollingjoint._kernels.chain import stiffness
from rollingjoint._kernels.linear import cholesky, cholesky_solve, lu_step
from rollingjoint._kernels.long_chain import DENSE_JOINTS, factor, fill_generators, new_sweep, substitute
from rollingjoint._kernels.newton import limit_angles
from rollingjoint._kernels.solve import solve

_LARGEST_TENSION = 1000.0  # N, where none is given
_SMALLEST_TENSION = 0.01  # N; a solution below it is slack and says nothing about the tension ratio
_MAX_ITERATIONS = 300
_GOAL = 1e-11  # mm that the next step would still change the lengths by


@kernel
def _length_rates(chain, state, conservative, springs, J):
    """Fill J = dl/dtau, joints at a surface limit held; False where H is singular."""
    n, m = state.residual.size, state.length.size
    free = np.ones(n, np.bool_)
    for i in range(n):
        highest, lowest = limit_angles(chain, i)
        free[i] = lowest + 1e-13 < state.joint[i, ANGLE] < highest - 1e-13
    long = conservative and n > DENSE_JOINTS
    sweep = new_sweep(n if long else 0, m, springs)
    H = np.empty((0, 0)) if long else np.empty((n, n))
    if long:
        fill_generators(chain, state, 0.0, sweep)
        if factor(sweep, free, 0.0) < 0.0:
            return False
    else:
        stiffness(chain, state, H)
    J[:] = 0.0
    column = np.empty(n)
    for j in range(m):
        if long:
            substitute(sweep, free, state.gap[:, j, 1], column)
        elif not lu_step(H, free, state.gap[:, j, 1], column):
            return False
        for k in range(m):
            for i in range(n):
                J[k, j] += state.gap[i, k, 1] * column[i]
    return True


@kernel
def _step(J, miss, tension, low, high, damping, step):
    """Levenberg-Marquardt step on the tensions that are not held at a bound."""
    m = tension.size
    gradient, normal = J.T @ miss, J.T @ J
    free = np.ones(m, np.bool_)
    for j in range(m):
        free[j] = not (tension[j] <= low[j] and gradient[j] > 0.0) and not (tension[j] >= high[j] and gradient[j] < 0.0)
    L = np.empty((m, m))
    while cholesky(normal, free, damping, L) <= 0.0:
        damping = max(10.0 * damping, 1e-300)
        if damping > 1e12:
            step[:] = 0.0
            return
    cholesky_solve(L, free, gradient, step)


@kernel
def _iterate(chain, law, loads, tension, s, state):
    """Improve the tensions in place; returns (status, iterations, residual)."""
    m = tension.size
    J, step, miss, trial = np.empty((m, m)), np.empty(m), np.empty(m), tension.copy()
    phi, fixed = state.joint[:, ANGLE].copy(), np.ones(m)
    cost, damping, count, finished = np.inf, 1e-5, 0, False
    conservative, springs = not np.any(loads[:, 5:7] != 0.0), np.any(loads[:, 8] != 0.0)
    for _ in range(_MAX_ITERATIONS):
        at_trial = TendonLaw(np.zeros(m), fixed, trial, trial)
        status, iterations, residual = solve(chain, at_trial, loads, phi, s, state)
        count += iterations
        new_cost = 0.5 * np.sum((state.length - law.command) ** 2)
        better = cost == np.inf or (status < NOT_CONVERGED and new_cost < cost)
        if better:
            cost, damping = new_cost, max(0.1 * damping, 1e-12)
            tension[:], miss[:], phi[:] = trial, state.length - law.command, state.joint[:, ANGLE]
            finished = finished or not _length_rates(chain, state, conservative, springs, J)
        else:
            damping *= 10.0
        if finished:
            return status, count, residual
        _step(J, miss, tension, law.low, law.high, damping * np.max(np.abs(J)) ** 2, step)
        trial[:] = np.minimum(np.maximum(tension + step, law.low), law.high)
        if np.max(np.abs(J @ (trial - tension))) < _GOAL:
            if better:
                return status, count, residual
            trial[:], finished = tension, True
    return NOT_CONVERGED, count, residual


@kernel
def _first_tensions(chain, law, loads, start, s, state):
    """Tensions of nearly inextensible tendons with the desired lengths; without a load only their ratio matters."""
    phi = start
    for k in (1.0, 30.0, 1000.0):
        stiff = TendonLaw(law.command, np.full(law.low.size, k), law.low, law.high)
        solve(chain, stiff, loads, phi, s, state)
        phi = state.joint[:, ANGLE].copy()
    tension = state.tension.copy()
    if np.max(tension) < _SMALLEST_TENSION:
        tension[:] = 1.0
    elif not np.any(loads[:, 3:9] != 0.0):
        tension /= np.max(tension)
    return np.minimum(np.maximum(tension, law.low), law.high)


@kernel
def solve_least_squares(chain, law, loads, start, results):
    """Solve one lane into results; law.command holds the desired lengths."""
    n, m = start.size, law.command.size
    state, s = new_state(n, m), results.arc_lengths[0]
    if not valid(law, loads, start):
        outcome = solve_invalid(chain, m, start, s, state)
    else:
        bounded = TendonLaw(law.command, law.stiffness, law.low, np.minimum(law.high, _LARGEST_TENSION))
        tension = _first_tensions(chain, bounded, loads, start, s, state)
        outcome = _iterate(chain, bounded, loads, tension, s, state)
    store(chain, state, outcome, results, 0)
