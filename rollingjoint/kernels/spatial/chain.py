"""A spatial hinge chain at one configuration: poses, tendons, energy, residual, stiffness.

Symbols as in docs/theory.md, section 8: a axis, c hinge, r = dV/dtheta (residual), H = dr/dtheta (stiffness).
What does not depend on loads serves floats and lanes alike; lanes.py shares it.
"""

from __future__ import annotations

import math

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import part
from rollingjoint._numba.simd import where
from rollingjoint.kernels.shared import formulas
from rollingjoint.kernels.shared.elementary import sine_and_cosine
from rollingjoint.kernels.shared.formulas import formula
from rollingjoint.kernels.shared.long_chain import symmetric_direction, unchanged, unlimited
from rollingjoint.kernels.shared.newton import reclassified
from rollingjoint.kernels.shared.tendons import evaluate_tendons, fill_residual
from rollingjoint.kernels.shared.vectors import dot, in_space, plus, times
from rollingjoint.kernels.spatial.arrays import END_COUPLE, EXACT, PX, Hinges, K
from rollingjoint.kernels.spatial.loads import (
    add_loads_without_potential,
    add_springs,
    evaluate_loads,
    fill_spring_generators,
    lever,
    load_moment,
    turned,
)


@formula(formulas.evaluate, Hinges)
def evaluate(chain, law, loads, state):
    """Fill the state at its angles; returns (potential energy, magnitude of its terms, force scale).

    Moments, follower loads and end couples have no potential and are left out of the energy.
    """
    state, loads = borrow(state), borrow(loads)
    exact = chain.model == EXACT
    evaluate_geometry(chain.axes, chain.spacings, chain.gaps, chain.channels, exact, chain.tendon_joints, state)
    energy, magnitude = evaluate_tendons(law, state)
    load_energy, load_magnitude = evaluate_loads(chain, loads, state)
    spring_energy = evaluate_hinges(chain.joints, chain.springs, state)
    magnitude = magnitude + (load_magnitude + spring_energy)
    return energy + (load_energy + spring_energy), magnitude, _evaluate_residual(chain, state)


@part(inline=True)
def evaluate_hinges(joints, springs, state):
    """Energy of the hinges' own springs."""
    energy = 0.0 * state.angle[0]
    for i in range(state.angle.size):
        turn = state.angle[i] - joints[i, 2]
        energy = energy + 0.5 * springs[i] * (turn * turn)
    return energy


@part(inline=True)
def evaluate_geometry(axes, spacings, gaps, channels, exact, tendon_joints, state):
    """Fill poses, axes, gaps, torques and tendon lengths; the arrays are those of Hinges, or of lanes."""
    pose, axis, angle, length = state.pose, state.axis, state.angle, state.length
    zero = 0.0 * angle[0]
    for j in range(length.size):
        length[j] = channels[j]
    for entry in range(12):
        pose[0, entry] = zero + 1.0 if entry == 0 or entry == 4 or entry == 8 else zero
    for i in range(angle.size):
        sin, cos = sine_and_cosine(angle[i])
        x, y, z = in_space(axes, i, 0)
        axis[i, 0], axis[i, 1], axis[i, 2] = turned(pose, i, (x, y, z))
        rest = 1.0 - cos
        columns = (
            (cos + rest * x * x, rest * x * y + sin * z, rest * x * z - sin * y),
            (rest * x * y - sin * z, cos + rest * y * y, rest * y * z + sin * x),
            (rest * x * z + sin * y, rest * y * z - sin * x, cos + rest * z * z),
        )
        for column in range(3):
            turned_column = turned(pose, i, columns[column])
            for row in range(3):
                pose[i + 1, 3 * row + column] = turned_column[row]
        origin = plus(in_space(pose, i, PX), times(turned(pose, i, columns[2]), spacings[i]))
        pose[i + 1, PX], pose[i + 1, PX + 1], pose[i + 1, PX + 2] = origin
        for j in range(length.size):
            if i < tendon_joints[j]:
                _evaluate_gap(gaps, exact, state, i, j, sin, cos)
                length[j] += state.gap[i, j, 0]


@part(inline=True)
def _evaluate_gap(gaps, exact, state, i, j, sin, cos):
    """Fill length, rates and torque of a gap: gap² = G - 2 (B cos + C sin), or linear in the angle."""
    gap = state.gap
    if exact:
        b, c = gaps[i, j, 1], gaps[i, j, 2]
        along = b * cos + c * sin
        square = gaps[i, j, 0] - 2.0 * along
        gap[i, j, 0] = math.sqrt(where(square > 0.0, square, 0.0))
        inverse = 1.0 / gap[i, j, 0]
        gap[i, j, 1] = (b * sin - c * cos) * inverse
        gap[i, j, 2] = (along - gap[i, j, 1] * gap[i, j, 1]) * inverse
    else:
        gap[i, j, 1], gap[i, j, 2] = gaps[i, j, 4], 0.0 * state.angle[i]
        gap[i, j, 0] = gaps[i, j, 3] + gap[i, j, 1] * state.angle[i]
    state.torque[i, j] = gap[i, j, 1]


@part(inline=True)
def _evaluate_residual(chain, state):
    """Fill r; returns the largest sum of its terms' magnitudes, every tension with a lever of at least 1 mm."""
    scale = 0.0
    for i in range(state.angle.size):
        moment = dot(in_space(state.axis, i, 0), load_moment(state, i))
        spring = chain.springs[i] * (state.angle[i] - chain.joints[i, 2])
        size = fill_residual(chain.tendon_joints, state, i, spring, moment)
        if chain.model == END_COUPLE:  # they are among the loads
            state.residual[i], size = spring - moment, abs(spring) + abs(moment)
            for j in range(state.tension.size):
                if i < chain.tendon_joints[j]:
                    size += max(abs(state.tension[j] * state.torque[i, j]), state.tension[j])
        scale = max(scale, size)
    return scale


@part(inline=True)
def own_stiffness(chain, state, i):
    """What hinge i has alone: its spring and its gaps."""
    value = chain.springs[i]
    for j in range(state.tension.size):
        if i < chain.tendon_joints[j]:
            value += state.tension[j] * state.gap[i, j, 2]
    return value


@formula(formulas.stiffness, Hinges)
def stiffness(chain, loads, state, H):
    """Fill H = dr/dtheta, (J, J); symmetric where everything has a potential."""
    state, H = borrow(state), borrow(H)
    axis, elastic = state.axis, state.elastic
    for i in range(state.angle.size):
        w = lever(state, i)
        for m in range(i + 1):
            H[i, m] = -dot(in_space(axis, m, 0), w)
            H[m, i] = H[i, m]
        H[i, i] += own_stiffness(chain, state, i)
    for j in range(elastic.size):
        if elastic[j] != 0.0:
            for i in range(chain.tendon_joints[j]):
                along = elastic[j] * state.torque[i, j]
                for m in range(chain.tendon_joints[j]):
                    H[i, m] += along * state.gap[m, j, 1]
    if state.held[0, K] != 0.0:
        add_springs(state, H)
    add_loads_without_potential(state, H)


formula(formulas.direction, Hinges)(symmetric_direction)
formula(formulas.renew, Hinges)(unchanged)
formula(formulas.overshoots, Hinges)(unlimited)
formula(formulas.reconsider, Hinges)(reclassified)


@formula(formulas.first_tendon_column, Hinges)
def first_tendon_column(chain, columns):
    """The tendons follow the three columns of the forces in fill_generators."""
    return 3


@formula(formulas.fill_generators, Hinges)
def fill_generators(chain, loads, state, prox, sweep):
    """Fill diagonal, U and V of a Sweep (long_chain.py) with H = U_i . V_m for i > m; prox is added to the diagonal."""
    state = borrow(state)
    n_tendons = state.tension.size
    for i in range(state.angle.size):
        w = lever(state, i)
        diagonal = prox + own_stiffness(chain, state, i)
        for a in range(3):
            sweep.U[i, a], sweep.V[i, a] = -w[a], state.axis[i, a]
            diagonal -= w[a] * state.axis[i, a]
        for j in range(n_tendons):
            rate = state.gap[i, j, 1] if i < chain.tendon_joints[j] else 0.0
            sweep.U[i, 3 + j], sweep.V[i, 3 + j] = state.elastic[j] * rate, rate
            diagonal += state.elastic[j] * rate * rate
        sweep.diagonal[i] = diagonal
    if sweep.U.shape[1] > 3 + n_tendons:
        fill_spring_generators(state, sweep, 3 + n_tendons)
