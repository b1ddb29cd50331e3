"""Turns of the tendons at the holes of the beads, by which friction divides their tension.

A tendon runs along the z axis of every bead and straight from bead to bead; docs/theory.md, section 8.
"""

from __future__ import annotations

import math

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import part
from rollingjoint.kernels.shared import formulas
from rollingjoint.kernels.shared.formulas import formula
from rollingjoint.kernels.spatial.arrays import IN_ABOVE, IN_BELOW, Hinges


@formula(formulas.fill_turns, Hinges)
def fill_turns(chain, state, turn):
    """Fill turn[i, j] with the turns at the hole below hinge i and at the hole above it, each with its slope."""
    table, angle, turn = borrow(chain.turns), borrow(state.angle), borrow(turn)
    for i in range(angle.size):
        sin, versine = math.sin(angle[i]), 2.0 * math.sin(0.5 * angle[i]) ** 2
        for j in range(chain.tendon_joints.size):
            if i < chain.tendon_joints[j]:
                turn[i, j, 0], turn[i, j, 1] = _turn_from_z(table, i, j, IN_BELOW, sin, versine)
                turn[i, j, 2], turn[i, j, 3] = _turn_from_z(table, i, j, IN_ABOVE, sin, versine)


@part(inline=True)
def _turn_from_z(table, i, j, frame, sin, versine):
    """Angle between the z axis of a link and the segment, and its slope; 0 where the segment has no side to turn to."""
    cos = 1.0 - versine
    x = table[i, j, 0] + sin * table[i, j, frame] + versine * table[i, j, frame + 3]
    y = table[i, j, 1] + sin * table[i, j, frame + 1] + versine * table[i, j, frame + 4]
    z = table[i, j, 2] + sin * table[i, j, frame + 2] + versine * table[i, j, frame + 5]
    dx = cos * table[i, j, frame] + sin * table[i, j, frame + 3]
    dy = cos * table[i, j, frame + 1] + sin * table[i, j, frame + 4]
    dz = cos * table[i, j, frame + 2] + sin * table[i, j, frame + 5]
    side = math.sqrt(x * x + y * y)
    if side == 0.0:
        return math.atan2(side, z), 0.0
    slope = (z * (x * dx + y * dy) / side - side * dz) / (side * side + z * z)
    return math.atan2(side, z), slope
