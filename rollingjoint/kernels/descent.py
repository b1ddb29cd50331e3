"""The slow, sure way from a start to an equilibrium, where Newton's method has ended without one.

Every step solves (H + shift D) step = -r: an implicit step of the overdamped motion D dphi/dt = -r of length 1 / shift,
and Newton's step where the shift is 0. D, the damping of every joint, is the largest stiffness that it has had lately:
a contact that has met a flat spot approaches it in small steps, while the others go on. Under conservative loads a step
has to lower the energy and not to end uphill, under follower forces it has to stay near that motion; where it does not,
or is too long, the shift grows and the step becomes shorter. A step that cannot be taken as a whole ends where its
first joint meets a limit: clipping every joint by itself, as Newton's method does, may turn a descent into an ascent.

`relax` follows that motion itself, for arms under loads without a potential.
"""

from __future__ import annotations

import numpy as np

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import part
from rollingjoint.kernels.arrays import (
    MAX_STEP,
    NEGLIGIBLE,
    RELATIVE_GOAL,
    RESIDUAL_FLOOR,
    RESIDUAL_GOAL,
    ROUNDING,
    SMALLEST_PIVOT,
)
from rollingjoint.kernels.bounds import mark_free, move, release_step
from rollingjoint.kernels.formulas import evaluate, renew, shorten, stiffness
from rollingjoint.kernels.friction import overshoots_kink
from rollingjoint.kernels.linear import cholesky, cholesky_solve, largest, lu_step
from rollingjoint.kernels.newton import (
    escape_direction,
    most_iterations,
    newton_step,
    proximal_energy,
    proximal_residual,
)

_MOST_STEPS = 2000
_ALL_STEPS_JOINTS = 60  # up to here; a step takes the cube of the joints
_MOST_JOINTS = 150  # beyond, a solve would take too long
_SMALLEST_SHIFT, _LARGEST_SHIFT = 1e-12, 1e12
_SMALLEST_DAMPING, _MEMORY = 1e-6, 0.5  # of the largest stiffness; of the damping, from one step to the next
_MOST_ESCAPES = 8
_SHORTEST_ESCAPE = 1e-4  # of 0.1 rad
_MOST_DEFECT = 0.5  # of the residual: largest distance of a step from the overdamped motion


@part
def most_descent_steps(n_joints):
    """Allowed steps with n_joints joints."""
    if n_joints > _MOST_JOINTS:
        return 0
    return int(_MOST_STEPS * min(1.0, (_ALL_STEPS_JOINTS / max(n_joints, 1)) ** 3))


@part
def descend(chain, law, loads, conservative, prox, anchor, state):
    """Go from the state's angles towards a stable equilibrium; returns the number of steps.

    The stiffness is dense, of a long chain too. The equilibrium is a minimum of V + prox/2 |phi - anchor|².
    """
    n = state.angle.size
    if most_descent_steps(n) == 0:
        return 0
    free = np.ones(n, np.bool_)
    return _descend(
        chain, law, loads, conservative, prox, anchor, state, np.empty((n, n)), np.empty((n, n)), np.zeros((5, n)), free
    )


@part
def _descend(chain, law, loads, conservative, prox, anchor, state, H, L, vectors, free):
    """descend with its scratch space."""
    H, L, vectors, free = borrow(H), borrow(L), borrow(vectors), borrow(free)
    residual, step, phi, damping, diagonal = vectors[0], vectors[1], vectors[2], vectors[3], vectors[4]
    n, max_steps = state.angle.size, most_descent_steps(state.angle.size)
    energy, magnitude, scale = evaluate(chain, law, loads, state)
    energy += proximal_energy(state, prox, anchor)
    shift, escapes = 0.0, 0
    for count in range(max_steps):
        energy, magnitude = renew(chain, state, energy, magnitude)
        worst = mark_free(chain, state, prox, anchor, free)
        stiffness(chain, loads, state, H)
        proximal_residual(state, prox, anchor, residual)
        for i in range(n):
            H[i, i] += prox
            phi[i] = state.angle[i]
        size, before = max(largest(H, free), NEGLIGIBLE), (energy, magnitude, worst)
        if worst <= max(RESIDUAL_FLOOR, min(RESIDUAL_GOAL, RELATIVE_GOAL * scale)):
            if not conservative or escapes == _MOST_ESCAPES or not _is_saddle(H, free, size, step):
                return count
            escapes += 1
            shorten(chain, state, step, False)
            escaped, energy, magnitude = _escape(chain, law, loads, prox, anchor, state, phi, step, before)
            if not escaped:
                return count
            continue
        for i in range(n):
            diagonal[i] = H[i, i]
            damping[i] = max(abs(H[i, i]), _MEMORY * damping[i], _SMALLEST_DAMPING * size)
        tries, accepted = 0, False
        while not accepted:
            if shift > _LARGEST_SHIFT:
                return count
            for i in range(n):
                H[i, i] = diagonal[i] + shift * damping[i]
            if _shifted_step(chain, state, H, conservative, free, residual, L, step):
                how = chain, law, loads, conservative, prox, anchor, state, shift, damping
                accepted, energy, magnitude, scale = _take(*how, residual, free, phi, step, before)
            if not accepted:
                tries, shift = tries + 1, max(8.0 * shift, _SMALLEST_SHIFT)
                move(chain, phi, step, 0.0, state.angle)
                evaluate(chain, law, loads, state)
                mark_free(chain, state, prox, anchor, free)
        if tries == 0:
            shift = 0.1 * shift if shift > _SMALLEST_SHIFT else 0.0
    return max_steps


@part
def _shifted_step(chain, state, H, conservative, free, residual, L, step):
    """Fill the step; False where H is not positive definite, or the step too long.

    Joints at a limit that it would push outwards are held as well.
    """
    n = free.size
    for _ in range(n + 1):
        if not cholesky(H, free, 0.0, L) > 0.0:
            return False
        if conservative:
            cholesky_solve(L, free, residual, step)
        elif not lu_step(H, free, residual, step):
            return False
        if not release_step(chain, state, free, step):
            break
    for i in range(n):
        if abs(step[i]) > MAX_STEP:
            return False
    return not shorten(chain, state, step, False) < 1.0


@part
def _take(chain, law, loads, conservative, prox, anchor, state, shift, damping, residual, free, phi, step, before):
    """Go a step, or else up to the first limit on its way; returns (accepted, energy, magnitude, force scale)."""
    energy, magnitude, worst = before
    for full in (True, False):
        t = 1.0 if full else _first_limit(chain, phi, step)
        move(chain, phi, step, t, state.angle)
        new_energy, new_magnitude, scale = evaluate(chain, law, loads, state)
        new_energy += proximal_energy(state, prox, anchor)
        if conservative:
            slope, new_slope = 0.0, 0.0
            for i in range(phi.size):
                way = state.angle[i] - phi[i]
                slope += residual[i] * way
                new_slope += (state.residual[i] + prox * (state.angle[i] - anchor[i])) * way
            noise, fall = ROUNDING * (magnitude + new_magnitude), energy - new_energy
            accepted = fall > noise and fall >= -1e-4 * slope and not overshoots_kink(slope, new_slope)
            if abs(fall) <= noise:  # rounding decides: by the residual, and a joint may go onto its limit
                accepted = not full or mark_free(chain, state, prox, anchor, free) < worst
        else:
            accepted = _follows(state, shift, damping, t, residual, free, phi, step)
        if accepted or t == 0.0:
            break
    return accepted, new_energy, new_magnitude, scale


@part
def _follows(state, shift, damping, t, residual, free, phi, step):
    """True if the residual after part t of a step is near the residual at which the step aims."""
    defect, squared = 0.0, 0.0
    for i in range(phi.size):
        way = state.angle[i] - phi[i]
        if free[i] and abs(way - t * step[i]) <= 1e-12:
            defect += (state.residual[i] - (1.0 - t) * residual[i] + shift * damping[i] * way) ** 2
            squared += residual[i] ** 2
    return defect <= (_MOST_DEFECT * t) ** 2 * squared


@part
def _first_limit(chain, phi, step):
    """The part of a step after which the first joint meets a limit."""
    t = 1.0
    for i in range(phi.size):
        if step[i] > 0.0:
            t = min(t, (chain.joints[i, 1] - phi[i]) / step[i])
        elif step[i] < 0.0:
            t = min(t, (chain.joints[i, 0] - phi[i]) / step[i])
    return max(t, 0.0)


@part
def _is_saddle(H, free, size, step):
    """True if H has a clearly negative eigenvalue; fills step along its vector, 0.1 rad long."""
    any_free = False
    for i in range(free.size):
        any_free = any_free or free[i]
    if not any_free:
        return False
    escape_direction(H, free, step)
    curvature, squared = 0.0, 0.0
    for i in range(free.size):
        squared += step[i] ** 2
        for m in range(free.size):
            curvature += step[i] * H[i, m] * step[m]
    return curvature < -1e-9 * size * squared


@part
def _escape(chain, law, loads, prox, anchor, state, phi, step, before):
    """Go along the step, or against it, so far that the energy falls; returns (whether it does, energy, magnitude)."""
    energy, magnitude, _ = before
    t = 1.0
    while t > _SHORTEST_ESCAPE:
        for way in (t, -t):
            move(chain, phi, step, way, state.angle)
            new_energy, new_magnitude, _ = evaluate(chain, law, loads, state)
            new_energy += proximal_energy(state, prox, anchor)
            if energy - new_energy > ROUNDING * (magnitude + new_magnitude):
                return True, new_energy, new_magnitude
        t *= 0.5
    move(chain, phi, step, 0.0, state.angle)
    evaluate(chain, law, loads, state)
    return False, energy, magnitude


@part
def relax(chain, law, loads, state, H, sweep):
    """From the state's angles, follow the overdamped motion dphi/dt = -r with implicit steps of growing length.

    Returns the steps taken. Follower forces have no potential to descend; this motion still leads from the start to a
    stable equilibrium where there is one.
    """
    n = state.angle.size
    free, step, L = np.ones(n, np.bool_), np.empty(n), np.empty((n, n))
    rate, worst = -1.0, 0.0
    max_steps = most_iterations(n)
    for count in range(max_steps):
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
    return max_steps
