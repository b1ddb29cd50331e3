"""The whole chain at one configuration: poses, tendon lengths and tensions, energy, residual, stiffness.

Symbols as in docs/theory.md: r = U' - M (residual), H = dr/dphi (stiffness), c contact point, F external force.
"""

from __future__ import annotations

import math

from rollingjoint._jit import kernel
from rollingjoint._kernels.arrays import (
    ANGLE,
    BX,
    BY,
    COS,
    CX,
    CY,
    EX,
    EY,
    FX,
    FY,
    GX,
    GY,
    K_XX,
    KAPPA,
    KX,
    KY,
    MOMENT,
    SIN,
    THETA,
    X_CROSS_F,
    X_DOT_B,
    X_DOT_F,
    C,
    K,
    S,
    X,
    Y,
)
from rollingjoint._kernels.joint import evaluate_gap, evaluate_joint


@kernel
def evaluate(chain, law, loads, s, state):
    """Fill the state at arc lengths s; returns (potential energy, magnitude of its terms, force scale).

    Follower forces have no potential and are left out of the energy.
    """
    evaluate_kinematics(chain, s, state)
    energy, magnitude = _evaluate_tendons(law, state)
    load_energy, load_magnitude = _evaluate_loads(loads, state)
    scale = _evaluate_residual(chain, state)
    return energy + load_energy, magnitude + load_magnitude, scale


@kernel
def evaluate_kinematics(chain, s, state):
    """Fill what does not depend on tendon law and loads: joints, gaps, lengths, poses."""
    state.length[:] = chain.channels
    for i in range(s.size):
        evaluate_joint(chain, i, s[i], state.joint[i])
        for j in range(chain.tendon_joints.size):
            if i < chain.tendon_joints[j]:
                evaluate_gap(state.joint[i], chain.child_holes[i, j], chain.parent_holes[i, j], state.gap[i, j])
                state.length[j] += state.gap[i, j, 0]
    _evaluate_poses(state)


@kernel
def _evaluate_poses(state):
    pose = state.pose
    pose[0, X] = pose[0, Y] = pose[0, THETA] = pose[0, S] = 0.0
    pose[0, C] = 1.0
    for i in range(state.joint.shape[0]):
        joint, contact = state.joint[i], state.contact[i]
        x, y, cos, sin = pose[i, X], pose[i, Y], pose[i, C], pose[i, S]
        contact[0] = x + cos * joint[CX] - sin * joint[CY]
        contact[1] = y + sin * joint[CX] + cos * joint[CY]
        contact[2] = cos * joint[EX] - sin * joint[EY]
        contact[3] = sin * joint[EX] + cos * joint[EY]
        pose[i + 1, X] = x + cos * joint[GX] - sin * joint[GY]
        pose[i + 1, Y] = y + sin * joint[GX] + cos * joint[GY]
        pose[i + 1, THETA] = pose[i, THETA] + joint[ANGLE]
        pose[i + 1, C] = cos * joint[COS] - sin * joint[SIN]
        pose[i + 1, S] = sin * joint[COS] + cos * joint[SIN]


@kernel
def _evaluate_tendons(law, state):
    energy = magnitude = 0.0
    for j in range(state.length.size):
        length = state.length[j]
        k, low, high = law.stiffness[j], law.low[j], law.high[j]
        stretch = length - law.command[j]
        state.elastic[j] = 0.0
        if k * stretch <= low:
            state.tension[j] = low
            term = low * stretch - 0.5 * low * low / k
        elif k * stretch >= high:
            state.tension[j] = high
            term = high * stretch - 0.5 * high * high / k
        else:
            state.tension[j] = k * stretch
            state.elastic[j] = k
            term = 0.5 * k * stretch * stretch
        energy += term
        magnitude += abs(term) + abs(state.tension[j] * length)
    return energy, magnitude


@kernel
def _evaluate_loads(loads, state):
    """Fill the sums of loads beyond each joint; returns (energy, magnitude of its terms)."""
    sums = state.sums
    sums[:] = 0.0
    energy = magnitude = 0.0
    for row in range(loads.shape[0]):
        link = int(loads[row, 0])
        cos, sin = state.pose[link, C], state.pose[link, S]
        px, py = loads[row, 1], loads[row, 2]
        x = state.pose[link, X] + cos * px - sin * py
        y = state.pose[link, Y] + sin * px + cos * py
        fx, fy, moment, k = loads[row, 3], loads[row, 4], loads[row, 7], loads[row, 8]
        term = -(fx * x + fy * y) - moment * state.pose[link, THETA]
        dx, dy = loads[row, 9] - x, loads[row, 10] - y
        term += 0.5 * k * (dx * dx + dy * dy)
        energy += term
        magnitude += abs(term)
        if link == 0:
            continue
        bx = cos * loads[row, 5] - sin * loads[row, 6]
        by = sin * loads[row, 5] + cos * loads[row, 6]
        fx, fy = fx + bx + k * dx, fy + by + k * dy
        beyond = sums[link - 1]
        beyond[FX] += fx
        beyond[FY] += fy
        beyond[X_CROSS_F] += x * fy - y * fx
        beyond[X_DOT_F] += x * fx + y * fy
        beyond[MOMENT] += moment
        beyond[BX] += bx
        beyond[BY] += by
        beyond[X_DOT_B] += x * bx + y * by
        beyond[K] += k
        beyond[KX] += k * x
        beyond[KY] += k * y
        beyond[K_XX] += k * (x * x + y * y)
    for i in range(sums.shape[0] - 2, -1, -1):
        sums[i] += sums[i + 1]
    return energy, magnitude


@kernel
def _evaluate_residual(chain, state):
    """Fill r = sum of tension g' minus the moment of the loads about the contact.

    Returns the largest sum of its terms' magnitudes, every tension with a lever of at least 1 mm.
    """
    scale = 0.0
    for i in range(state.joint.shape[0]):
        sums, cx, cy = state.sums[i], state.contact[i, 0], state.contact[i, 1]
        moment = sums[MOMENT] + sums[X_CROSS_F] - (cx * sums[FY] - cy * sums[FX])
        size = abs(moment)
        residual = -moment
        for j in range(chain.tendon_joints.size):
            if i < chain.tendon_joints[j]:
                torque = state.tension[j] * state.gap[i, j, 1]
                residual += torque
                size += max(abs(torque), state.tension[j])
        state.residual[i] = residual
        scale = max(scale, size)
    return scale


@kernel
def stiffness(chain, state, H):
    """Fill H = dr/dphi, (J, J); symmetric unless follower forces act."""
    n_joints = state.joint.shape[0]
    for i in range(n_joints):
        for m in range(n_joints):
            b = max(i, m)
            sums, contact = state.sums[b], state.contact[b]
            ci_x, ci_y = state.contact[i, 0], state.contact[i, 1]
            cm_x, cm_y = state.contact[m, 0], state.contact[m, 1]
            value = sums[X_DOT_F] - (contact[0] * sums[FX] + contact[1] * sums[FY])
            value -= sums[X_DOT_B] - (ci_x * sums[BX] + ci_y * sums[BY])
            value += sums[K_XX] - sums[KX] * (ci_x + cm_x) - sums[KY] * (ci_y + cm_y)
            value += sums[K] * (ci_x * cm_x + ci_y * cm_y)
            for j in range(chain.tendon_joints.size):
                if b < chain.tendon_joints[j]:
                    value += state.elastic[j] * state.gap[i, j, 1] * state.gap[m, j, 1]
            H[i, m] = value
        kappa = state.joint[i, KAPPA]
        along = state.contact[i, 2] * state.sums[i, FY] - state.contact[i, 3] * state.sums[i, FX]
        H[i, i] += along / kappa
        for j in range(chain.tendon_joints.size):
            if i < chain.tendon_joints[j]:
                H[i, i] += state.tension[j] * state.gap[i, j, 2]


@kernel
def contact_forces(chain, state, forces):
    """Fill forces on the distal link of every joint, (J, 2): along the tangent and along the normal."""
    for i in range(state.joint.shape[0]):
        cos, sin = state.pose[i, C], state.pose[i, S]
        joint = state.joint[i]
        fx, fy = -state.sums[i, FX], -state.sums[i, FY]
        for j in range(chain.tendon_joints.size):
            if i < chain.tendon_joints[j]:
                child, parent = chain.child_holes[i, j], chain.parent_holes[i, j]
                vx = joint[GX] + joint[COS] * parent[0] - joint[SIN] * parent[1] - child[0]
                vy = joint[GY] + joint[SIN] * parent[0] + joint[COS] * parent[1] - child[1]
                length = math.sqrt(vx * vx + vy * vy)
                if length > 1e-9:
                    vx, vy = vx / length, vy / length
                else:
                    vx, vy = -joint[EY], joint[EX]
                fx += state.tension[j] * (cos * vx - sin * vy)
                fy += state.tension[j] * (sin * vx + cos * vy)
        ex, ey = state.contact[i, 2], state.contact[i, 3]
        forces[i, 0] = fx * ex + fy * ey
        forces[i, 1] = -fx * ey + fy * ex
