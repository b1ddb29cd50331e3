"""Loads on a spatial chain: all formulas of the rows of a load table, and the residual.

A row acts on one body point x of one link: force and moment of fixed direction, force and moment that turn with the
link, a spring to an anchor; its torsion spring acts on that link and a second one. The standing rows of a chain, its
springs, act together with the rows of a call. Symbols as in docs/theory.md: a axis, c contact or hinge. Dead forces
alone act in lanes.
"""

from __future__ import annotations

from rollingjoint._numba.jit import part
from rollingjoint._numba.simd import any_lane
from rollingjoint._numba.views import numbers
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import resolvable
from rollingjoint.kernels.contacts import ContactJoints
from rollingjoint.kernels.formulas import formula
from rollingjoint.kernels.hinges import (
    ANCHOR,
    BODY_FORCE,
    BODY_MOMENT,
    END_COUPLE,
    FORCE,
    KX,
    KXX,
    LINK,
    MOMENT,
    N_COLUMNS,
    N_DEAD,
    OTHER,
    POINT,
    REST,
    SPRING,
    TB,
    TORSION,
    TWIST,
    XF,
    B,
    F,
    Hinges,
    K,
    M,
    evaluate_hinges,
    placed,
    turned,
)
from rollingjoint.kernels.tendons import fill_residual
from rollingjoint.kernels.torsion_springs import (
    add_torsion_springs,
    fill_torsion_generators,
    row_of,
    torsion_columns,
    twisted,
)
from rollingjoint.kernels.vectors import about, choose, dot, in_space, minus, plus, times


@part(inline=True)
def _has_springs(standing, loads):
    for place in range(standing.shape[0] + loads.shape[0]):
        if row_of(standing, loads, place)[SPRING] != 0.0:
            return True
    return False


@part(inline=True)
def any_spring(table):
    """Whether a load table has a spring or a torsion spring."""
    for row in range(table.shape[0]):
        if table[row, SPRING] != 0.0 or table[row, TORSION] != 0.0:
            return True
    return False


@part
def has_potential(chain, loads):
    """Whether all loads and tendons have one: no moments, no follower loads, no end couples. Springs always have."""
    if formulas.has_end_couples(chain):
        return False
    for row in range(loads.shape[0]):
        for column in range(MOMENT, SPRING):
            if loads[row, LINK] > 0.0 and loads[row, column] != 0.0:
                return False
    return True


@formula(formulas.generator_columns, Hinges, ContactJoints)
def generator_columns(chain, loads):
    """Number of columns of a Sweep for the loads: three, three for springs, one for each torsion spring over hinges."""
    return (6 if _has_springs(chain.standing, loads) else 3) + torsion_columns(chain.standing, loads, False)


@part(inline=True)
def _clear(sums):
    for i in range(sums.shape[0]):
        for column in range(sums.shape[1]):
            sums[i, column] = 0.0


@part(inline=True)
def _accumulate(sums):
    """Turn the sums of each link into sums over all links beyond each hinge, in place."""
    for i in range(sums.shape[0] - 2, -1, -1):
        for column in range(sums.shape[1]):
            sums[i, column] += sums[i + 1, column]


@part(inline=True)
def _add_force(sums, i, at, force):
    """Add a force of fixed direction, or one of a spring, to the sums of a link."""
    for a in range(3):
        sums[i, F + a] += force[a]
        for b in range(3):
            sums[i, XF + 3 * a + b] += at[a] * force[b]


@part
def evaluate_table(chain, loads, state):
    """Fill the sums of loads beyond each hinge, end couples among them; returns (energy, magnitude of its terms)."""
    springs = _has_springs(chain.standing, loads)
    _clear(state.sums)
    state.held[0, K] = 0.0  # marks that there are none
    energy, magnitude = _add_loads(loads, state)
    if springs:
        _clear(state.held)
        spring_energy = _add_springs(loads, state) + _add_springs(chain.standing, state)
        energy, magnitude = energy + spring_energy, magnitude + spring_energy
        _accumulate(state.held)
    energy, magnitude = _add_torsion_springs(chain.standing, loads, state, energy, magnitude)
    if formulas.has_end_couples(chain):
        formulas.add_end_couples(chain, state)
    _accumulate(state.sums)
    return energy, magnitude


@part(inline=True)
def _add_loads(loads, state):
    """Add the loads of each link, springs left out; returns (energy, magnitude of its terms)."""
    sums, pose = state.sums, state.pose
    energy = magnitude = 0.0
    for row in range(loads.shape[0]):
        link = int(loads[row, LINK])
        if link == 0:
            continue
        i = link - 1
        at, force = placed(pose, link, in_space(loads, row, POINT)), in_space(loads, row, FORCE)
        term = -dot(at, force)
        energy += term
        magnitude += abs(term)
        _add_force(sums, i, at, force)
        body = turned(pose, link, in_space(loads, row, BODY_FORCE))
        moment = plus(about(at, body), turned(pose, link, in_space(loads, row, BODY_MOMENT)))
        for a in range(3):
            sums[i, M + a] += loads[row, MOMENT + a]
            sums[i, B + a] += body[a]
            sums[i, TB + a] += moment[a]
    return energy, magnitude


@part
def _add_springs(loads, state):
    """Add the forces of springs to the sums and fill held, link by link; returns their energy."""
    sums, held, pose = state.sums, state.held, state.pose
    energy = 0.0
    for row in range(loads.shape[0]):
        link, k = int(loads[row, LINK]), loads[row, SPRING]
        if link == 0 or k == 0.0:
            continue
        at = placed(pose, link, in_space(loads, row, POINT))
        way = minus(in_space(loads, row, ANCHOR), at)
        energy += 0.5 * k * dot(way, way)
        _add_force(sums, link - 1, at, times(way, k))
        x, y, z = at
        products = (1.0, x, y, z, x * x, x * y, x * z, y * y, y * z, z * z)
        for column in range(10):
            held[link - 1, column] += k * products[column]
    return energy


@part
def _add_torsion_springs(standing, loads, state, energy, magnitude):
    """Add the moments of torsion springs to the sums; returns energy and magnitude with the springs' terms."""
    for place in range(standing.shape[0] + loads.shape[0]):
        row = row_of(standing, loads, place)
        if row[TORSION] == 0.0:
            continue
        link, partner = int(row[LINK]), int(row[OTHER])
        term, size, couple = twisted(_turn_of(state, link), _turn_of(state, partner), row[TORSION], row[REST])
        energy, magnitude = energy + term, magnitude + size
        if link > 0:
            state.sums[link - 1, TWIST] += couple
        if partner > 0:
            state.sums[partner - 1, TWIST] -= couple
    return energy, magnitude


@part(inline=True)
def _turn_of(state, link):
    """Sum of the angles of the hinges below a link."""
    turn = 0.0
    for i in range(link):
        turn += state.angle[i]
    return turn


@formula(formulas.has_end_couples, Hinges)
def _has_end_couples(chain):
    return chain.model == END_COUPLE


@formula(formulas.add_end_couples, Hinges)
def _add_end_couples(chain, state):
    """Torques and sums of tendons that act as a couple on their last bead alone."""
    for j in range(state.length.size):
        last = chain.tendon_joints[j]
        couple = turned(state.pose, last, (-chain.ends[j, 1], chain.ends[j, 0], 0.0))
        for a in range(3):
            state.sums[last - 1, TB + a] += state.tension[j] * couple[a]
        for i in range(last):
            state.torque[i, j] = -dot(in_space(state.axis, i, 0), couple)


@formula(formulas.has_end_couples, ContactJoints)
def _has_none(chain):
    return False


@formula(formulas.add_end_couples, ContactJoints)
def _add_none(chain, state):
    """ContactJoints have exact tendons."""


@part(inline=True)
def dead_moment(state, i):
    """Moment of the dead forces and springs beyond hinge i about it, a vector."""
    sums = state.sums
    crossed = sums[i, XF + 5] - sums[i, XF + 7], sums[i, XF + 6] - sums[i, XF + 2], sums[i, XF + 1] - sums[i, XF + 3]
    return minus(crossed, about(formulas.pivot(state, i), in_space(sums, i, F)))


@part(inline=True)
def load_moment(state, i):
    """Moment of all loads beyond hinge i about it, a vector."""
    sums = state.sums
    turning = minus(in_space(sums, i, TB), about(formulas.pivot(state, i), in_space(sums, i, B)))
    return plus(plus(dead_moment(state, i), in_space(sums, i, M)), turning)


@part(inline=True)
def lever(state, i):
    """The vector w of H_im = -a_m . w for m <= i: sum of (a_i × (x - c_i)) × f over the dead forces beyond hinge i."""
    return lever_of(state.sums, i, F, XF, in_space(state.axis, i, 0), formulas.pivot(state, i))


@part(inline=True)
def lever_of(sums, i, first, product, axis, hinge):
    """`lever` of forces f at points x from their sums, f from column `first` and x outer f from column `product`."""
    force = in_space(sums, i, first)
    trace = sums[i, product] + sums[i, product + 4] + sums[i, product + 8] - dot(hinge, force)
    along = (
        dot(in_space(sums, i, product), axis),
        dot(in_space(sums, i, product + 3), axis),
        dot(in_space(sums, i, product + 6), axis),
    )
    return minus(minus(along, times(hinge, dot(axis, force))), times(axis, trace))


@part(inline=True)
def spring_lever(state, i):
    """p and s of H_im = a_m . p + (c_m × a_m) . s for m <= i: terms of the springs' give, from sums beyond hinge i."""
    held, axis, hinge = state.held, in_space(state.axis, i, 0), formulas.pivot(state, i)
    kx = in_space(held, i, KX)
    xx, xy, xz = in_space(held, i, KXX)
    yy, yz, zz = in_space(held, i, KXX + 3)
    trace = xx + yy + zz - dot(hinge, kx)
    products = dot((xx, xy, xz), axis), dot((xy, yy, yz), axis), dot((xz, yz, zz), axis)
    p = plus(minus(times(axis, trace), products), times(hinge, dot(kx, axis)))
    return p, about(axis, minus(kx, times(hinge, held[i, K])))


@part(inline=True)
def turned_about_origin(state, m):
    """c_m × a_m."""
    return about(formulas.pivot(state, m), in_space(state.axis, m, 0))


@formula(formulas.fill_load_stiffness, Hinges, ContactJoints)
def fill_load_stiffness(chain, state, i, H):
    """Fill H_im and H_mi, m <= i, with the terms of loads beyond hinge i."""
    axis, sums = state.axis, state.sums
    w, springs = lever(state, i), state.held[0, K] != 0.0
    p, s = spring_lever(state, i) if springs else (w, w)
    for m in range(i + 1):
        value = -dot(in_space(axis, m, 0), w)
        if springs:
            value += dot(in_space(axis, m, 0), p) + dot(turned_about_origin(state, m), s)
        H[i, m] = H[m, i] = value
    if _any(sums, i, B, 6):
        _add_followers(state, i, H)
    if _any(sums, i, M, 3):  # the axis turns with every hinge below it, the moment does not
        for m in range(i):
            H[i, m] -= dot(about(in_space(axis, m, 0), in_space(axis, i, 0)), in_space(sums, i, M))


@part(inline=True)
def _any(sums, i, first, count):
    for column in range(first, first + count):
        if sums[i, column] != 0.0:
            return True
    return False


@part(inline=True)
def _add_followers(state, i, H):
    """Add the moments about the hinges below that follow from turning the follower loads beyond hinge i about it."""
    axis, hinge, force = in_space(state.axis, i, 0), formulas.pivot(state, i), in_space(state.sums, i, B)
    turning = about(axis, minus(in_space(state.sums, i, TB), about(hinge, force)))
    moved = about(axis, force)
    for m in range(i):
        arm = minus(hinge, formulas.pivot(state, m))
        H[m, i] -= dot(in_space(state.axis, m, 0), plus(turning, about(arm, moved)))


@formula(formulas.add_between_links, Hinges, ContactJoints)
def add_between_links(chain, loads, H):
    """Add torsion springs to H."""
    add_torsion_springs(chain.standing, loads, H)


@formula(formulas.fill_load_generators, Hinges, ContactJoints)
def fill_load_generators(chain, loads, state, prox, sweep):
    """Fill diagonal, U and V of a Sweep: -w and a; springs add p to the first columns, and s, c × a in three more."""
    fill_generators_in_space(chain, loads, state, prox, False, sweep)


@part
def fill_generators_in_space(chain, loads, state, prox, wide, sweep):
    """fill_load_generators; wide: whether there are the columns of springs where there are none."""
    springs = _has_springs(chain.standing, loads)
    for i in range(state.angle.size):
        w, axis = lever(state, i), in_space(state.axis, i, 0)
        sweep.diagonal[i] = prox + formulas.own_stiffness(chain, state, i) - dot(w, axis)
        for a in range(3):
            sweep.U[i, a], sweep.V[i, a] = -w[a], axis[a]
        if springs:
            (p, s), arm = spring_lever(state, i), turned_about_origin(state, i)
            sweep.diagonal[i] += dot(p, axis) + dot(arm, s)
            for a in range(3):
                sweep.U[i, a] += p[a]
                sweep.U[i, 3 + a], sweep.V[i, 3 + a] = s[a], arm[a]
        elif wide:
            arm = turned_about_origin(state, i)
            for a in range(3):
                sweep.U[i, 3 + a], sweep.V[i, 3 + a] = 0.0, arm[a]
    fill_torsion_generators(chain.standing, loads, False, 6 if springs or wide else 3, sweep)


@part(inline=True)
def fill_dead_loads(loads, table, lane):
    """Copy the loads of one lane into the table of dead loads; False where they need the general solver."""
    supported = True
    for row in range(table.shape[0]):
        for column in range(N_DEAD):
            table[row, column, lane] = loads[row, column]
        for column in range(N_COLUMNS):
            supported = supported and resolvable(loads[row, column])
        for column in range(MOMENT, SPRING + 1):
            supported = supported and (loads[row, column] == 0.0 or (loads[row, LINK] == 0.0 and column < SPRING))
        supported = supported and loads[row, TORSION] == 0.0
    return supported


@part(inline=True)
def evaluate_dead_loads(table, state):
    """Fill the sums of dead forces beyond each hinge; returns (energy, magnitude of its terms)."""
    sums, n_joints = state.sums, state.angle.size
    zero = 0.0 * state.angle[0]
    energy, magnitude = zero, zero
    for i in range(n_joints):
        for column in range(M):
            sums[i, column] = zero
    for row in range(table.shape[0]):
        link, first = table[row, LINK], numbers(table)[row, LINK, 0]
        at, force = in_space(table, row, POINT), in_space(table, row, FORCE)
        if any_lane((link < first) | (link > first)):  # not the same in all lanes
            point, nowhere = at, (zero, zero, zero)
            at, force = nowhere, choose(link > 0.0, force, nowhere)
            for k in range(1, n_joints + 1):
                on_link = link == float(k)
                at = choose(on_link, placed(state.pose, k, point), at)
                _add_force(sums, k - 1, at, choose(on_link, force, nowhere))
        elif first > 0.0:
            at = placed(state.pose, int(first), at)
            _add_force(sums, int(first) - 1, at, force)
        else:
            continue
        term = -dot(at, force)
        energy, magnitude = energy + term, magnitude + abs(term)
    _accumulate(sums)
    return energy, magnitude


@formula(formulas.evaluate_loads, Hinges, ContactJoints)
def evaluate_loads(chain, loads, state):
    """Fill the sums of loads beyond each hinge; returns (energy, magnitude of its terms), the hinges' springs included.

    Moments, follower loads and end couples have no potential and are left out of the energy.
    """
    energy, magnitude = evaluate_table(chain, loads, state)
    springs = evaluate_hinges(chain.joints, chain.springs, state)
    return energy + springs, magnitude + springs


@formula(formulas.evaluate_residual, Hinges, ContactJoints)
def evaluate_residual(chain, state):
    """Fill r; returns the largest sum of its terms' magnitudes, every tension with a lever of at least 1 mm."""
    scale = 0.0
    for i in range(state.angle.size):
        moment = dot(in_space(state.axis, i, 0), load_moment(state, i)) + state.sums[i, TWIST]
        spring = chain.springs[i] * (state.angle[i] - chain.joints[i, 2])
        size = fill_residual(chain.tendon_joints, state, i, spring, moment)
        if formulas.has_end_couples(chain):  # they are among the loads
            state.residual[i], size = spring - moment, abs(spring) + abs(moment)
            for j in range(state.tension.size):
                if i < chain.tendon_joints[j]:
                    size += max(abs(state.tension[j] * formulas.torque(state, i, j)), state.tension[j])
        scale = max(scale, size)
    return scale
