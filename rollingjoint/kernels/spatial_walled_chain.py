"""A chain in space among walls: the formulas of the chain itself and, on top of them, contact with walls.

With friction at the walls, which acts along two directions, there is no incremental potential: Newton's method goes by
the residual. Source: docs/theory.md, section 12.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from rollingjoint._numba.jit import part
from rollingjoint._numba.layout import Floats, Integers
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import INDETERMINATE, all_resolvable
from rollingjoint.kernels.chain import register
from rollingjoint.kernels.formulas import formula
from rollingjoint.kernels.hinges import PX, XF, F, turned
from rollingjoint.kernels.passing_in_space import curve_passes
from rollingjoint.kernels.spatial_loads import (
    fill_generators_in_space,
    lever_of,
    turned_about_origin,
)
from rollingjoint.kernels.spatial_wall_contacts import (
    FORCE,
    N_SUMS,
    POINT_FORCE,
    SUM_S,
    SpatialContactMemory,
    SpatialTouch,
    SpatialTouched,
    add_in_space,
    rubs_any,
    touch_in_space,
)
from rollingjoint.kernels.spatial_walls import SpatialSeen, put, unit
from rollingjoint.kernels.torsion_springs import torsion_columns
from rollingjoint.kernels.vectors import about, dot, in_space, minus, plus, times
from rollingjoint.kernels.wall_contacts import PRESSING, RUBS, SOFTER, shorten_move


class SpatialWalled(NamedTuple):
    """A chain in space among walls."""

    chain: Any
    joints: Floats  # of the chain
    springs: Floats
    tendon_joints: Integers
    standing: Floats
    walls: SpatialSeen
    before: SpatialTouched
    touch: SpatialTouch


@formula(formulas.walled, SpatialContactMemory)
def walled_in_space(place, chain, before):
    """The chain among the walls of a SpatialContactMemory."""
    own = chain.joints, chain.springs, chain.tendon_joints, chain.standing
    return SpatialWalled(chain, *own, place.seen, before, place.touch)


formula(formulas.touch_walls, SpatialWalled)(touch_in_space.py_func)


@formula(formulas.evaluate_loads, SpatialWalled)
def evaluate_loads(chain, loads, state):
    """Fill the sums of loads and walls beyond each joint; returns (energy, magnitude of its terms)."""
    energy, magnitude = formulas.evaluate_loads(chain.chain, loads, state)
    more, size = add_in_space(chain, state)
    wall_sums, sums = chain.touch.sums, state.sums
    n = sums.shape[0]
    for i in range(n - 1, -1, -1) if chain.touch.how[PRESSING] > 0.0 else range(0):
        for column in range(N_SUMS if i < n - 1 else 0):
            wall_sums[i, column] += wall_sums[i + 1, column]
        for a in range(3):
            sums[i, F + a] += wall_sums[i, FORCE + a]
        for a in range(9):
            sums[i, XF + a] += wall_sums[i, POINT_FORCE + a]
    return energy + more, magnitude + size


@part(inline=True)
def _twist(state, i):
    """Velocity of the links beyond joint i at the origin of the base frame, and their turn."""
    x, y, z = turned_about_origin(state, i)
    a, b, c = in_space(state.axis, i, 0)
    return x, y, z, a, b, c


@part(inline=True)
def _row(sums, i, a, twist):
    """A row of S of the walls beyond joint i times a twist."""
    value = 0.0
    for b in range(6):
        value += sums[i, SUM_S + 6 * a + b] * twist[b]
    return value


@part(inline=True)
def _column(sums, i, b, twist):
    """A twist times a column of S of the walls beyond joint i."""
    value = 0.0
    for a in range(6):
        value += twist[a] * sums[i, SUM_S + 6 * a + b]
    return value


@part(inline=True)
def _all_rows(sums, i, twist):
    """S of the walls beyond joint i times a twist."""
    return (
        _row(sums, i, 0, twist),
        _row(sums, i, 1, twist),
        _row(sums, i, 2, twist),
        _row(sums, i, 3, twist),
        _row(sums, i, 4, twist),
        _row(sums, i, 5, twist),
    )


@part(inline=True)
def _all_columns(sums, i, twist):
    """A twist times S of the walls beyond joint i."""
    return (
        _column(sums, i, 0, twist),
        _column(sums, i, 1, twist),
        _column(sums, i, 2, twist),
        _column(sums, i, 3, twist),
        _column(sums, i, 4, twist),
        _column(sums, i, 5, twist),
    )


@part(inline=True)
def _times(p, q):
    """Sum of the products of six numbers."""
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3] + p[4] * q[4] + p[5] * q[5]


@formula(formulas.fill_load_stiffness, SpatialWalled)
def fill_load_stiffness(chain, state, i, H):
    """Fill H_im and H_mi, m <= i, with the terms of loads and walls beyond joint i."""
    formulas.fill_load_stiffness(chain.chain, state, i, H)
    if chain.touch.how[PRESSING] == 0.0:
        return
    sums, mine = chain.touch.sums, _twist(state, i)
    left, right = _all_columns(sums, i, mine), _all_rows(sums, i, mine)
    for m in range(i + 1):
        other = _twist(state, m)
        H[i, m] += _times(left, other)
        if m < i:
            H[m, i] += _times(right, other)


@formula(formulas.base_stiffness, SpatialWalled)
def base_stiffness(chain, state, S):
    """Fill d residual / d velocity of the base in its own frame, (J, 6): x, y, z, turn about its origin."""
    sums = chain.touch.sums
    for i in range(state.angle.size):
        left = _all_columns(sums, i, _twist(state, i))
        lever = lever_of(sums, i, FORCE, POINT_FORCE, in_space(state.axis, i, 0), formulas.pivot(state, i))
        for a in range(6):
            S[i, a] = left[a] - (lever[a - 3] if a >= 3 else 0.0)


@formula(formulas.force_rates, SpatialWalled)
def force_rates(chain, state, rates):
    """Fill d force of all walls / d joint angle and d velocity of the base in its own frame, (3, J + 6)."""
    sums, n = chain.touch.sums, state.angle.size
    for i in range(n):
        right = _all_rows(sums, i, _twist(state, i))
        for a in range(3):
            rates[a, i] = -right[a]
    force = in_space(sums, 0, FORCE)
    for column in range(6):
        for a in range(3):
            rates[a, n + column] = -sums[0, SUM_S + 6 * a + column]
    for column in range(3):  # the frame of the base turns, too
        turn = about(unit(column), force)
        for a in range(3):
            rates[a, n + 3 + column] -= turn[a]


@formula(formulas.generator_columns, SpatialWalled)
def generator_columns(chain, loads):
    """Number of columns of a Sweep for loads and walls: six, and one for each torsion spring over two joints."""
    return 6 + torsion_columns(chain.standing, loads, False)


@formula(formulas.fill_load_generators, SpatialWalled)
def fill_load_generators(chain, loads, state, prox, sweep):
    """Fill diagonal, U and V of a Sweep with the terms of loads, walls and joints."""
    fill_generators_in_space(chain.chain, loads, state, prox, True, sweep)
    if chain.touch.how[PRESSING] == 0.0:
        return
    for i in range(state.angle.size):
        mine = _twist(state, i)
        left = _all_columns(chain.touch.sums, i, mine)
        sweep.diagonal[i] += _times(left, mine)
        for a in range(3):
            sweep.U[i, a] += left[3 + a]
            sweep.U[i, 3 + a] += left[a]


@formula(formulas.shorten, SpatialWalled)
def shorten(chain, state, step, is_newtons):
    """Shorten a step that would move the origin of a link too far; keep the first of Newton's; returns the factor."""
    return shorten_move(chain.touch, _farthest_move(state, step), step, is_newtons)


@part
def _farthest_move(state, step):
    """How far a step moves the origin of the link that it moves farthest, to first order [mm]."""
    velocity, turn, farthest = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0
    for i in range(step.size):
        velocity = plus(velocity, times(turned_about_origin(state, i), step[i]))
        turn = plus(turn, times(in_space(state.axis, i, 0), step[i]))
        moved = plus(velocity, about(turn, in_space(state.pose, i + 1, PX)))
        farthest = max(farthest, dot(moved, moved))
    return math.sqrt(farthest)


@formula(formulas.middle, SpatialWalled)
def middle(chain, i):
    """The rest angle of a joint, or the limit nearest to it."""
    return formulas.middle(chain.chain, i)


@formula(formulas.evaluate_geometry, SpatialWalled)
def evaluate_geometry(chain, state):
    """Fill poses, gaps and tendon lengths."""
    formulas.evaluate_geometry(chain.chain, state)


@formula(formulas.evaluate_residual, SpatialWalled)
def evaluate_residual(chain, state):
    """Fill r; returns the largest sum of its terms' magnitudes."""
    return formulas.evaluate_residual(chain.chain, state)


@formula(formulas.own_stiffness, SpatialWalled)
def own_stiffness(chain, state, i):
    """Term of joint i alone."""
    return formulas.own_stiffness(chain.chain, state, i)


@formula(formulas.add_between_links, SpatialWalled)
def add_between_links(chain, loads, H):
    """Add the terms of loads between two links."""
    formulas.add_between_links(chain.chain, loads, H)


@formula(formulas.has_end_couples, SpatialWalled)
def has_end_couples(chain):
    """Whether tendons act as couples on their last links."""
    return formulas.has_end_couples(chain.chain)


@formula(formulas.fill_turns, SpatialWalled)
def fill_turns(chain, state, turn):
    """Fill the turns of the tendons."""
    formulas.fill_turns(chain.chain, state, turn)


@formula(formulas.fill_normals, SpatialWalled)
def fill_normals(chain, state, rolling):
    """Fill the normal force between links, with the share of the walls."""
    formulas.fill_normals(chain.chain, state, rolling)


@formula(formulas.soften, SpatialWalled)
def soften(chain, softness):
    """Multiply the presliding at the walls."""
    chain.touch.how[SOFTER] = softness


@formula(formulas.is_among_walls, SpatialWalled)
def is_among_walls(chain):
    """True."""
    return True


@formula(formulas.rubs_at_walls, SpatialWalled)
def rubs_at_walls(chain):
    """Whether any wall rubs in this solve."""
    return chain.touch.how[RUBS] > 0.0 and rubs_any(chain.walls)


@formula(formulas.renew, SpatialWalled)
def renew(chain, state, energy, magnitude):
    """(energy, magnitude) with the normal forces of friction frozen at the present state."""
    touch, change = chain.touch, 0.0
    if touch.how[RUBS] > 0.0:
        for c in range(touch.gaps.size):
            if touch.normals[c] != touch.frozen[c]:
                change += (touch.normals[c] - touch.frozen[c]) * touch.works[c]
                touch.frozen[c] = touch.normals[c]
    return energy + change, magnitude + abs(change)


register(
    SpatialWalled,
    (formulas.shorten, formulas.renew, formulas.soften, formulas.is_among_walls, formulas.rubs_at_walls),
)


@formula(formulas.link_forces, SpatialTouch)
def link_forces(touch, state, forces):
    """Fill the wall force on every link and its moment about its origin, in the base frame [N, N·mm]."""
    n = touch.sums.shape[0]
    for a in range(6):
        forces[0, a] = 0.0
    for i in range(n):
        force, moment = in_space(touch.sums, i, FORCE), _moment(touch.sums, i)
        if i < n - 1:
            force = minus(force, in_space(touch.sums, i + 1, FORCE))
            moment = minus(moment, _moment(touch.sums, i + 1))
        put(forces[i + 1], 0, force)
        put(forces[i + 1], 3, minus(moment, about(in_space(state.pose, i + 1, PX), force)))


@part(inline=True)
def _moment(sums, i):
    """Moment about the origin of all wall forces beyond a joint."""
    xx = POINT_FORCE
    return (
        sums[i, xx + 5] - sums[i, xx + 7],
        sums[i, xx + 6] - sums[i, xx + 2],
        sums[i, xx + 1] - sums[i, xx + 3],
    )


@formula(formulas.store_contacts, SpatialTouch)
def store_contacts(touch, walls, lane):
    """Copy friction states into the outputs of one lane."""
    for c in range(touch.gaps.size):
        put(walls.after.states[lane, c], 0, in_space(touch.states, c, 0))


@formula(formulas.valid_memory, SpatialTouched)
def valid_memory(touched):
    """Whether what contacts remember are finite numbers."""
    for k in range(touched.poses.shape[0]):
        if not all_resolvable(touched.poses[k]):
            return False
    for c in range(touched.states.shape[0]):
        if not all_resolvable(touched.states[c]):
            return False
    return True


@formula(formulas.remember_contact, SpatialWalled)
def remember_contact(chain, state, status, after):
    """Fill what contacts remember after a step, but for normal forces: the poses of the links, and friction states."""
    before, touch, frame = chain.before, chain.touch, chain.walls.base
    for k in range(state.pose.shape[0]):
        if status > INDETERMINATE:
            for column in range(12):
                after.poses[k, column] = before.poses[k, column]
            continue
        for column in range(3):
            x = state.pose[k, column], state.pose[k, 3 + column], state.pose[k, 6 + column]
            x, y, z = turned(frame, 0, x)
            after.poses[k, column], after.poses[k, 3 + column], after.poses[k, 6 + column] = x, y, z
        put(after.poses[k], PX, plus(in_space(frame, 0, PX), turned(frame, 0, in_space(state.pose, k, PX))))
    for c in range(touch.gaps.size):
        z = in_space(before.states, c, 0)
        if status < INDETERMINATE:
            z = in_space(touch.states, c, 0)
        if status <= INDETERMINATE and after.normals[c] <= 0.0:
            z = (0.0, 0.0, 0.0)
        put(after.states[c], 0, z)


@formula(formulas.passes, SpatialContactMemory)
def passes(place, state, walls, lane):
    """Whether the chain has passed through a wall on its way from the equilibrium before."""
    if walls.bases_before.shape[0] == 0 or not all_resolvable(walls.bases_before[lane]):
        return False
    which = walls.which[lane]
    if walls.walls.capsules.shape[1] + walls.walls.pieces.shape[1] == 0:
        return False
    return curve_passes(walls, lane, which, state, place.seen, place.curve)
