"""Loads on a planar chain: the columns of a load table, and everything the kernels make of its rows.

A row acts on one body point x of one link: world force + body force turned with the link + spring k (anchor - x), and a
moment. The standing rows of a chain, its springs, act beside those of a call. `Dead` functions serve eight SIMD lanes
side by side, whose loads are dead forces and moments only.
"""

from __future__ import annotations

from rollingjoint._numba.jit import part
from rollingjoint._numba.simd import where
from rollingjoint.kernels.planar.arrays import (
    BX,
    BY,
    FX,
    FY,
    K_XX,
    KX,
    KY,
    THETA,
    TURN,
    X_DOT_B,
    X_DOT_F,
    C,
    K,
    S,
    X,
    Y,
)
from rollingjoint.kernels.shared.lane import resolvable

LOAD_COLUMNS = ("link", "px", "py", "fx", "fy", "bx", "by", "moment", "k", "ax", "ay")
LINK, POINT, FORCE, BODY, MOMENT, SPRING, ANCHOR = map(
    LOAD_COLUMNS.index, ("link", "px", "fx", "bx", "moment", "k", "ax")
)
N_COLUMNS = len(LOAD_COLUMNS)
LINK_COLUMNS = ("link",)  # those that name a link
STIFFNESSES = (SPRING,)  # those that must not be negative
ACTING = (FORCE, FORCE + 1, BODY, BODY + 1, MOMENT, SPRING)  # a row in which all these are zero does nothing

# Columns of the table of dead loads of SIMD lanes: those of a load table up to the force, and the moment
DEAD_MOMENT, N_DEAD = BODY, BODY + 1


@part(inline=True)
def _row(standing, loads, place):
    """A row of the two tables, the standing one first."""
    return standing[place] if place < standing.shape[0] else loads[place - standing.shape[0]]


@part(inline=True)
def placed(x, y, cos, sin, px, py):
    """Where a body point is in the world."""
    return x + cos * px - sin * py, y + sin * px + cos * py


@part(inline=True)
def _dead_energy(x, y, theta, fx, fy, moment):
    return -(fx * x + fy * y) - moment * theta


@part(inline=True)
def has_potential(standing, loads):
    """Whether no force turns with its link."""
    for place in range(standing.shape[0] + loads.shape[0]):
        row = _row(standing, loads, place)
        if row[BODY] != 0.0 or row[BODY + 1] != 0.0:
            return False
    return True


@part(inline=True)
def generator_columns(standing, loads):
    """How many columns of a Sweep the loads need."""
    for place in range(standing.shape[0] + loads.shape[0]):
        if _row(standing, loads, place)[SPRING] != 0.0:
            return 3
    return 1


@part(inline=True)
def evaluate_loads(standing, loads, state):
    """Fill the sums of loads beyond each joint; returns (energy, magnitude of its terms)."""
    sums, pose = state.sums, state.pose
    energy = magnitude = 0.0
    for i in range(sums.shape[0]):
        for column in range(sums.shape[1]):
            sums[i, column] = 0.0
    for place in range(standing.shape[0] + loads.shape[0]):
        row = _row(standing, loads, place)
        link = int(row[LINK])
        cos, sin = pose[link, C], pose[link, S]
        x, y = placed(pose[link, X], pose[link, Y], cos, sin, row[POINT], row[POINT + 1])
        fx, fy, moment, k = row[FORCE], row[FORCE + 1], row[MOMENT], row[SPRING]
        term = _dead_energy(x, y, pose[link, THETA], fx, fy, moment)
        dx, dy = row[ANCHOR] - x, row[ANCHOR + 1] - y
        term += 0.5 * k * (dx * dx + dy * dy)
        energy += term
        magnitude += abs(term)
        if link == 0:
            continue
        bx = cos * row[BODY] - sin * row[BODY + 1]
        by = sin * row[BODY] + cos * row[BODY + 1]
        fx, fy = fx + bx + k * dx, fy + by + k * dy
        i = link - 1
        sums[i, FX] += fx
        sums[i, FY] += fy
        sums[i, TURN] += x * fy - y * fx + moment
        sums[i, X_DOT_F] += x * fx + y * fy
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


@part(inline=True)
def fill_load_stiffness(standing, loads, state, H):
    """Fill H with what the loads add to it, the moving contact of each joint itself left out."""
    sums, contact = state.sums, state.contact
    for i in range(H.shape[0]):
        for m in range(H.shape[0]):
            b = max(i, m)
            ci_x, ci_y, cm_x, cm_y = contact[i, 0], contact[i, 1], contact[m, 0], contact[m, 1]
            value = dead_lever(state, b)
            value -= sums[b, X_DOT_B] - (ci_x * sums[b, BX] + ci_y * sums[b, BY])
            value += sums[b, K_XX] - sums[b, KX] * (ci_x + cm_x) - sums[b, KY] * (ci_y + cm_y)
            value += sums[b, K] * (ci_x * cm_x + ci_y * cm_y)
            H[i, m] = value


@part(inline=True)
def fill_load_generators(standing, loads, state, prox, sweep):
    """Fill diagonal, U and V of a Sweep with what the loads add, and prox; tendons take the last columns."""
    sums, contact = state.sums, state.contact
    n_columns = sweep.U.shape[1] - state.tension.size
    for i in range(sums.shape[0]):
        cx, cy = contact[i, 0], contact[i, 1]
        lever = sums[i, X_DOT_F] - cx * sums[i, FX] - cy * sums[i, FY]
        lever += sums[i, K_XX] - cx * sums[i, KX] - cy * sums[i, KY]
        sweep.U[i, 0], sweep.V[i, 0] = lever, 1.0
        diagonal = lever + prox
        if n_columns == 3:
            sweep.U[i, 1], sweep.U[i, 2] = cx * sums[i, K] - sums[i, KX], cy * sums[i, K] - sums[i, KY]
            sweep.V[i, 1], sweep.V[i, 2] = cx, cy
            diagonal += sweep.U[i, 1] * cx + sweep.U[i, 2] * cy
        diagonal += contact[i, 2] * sums[i, FY] - contact[i, 3] * sums[i, FX]
        sweep.diagonal[i] = diagonal


@part(inline=True)
def n_rows(chain, loads):
    """How many rows act on each lane: those of its table, (B, rows, columns), and the standing ones."""
    return chain.standing.shape[1] + loads.shape[1]


@part(inline=True)
def dead_lever(state, i):
    """What dead forces beyond joint i add to the stiffness of the joints up to it."""
    sums, contact = state.sums, state.contact
    return sums[i, X_DOT_F] - (contact[i, 0] * sums[i, FX] + contact[i, 1] * sums[i, FY])


@part(inline=True)
def fill_dead_loads(standing, loads, table, lane):
    """Copy the loads of one lane into the table of dead loads; False where they need the solver for all cases."""
    usual = True
    for place in range(table.shape[0]):
        row = _row(standing, loads, place)
        for column in range(BODY):
            table[place, column, lane] = row[column]
        table[place, DEAD_MOMENT, lane] = row[MOMENT]
        for column in range(N_COLUMNS):
            usual = usual and resolvable(row[column])
        usual = usual and row[BODY] == 0.0 and row[BODY + 1] == 0.0 and row[SPRING] == 0.0
    return usual


@part(inline=True)
def evaluate_dead_loads(table, state):
    """Fill the sums of dead forces and moments beyond each joint; returns (energy, magnitude of its terms)."""
    sums, pose, n_joints = state.sums, state.pose, state.angle.size
    zero = 0.0 * state.angle[0]
    energy, magnitude = zero, zero
    for i in range(n_joints):
        sums[i, FX], sums[i, FY], sums[i, TURN], sums[i, X_DOT_F] = zero, zero, zero, zero
    for row in range(table.shape[0]):
        link, px, py = table[row, LINK], table[row, POINT], table[row, POINT + 1]
        fx, fy, moment = table[row, FORCE], table[row, FORCE + 1], table[row, DEAD_MOMENT]
        x, y, theta, cos, sin = zero, zero, zero, zero + 1.0, zero
        for k in range(1, n_joints + 1):
            here = link == float(k)
            x, y, theta = where(here, pose[k, X], x), where(here, pose[k, Y], y), where(here, pose[k, THETA], theta)
            cos, sin = where(here, pose[k, C], cos), where(here, pose[k, S], sin)
        x, y = placed(x, y, cos, sin, px, py)
        term = _dead_energy(x, y, theta, fx, fy, moment)
        energy, magnitude = energy + term, magnitude + abs(term)
        turn, dot = x * fy - y * fx + moment, x * fx + y * fy
        for i in range(n_joints):
            beyond = link > float(i)
            sums[i, FX] += where(beyond, fx, 0.0)
            sums[i, FY] += where(beyond, fy, 0.0)
            sums[i, TURN] += where(beyond, turn, 0.0)
            sums[i, X_DOT_F] += where(beyond, dot, 0.0)
    return energy, magnitude


@part(inline=True)
def fill_dead_stiffness(table, state, i, H):
    """Fill row i of H up to the diagonal with what dead loads add to it; returns what they add to the diagonal."""
    lever = dead_lever(state, i)
    for m in range(i):
        H[i, m] = lever
    return lever
