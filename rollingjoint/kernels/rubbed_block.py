"""Steps with friction in lanes: lanes.py with the terms of friction.

The Jacobian is not symmetric: it is factored without exchange of rows, and pivots that are not positive are replaced on
the way; at the end its symmetric part must be positive definite. The line search goes by the incremental potential with
the grips of the holes as they were where it began (rubbed_chain.py). Rolling resistance and stretch in the channels are
left to the general solver.

A class of chains brings its block with friction, with the fields `block`, `law`, `before`, `now`, `symmetric` and
`work` of rolling_lanes.RubbedBlock.
"""

from __future__ import annotations

import numpy as np

from rollingjoint._numba.jit import part
from rollingjoint._numba.simd import any_lane, where
from rollingjoint._numba.views import numbers
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import (
    NEGLIGIBLE,
    RELATIVE_GOAL,
    RESIDUAL_FLOOR,
    RESIDUAL_GOAL,
    ROUNDING,
    SMALLEST_PIVOT,
    resolvable,
)
from rollingjoint.kernels.friction import (
    ARM,
    COMPLIANCE,
    N_COEFFICIENTS,
    evaluate_holes,
    evaluate_slips,
    evaluated_energy,
    friction_of,
    history_of,
    overshoots_kink,
    valid_law,
)
from rollingjoint.kernels.lanes import (
    ARRIVED,
    ENERGY,
    LEFT,
    MAGNITUDE,
    PHASE,
    RUNNING,
    STEPS,
    WORST,
    hold_ends,
    keep,
    move,
)

_MAX_PASSES = 60.0
_SHORTEST = 2.0**-20  # of a Newton step


@part(inline=True)
def fill_friction(friction, rubbed, lane, source):
    """Copy the friction of one lane into the block; False where it needs the general solver."""
    law, before = friction_of(friction.law, source), history_of(friction.before, source)
    tendons, frozen = numbers(rubbed.law.tendons), numbers(rubbed.now.frozen)
    states, slips, grips = numbers(rubbed.before.states), numbers(rubbed.before.slips), numbers(rubbed.before.grips)
    supported = valid_law(law) and law.rolling[ARM] == 0.0
    for j in range(tendons.shape[0]):
        supported = supported and law.tendons[j, COMPLIANCE] == 0.0
        for column in range(N_COEFFICIENTS):
            tendons[j, column, lane] = law.tendons[j, column]
    for i in range(states.shape[0]):
        supported = supported and resolvable(before.angles[i]) and abs(before.rolling[i]) <= 1.0
        for j in range(states.shape[1]):
            z, slip, grip = before.states[i, j], before.slips[i, j], before.grips[i, j]
            states[i, j, lane], slips[i, j, lane], grips[i, j, lane], frozen[i, j, lane] = z, slip, grip, 0.0
            supported = supported and abs(z) <= 1.0 and resolvable(slip) and resolvable(grip)
    return supported


@part(inline=True)
def _add_friction(tendon_joints, rubbed):
    """Evaluate the friction of the state, and add it to the residual."""
    state, now, coefficients = rubbed.block.state, rubbed.now, rubbed.law.tendons
    formulas.evaluate_turns(rubbed, tendon_joints)
    evaluate_slips(coefficients, tendon_joints, state, now)
    evaluate_holes(coefficients, rubbed.before, tendon_joints, state, now)
    for j in range(tendon_joints.size):
        for i in range(tendon_joints[j]):
            torque = now.tension[i, j] * now.lever[i, j] - state.tension[j] * state.gap[i, j, 1]
            state.residual[i] = state.residual[i] + torque


@part(inline=True)
def _freeze(tendon_joints, rubbed, accepted):
    """Keep the grips of the lanes that begin another line search."""
    now = rubbed.now
    for j in range(tendon_joints.size):
        for k in range(tendon_joints[j]):
            now.frozen[k, j] = where(accepted, now.grips[k, j], now.frozen[k, j])


@part(inline=True)
def _fill_jacobian(tendon_joints, rubbed, held, A, own_rate, flat):
    """Fill A = dr/dphi; the row and column of a held joint are the identity's.

    own_rate, flat: scratch space, (J,).
    """
    block, now = rubbed.block, rubbed.now
    state, free = block.state, block.vectors[5]
    gap, n_joints = state.gap, free.size
    for i in range(n_joints):
        lever = formulas.fill_row_of_loads(block, i, A)
        term, less = formulas.own_terms(block, i)
        A[i, i] = lever + (term - less)
        for m in range(i):
            A[m, i] = A[i, m]
    for j in range(tendon_joints.size):
        for i in range(tendon_joints[j]):
            rate, lever, carried = gap[i, j, 1], now.lever[i, j], now.carried[i, j]
            stretch, bent = lever * (state.elastic[j] * now.passed[i, j]), lever * carried
            total = stretch + bent * now.give[i, j] + lever * now.flat[i, j]
            for m in range(i):
                A[i, m] += stretch * gap[m, j, 1] + bent * own_rate[m] + lever * flat[m]
            A[i, i] += total * rate - bent * now.bend[i, j, 0] + now.tension[i, j] * gap[i, j, 2]
            for m in range(i + 1, tendon_joints[j]):
                A[i, m] += total * gap[m, j, 1]
            own_rate[i], flat[i] = now.give[i, j] * rate - now.bend[i, j, 1], now.flat[i, j] * rate
    if any_lane(held > 0.0):
        for i in range(n_joints):
            for m in range(n_joints):
                present = (free[i] > 0.0) & (free[m] > 0.0)
                A[i, m] = where(present, A[i, m], 1.0 if i == m else 0.0)


@part(inline=True)
def _smallest_pivot(A, S):
    """Smallest pivot of the symmetric part of A; S: memory for its factor S D Sᵀ."""
    smallest = 0.0 * A[0, 0] + np.inf
    for i in range(A.shape[0]):
        pivot = A[i, i]
        for m in range(i):
            value = 0.5 * (A[i, m] + A[m, i])
            for k in range(m):
                value = value - S[i, k] * S[m, k]
            S[i, m] = value
        for m in range(i):
            scaled = S[i, m] / S[m, m]
            pivot = pivot - S[i, m] * scaled
            S[i, m] = scaled
        S[i, i] = pivot
        smallest = where(pivot < smallest, pivot, smallest)
    return smallest


@part(inline=True)
def _factor(A, largest, per_pivot):
    """Factor A = L R in place, the diagonal of L ones; pivots that are not positive become the largest entry."""
    n_joints = per_pivot.size
    for i in range(n_joints):
        for k in range(i):
            scaled = A[i, k] * per_pivot[k]
            A[i, k] = scaled
            for m in range(k + 1, n_joints):
                A[i, m] = A[i, m] - scaled * A[k, m]
        pivot = A[i, i]
        per_pivot[i] = 1.0 / where(pivot > SMALLEST_PIVOT * largest, pivot, largest)


@part(inline=True)
def substitute(A, per_pivot, residual, free, step):
    """Solve L R step = -residual on the free joints; zero elsewhere. May be done in place."""
    n_joints = step.size
    for i in range(n_joints):
        value = -residual[i] * free[i]
        for m in range(i):
            value = value - A[i, m] * step[m]
        step[i] = value
    for i in range(n_joints - 1, -1, -1):
        value = step[i]
        for m in range(i + 1, n_joints):
            value = value - A[i, m] * step[m]
        step[i] = value * per_pivot[i]


def advance_with_friction(rubbed, chain, designs):
    """One evaluation of all lanes, then another Newton step, a shorter one, or the end; True where a lane has ended."""
    block, now, coefficients, tendon_joints = rubbed.block, rubbed.now, rubbed.law.tendons, chain.tendon_joints
    search, angle, residual = block.search, block.state.angle, block.state.residual
    solution, per_pivot = block.vectors[0], block.vectors[2]
    base_angle, base_residual, free = block.vectors[3], block.vectors[4], block.vectors[5]
    potential, magnitude, scale = formulas.evaluate_lanes(block, chain, designs)
    _add_friction(tendon_joints, rubbed)
    term, size, present, work = evaluated_energy(coefficients, rubbed.before, tendon_joints, now)
    rubbed.work[0] = work
    energy, magnitude = potential + term, magnitude + size
    worst, held = hold_ends(block)
    zero = 0.0 * worst
    slope, new_slope = zero, zero
    for i in range(angle.size):
        way = angle[i] - base_angle[i]
        slope, new_slope = slope + base_residual[i] * way, new_slope + residual[i] * way

    running = search[PHASE] == RUNNING
    noise, fall = ROUNDING * (search[MAGNITUDE] + magnitude), search[ENERGY] - energy
    short = (search[STEPS] < 0.0) | ~overshoots_kink(slope, new_slope)
    descent = (fall > noise) & (fall >= -1e-4 * slope) & short
    accepted = running & (descent | ((fall >= -noise) & (worst < search[WORST])))
    goal = RELATIVE_GOAL * scale
    goal = where(goal < RESIDUAL_GOAL, goal, RESIDUAL_GOAL)
    at_rest = accepted & (worst <= where(goal > RESIDUAL_FLOOR, goal, RESIDUAL_FLOOR))
    _freeze(tendon_joints, rubbed, accepted)
    _fill_jacobian(tendon_joints, rubbed, held, block.L, solution, per_pivot)
    largest = zero
    for i in range(angle.size):
        size = where(free[i] > 0.0, abs(block.L[i, i]), 0.0)
        largest = where(size > largest, size, largest)
    firm = at_rest
    if any_lane(at_rest):
        firm = at_rest & (_smallest_pivot(block.L, rubbed.symmetric) > SMALLEST_PIVOT * largest)
    _factor(block.L, largest, per_pivot)
    share, passes = keep(search, accepted, potential + present, magnitude, worst, held)
    substitute(block.L, per_pivot, residual, free, solution)
    downhill = zero
    for i in range(angle.size):
        downhill = downhill - residual[i] * solution[i]
    goes_on = running & ((downhill > 0.0) | ~accepted) & (share >= _SHORTEST) & (passes < _MAX_PASSES)
    move(block, accepted, share, running & ~at_rest)
    ongoing = where(goes_on, RUNNING, LEFT)
    arrived = where(firm & (largest >= NEGLIGIBLE), ARRIVED, LEFT)
    search[PHASE] = where(running, where(at_rest, arrived, ongoing), search[PHASE])
    return any_lane(running & (at_rest | ~goes_on))


@part(inline=True)
def fill_responses_with_friction(rubbed, tendon_joints):
    """Fill d angle / d command, where the Jacobian has just been factored."""
    block, now = rubbed.block, rubbed.now
    elastic, responses = block.state.elastic, block.responses
    for j in range(elastic.size):
        for i in range(block.state.angle.size):
            crossing = i < tendon_joints[j]
            responses[j, i] = -(elastic[j] * now.lever[i, j] * now.passed[i, j]) if crossing else 0.0 * elastic[j]
        substitute(block.L, block.vectors[2], responses[j], block.vectors[5], responses[j])


@part(inline=True)
def store_history(rubbed, friction, lane, row):
    """Copy the history of a lane that has arrived into its row."""
    now, after, angle = rubbed.now, friction.after, numbers(rubbed.block.state.angle)
    states, slips, grips, tension = numbers(now.states), numbers(now.slips), numbers(now.grips), numbers(now.tension)
    for i in range(states.shape[0]):
        after.angles[row, i], after.rolling[row, i] = angle[i, lane], friction.before.rolling[row, i]
        for j in range(states.shape[1]):
            after.states[row, i, j], after.slips[row, i, j] = states[i, j, lane], slips[i, j, lane]
            after.grips[row, i, j], friction.tension[row, i, j] = grips[i, j, lane], tension[i, j, lane]
    friction.work[row] = numbers(rubbed.work)[0, lane]


def inner_search(rubbed):
    """`search_of` a block with friction."""
    return rubbed.block.search
