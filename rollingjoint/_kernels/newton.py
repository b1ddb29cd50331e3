"""Globalised Newton solve of the bound-constrained statics problem.

Conservative loads: minimise the energy V over the joint angles by projected Newton steps with a line search on V; leave
saddles along negative curvature. Follower loads: Newton on r = 0 with a line search on |r|.
The state variable is the arc length s; steps are taken in the joint angle phi, where H is symmetric.
"""

from __future__ import annotations

import numpy as np

from rollingjoint._jit import kernel
from rollingjoint._kernels.arrays import (
    ANGLE,
    AT_LIMIT,
    CONVERGED,
    INDETERMINATE,
    NOT_CONVERGED,
    UNSTABLE,
)
from rollingjoint._kernels.chain import evaluate, stiffness
from rollingjoint._kernels.joint import arc_length
from rollingjoint._kernels.linear import (
    cholesky,
    damped_step,
    descent_step,
    eigen,
    largest,
    lu_step,
)
from rollingjoint._kernels.long_chain import factor, fill_generators, long_step

RESIDUAL_LIMIT = 1e-8  # N·mm: no result above it is called converged
RESIDUAL_GOAL = 1e-9  # N·mm: where iteration stops; smaller for small forces
_RESIDUAL_FLOOR = 1e-12
_STALLED_FLOOR = 1e-10  # N·mm: good enough where rounding stops the descent
_RELATIVE_GOAL = 1e-11
_NEGLIGIBLE = 1e-8  # N·mm/rad: with no stiffness above it, nothing holds the pose
MAX_ITERATIONS = 200
_MAX_STEP = 0.5  # rad in any joint
_MAX_HALVINGS = 40
_MAX_ESCAPES = 8
_ROUNDING = 1e-14  # of the magnitude of the energy terms


@kernel
def limit_angles(chain, i):
    """Joint angles at both surface limits: (largest, at the smallest s; smallest, at the largest s)."""
    return chain.cells[chain.cell_first[i], 2], chain.cells[chain.cell_first[i + 1] - 1, 3]


@kernel
def mark_free(chain, state, prox, anchor, free):
    """Mark joints that are not held by a surface limit; returns the largest free |r|. The proximal term is included."""
    worst = 0.0
    for i in range(free.size):
        phi = state.joint[i, ANGLE]
        highest, lowest = limit_angles(chain, i)
        residual = state.residual[i] + prox * (phi - anchor[i])
        held = (phi >= highest - 1e-13 and residual < 0.0) or (phi <= lowest + 1e-13 and residual > 0.0)
        free[i] = not held
        if free[i]:
            worst = max(worst, abs(residual))
    return worst


@kernel
def _release_step(chain, state, free, step):
    """Hold joints at a limit that the step would leave outwards; returns True when it held any."""
    changed = False
    for i in range(free.size):
        if free[i] and step[i] != 0.0:
            phi = state.joint[i, ANGLE]
            highest, lowest = limit_angles(chain, i)
            if (phi >= highest - 1e-13 and step[i] > 0.0) or (phi <= lowest + 1e-13 and step[i] < 0.0):
                free[i] = False
                changed = True
    return changed


@kernel
def _proximal_energy(state, prox, anchor):
    energy = 0.0
    for i in range(anchor.size):
        energy += 0.5 * prox * (state.joint[i, ANGLE] - anchor[i]) ** 2
    return energy


@kernel
def _proximal_residual(state, prox, anchor, out):
    for i in range(anchor.size):
        out[i] = state.residual[i] + prox * (state.joint[i, ANGLE] - anchor[i])


@kernel
def newton_step(chain, state, H, sweep, conservative, damping, free, residual, L, step):
    """Step on the free joints; joints at a limit that it would push outwards are held as well."""
    for _ in range(free.size + 1):
        if sweep.diagonal.size > 0:
            long_step(sweep, free, residual, step)
        elif conservative:
            descent_step(H, free, residual, L, step)
        elif damping > 0.0 or not lu_step(H, free, residual, step):
            damped_step(H, free, residual, damping, L, step)
        if not _release_step(chain, state, free, step):
            break
    longest = 0.0
    for i in range(free.size):
        longest = max(longest, abs(step[i]))
    if longest > _MAX_STEP:
        step *= _MAX_STEP / longest


@kernel
def move(chain, phi, step, t, s):
    """Arc lengths at joint angles phi + t step, clipped to the surface limits."""
    for i in range(s.size):
        if step[i] != 0.0:
            s[i] = arc_length(chain, i, phi[i] + t * step[i])


@kernel
def _line_search(chain, law, loads, prox, anchor, conservative, step, state, s, free, energy, magnitude, worst, work):
    """Halve the step until the merit falls.

    Returns (moved, energy, magnitude, scale, worst free |r|); state and s are at the new configuration, or restored.
    work is scratch space, (3, J).
    """
    n = s.size
    phi, s_old, residual = work[0], work[1], work[2]
    _proximal_residual(state, prox, anchor, residual)
    squared = 0.0
    for i in range(n):
        phi[i], s_old[i] = state.joint[i, ANGLE], s[i]
        if free[i]:
            squared += residual[i] ** 2
    t = 1.0
    for attempt in range(_MAX_HALVINGS + 1):
        restored = attempt == _MAX_HALVINGS
        if restored:
            s[:] = s_old
        else:
            move(chain, phi, step, t, s)
        new_energy, new_magnitude, scale = evaluate(chain, law, loads, s, state)
        new_energy += _proximal_energy(state, prox, anchor)
        new_worst = mark_free(chain, state, prox, anchor, free)
        if conservative:
            slope = 0.0
            for i in range(n):
                slope += residual[i] * (state.joint[i, ANGLE] - phi[i])
            noise, fall = _ROUNDING * (magnitude + new_magnitude), energy - new_energy
            accept = fall > noise and fall >= -1e-4 * slope
            accept = accept or (fall >= -noise and new_worst < worst)
        else:
            new_squared = 0.0
            for i in range(n):
                if free[i]:
                    new_squared += (state.residual[i] + prox * (state.joint[i, ANGLE] - anchor[i])) ** 2
            accept = new_squared <= (1.0 - 1e-4 * t) * squared
        if accept or restored:
            break
        t *= 0.5
    return not restored, new_energy, new_magnitude, scale, new_worst


@kernel
def _escape_direction(H, free, step):
    """Fill step with the direction of most negative curvature, 0.1 rad long, its largest entry positive."""
    index, _, vectors = eigen(H, free)
    leader = np.argmax(np.abs(vectors[:, 0]))
    sign = 1.0 if vectors[leader, 0] > 0.0 else -1.0
    step[:] = 0.0
    for i in range(index.size):
        step[index[i]] = 0.1 * sign * vectors[i, 0]


@kernel
def classify(H, sweep, free, conservative, L):
    """Kind of a stationary point: CONVERGED (stable), INDETERMINATE (H singular) or UNSTABLE.

    Unstable: H has an eigenvalue of negative real part.
    """
    long = sweep.diagonal.size > 0
    size = np.max(np.abs(sweep.diagonal)) if long else largest(H, free)
    if size < _NEGLIGIBLE and np.any(free):
        return INDETERMINATE
    if long:
        if factor(sweep, free, 0.0) > 1e-10:
            return CONVERGED
        return INDETERMINATE if factor(sweep, free, 1e-9 * size) > 0.0 else UNSTABLE
    symmetric = H if conservative else 0.5 * (H + H.T)
    if cholesky(symmetric, free, 0.0, L) > 1e-10:
        return CONVERGED
    index = np.flatnonzero(free)
    reduced = np.empty((index.size, index.size), np.complex128)
    for i in range(index.size):
        for m in range(index.size):
            reduced[i, m] = H[index[i], index[m]]
    smallest = np.min(np.linalg.eigvals(reduced).real)
    if smallest > 1e-10 * size:
        return CONVERGED
    return INDETERMINATE if smallest > -1e-9 * size else UNSTABLE


@kernel
def minimise(chain, law, loads, conservative, prox, anchor, s, state, H, sweep):
    """Iterate from s to equilibrium in place; returns (status, iterations, largest free |r|)."""
    n = s.size
    free = np.ones(n, np.bool_)
    residual, step, L, work = np.empty(n), np.empty(n), np.empty_like(H), np.empty((3, n))
    long = sweep.diagonal.size > 0
    energy, magnitude, scale = evaluate(chain, law, loads, s, state)
    energy += _proximal_energy(state, prox, anchor)
    worst = mark_free(chain, state, prox, anchor, free)
    damping, escapes, stalled = 0.0, 0, False
    for iteration in range(MAX_ITERATIONS):
        goal = max(_RESIDUAL_FLOOR, min(RESIDUAL_GOAL, _RELATIVE_GOAL * scale))
        if long:
            fill_generators(chain, state, prox, sweep)
        else:
            stiffness(chain, state, H)
            for i in range(n):
                H[i, i] += prox
        if worst <= goal or (stalled and worst <= min(RESIDUAL_LIMIT, max(_STALLED_FLOOR, 1e-8 * scale))):
            kind = classify(H, sweep, free, conservative, L)
            if kind != UNSTABLE or not conservative or long or escapes == _MAX_ESCAPES:
                if kind == CONVERGED and not np.all(free):
                    kind = AT_LIMIT
                return kind, iteration, worst
            escapes += 1
            _escape_direction(H, free, step)
        elif stalled:
            return NOT_CONVERGED, iteration, worst
        else:
            _proximal_residual(state, prox, anchor, residual)
            newton_step(chain, state, H, sweep, conservative, damping, free, residual, L, step)
        moved, energy, magnitude, scale, worst = _line_search(
            chain, law, loads, prox, anchor, conservative, step, state, s, free, energy, magnitude, worst, work
        )
        if moved:
            damping *= 0.1 if damping > 1e-8 else 0.0
        elif conservative or damping > 1.0:
            stalled = True
        else:
            damping = max(10.0 * damping, 1e-6)
    return NOT_CONVERGED, MAX_ITERATIONS, worst
