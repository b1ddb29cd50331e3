"""Globalised Newton solve of the bound-constrained statics problem.

Conservative loads: minimise the energy V over the joint angles by projected Newton steps with a line search on V; leave
saddles along negative curvature. Follower loads: Newton on r = 0 with a line search on |r|. So does friction at walls
in space, and on |H⁻¹ r|, Newton's next correction, where that takes long: a stiff wall and weak springs make |r| a
narrow valley, and around a round end it is bent.
The unknowns are the joint angles, where H is symmetric; a contact at the end of its surface is a bound on its angle.
"""

from __future__ import annotations

import numpy as np

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import part
from rollingjoint.kernels.arrays import (
    AT_LIMIT,
    CONVERGED,
    INDETERMINATE,
    MAX_STEP,
    NEGLIGIBLE,
    NOT_CONVERGED,
    RELATIVE_GOAL,
    RESIDUAL_FLOOR,
    RESIDUAL_GOAL,
    RESIDUAL_LIMIT,
    ROUNDING,
    SMALLEST_PIVOT,
    UNSTABLE,
)
from rollingjoint.kernels.bounds import mark_free, move, release_step
from rollingjoint.kernels.formulas import (
    direction,
    evaluate,
    fill_generators,
    overshoots,
    reconsider,
    renew,
    rubs_at_walls,
    shorten,
    stiffness,
)
from rollingjoint.kernels.linear import cholesky, damped_step, eigen, largest, lu_step, smallest_real_part
from rollingjoint.kernels.long_chain import DENSE_JOINTS, factor, new_sweep

MAX_ITERATIONS = 200
_FEWEST_ITERATIONS = 80
_ALL_ITERATIONS_JOINTS = 220  # up to here; a dense step takes the cube of the joints
_MOST_DENSE_JOINTS = 1000  # beyond, a single step takes too long
_MOST_DENSE_EIGEN_JOINTS = 300  # beyond, eigenvalues take too long
_STAGED_ITERATIONS = 1000  # with 300 joints, in all the stages of a load that grows
_STALLED_FLOOR = 1e-10  # N·mm: good enough where rounding stops the descent
_ROUNDING_OF_LENGTH = 4e-16  # relative
_MAX_HALVINGS = 40
_PATIENCE = 40  # iterations by |r| among walls that rub


@part
def most_iterations(n_dense):
    """Allowed dense steps with n_dense joints: all of MAX_ITERATIONS for 0, fewer where they would take too long."""
    if n_dense <= _ALL_ITERATIONS_JOINTS:
        return MAX_ITERATIONS
    if n_dense > _MOST_DENSE_JOINTS:
        return 0
    return max(_FEWEST_ITERATIONS, int(MAX_ITERATIONS * (_ALL_ITERATIONS_JOINTS / n_dense) ** 3))


@part
def most_staged_iterations(n_joints):
    """Allowed dense steps with n_joints joints in all the stages of a load that grows from zero."""
    return int(_STAGED_ITERATIONS * (300.0 / max(n_joints, 1)) ** 3)


@part
def proximal_energy(state, prox, anchor):
    """prox/2 |angle - anchor|²."""
    energy = 0.0
    for i in range(anchor.size):
        energy += 0.5 * prox * (state.angle[i] - anchor[i]) ** 2
    return energy


@part
def proximal_residual(state, prox, anchor, out):
    """Fill out with the residual, the proximal term included."""
    for i in range(anchor.size):
        out[i] = state.residual[i] + prox * (state.angle[i] - anchor[i])


@part
def newton_step(chain, state, H, sweep, conservative, damping, free, residual, L, step):
    """Step on the free joints; joints at a limit that it would push outwards are held as well."""
    for _ in range(free.size + 1):
        if conservative:
            direction(chain, H, sweep, free, residual, L, step)
        elif damping > 0.0 or not lu_step(H, free, residual, step):
            damped_step(H, free, residual, damping, L, step)
        if not release_step(chain, state, free, step):
            break
    longest = 0.0
    for i in range(free.size):
        longest = max(longest, abs(step[i]))
    if longest > MAX_STEP:
        for i in range(free.size):
            step[i] *= MAX_STEP / longest
    shorten(chain, state, step, True)


@part
def _squared(H, natural, free, residual, correction):
    """|r|² on the free joints, or |H⁻¹ r|² for a natural merit; inf where H is singular."""
    if natural and not lu_step(H, free, residual, correction):
        return np.inf
    squared = 0.0
    for i in range(free.size):
        if free[i]:
            squared += correction[i] ** 2 if natural else residual[i] ** 2
    return squared


@part
def _line_search(
    chain, law, loads, prox, anchor, conservative, natural, H, step, state, free, energy, magnitude, worst, work
):
    """Halve the step until the merit falls.

    Returns (moved, energy, magnitude, scale, worst free |r|); the state is at the new configuration, or restored.
    natural: whether the merit is `_squared` with this H. work is scratch space, three arrays (J,).
    """
    angle = state.angle
    n = angle.size
    phi, residual, correction = work[0], work[1], work[2]
    proximal_residual(state, prox, anchor, residual)
    squared, step_squared, t = _squared(H, natural, free, residual, correction), 0.0, 1.0
    for i in range(n):
        phi[i] = angle[i]
        step_squared += step[i] ** 2
    least_fall = 0.5 * min(1.0, np.sqrt(step_squared / squared)) if natural and squared > 0.0 else 1e-4
    for attempt in range(_MAX_HALVINGS + 1):
        restored = attempt == _MAX_HALVINGS
        move(chain, phi, step, 0.0 if restored else t, angle)
        new_energy, new_magnitude, scale = evaluate(chain, law, loads, state)
        new_energy += proximal_energy(state, prox, anchor)
        new_worst = mark_free(chain, state, prox, anchor, free)
        if conservative:
            slope, new_slope = 0.0, 0.0
            for i in range(n):
                way = state.angle[i] - phi[i]
                slope += residual[i] * way
                new_slope += (state.residual[i] + prox * (state.angle[i] - anchor[i])) * way
            noise, fall = ROUNDING * (magnitude + new_magnitude), energy - new_energy
            accept = fall > noise and fall >= -1e-4 * slope and not overshoots(chain, slope, new_slope)
            accept = accept or (fall >= -noise and new_worst < worst)
        else:
            proximal_residual(state, prox, anchor, residual)
            accept = _squared(H, natural, free, residual, correction) <= (1.0 - least_fall * t) * squared
        if accept or restored:
            break
        t *= 0.5
    return not restored, new_energy, new_magnitude, scale, new_worst


@part
def _stalled_goal(state, scale):
    """The residual that is good enough where rounding stops the descent, of energies or of stiff tendons' lengths."""
    pull = 0.0
    for j in range(state.length.size):
        for i in range(state.angle.size):
            pull = max(pull, state.elastic[j] * state.length[j] * abs(state.gap[i, j, 1]))
    return min(RESIDUAL_LIMIT, max(_STALLED_FLOOR, 1e-8 * scale, _ROUNDING_OF_LENGTH * pull))


@part
def escape_direction(H, free, step):
    """Fill step with the direction of most negative curvature, 0.1 rad long, its largest entry positive."""
    index, _, vectors = eigen(H, free)
    leader = 0
    for i in range(index.size):
        if abs(vectors[i, 0]) > abs(vectors[leader, 0]):
            leader = i
    sign = 1.0 if vectors[leader, 0] > 0.0 else -1.0
    for i in range(step.size):
        step[i] = 0.0
    for i in range(index.size):
        step[index[i]] = 0.1 * sign * vectors[i, 0]


@part
def classify(H, sweep, free, L):
    """Kind of a stationary point: CONVERGED (stable), INDETERMINATE (H singular) or UNSTABLE.

    Unstable: H has an eigenvalue of negative real part.
    """
    long = sweep.diagonal.size > 0
    n = free.size
    size, any_free = 0.0, False
    for i in range(n):
        any_free = any_free or free[i]
        if long:
            size = max(size, abs(sweep.diagonal[i]))
    if not long:
        size = largest(H, free)
    if size < NEGLIGIBLE and any_free:
        return INDETERMINATE
    if long:
        if factor(sweep, free, 0.0) > SMALLEST_PIVOT:
            return CONVERGED
        return INDETERMINATE if factor(sweep, free, 1e-9 * size) > 0.0 else UNSTABLE
    if cholesky(H, free, 0.0, L) > SMALLEST_PIVOT:
        return CONVERGED
    smallest = smallest_real_part(H, free)
    if smallest > 1e-10 * size:
        return CONVERGED
    return INDETERMINATE if smallest > -1e-9 * size else UNSTABLE


def reclassified(chain, loads, state, free, kind):
    """`reconsider` where H is the whole derivative of the residual.

    The pivots of a long chain lose terms that are small compared with its largest lever, so that an UNSTABLE by them is
    judged again by the eigenvalues of the dense H.
    """
    n = free.size
    if kind != UNSTABLE or n <= DENSE_JOINTS or n > _MOST_DENSE_EIGEN_JOINTS:
        return kind
    H = np.empty((n, n))
    stiffness(chain, loads, state, H)
    return classify(H, new_sweep(0, 0), free, np.empty((n, n)))


@part
def minimise(chain, law, loads, conservative, most_escapes, max_iterations, prox, anchor, state, H, sweep):
    """Iterate from the state's angles to equilibrium in place; returns (status, iterations, largest free |r|).

    max_iterations: bound on the iterations, lower where dense steps take long. Under conservative loads it leaves up to
    `most_escapes` saddles along their negative curvature.
    """
    n = state.angle.size
    max_iterations = min(max_iterations, most_iterations(0 if sweep.diagonal.size > 0 else n))
    return _minimise(
        chain,
        law,
        loads,
        conservative,
        most_escapes,
        max_iterations,
        prox,
        anchor,
        state,
        H,
        sweep,
        np.empty(H.shape),
        np.empty((5, n)),
        np.empty(n, np.bool_),
    )


@part
def _minimise(
    chain, law, loads, conservative, most_escapes, max_iterations, prox, anchor, state, H, sweep, L, vectors, free
):
    """minimise with its scratch space."""
    H, sweep, L, vectors, free = borrow(H), borrow(sweep), borrow(L), borrow(vectors), borrow(free)
    residual, step, work = vectors[0], vectors[1], (vectors[2], vectors[3], vectors[4])
    n = state.angle.size
    long = sweep.diagonal.size > 0
    energy, magnitude, scale = evaluate(chain, law, loads, state)
    energy, magnitude = renew(chain, state, energy + proximal_energy(state, prox, anchor), magnitude)
    worst = mark_free(chain, state, prox, anchor, free)
    damping, escapes, stalled, natural = 0.0, 0, False, False
    for iteration in range(max_iterations):
        goal = max(RESIDUAL_FLOOR, min(RESIDUAL_GOAL, RELATIVE_GOAL * scale))
        if long:
            fill_generators(chain, loads, state, prox, sweep)
        else:
            stiffness(chain, loads, state, H)
            for i in range(n):
                H[i, i] += prox
        if worst <= goal or (stalled and worst <= _stalled_goal(state, scale)):
            kind = classify(H, sweep, free, L)
            if kind != CONVERGED:
                kind = reconsider(chain, loads, state, free, kind)
            if kind != UNSTABLE or not conservative or long or escapes == most_escapes:
                for i in range(n):
                    if kind == CONVERGED and not free[i]:
                        kind = AT_LIMIT
                return kind, iteration, worst
            escapes += 1
            escape_direction(H, free, step)
            shorten(chain, state, step, False)
        elif stalled:
            return NOT_CONVERGED, iteration, worst
        else:
            proximal_residual(state, prox, anchor, residual)
            natural = not conservative and iteration >= _PATIENCE and rubs_at_walls(chain)
            newton_step(chain, state, H, sweep, conservative, 0.0 if natural else damping, free, residual, L, step)
        moved, energy, magnitude, scale, worst = _line_search(
            chain, law, loads, prox, anchor, conservative, natural, H, step, state, free, energy, magnitude, worst, work
        )
        energy, magnitude = renew(chain, state, energy, magnitude)
        if moved:
            damping *= 0.1 if damping > 1e-8 else 0.0
        elif conservative or damping > 1.0:
            stalled = True
        else:
            damping = max(10.0 * damping, 1e-6)
    return NOT_CONVERGED, max_iterations, worst
