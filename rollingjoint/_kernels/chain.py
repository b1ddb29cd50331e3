"""The whole chain at one configuration: poses, tendon lengths and tensions, energy, residual, stiffness.

Symbols as in docs/theory.md: r = U' - M (residual), H = dr/dphi (stiffness), c contact point, F external force.
"""

from __future__ import annotations

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
from rollingjoint._kernels.joint import evaluate_gap, evaluate_joint, gap_direction


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
    joint, gap, length, tendon_joints = state.joint, state.gap, state.length, chain.tendon_joints
    child_holes, parent_holes, channels = chain.child_holes, chain.parent_holes, chain.channels
    for j in range(length.size):
        length[j] = channels[j]
    for i in range(s.size):
        evaluate_joint(chain, i, s[i], joint)
        for j in range(length.size):
            if i < tendon_joints[j]:
                evaluate_gap(child_holes, parent_holes, i, j, joint, gap)
                length[j] += gap[i, j, 0]
    _evaluate_poses(state)


@kernel
def _evaluate_poses(state):
    pose, joint, contact = state.pose, state.joint, state.contact
    pose[0, X] = pose[0, Y] = pose[0, THETA] = pose[0, S] = 0.0
    pose[0, C] = 1.0
    for i in range(joint.shape[0]):
        x, y, cos, sin = pose[i, X], pose[i, Y], pose[i, C], pose[i, S]
        contact[i, 0] = x + cos * joint[i, CX] - sin * joint[i, CY]
        contact[i, 1] = y + sin * joint[i, CX] + cos * joint[i, CY]
        contact[i, 2] = cos * joint[i, EX] - sin * joint[i, EY]
        contact[i, 3] = sin * joint[i, EX] + cos * joint[i, EY]
        pose[i + 1, X] = x + cos * joint[i, GX] - sin * joint[i, GY]
        pose[i + 1, Y] = y + sin * joint[i, GX] + cos * joint[i, GY]
        pose[i + 1, THETA] = pose[i, THETA] + joint[i, ANGLE]
        pose[i + 1, C] = cos * joint[i, COS] - sin * joint[i, SIN]
        pose[i + 1, S] = sin * joint[i, COS] + cos * joint[i, SIN]


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
        i = link - 1
        sums[i, FX] += fx
        sums[i, FY] += fy
        sums[i, X_CROSS_F] += x * fy - y * fx
        sums[i, X_DOT_F] += x * fx + y * fy
        sums[i, MOMENT] += moment
        sums[i, BX] += bx
        sums[i, BY] += by
        sums[i, X_DOT_B] += x * bx + y * by
        sums[i, K] += k
        sums[i, KX] += k * x
        sums[i, KY] += k * y
        sums[i, K_XX] += k * (x * x + y * y)
    for i in range(sums.shape[0] - 2, -1, -1):
        for column in range(sums.shape[1]):
            sums[i, column] += sums[i + 1, column]
    return energy, magnitude


@kernel
def _evaluate_residual(chain, state):
    """Fill r = sum of tension g' minus the moment of the loads about the contact.

    Returns the largest sum of its terms' magnitudes, every tension with a lever of at least 1 mm.
    """
    scale, sums, contact, gap = 0.0, state.sums, state.contact, state.gap
    tension, tendon_joints, out = state.tension, chain.tendon_joints, state.residual
    for i in range(sums.shape[0]):
        cx, cy = contact[i, 0], contact[i, 1]
        moment = sums[i, MOMENT] + sums[i, X_CROSS_F] - (cx * sums[i, FY] - cy * sums[i, FX])
        size = abs(moment)
        residual = -moment
        for j in range(tension.size):
            if i < tendon_joints[j]:
                torque = tension[j] * gap[i, j, 1]
                residual += torque
                size += max(abs(torque), tension[j])
        out[i] = residual
        scale = max(scale, size)
    return scale


@kernel
def stiffness(chain, state, H):
    """Fill H = dr/dphi, (J, J); symmetric unless follower forces act."""
    n_joints, sums, contact, joint = state.joint.shape[0], state.sums, state.contact, state.joint
    gap, elastic, tension, tendon_joints = state.gap, state.elastic, state.tension, chain.tendon_joints
    for i in range(n_joints):
        for m in range(n_joints):
            b = max(i, m)
            ci_x, ci_y, cm_x, cm_y = contact[i, 0], contact[i, 1], contact[m, 0], contact[m, 1]
            value = sums[b, X_DOT_F] - (contact[b, 0] * sums[b, FX] + contact[b, 1] * sums[b, FY])
            value -= sums[b, X_DOT_B] - (ci_x * sums[b, BX] + ci_y * sums[b, BY])
            value += sums[b, K_XX] - sums[b, KX] * (ci_x + cm_x) - sums[b, KY] * (ci_y + cm_y)
            value += sums[b, K] * (ci_x * cm_x + ci_y * cm_y)
            for j in range(elastic.size):
                if b < tendon_joints[j]:
                    value += elastic[j] * gap[i, j, 1] * gap[m, j, 1]
            H[i, m] = value
        along = contact[i, 2] * sums[i, FY] - contact[i, 3] * sums[i, FX]
        H[i, i] += along / joint[i, KAPPA]
        for j in range(elastic.size):
            if i < tendon_joints[j]:
                H[i, i] += tension[j] * gap[i, j, 2]


@kernel
def contact_forces(chain, state, forces, lane):
    """Fill forces[lane] on the distal link of every joint, (J, 2): along the tangent and along the normal."""
    for i in range(state.joint.shape[0]):
        cos, sin = state.pose[i, C], state.pose[i, S]
        fx, fy = -state.sums[i, FX], -state.sums[i, FY]
        for j in range(chain.tendon_joints.size):
            if i < chain.tendon_joints[j]:
                vx, vy, _ = gap_direction(chain.child_holes, chain.parent_holes, i, j, state.joint)
                fx += state.tension[j] * (cos * vx - sin * vy)
                fy += state.tension[j] * (sin * vx + cos * vy)
        ex, ey = state.contact[i, 2], state.contact[i, 3]
        forces[lane, i, 0] = fx * ex + fy * ey
        forces[lane, i, 1] = -fx * ey + fy * ex
