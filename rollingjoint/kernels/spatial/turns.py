"""What friction needs of an arm: how far tendons turn at the holes of the beads.

A tendon runs along the z axis of every bead and straight from bead to bead; docs/theory.md, section 8.
"""

from __future__ import annotations

import math

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import part
from rollingjoint._numba.simd import where
from rollingjoint.kernels.shared import formulas
from rollingjoint.kernels.shared.elementary import angle_and_inverse, sine_and_cosine
from rollingjoint.kernels.shared.formulas import formula
from rollingjoint.kernels.shared.friction import ABOVE_RATE, BELOW_RATE, TURN
from rollingjoint.kernels.shared.vectors import plus, times
from rollingjoint.kernels.spatial.arrays import HALVES, IN_ABOVE, IN_BELOW, Hinges


@part(inline=True)
def evaluate_turns(table, tendon_joints, state, turn):
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
def fill_turns(chain, state, turn):
    """Fill turns and their rates (shared.friction.Rubbing.turn)."""
    evaluate_turns(borrow(chain.turns), chain.tendon_joints, borrow(state), borrow(turn))


@formula(formulas.fill_normals, Hinges)
def fill_normals(chain, state, rolling):
    """Nothing presses the beads on each other, so hinges have no rolling resistance."""
    for i in range(state.angle.size):
        rolling.of_loads[i] = 0.0
        for j in range(state.tension.size):
            rolling.per_tension[i, j] = 0.0
