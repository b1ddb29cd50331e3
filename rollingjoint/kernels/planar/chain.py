"""A planar chain at one configuration: poses, tendon lengths, residual, contact forces.

Symbols as in docs/theory.md: c contact point, F external force. All but the joints' tables serves floats and lanes.
"""

from __future__ import annotations

import math

from rollingjoint._numba.jit import part
from rollingjoint._numba.simd import where
from rollingjoint.kernels.planar.arrays import (
    COS,
    CX,
    CY,
    FX,
    FY,
    GX,
    GY,
    PX,
    PY,
    SIN,
    THETA,
    TURN,
    C,
    Chain,
    S,
    State,
    X,
    Y,
)
from rollingjoint.kernels.planar.joint import evaluate_gap, evaluate_joints
from rollingjoint.kernels.shared import formulas
from rollingjoint.kernels.shared.chain import register
from rollingjoint.kernels.shared.formulas import formula
from rollingjoint.kernels.shared.tendons import fill_residual


@formula(formulas.evaluate_geometry, Chain)
def evaluate_geometry(chain, state):
    """Fill joints, gaps, tendon lengths, poses and contacts."""
    evaluate_joints(chain, state)
    evaluate_poses(chain.holes, chain.channels, chain.tendon_joints, state)


@part(inline=True)
def evaluate_poses(holes, channels, tendon_joints, state):
    """Fill gaps, tendon lengths, poses and contacts from state.joint."""
    pose, joint, contact, angle = state.pose, state.joint, state.contact, state.angle
    gap, length = state.gap, state.length
    for j in range(length.size):
        length[j] = channels[j]
    zero = 0.0 * angle[0]
    x, y, theta, cos, sin = zero, zero, zero, zero + 1.0, zero
    pose[0, X], pose[0, Y], pose[0, THETA], pose[0, C], pose[0, S] = x, y, theta, cos, sin
    for i in range(angle.size):
        for j in range(length.size):
            if i < tendon_joints[j]:
                evaluate_gap(holes, i, j, joint, gap)
                length[j] += gap[i, j, 0]
        contact[i, 0] = x + cos * joint[i, CX] - sin * joint[i, CY]
        contact[i, 1] = y + sin * joint[i, CX] + cos * joint[i, CY]
        contact[i, 2] = cos * joint[i, PX] - sin * joint[i, PY]
        contact[i, 3] = sin * joint[i, PX] + cos * joint[i, PY]
        x, y = x + cos * joint[i, GX] - sin * joint[i, GY], y + sin * joint[i, GX] + cos * joint[i, GY]
        cos, sin = cos * joint[i, COS] - sin * joint[i, SIN], sin * joint[i, COS] + cos * joint[i, SIN]
        theta = theta + angle[i]
        pose[i + 1, X], pose[i + 1, Y], pose[i + 1, THETA], pose[i + 1, C], pose[i + 1, S] = x, y, theta, cos, sin


@part(inline=True)
def evaluate_residual(tendon_joints, state):
    """Fill r; returns the largest sum of its terms' magnitudes, every tension with a lever of at least 1 mm."""
    sums, contact = state.sums, state.contact
    scale = 0.0 * state.angle[0]
    for i in range(state.residual.size):
        moment = sums[i, TURN] - (contact[i, 0] * sums[i, FY] - contact[i, 1] * sums[i, FX])
        size = fill_residual(tendon_joints, state, i, 0.0, moment)
        scale = where(size > scale, size, scale)
    return scale


@formula(formulas.evaluate_residual, Chain)
def residual_of(chain, state):
    """`evaluate_residual` of a chain."""
    return evaluate_residual(chain.tendon_joints, state)


@formula(formulas.torque, State)
def torque(state, i, j):
    """g'."""
    return state.gap[i, j, 1]


@formula(formulas.own_stiffness, Chain)
def moving_contact(chain, state, i):
    """The contact of a joint moves as it turns, and with it the lever of what acts beyond it."""
    return state.contact[i, 2] * state.sums[i, FY] - state.contact[i, 3] * state.sums[i, FX]


register(Chain)


@part(inline=True)
def contact_forces(tendon_joints, state, tension, i):
    """Contact force on the distal link of joint i along tangent and normal; the unit tangent in the world, x and y.

    tension: of every tendon in the gap, (m,).
    """
    cos, sin = state.pose[i, C], state.pose[i, S]
    fx, fy = -state.sums[i, FX], -state.sums[i, FY]
    for j in range(tendon_joints.size):
        if i < tendon_joints[j]:
            vx, vy = state.gap[i, j, 3], state.gap[i, j, 4]
            fx = fx + tension[j] * (cos * vx - sin * vy)
            fy = fy + tension[j] * (sin * vx + cos * vy)
    rx, ry = state.contact[i, 2], state.contact[i, 3]  # against the tangent: the angle falls as s grows
    per_length = -1.0 / math.sqrt(rx * rx + ry * ry)
    ex, ey = rx * per_length, ry * per_length
    return fx * ex + fy * ey, fy * ex - fx * ey, ex, ey
