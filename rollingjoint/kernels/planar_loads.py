"""Loads on a planar chain: the columns of a load table, and all formulas of its rows.

A row acts on one body point x of one link: world force + body force turned with the link + spring k (anchor - x), and a
moment; its torsion spring acts on that link and a second one. The standing rows of a chain, its springs, act together
with the rows of a call. The functions of dead loads serve eight SIMD lanes side by side, on which dead forces, moments
and torsion springs act.
"""

from __future__ import annotations

from rollingjoint._numba.jit import part
from rollingjoint._numba.simd import any_lane, where
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import resolvable
from rollingjoint.kernels.formulas import formula
from rollingjoint.kernels.rolling import (
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
    Chain,
    K,
    S,
    X,
    Y,
)
from rollingjoint.kernels.torsion_springs import (
    add_torsion_springs,
    fill_torsion_generators,
    row_of,
    torsion_columns,
    twisted,
)

LOAD_COLUMNS = ("link", "px", "py", "fx", "fy", "bx", "by", "moment", "k", "ax", "ay", "torsion", "rest", "other")
LINK, POINT, FORCE, BODY, MOMENT, SPRING, ANCHOR, TORSION, REST, OTHER = map(
    LOAD_COLUMNS.index, ("link", "px", "fx", "bx", "moment", "k", "ax", "torsion", "rest", "other")
)
N_COLUMNS = len(LOAD_COLUMNS)
LINK_COLUMNS = ("link", "other")  # columns with the number of a link
STIFFNESSES = (SPRING, TORSION)  # columns without negative numbers
ACTING = (FORCE, FORCE + 1, BODY, BODY + 1, MOMENT, SPRING, TORSION)  # a row with zeros in all of these has no effect

# Columns of the table of dead loads of SIMD lanes: as in a load table up to the force, then moment and torsion spring.
# The first column of its last row is the number of torsion springs.
DEAD_MOMENT, DEAD_TORSION, DEAD_REST, DEAD_OTHER, N_DEAD = range(BODY, BODY + 5)


@part(inline=True)
def placed(x, y, cos, sin, px, py):
    """Coordinates (x, y) of a body point in the base frame [mm]."""
    return x + cos * px - sin * py, y + sin * px + cos * py


@part(inline=True)
def _dead_energy(x, y, theta, fx, fy, moment):
    return -(fx * x + fy * y) - moment * theta


@part(inline=True)
def _has_springs(standing, loads):
    for place in range(standing.shape[0] + loads.shape[0]):
        if row_of(standing, loads, place)[SPRING] != 0.0:
            return True
    return False


@part
def has_potential(standing, loads):
    """True if there are no follower forces."""
    for place in range(standing.shape[0] + loads.shape[0]):
        row = row_of(standing, loads, place)
        if row[BODY] != 0.0 or row[BODY + 1] != 0.0:
            return False
    return True


@part
def generator_columns(standing, loads):
    """Number of columns of a Sweep for the loads: one, two for springs, one for each torsion spring over two joints."""
    return (3 if _has_springs(standing, loads) else 1) + torsion_columns(standing, loads, True)


@formula(formulas.generator_columns, Chain)
def columns_of_loads(chain, loads):
    """`generator_columns` of a chain."""
    return generator_columns(chain.standing, loads)


@part(inline=True)
def _add_loads(table, state, energy, magnitude):
    """Add the rows of a table to the sums of each link; returns energy and magnitude with the terms of the rows."""
    sums, pose = state.sums, state.pose
    for place in range(table.shape[0]):
        row = table[place]
        link = int(row[LINK])
        cos, sin = pose[link, C], pose[link, S]
        x, y = placed(pose[link, X], pose[link, Y], cos, sin, row[POINT], row[POINT + 1])
        fx, fy, moment, k = row[FORCE], row[FORCE + 1], row[MOMENT], row[SPRING]
        term = _dead_energy(x, y, pose[link, THETA], fx, fy, moment)
        dx, dy = row[ANCHOR] - x, row[ANCHOR + 1] - y
        term += 0.5 * k * (dx * dx + dy * dy)
        energy += term
        magnitude += abs(term)
        if row[TORSION] != 0.0:
            partner = int(row[OTHER])
            term, size, couple = twisted(pose[link, THETA], pose[partner, THETA], row[TORSION], row[REST])
            energy += term
            magnitude += size
            if partner > 0:
                sums[partner - 1, TURN] -= couple
            moment += couple
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
    return energy, magnitude


@formula(formulas.evaluate_loads, Chain)
def evaluate_loads(chain, loads, state):
    """Fill the sums of loads beyond each joint; returns (energy, magnitude of its terms)."""
    sums = state.sums
    for i in range(sums.shape[0]):
        for column in range(sums.shape[1]):
            sums[i, column] = 0.0
    energy, magnitude = _add_loads(chain.standing, state, 0.0, 0.0)
    energy, magnitude = _add_loads(loads, state, energy, magnitude)
    for i in range(sums.shape[0] - 2, -1, -1):
        for column in range(sums.shape[1]):
            sums[i, column] += sums[i + 1, column]
    return energy, magnitude


@formula(formulas.fill_load_stiffness, Chain)
def fill_load_stiffness(chain, state, i, H):
    """Fill H_im and H_mi, m <= i, with the terms of loads on one link beyond joint i."""
    for m in range(i):
        H[i, m] = _load_stiffness(state.sums, state.contact, i, m)
        H[m, i] = _load_stiffness(state.sums, state.contact, m, i)
    H[i, i] = _load_stiffness(state.sums, state.contact, i, i)


@part(inline=True)
def _load_stiffness(sums, contact, i, m):
    """H_im of the loads that act on one link, the moving contact of each joint itself left out."""
    b = max(i, m)
    ci_x, ci_y, cm_x, cm_y = contact[i, 0], contact[i, 1], contact[m, 0], contact[m, 1]
    value = dead_lever(sums, contact, b)
    value -= sums[b, X_DOT_B] - (ci_x * sums[b, BX] + ci_y * sums[b, BY])
    value += sums[b, K_XX] - sums[b, KX] * (ci_x + cm_x) - sums[b, KY] * (ci_y + cm_y)
    value += sums[b, K] * (ci_x * cm_x + ci_y * cm_y)
    return value


@formula(formulas.add_between_links, Chain)
def add_between_links(chain, loads, H):
    """Add torsion springs to H."""
    add_torsion_springs(chain.standing, loads, H)


@formula(formulas.fill_load_generators, Chain)
def fill_load_generators(chain, loads, state, prox, sweep):
    """Fill diagonal, U and V of a Sweep with the terms of loads and moving contacts."""
    fill_generators_of_loads(chain, loads, state, prox, _has_springs(chain.standing, loads), sweep)


@part
def fill_generators_of_loads(chain, loads, state, prox, springs, sweep):
    """fill_load_generators; springs: whether there are the columns of springs."""
    standing, sums, contact = chain.standing, state.sums, state.contact
    for i in range(sums.shape[0]):
        cx, cy = contact[i, 0], contact[i, 1]
        lever = sums[i, X_DOT_F] - cx * sums[i, FX] - cy * sums[i, FY]
        lever += sums[i, K_XX] - cx * sums[i, KX] - cy * sums[i, KY]
        sweep.U[i, 0], sweep.V[i, 0] = lever, 1.0
        diagonal = lever + prox
        if springs:
            sweep.U[i, 1], sweep.U[i, 2] = cx * sums[i, K] - sums[i, KX], cy * sums[i, K] - sums[i, KY]
            sweep.V[i, 1], sweep.V[i, 2] = cx, cy
            diagonal += sweep.U[i, 1] * cx + sweep.U[i, 2] * cy
        sweep.diagonal[i] = diagonal + formulas.own_stiffness(chain, state, i)
    fill_torsion_generators(standing, loads, True, 3 if springs else 1, sweep)


@part(inline=True)
def n_rows(chain, loads):
    """Number of rows of the table of dead loads: standing rows, rows of load tables (B, rows, columns), the last."""
    return chain.standing.shape[1] + loads.shape[1] + 1


@part(inline=True)
def dead_lever(sums, contact, i):
    """Term of dead forces beyond joint i in the stiffness of the joints up to it [N·mm/rad]."""
    return sums[i, X_DOT_F] - (contact[i, 0] * sums[i, FX] + contact[i, 1] * sums[i, FY])


@part(inline=True)
def fill_dead_loads(standing, loads, table, lane):
    """Copy the loads of one lane into the table of dead loads; False where they need the general solver."""
    supported, last = True, table.shape[0] - 1
    table[last, 0, lane] = 0.0
    for place in range(last):
        row = row_of(standing, loads, place)
        for column in range(BODY):
            table[place, column, lane] = row[column]
        table[place, DEAD_MOMENT, lane], table[place, DEAD_TORSION, lane] = row[MOMENT], row[TORSION]
        table[place, DEAD_REST, lane], table[place, DEAD_OTHER, lane] = row[REST], row[OTHER]
        if row[TORSION] != 0.0:
            table[last, 0, lane] += 1.0
        for column in range(N_COLUMNS):
            supported = supported and resolvable(row[column])
        supported = supported and row[BODY] == 0.0 and row[BODY + 1] == 0.0 and row[SPRING] == 0.0
        supported = supported and row[TORSION] >= 0.0
    return supported


@part(inline=True)
def evaluate_dead_loads(table, state):
    """Fill the sums of dead forces and moments beyond each joint; returns (energy, magnitude of its terms)."""
    sums, pose, n_joints = state.sums, state.pose, state.angle.size
    zero = 0.0 * state.angle[0]
    energy, magnitude = zero, zero
    for i in range(n_joints):
        sums[i, FX], sums[i, FY], sums[i, TURN], sums[i, X_DOT_F] = zero, zero, zero, zero
    last = table.shape[0] - 1
    twisting = any_lane(table[last, 0] > 0.0)
    for row in range(last):
        link, px, py = table[row, LINK], table[row, POINT], table[row, POINT + 1]
        fx, fy, moment = table[row, FORCE], table[row, FORCE + 1], table[row, DEAD_MOMENT]
        x, y, theta, cos, sin = zero, zero, zero, zero + 1.0, zero
        for k in range(1, n_joints + 1):
            match = link == float(k)
            x, y, theta = where(match, pose[k, X], x), where(match, pose[k, Y], y), where(match, pose[k, THETA], theta)
            cos, sin = where(match, pose[k, C], cos), where(match, pose[k, S], sin)
        x, y = placed(x, y, cos, sin, px, py)
        term = _dead_energy(x, y, theta, fx, fy, moment)
        energy, magnitude = energy + term, magnitude + abs(term)
        turn, dot = x * fy - y * fx + moment, x * fx + y * fy
        if twisting:
            partner, behind = table[row, DEAD_OTHER], zero
            for k in range(1, n_joints + 1):
                behind = where(partner == float(k), pose[k, THETA], behind)
            term, size, couple = twisted(theta, behind, table[row, DEAD_TORSION], table[row, DEAD_REST])
            energy, magnitude = energy + term, magnitude + size
            turn = turn + couple
            for i in range(n_joints):
                sums[i, TURN] += where(partner > float(i), -couple, 0.0)
        for i in range(n_joints):
            outside = link > float(i)
            sums[i, FX] += where(outside, fx, 0.0)
            sums[i, FY] += where(outside, fy, 0.0)
            sums[i, TURN] += where(outside, turn, 0.0)
            sums[i, X_DOT_F] += where(outside, dot, 0.0)
    return energy, magnitude


@part(inline=True)
def fill_dead_stiffness(table, state, i, H):
    """Fill row i of H up to the diagonal with the terms of dead loads; returns their term on the diagonal."""
    lever = dead_lever(state.sums, state.contact, i)
    for m in range(i):
        H[i, m] = lever
    last = table.shape[0] - 1
    if any_lane(table[last, 0] > 0.0):
        for row in range(last):
            link, partner = table[row, LINK], table[row, DEAD_OTHER]
            low, high = where(link < partner, link, partner), where(link < partner, partner, link)
            k = where((low <= float(i)) & (high > float(i)), table[row, DEAD_TORSION], 0.0)
            lever = lever + k
            for m in range(i):
                H[i, m] += where(low <= float(m), k, 0.0)
    return lever
