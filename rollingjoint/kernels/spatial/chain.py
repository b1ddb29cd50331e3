"""A spatial hinge chain at one configuration: poses, tendons, loads, energy, residual, stiffness.

Symbols as in docs/theory.md, section 8: a axis, c hinge, r = dV/dtheta (residual), H = dr/dtheta (stiffness).
"""

from __future__ import annotations

import math

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import part
from rollingjoint.kernels.shared import formulas
from rollingjoint.kernels.shared.formulas import formula
from rollingjoint.kernels.shared.long_chain import symmetric_direction, unchanged, unlimited
from rollingjoint.kernels.shared.newton import reclassified
from rollingjoint.kernels.shared.tendons import evaluate_tendons
from rollingjoint.kernels.spatial.arrays import (
    BODY_FORCE,
    BODY_MOMENT,
    END_COUPLE,
    EXACT,
    FORCE,
    LINK,
    MOMENT,
    POINT,
    PX,
    PY,
    PZ,
    TB,
    XF,
    B,
    F,
    Hinges,
    K,
    M,
)
from rollingjoint.kernels.spatial.springs import add_springs, evaluate_springs, fill_spring_generators, has_springs
from rollingjoint.kernels.spatial.vectors import cross, turned


@formula(formulas.evaluate, Hinges)
def evaluate(chain, law, loads, state):
    """Fill the state at its angles; returns (potential energy, magnitude of its terms, force scale).

    Moments, follower loads and end couples have no potential and are left out of the energy.
    """
    state, loads = borrow(state), borrow(loads)
    _evaluate_geometry(chain, state)
    energy, magnitude = evaluate_tendons(law, state)
    load_energy, load_magnitude = _evaluate_loads(loads, state)
    springs = has_springs(loads)
    state.held[0, K] = 0.0  # enough to say that there are none
    if springs:
        spring_energy = evaluate_springs(loads, state)
        load_energy, load_magnitude = load_energy + spring_energy, load_magnitude + spring_energy
    if chain.model == END_COUPLE:
        _add_end_couples(chain, state)
    _accumulate(state.sums)
    if springs:
        _accumulate(state.held)
    for i in range(state.angle.size):
        term = 0.5 * chain.springs[i] * (state.angle[i] - chain.joints[i, 2]) ** 2
        load_energy += term
        load_magnitude += term
    return energy + load_energy, magnitude + load_magnitude, _evaluate_residual(chain, state)


@part(inline=True)
def _evaluate_geometry(chain, state):
    """Fill poses, axes, gaps and tendon lengths."""
    pose, axis, length = state.pose, state.axis, state.length
    for j in range(length.size):
        length[j] = chain.channels[j]
    for entry in range(12):
        pose[0, entry] = 1.0 if entry == 0 or entry == 4 or entry == 8 else 0.0
    for i in range(state.angle.size):
        sin, cos = math.sin(state.angle[i]), math.cos(state.angle[i])
        x, y, z = chain.axes[i, 0], chain.axes[i, 1], chain.axes[i, 2]
        axis[i, 0], axis[i, 1], axis[i, 2] = turned(pose, i, x, y, z)
        rest = 1.0 - cos
        columns = (
            (cos + rest * x * x, rest * x * y + sin * z, rest * x * z - sin * y),
            (rest * x * y - sin * z, cos + rest * y * y, rest * y * z + sin * x),
            (rest * x * z + sin * y, rest * y * z - sin * x, cos + rest * z * z),
        )
        for column in range(3):
            u, v, w = columns[column]
            pose[i + 1, column], pose[i + 1, 3 + column], pose[i + 1, 6 + column] = turned(pose, i, u, v, w)
        for row in range(3):
            pose[i + 1, PX + row] = pose[i, PX + row] + chain.spacings[i] * pose[i + 1, 3 * row + 2]
        _evaluate_gaps(chain, state, i, sin, cos)


@part(inline=True)
def _evaluate_gaps(chain, state, i, sin, cos):
    """Fill gaps and torques of hinge i, and add the gaps to the lengths."""
    gap = state.gap
    for j in range(state.length.size):
        if i < chain.tendon_joints[j]:
            if chain.model == EXACT:
                b, c = chain.gaps[i, j, 1], chain.gaps[i, j, 2]
                along = b * cos + c * sin
                gap[i, j, 0] = math.sqrt(max(chain.gaps[i, j, 0] - 2.0 * along, 0.0))
                inverse = 1.0 / gap[i, j, 0]
                gap[i, j, 1] = (b * sin - c * cos) * inverse
                gap[i, j, 2] = (along - gap[i, j, 1] * gap[i, j, 1]) * inverse
            else:
                gap[i, j, 1], gap[i, j, 2] = chain.gaps[i, j, 4], 0.0
                gap[i, j, 0] = chain.gaps[i, j, 3] + gap[i, j, 1] * state.angle[i]
            state.torque[i, j] = gap[i, j, 1]
            state.length[j] += gap[i, j, 0]


@part(inline=True)
def _evaluate_loads(loads, state):
    """Fill sums with the loads of each link, springs left out; returns (energy, magnitude of its terms)."""
    sums, pose = state.sums, state.pose
    energy = magnitude = 0.0
    for i in range(sums.shape[0]):
        for column in range(sums.shape[1]):
            sums[i, column] = 0.0
    for row in range(loads.shape[0]):
        link = int(loads[row, LINK])
        if link == 0:
            continue
        i = link - 1
        px, py, pz = turned(pose, link, loads[row, POINT], loads[row, POINT + 1], loads[row, POINT + 2])
        x, y, z = px + pose[link, PX], py + pose[link, PY], pz + pose[link, PZ]
        fx, fy, fz = loads[row, FORCE], loads[row, FORCE + 1], loads[row, FORCE + 2]
        term = -(x * fx + y * fy + z * fz)
        energy += term
        magnitude += abs(term)
        at, force = (x, y, z), (fx, fy, fz)
        for a in range(3):
            sums[i, F + a] += force[a]
            sums[i, M + a] += loads[row, MOMENT + a]
            for b in range(3):
                sums[i, XF + 3 * a + b] += at[a] * force[b]
        bx, by, bz = turned(pose, link, loads[row, BODY_FORCE], loads[row, BODY_FORCE + 1], loads[row, BODY_FORCE + 2])
        mx, my, mz = turned(
            pose, link, loads[row, BODY_MOMENT], loads[row, BODY_MOMENT + 1], loads[row, BODY_MOMENT + 2]
        )
        tx, ty, tz = cross(x, y, z, bx, by, bz)
        body = (bx, by, bz, tx + mx, ty + my, tz + mz)
        for a in range(6):
            sums[i, B + a] += body[a]
    return energy, magnitude


@part(inline=True)
def _add_end_couples(chain, state):
    """Torques and sums of tendons that act as a couple on their last bead alone."""
    for j in range(state.length.size):
        last = chain.tendon_joints[j]
        mx, my, mz = turned(state.pose, last, -chain.ends[j, 1], chain.ends[j, 0], 0.0)
        state.sums[last - 1, TB] += state.tension[j] * mx
        state.sums[last - 1, TB + 1] += state.tension[j] * my
        state.sums[last - 1, TB + 2] += state.tension[j] * mz
        for i in range(last):
            state.torque[i, j] = -(state.axis[i, 0] * mx + state.axis[i, 1] * my + state.axis[i, 2] * mz)


@part(inline=True)
def _accumulate(sums):
    """Turn what acts on each link into what acts beyond each hinge."""
    for i in range(sums.shape[0] - 2, -1, -1):
        for column in range(sums.shape[1]):
            sums[i, column] += sums[i + 1, column]


@part(inline=True)
def _evaluate_residual(chain, state):
    """Fill r = spring + sum of tension × torque - moment of the loads about the hinge.

    Returns the largest sum of its terms' magnitudes, every tension with a lever of at least 1 mm.
    """
    sums, tension = state.sums, state.tension
    scale = 0.0
    for i in range(state.angle.size):
        cx, cy, cz = state.pose[i, PX], state.pose[i, PY], state.pose[i, PZ]
        fx, fy, fz = sums[i, F] + sums[i, B], sums[i, F + 1] + sums[i, B + 1], sums[i, F + 2] + sums[i, B + 2]
        ox, oy, oz = cross(cx, cy, cz, fx, fy, fz)
        mx = sums[i, XF + 5] - sums[i, XF + 7] + sums[i, M] + sums[i, TB] - ox
        my = sums[i, XF + 6] - sums[i, XF + 2] + sums[i, M + 1] + sums[i, TB + 1] - oy
        mz = sums[i, XF + 1] - sums[i, XF + 3] + sums[i, M + 2] + sums[i, TB + 2] - oz
        moment = state.axis[i, 0] * mx + state.axis[i, 1] * my + state.axis[i, 2] * mz
        spring = chain.springs[i] * (state.angle[i] - chain.joints[i, 2])
        residual, size = spring - moment, abs(spring) + abs(moment)
        for j in range(tension.size):
            if i < chain.tendon_joints[j]:
                torque = tension[j] * state.torque[i, j]
                size += max(abs(torque), tension[j])
                if chain.model != END_COUPLE:  # end couples are among the sums
                    residual += torque
        state.residual[i] = residual
        scale = max(scale, size)
    return scale


@part(inline=True)
def lever(state, i):
    """The vector w of H_im = -a_m . w for m <= i: sum of (a_i × (x - c_i)) × f over the dead forces beyond hinge i."""
    sums = state.sums
    ax, ay, az = state.axis[i, 0], state.axis[i, 1], state.axis[i, 2]
    cx, cy, cz = state.pose[i, PX], state.pose[i, PY], state.pose[i, PZ]
    fx, fy, fz = sums[i, F], sums[i, F + 1], sums[i, F + 2]
    along = ax * fx + ay * fy + az * fz
    trace = sums[i, XF] + sums[i, XF + 4] + sums[i, XF + 8] - (cx * fx + cy * fy + cz * fz)
    wx = sums[i, XF] * ax + sums[i, XF + 1] * ay + sums[i, XF + 2] * az - cx * along - ax * trace
    wy = sums[i, XF + 3] * ax + sums[i, XF + 4] * ay + sums[i, XF + 5] * az - cy * along - ay * trace
    wz = sums[i, XF + 6] * ax + sums[i, XF + 7] * ay + sums[i, XF + 8] * az - cz * along - az * trace
    return wx, wy, wz


@part(inline=True)
def own_stiffness(chain, state, i):
    """What hinge i has alone: its spring and its gaps."""
    value = chain.springs[i]
    for j in range(state.tension.size):
        if i < chain.tendon_joints[j]:
            value += state.tension[j] * state.gap[i, j, 2]
    return value


@formula(formulas.stiffness, Hinges)
def stiffness(chain, loads, state, H):
    """Fill H = dr/dtheta, (J, J); symmetric where everything has a potential."""
    state, H = borrow(state), borrow(H)
    axis, elastic = state.axis, state.elastic
    for i in range(state.angle.size):
        wx, wy, wz = lever(state, i)
        for m in range(i + 1):
            H[i, m] = -(axis[m, 0] * wx + axis[m, 1] * wy + axis[m, 2] * wz)
            H[m, i] = H[i, m]
        H[i, i] += own_stiffness(chain, state, i)
    for j in range(elastic.size):
        if elastic[j] != 0.0:
            for i in range(chain.tendon_joints[j]):
                along = elastic[j] * state.torque[i, j]
                for m in range(chain.tendon_joints[j]):
                    H[i, m] += along * state.gap[m, j, 1]
    if state.held[0, K] != 0.0:
        add_springs(state, H)
    _add_loads_without_potential(state, H)


@part
def _add_loads_without_potential(state, H):
    """Add the parts of H that moments of fixed direction and loads that turn with their link cause."""
    axis, sums = state.axis, state.sums
    for m in range(axis.shape[0]):
        if _any(sums, m, B, 6):
            _add_followers(state, m, H)
        if _any(sums, m, M, 3):  # the axis turns with every hinge below it, the moment does not
            for k in range(m):
                ux, uy, uz = cross(axis[k, 0], axis[k, 1], axis[k, 2], axis[m, 0], axis[m, 1], axis[m, 2])
                H[m, k] -= ux * sums[m, M] + uy * sums[m, M + 1] + uz * sums[m, M + 2]


@part(inline=True)
def _any(sums, i, first, count):
    for column in range(first, first + count):
        if sums[i, column] != 0.0:
            return True
    return False


@part(inline=True)
def _add_followers(state, m, H):
    """Add what turning the follower loads beyond hinge m about it does to the hinges below."""
    axis, sums, pose = state.axis, state.sums, state.pose
    ax, ay, az = axis[m, 0], axis[m, 1], axis[m, 2]
    cx, cy, cz = pose[m, PX], pose[m, PY], pose[m, PZ]
    bx, by, bz = sums[m, B], sums[m, B + 1], sums[m, B + 2]
    ox, oy, oz = cross(cx, cy, cz, bx, by, bz)
    tx, ty, tz = cross(ax, ay, az, sums[m, TB] - ox, sums[m, TB + 1] - oy, sums[m, TB + 2] - oz)
    gx, gy, gz = cross(ax, ay, az, bx, by, bz)
    for i in range(m):
        qx, qy, qz = cross(cx - pose[i, PX], cy - pose[i, PY], cz - pose[i, PZ], gx, gy, gz)
        H[i, m] -= axis[i, 0] * (tx + qx) + axis[i, 1] * (ty + qy) + axis[i, 2] * (tz + qz)


formula(formulas.direction, Hinges)(symmetric_direction)
formula(formulas.renew, Hinges)(unchanged)
formula(formulas.overshoots, Hinges)(unlimited)
formula(formulas.reconsider, Hinges)(reclassified)


@formula(formulas.first_tendon_column, Hinges)
def first_tendon_column(chain, columns):
    """The tendons follow the three columns of the forces in fill_generators."""
    return 3


@formula(formulas.fill_generators, Hinges)
def fill_generators(chain, loads, state, prox, sweep):
    """Fill diagonal, U and V of a Sweep (long_chain.py) with H = U_i . V_m for i > m; prox is added to the diagonal."""
    state = borrow(state)
    n_tendons = state.tension.size
    for i in range(state.angle.size):
        w = lever(state, i)
        diagonal = prox + own_stiffness(chain, state, i)
        for a in range(3):
            sweep.U[i, a], sweep.V[i, a] = -w[a], state.axis[i, a]
            diagonal -= w[a] * state.axis[i, a]
        for j in range(n_tendons):
            rate = state.gap[i, j, 1] if i < chain.tendon_joints[j] else 0.0
            sweep.U[i, 3 + j], sweep.V[i, 3 + j] = state.elastic[j] * rate, rate
            diagonal += state.elastic[j] * rate * rate
        sweep.diagonal[i] = diagonal
    if sweep.U.shape[1] > 3 + n_tendons:
        fill_spring_generators(state, sweep, 3 + n_tendons)
