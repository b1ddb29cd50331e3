"""What friction needs of a planar chain: how far tendons turn at their holes, and what presses the links together."""

from __future__ import annotations

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import part
from rollingjoint._numba.simd import where
from rollingjoint.kernels.planar.arrays import COS, CX, CY, FX, FY, SIN, C, Chain, S
from rollingjoint.kernels.planar.chain import contact_forces
from rollingjoint.kernels.planar.joint import CLOSED_GAP
from rollingjoint.kernels.shared import formulas
from rollingjoint.kernels.shared.elementary import angle_and_inverse
from rollingjoint.kernels.shared.formulas import formula
from rollingjoint.kernels.shared.friction import ABOVE_RATE, BELOW_RATE, TURN


@part(inline=True)
def evaluate_turns(holes, directions, tendon_joints, state, turn):
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
def fill_turns(chain, state, turn):
    """Fill turns and their rates (shared.friction.Rubbing.turn)."""
    chain = borrow(chain)
    evaluate_turns(chain.holes, chain.directions, chain.tendon_joints, state, turn)


@formula(formulas.fill_normals, Chain)
def fill_normals(chain, state, rolling):
    """Fill normal force per tension, and that of the loads."""
    for i in range(state.angle.size):
        _, _, ex, ey = contact_forces(chain.tendon_joints, state, state.tension, i)
        rolling.of_loads[i] = state.sums[i, FX] * ey - state.sums[i, FY] * ex
        cos, sin = state.pose[i, C], state.pose[i, S]
        for j in range(state.tension.size):
            vx, vy = state.gap[i, j, 3], state.gap[i, j, 4]
            rolling.per_tension[i, j] = (sin * vx + cos * vy) * ex - (cos * vx - sin * vy) * ey
