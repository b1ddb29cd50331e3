"""A spatial hinge chain at one configuration: poses, tendon lengths, residual.

Symbols as in docs/theory.md, section 8: a axis, c hinge, r = dV/dtheta (residual), H = dr/dtheta (stiffness).
What does not depend on loads serves floats and lanes alike; lanes.py shares it.
"""

from __future__ import annotations

import math

from rollingjoint._numba.jit import part
from rollingjoint._numba.simd import where
from rollingjoint.kernels.shared import formulas
from rollingjoint.kernels.shared.chain import register
from rollingjoint.kernels.shared.elementary import sine_and_cosine
from rollingjoint.kernels.shared.formulas import formula
from rollingjoint.kernels.shared.tendons import fill_residual
from rollingjoint.kernels.shared.vectors import dot, in_space, plus, times
from rollingjoint.kernels.spatial.arrays import END_COUPLE, EXACT, PX, Hinges, HingeState
from rollingjoint.kernels.spatial.loads import evaluate_table, load_moment, turned


@formula(formulas.evaluate_geometry, Hinges)
def geometry_of(chain, state):
    """`evaluate_geometry` of a chain."""
    exact = chain.model == EXACT
    evaluate_geometry(chain.axes, chain.spacings, chain.gaps, chain.channels, exact, chain.tendon_joints, state)


@formula(formulas.evaluate_loads, Hinges)
def evaluate_loads(chain, loads, state):
    """Fill the sums of loads beyond each hinge; returns (energy, magnitude of its terms), the hinges' springs included.

    Moments, follower loads and end couples have no potential and are left out of the energy.
    """
    energy, magnitude = evaluate_table(chain, loads, state)
    springs = evaluate_hinges(chain.joints, chain.springs, state)
    return energy + springs, magnitude + springs


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


@formula(formulas.evaluate_residual, Hinges)
def evaluate_residual(chain, state):
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


@formula(formulas.torque, HingeState)
def torque(state, i, j):
    """g', but of end couples."""
    return state.torque[i, j]


@formula(formulas.own_stiffness, Hinges)
def own_stiffness(chain, state, i):
    """The spring of a hinge."""
    return chain.springs[i]


register(Hinges)
