"""What friction needs of an arm: how far tendons turn at the holes of the beads.

A tendon runs along the z axis of every bead and straight from bead to bead; docs/theory.md, section 8.
"""

from __future__ import annotations

import math

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import part
from rollingjoint.kernels.shared import formulas
from rollingjoint.kernels.shared.formulas import formula
from rollingjoint.kernels.shared.friction import ABOVE_RATE, BELOW_RATE, TURN
from rollingjoint.kernels.spatial.arrays import HALVES, IN_ABOVE, IN_BELOW, Hinges


@formula(formulas.fill_turns, Hinges)
def fill_turns(chain, state, turn):
    """Fill turns and their rates (shared.friction.Rubbing.turn)."""
    table, angle, turn = borrow(chain.turns), borrow(state.angle), borrow(turn)
    for j in range(chain.tendon_joints.size):
        entry = 0.0
        for i in range(chain.tendon_joints[j]):
            half = 0.5 * abs(angle[i])
            if table[i, j, HALVES] > 0.0:
                slope = math.copysign(0.5, angle[i]) if angle[i] != 0.0 else 0.0
                turn[i, j, TURN], entry = entry + half, half
                turn[i, j, BELOW_RATE] = turn[i, j, ABOVE_RATE] = slope
            else:
                sin, versine = math.sin(angle[i]), 2.0 * math.sin(half) ** 2
                below, turn[i, j, BELOW_RATE] = _turn_from_z(table, i, j, IN_BELOW, sin, versine)
                turn[i, j, TURN] = entry + below
                entry, turn[i, j, ABOVE_RATE] = _turn_from_z(table, i, j, IN_ABOVE, sin, versine)


@part(inline=True)
def _turn_from_z(table, i, j, frame, sin, versine):
    """Angle between a link's z axis and the segment, and its rate; the rate is 0 where the segment continues z."""
    cos = 1.0 - versine
    x = table[i, j, 0] + sin * table[i, j, frame] + versine * table[i, j, frame + 3]
    y = table[i, j, 1] + sin * table[i, j, frame + 1] + versine * table[i, j, frame + 4]
    z = table[i, j, 2] + sin * table[i, j, frame + 2] + versine * table[i, j, frame + 5]
    dx = cos * table[i, j, frame] + sin * table[i, j, frame + 3]
    dy = cos * table[i, j, frame + 1] + sin * table[i, j, frame + 4]
    dz = cos * table[i, j, frame + 2] + sin * table[i, j, frame + 5]
    side = math.sqrt(x * x + y * y)
    if side == 0.0:
        return 0.0, 0.0
    return math.atan2(side, z), (z * (x * dx + y * dy) / side - side * dz) / (side * side + z * z)


@formula(formulas.fill_normals, Hinges)
def fill_normals(chain, state, rolling):
    """Nothing presses the beads on each other, so hinges have no rolling resistance."""
    for i in range(state.angle.size):
        rolling.of_loads[i] = 0.0
        for j in range(state.tension.size):
            rolling.per_tension[i, j] = 0.0
