"""A planar chain among walls: the formulas of the chain itself and, on top of them, contact with walls.

To the chain a contact is a load whose place and direction follow from the pose: its force enters the sums of loads, and
its stiffness is a matrix S (3, 3) in the velocity of a link, taken at the origin of the base frame and summed over the
links beyond a joint. With friction at the walls S is not symmetric. Source: docs/theory.md, section 12.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rollingjoint._numba.jit import part
from rollingjoint._numba.layout import Floats, Integers
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import INDETERMINATE, all_resolvable
from rollingjoint.kernels.chain import register
from rollingjoint.kernels.formulas import formula
from rollingjoint.kernels.passing import has_passed, may_pass, place_line
from rollingjoint.kernels.planar_loads import fill_generators_of_loads
from rollingjoint.kernels.rolling import FX, FY, TURN, X_DOT_F, X, Y
from rollingjoint.kernels.seen_walls import Seen
from rollingjoint.kernels.torsion_springs import torsion_columns
from rollingjoint.kernels.wall_contacts import (
    EVALUATIONS,
    GM,
    GX,
    GY,
    N_SUMS,
    PRESSING,
    RUBS,
    SOFTER,
    SUM_S,
    X_DOT_G,
    ContactMemory,
    Touch,
    Touched,
    shorten_move,
    touch_walls,
)


class Walled(NamedTuple):
    """A chain among walls."""

    chain: Any
    joints: Floats  # of the chain
    tendon_joints: Integers
    standing: Floats
    walls: Seen
    before: Touched
    touch: Touch


@formula(formulas.evaluate_loads, Walled)
def evaluate_loads(chain, loads, state):
    """Fill the sums of loads and walls beyond each joint; returns (energy, magnitude of its terms)."""
    energy, magnitude = formulas.evaluate_loads(chain.chain, loads, state)
    more, size = add_walls(chain, state)
    return energy + more, magnitude + size


@part
def add_walls(chain, state):
    """Add the forces of the walls to the sums of loads beyond each joint; returns (energy, magnitude of its terms)."""
    energy, magnitude = touch_walls(chain, state, False)
    wall_sums, sums = chain.touch.sums, state.sums
    chain.touch.how[EVALUATIONS] += 1.0
    if chain.touch.how[PRESSING] == 0.0:  # all sums are zero
        return energy, magnitude
    n = sums.shape[0]
    for i in range(n - 1, -1, -1):
        if i < n - 1:
            for column in range(N_SUMS):
                wall_sums[i, column] += wall_sums[i + 1, column]
        sums[i, FX] -= wall_sums[i, GX]
        sums[i, FY] -= wall_sums[i, GY]
        sums[i, TURN] -= wall_sums[i, GM]
        sums[i, X_DOT_F] -= wall_sums[i, X_DOT_G]
    return energy, magnitude


@part(inline=True)
def from_the_left(sums, i, x, y):
    """tᵀ S, S of the walls beyond joint i, t = (y, -x, 1): velocity at the origin per turn about (x, y)."""
    return (
        y * sums[i, SUM_S] - x * sums[i, SUM_S + 3] + sums[i, SUM_S + 6],
        y * sums[i, SUM_S + 1] - x * sums[i, SUM_S + 4] + sums[i, SUM_S + 7],
        y * sums[i, SUM_S + 2] - x * sums[i, SUM_S + 5] + sums[i, SUM_S + 8],
    )


@part(inline=True)
def _from_the_right(sums, i, x, y):
    """S t, likewise."""
    return (
        y * sums[i, SUM_S] - x * sums[i, SUM_S + 1] + sums[i, SUM_S + 2],
        y * sums[i, SUM_S + 3] - x * sums[i, SUM_S + 4] + sums[i, SUM_S + 5],
        y * sums[i, SUM_S + 6] - x * sums[i, SUM_S + 7] + sums[i, SUM_S + 8],
    )


@formula(formulas.fill_load_stiffness, Walled)
def fill_load_stiffness(chain, state, i, H):
    """Fill H_im and H_mi, m <= i, with the terms of loads and walls beyond joint i."""
    formulas.fill_load_stiffness(chain.chain, state, i, H)
    contact, sums, rubs = state.contact, chain.touch.sums, chain.touch.how[RUBS] > 0.0
    if chain.touch.how[PRESSING] == 0.0:
        return
    lx, ly, lm = from_the_left(sums, i, contact[i, 0], contact[i, 1])
    rx, ry, rm = _from_the_right(sums, i, contact[i, 0], contact[i, 1]) if rubs else (lx, ly, lm)
    for m in range(i + 1):
        x, y = contact[m, 0], contact[m, 1]
        value = lx * y - ly * x + lm
        H[i, m] += value
        if m < i:
            H[m, i] += rx * y - ry * x + rm if rubs else value


@formula(formulas.base_stiffness, Walled)
def base_stiffness(chain, state, S):
    """Fill d residual / d velocity of the base in its own frame, (J, 3): x, y, turn about its origin."""
    contact, sums = state.contact, chain.touch.sums
    for i in range(contact.shape[0]):
        x, y = contact[i, 0], contact[i, 1]
        S[i, 0], S[i, 1], S[i, 2] = from_the_left(sums, i, x, y)
        S[i, 2] -= sums[i, X_DOT_G] - (x * sums[i, GX] + y * sums[i, GY])


@formula(formulas.force_rates, Walled)
def force_rates(chain, state, rates):
    """Fill d force of all walls, x and y / d joint angle and d velocity of the base in its own frame, (2, J + 3)."""
    contact, sums = state.contact, chain.touch.sums
    n = contact.shape[0]
    for i in range(n):
        fx, fy, _ = _from_the_right(sums, i, contact[i, 0], contact[i, 1])
        rates[0, i], rates[1, i] = -fx, -fy
    for column in range(3):
        rates[0, n + column], rates[1, n + column] = -sums[0, SUM_S + column], -sums[0, SUM_S + 3 + column]
    rates[0, n + 2] -= sums[0, GY]  # the frame of the base turns, too
    rates[1, n + 2] += sums[0, GX]


@formula(formulas.generator_columns, Walled)
def generator_columns(chain, loads):
    """Number of columns of a Sweep for loads and walls: three, and one for each torsion spring over two joints."""
    return 3 + torsion_columns(chain.standing, loads, True)


@formula(formulas.fill_load_generators, Walled)
def fill_load_generators(chain, loads, state, prox, sweep):
    """Fill diagonal, U and V of a Sweep with the terms of loads, walls and moving contacts."""
    fill_generators_of_loads(chain.chain, loads, state, prox, True, sweep)
    contact, sums = state.contact, chain.touch.sums
    for i in range(contact.shape[0]):
        cx, cy = contact[i, 0], contact[i, 1]
        lx, ly, lm = from_the_left(sums, i, cx, cy)
        sweep.U[i, 0] += lm
        sweep.U[i, 1] -= ly
        sweep.U[i, 2] += lx
        sweep.diagonal[i] += lx * cy - ly * cx + lm


@formula(formulas.shorten, Walled)
def shorten(chain, state, step, is_newtons):
    """Shorten a step that would move the origin of a link too far; keep the first of Newton's; returns the factor."""
    return shorten_move(chain.touch, farthest_move(state, step), step, is_newtons)


@part
def farthest_move(state, step):
    """How far a step moves the origin of the link that it moves farthest, to first order [mm]."""
    contact, pose = state.contact, state.pose
    turn, x, y, farthest = 0.0, 0.0, 0.0, 0.0
    for i in range(step.size):
        turn += step[i]
        x += step[i] * contact[i, 0]
        y += step[i] * contact[i, 1]
        dx, dy = y - turn * pose[i + 1, Y], turn * pose[i + 1, X] - x
        farthest = max(farthest, dx * dx + dy * dy)
    return np.sqrt(farthest)


@formula(formulas.evaluate_geometry, Walled)
def evaluate_geometry(chain, state):
    """Fill poses, gaps and tendon lengths."""
    formulas.evaluate_geometry(chain.chain, state)


@formula(formulas.evaluate_residual, Walled)
def evaluate_residual(chain, state):
    """Fill r; returns the largest sum of its terms' magnitudes."""
    return formulas.evaluate_residual(chain.chain, state)


@formula(formulas.own_stiffness, Walled)
def own_stiffness(chain, state, i):
    """Term of joint i alone."""
    return formulas.own_stiffness(chain.chain, state, i)


@formula(formulas.add_between_links, Walled)
def add_between_links(chain, loads, H):
    """Add the terms of loads between two links."""
    formulas.add_between_links(chain.chain, loads, H)


@formula(formulas.fill_turns, Walled)
def fill_turns(chain, state, turn):
    """Fill the turns of the tendons."""
    formulas.fill_turns(chain.chain, state, turn)


@formula(formulas.fill_normals, Walled)
def fill_normals(chain, state, rolling):
    """Fill the normal force between links, with the share of the walls."""
    formulas.fill_normals(chain.chain, state, rolling)


@formula(formulas.fill_upper_generators, Walled)
def fill_upper_generators(chain, state, U, Q):
    """Fill the generators above the diagonal: friction at walls acts on every link, and its force is not symmetric."""
    contact, sums = state.contact, chain.touch.sums
    for i in range(U.shape[0]):
        for a in range(U.shape[1]):
            Q[i, a] = U[i, a]
        lx, ly, lm = from_the_left(sums, i, contact[i, 0], contact[i, 1])
        rx, ry, rm = _from_the_right(sums, i, contact[i, 0], contact[i, 1])
        Q[i, 0] += rm - lm
        Q[i, 1] += ly - ry
        Q[i, 2] += rx - lx


@formula(formulas.soften, Walled)
def soften(chain, softness):
    """Multiply the presliding at the walls."""
    chain.touch.how[SOFTER] = softness


@formula(formulas.is_among_walls, Walled)
def is_among_walls(chain):
    """True."""
    return True


@formula(formulas.renew, Walled)
def renew(chain, state, energy, magnitude):
    """(incremental potential, magnitude) with the normal forces of friction frozen at the present state."""
    touch, change = chain.touch, 0.0
    if touch.how[RUBS] > 0.0:
        for c in range(touch.gaps.size):
            if touch.normals[c] != touch.frozen[c]:
                change += (touch.normals[c] - touch.frozen[c]) * touch.works[c]
                touch.frozen[c] = touch.normals[c]
    return energy + change, magnitude + abs(change)


register(
    Walled,
    (
        formulas.shorten,
        formulas.renew,
        formulas.soften,
        formulas.is_among_walls,
        formulas.fill_upper_generators,
    ),
)


formula(formulas.touch_walls, Walled)(touch_walls.py_func)


@formula(formulas.walled, ContactMemory)
def walled(place, chain, before):
    """The chain among the walls of a ContactMemory."""
    return Walled(chain, chain.joints, chain.tendon_joints, chain.standing, place.seen, before, place.touch)


@formula(formulas.link_forces, Touch)
def link_forces(touch, state, forces):
    """Fill the wall force on every link: x, y, moment about its origin, in the base frame [N, N·mm]."""
    n = touch.sums.shape[0]
    forces[0, 0] = forces[0, 1] = forces[0, 2] = 0.0
    for i in range(n):
        fx, fy, moment = -touch.sums[i, GX], -touch.sums[i, GY], -touch.sums[i, GM]
        if i < n - 1:
            fx, fy, moment = fx + touch.sums[i + 1, GX], fy + touch.sums[i + 1, GY], moment + touch.sums[i + 1, GM]
        x, y = state.pose[i + 1, X], state.pose[i + 1, Y]
        forces[i + 1, 0], forces[i + 1, 1], forces[i + 1, 2] = fx, fy, moment - (x * fy - y * fx)


@formula(formulas.store_contacts, Touch)
def store_contacts(touch, walls, lane):
    """Copy friction states into the outputs of one lane."""
    for c in range(touch.gaps.size):
        walls.after.states[lane, c] = touch.states[c]


@formula(formulas.remember_contact, Walled)
def remember_contact(chain, state, status, after):
    """Fill what contacts remember after a step, but for normal forces."""
    touch, before = chain.touch, chain.before
    for c in range(touch.gaps.size):
        if status > INDETERMINATE:
            after.states[c], after.slips[c], after.sides[c] = before.states[c], before.slips[c], before.sides[c]
            continue
        after.slips[c], after.sides[c] = touch.slips[c], touch.sides[c]
        presses = after.normals[c] > 0.0
        after.states[c] = (touch.states[c] if status < INDETERMINATE else before.states[c]) if presses else 0.0


@formula(formulas.passes, ContactMemory)
def passes(place, state, walls, lane):
    """Whether the chain has passed through a wall on its way from the equilibrium before."""
    if walls.bases_before.shape[0] == 0 or not all_resolvable(walls.bases_before[lane]):
        return False
    which, curve, before, now = walls.which[lane], place.curve, walls.bases_before[lane], walls.bases[lane]
    if not may_pass(walls.walls, which, walls.poses_before[lane], before, state.pose, now):
        return False
    bars, last = walls.walls.bars[which], curve.shape[0] - 1
    place_line(bars, walls.poses_before[lane], before, curve, 0, 1)
    place_line(bars, state.pose, now, curve, last, -1)
    return has_passed(walls.walls, which, curve)
