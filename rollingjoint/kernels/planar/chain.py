"""The whole chain at one configuration: poses, tendon lengths and tensions, energy, residual, stiffness.

Symbols as in docs/theory.md: r = U' - M (residual), H = dr/dphi (stiffness), c contact point, F external force.
What does not depend on loads serves floats and Lanes alike; side_by_side.py shares it.
"""

from __future__ import annotations

import math

from rollingjoint._numba.borrowed import borrow
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
    X,
    Y,
)
from rollingjoint.kernels.planar.joint import evaluate_gap, evaluate_joints
from rollingjoint.kernels.planar.loads import add_link_pairs, evaluate_loads, fill_load_generators, load_stiffness
from rollingjoint.kernels.shared import formulas
from rollingjoint.kernels.shared.formulas import formula
from rollingjoint.kernels.shared.long_chain import symmetric_direction, unchanged, unlimited
from rollingjoint.kernels.shared.newton import reclassified
from rollingjoint.kernels.shared.tendons import evaluate_tendons, fill_residual


@formula(formulas.evaluate, Chain)
def evaluate(chain, law, loads, state):
    """Fill the state at its angles; returns (potential energy, magnitude of its terms, force scale).

    Follower forces have no potential and are left out of the energy.
    """
    chain, law, loads, state = borrow(chain), borrow(law), borrow(loads), borrow(state)
    evaluate_joints(chain, state)
    evaluate_poses(chain.holes, chain.channels, chain.tendon_joints, state)
    energy, magnitude = evaluate_tendons(law, state)
    load_energy, load_magnitude = evaluate_loads(chain.standing, loads, state)
    scale = evaluate_residual(chain.tendon_joints, state)
    return energy + load_energy, magnitude + load_magnitude, scale


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


@formula(formulas.stiffness, Chain)
def stiffness(chain, loads, state, H):
    """Fill H = dr/dphi, (J, J); symmetric unless follower forces act."""
    standing, loads, tendon_joints = borrow(chain.standing), borrow(loads), borrow(chain.tendon_joints)
    state, H = borrow(state), borrow(H)
    n_joints, sums, contact = state.angle.size, state.sums, state.contact
    gap, elastic, tension = state.gap, state.elastic, state.tension
    for i in range(n_joints):
        for m in range(n_joints):
            b, value = max(i, m), load_stiffness(sums, contact, i, m)
            for j in range(elastic.size):
                if b < tendon_joints[j]:
                    value += elastic[j] * gap[i, j, 1] * gap[m, j, 1]
            H[i, m] = value
        H[i, i] += contact[i, 2] * sums[i, FY] - contact[i, 3] * sums[i, FX]
        for j in range(elastic.size):
            if i < tendon_joints[j]:
                H[i, i] += tension[j] * gap[i, j, 2]
    add_link_pairs(standing, loads, H)


@formula(formulas.fill_generators, Chain)
def fill_generators(chain, loads, state, prox, sweep):
    """Fill diagonal, U and V of a Sweep (long_chain.py) from the state; prox is added to the diagonal."""
    fill_load_generators(borrow(chain.standing), borrow(loads), state, prox, sweep)
    n_tendons = chain.tendon_joints.size
    first = sweep.U.shape[1] - n_tendons
    for i in range(state.angle.size):
        diagonal = sweep.diagonal[i]
        for j in range(n_tendons):
            rate = state.gap[i, j, 1] if i < chain.tendon_joints[j] else 0.0
            sweep.U[i, first + j], sweep.V[i, first + j] = state.elastic[j] * rate, rate
            if i < chain.tendon_joints[j]:
                diagonal += state.elastic[j] * rate * rate + state.tension[j] * state.gap[i, j, 2]
        sweep.diagonal[i] = diagonal


formula(formulas.direction, Chain)(symmetric_direction)
formula(formulas.renew, Chain)(unchanged)
formula(formulas.overshoots, Chain)(unlimited)
formula(formulas.reconsider, Chain)(reclassified)


@formula(formulas.first_tendon_column, Chain)
def first_tendon_column(chain, columns):
    """The tendons have the last columns of fill_generators."""
    return columns - chain.tendon_joints.size


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
