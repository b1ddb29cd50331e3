"""Turns of the tendons at their holes, and the forces that press links together: the inputs of friction.

In a rolling link, a tendon runs straight from hole to hole; in a bead of an arm, along its z axis (docs/theory.md,
section 8). In the plane a turn has a sign; in space it is an angle between two directions.
"""

from __future__ import annotations

import math

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import part
from rollingjoint._numba.simd import where
from rollingjoint.kernels import formulas
from rollingjoint.kernels.contacts import ContactJoints, load_force, tangent
from rollingjoint.kernels.elementary import angle_and_inverse, sine_and_cosine
from rollingjoint.kernels.formulas import formula
from rollingjoint.kernels.friction import ABOVE_RATE, BELOW_RATE, TURN
from rollingjoint.kernels.hinges import HALVES, IN_ABOVE, IN_BELOW, Hinges
from rollingjoint.kernels.joints import CLOSED_GAP, COS, CX, CY, SIN
from rollingjoint.kernels.rolling import FX, FY, C, Chain, S, contact_forces
from rollingjoint.kernels.vectors import about, dot, in_space, minus, plus, times


@part(inline=True)
def evaluate_rolling_turns(holes, directions, tendon_joints, state, turn):
    """Fill turns and their rates from the gaps; where a gap is closed, its direction does not change.

    The turns at both holes of a link are added as vectors, so that one angle is taken of the two.
    """
    gap, joint = state.gap, state.joint
    for j in range(tendon_joints.size):
        entry_sine = 0.0 * state.angle[0]
        entry_cosine = entry_sine + 1.0
        for i in range(tendon_joints[j]):
            vx, vy, length = gap[i, j, 3], gap[i, j, 4], gap[i, j, 0]
            jrx = -(holes[i, j, 1] + length * vy - joint[i, CY])
            jry = holes[i, j, 0] + length * vx - joint[i, CX]
            closed = length <= CLOSED_GAP
            dx, dy = directions[i, j, 0], directions[i, j, 1]
            below, below_cosine = dx * vy - dy * vx, dx * vx + dy * vy
            side = abs(below)
            sine, cosine = (
                side * entry_cosine + below_cosine * entry_sine,
                below_cosine * entry_cosine - side * entry_sine,
            )
            turn[i, j, TURN], per_length = angle_and_inverse(sine, cosine, where(closed, 1.0, length))
            rate = where(closed, 0.0, (vx * jry - vy * jrx) * per_length)
            ex, ey = directions[i, j, 2], directions[i, j, 3]
            fx, fy = joint[i, COS] * ex - joint[i, SIN] * ey, joint[i, SIN] * ex + joint[i, COS] * ey
            above, entry_cosine = vx * fy - vy * fx, vx * fx + vy * fy
            entry_sine = abs(above)
            turn[i, j, BELOW_RATE] = where(below < 0.0, -rate, rate)
            turn[i, j, ABOVE_RATE] = where(above < 0.0, rate - 1.0, 1.0 - rate)


@formula(formulas.fill_turns, Chain)
def fill_rolling_turns(chain, state, turn):
    """Fill turns and their rates (friction.Rubbing.turn)."""
    chain = borrow(chain)
    evaluate_rolling_turns(chain.holes, chain.directions, chain.tendon_joints, state, turn)


@formula(formulas.fill_normals, Chain)
def fill_rolling_normals(chain, state, rolling):
    """Fill the normal force per tension, and the normal force of the loads."""
    for i in range(state.angle.size):
        _, _, ex, ey = contact_forces(chain.tendon_joints, state, state.tension, i)
        rolling.of_loads[i] = state.sums[i, FX] * ey - state.sums[i, FY] * ex
        cos, sin = state.pose[i, C], state.pose[i, S]
        for j in range(state.tension.size):
            vx, vy = state.gap[i, j, 3], state.gap[i, j, 4]
            rolling.per_tension[i, j] = (sin * vx + cos * vy) * ex - (cos * vx - sin * vy) * ey


@part(inline=True)
def evaluate_hinge_turns(table, tendon_joints, state, turn):
    """Fill turns and their rates; table: Hinges.turns, or of lanes."""
    angle = state.angle
    zero = 0.0 * angle[0]
    for j in range(tendon_joints.size):
        entry = zero
        for i in range(tendon_joints[j]):
            half = 0.5 * angle[i]
            sin, _ = sine_and_cosine(angle[i])
            sin_half, _ = sine_and_cosine(half)
            versine = 2.0 * (sin_half * sin_half)
            below, below_rate = _turn_from_z(table[i, j], IN_BELOW, sin, versine)
            above, above_rate = _turn_from_z(table[i, j], IN_ABOVE, sin, versine)
            in_line = table[i, j, HALVES] > 0.0
            slope = where(half > 0.0, 0.5, where(half < 0.0, zero - 0.5, zero))
            turn[i, j, TURN] = entry + where(in_line, abs(half), below)
            turn[i, j, BELOW_RATE] = where(in_line, slope, below_rate)
            turn[i, j, ABOVE_RATE] = where(in_line, slope, above_rate)
            entry = where(in_line, abs(half), above)


@part(inline=True)
def _turn_from_z(row, frame, sin, versine):
    """Angle between a link's z axis and the segment, and its rate; the rate is 0 where the segment continues z."""
    cos = 1.0 - versine
    per_sin, per_versine = _three(row, frame), _three(row, frame + 3)
    x, y, z = plus(plus(_three(row, 0), times(per_sin, sin)), times(per_versine, versine))
    dx, dy, dz = plus(times(per_sin, cos), times(per_versine, sin))
    side = math.sqrt(x * x + y * y)
    aside = side > 0.0
    angle, per_side = angle_and_inverse(side, where(aside, z, 1.0), where(aside, side, 1.0))
    rate = (z * (x * dx + y * dy) * per_side - side * dz) / where(aside, side * side + z * z, 1.0)
    return where(aside, angle, 0.0 * side), where(aside, rate, 0.0 * side)


@part(inline=True)
def _three(row, first):
    return row[first], row[first + 1], row[first + 2]


@formula(formulas.fill_turns, Hinges)
def fill_hinge_turns(chain, state, turn):
    """Fill turns and their rates (friction.Rubbing.turn)."""
    evaluate_hinge_turns(borrow(chain.turns), chain.tendon_joints, borrow(state), borrow(turn))


@formula(formulas.fill_turns, ContactJoints)
def fill_contact_turns(chain, state, turn):
    """Fill turns and their rates; where a gap is closed, its direction does not change."""
    chain, state, turn = borrow(chain), borrow(state), borrow(turn)
    gap, joint = state.gap, state.joint
    for j in range(chain.tendon_joints.size):
        entry = 0.0
        for i in range(chain.tendon_joints[j]):
            length, direction = gap[i, j, 0], in_space(state.direction[i], j, 0)
            per_length = 0.0 if length <= CLOSED_GAP else 1.0 / length
            above = plus(in_space(chain.holes[i], j, 0), times(direction, length))
            rate = times((joint[i, CY] - above[1], above[0] - joint[i, CX], 0.0), per_length)
            below_channel, (ex, ey, ez) = in_space(chain.directions[i], j, 0), in_space(chain.directions[i], j, 3)
            cos, sin = joint[i, COS], joint[i, SIN]
            above_channel, axis = (cos * ex - sin * ey, sin * ex + cos * ey, ez), (0.0, 0.0, 1.0)
            below, turn[i, j, BELOW_RATE] = _turn_between(below_channel, direction, rate)
            turn[i, j, TURN] = entry + below
            entry, turn[i, j, ABOVE_RATE] = _turn_between(above_channel, direction, minus(rate, about(axis, direction)))


@part(inline=True)
def _turn_between(channel, direction, rate):
    """Angle between a channel and the unit direction of a segment, and its rate; 0 where they are in line."""
    across, along = about(channel, direction), dot(channel, direction)
    side = math.sqrt(dot(across, across))
    if side == 0.0:
        return 0.0, 0.0
    return math.atan2(side, along), along * dot(across, about(channel, rate)) / side - side * dot(channel, rate)


@formula(formulas.fill_normals, Hinges)
def fill_hinge_normals(chain, state, rolling):
    """Zeros: beads do not press on each other, so hinges have no rolling resistance."""
    for i in range(state.angle.size):
        rolling.of_loads[i] = 0.0
        for j in range(state.tension.size):
            rolling.per_tension[i, j] = 0.0


@formula(formulas.fill_normals, ContactJoints)
def fill_contact_normals(chain, state, rolling):
    """Fill the normal force per tension, and the normal force of the loads; zeros where links do not roll."""
    for i in range(state.angle.size):
        over_curvature = in_space(state.normal, i, 0)  # against the normal
        size = math.sqrt(dot(over_curvature, over_curvature))
        rolls = size > 0.0
        ex, ey = tangent(state.joint, i)
        rolling.of_loads[i] = dot(over_curvature, load_force(state, i)) / size if rolls else 0.0
        for j in range(state.tension.size):
            across = ex * state.direction[i, j, 1] - ey * state.direction[i, j, 0]
            rolling.per_tension[i, j] = across if rolls and i < chain.tendon_joints[j] else 0.0
