"""Equilibria of chains among walls, row by row."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import kernel, part
from rollingjoint._numba.layout import Floats, Integers
from rollingjoint._numba.pins import carve_tuple, size_of
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import NO_ROOM, UNSTABLE, TendonLaw, all_resolvable
from rollingjoint.kernels.batch import evaluate_at, solve_invalid, valid
from rollingjoint.kernels.bounds import mark_free
from rollingjoint.kernels.linear import lu_step
from rollingjoint.kernels.long_chain import DENSE_JOINTS, long_step, new_sweep
from rollingjoint.kernels.walled_chain import (
    PLACES,
    STIFFER,
    ContactMemory,
    Touched,
    base_stiffness,
    begin_touch,
    contact_sizes,
    link_forces,
    see,
    touch_walls,
    walled,
)
from rollingjoint.kernels.walls import Walls

JUMP = 0.05  # rad, and thrice the tangent: motion of a joint that is a jump
_MOST_UPDATES, _GAP_GOAL, _MOST_GAP = (
    60,
    1e-10,
    1e-6,
)  # of the forces of rigid walls; mm: gap that is zero, that is no room
_SLOW, _MOST_STIFFER = 0.25, 1e6  # a gap that falls less in an update has the penalty multiplied by ten


class WallArrays(NamedTuple):
    """Walls of B lanes, what they remember, and outputs."""

    walls: Walls
    which: Annotated[Integers, "B"]  # index of each lane's walls
    bases: Annotated[Floats, "B", 3]  # pose of the base in the world [mm, rad]
    before: Annotated[Touched, "B"]
    after: Annotated[Touched, "B"]
    gaps: Annotated[Floats, "B", "C"]  # of candidates that press; else a lower bound [mm]
    forces: Annotated[Floats, "B", "n", 3]  # on every link: x, y, moment about its origin, base frame [N, N·mm]
    work: Annotated[Floats, "B"]  # dissipated at the walls in the step [N·mm]
    jumped: Annotated[Integers, "B"]  # 1 where a joint moved much farther than the tangent at the start


@part
def touched_of(touched, lane):
    """What one lane remembers."""
    return Touched(touched.states[lane], touched.slips[lane], touched.sides[lane], touched.normals[lane])


@kernel(nogil=True, lapack=True, title="the solver among walls")
def solve_among_walls(chain, designs, laws, loads, starts, results, walls, lanes):
    """Solve the given lanes without friction; all inputs but the stacks carry a leading lane axis."""
    sizes = contact_sizes(walls.walls, starts.shape[1])
    memory, state = np.zeros(size_of(ContactMemory, sizes)), formulas.new_state(chain, sizes.J, laws.command.shape[1])
    _solve_each(chain, designs, laws, loads, starts, results, walls, lanes, state, memory, sizes)


@part
def _solve_each(chain, designs, laws, loads, starts, results, walls, lanes, state, space, sizes):
    chain, laws, results, state, walls = borrow(chain), borrow(laws), borrow(results), borrow(state), borrow(walls)
    designs, loads, starts, lanes = borrow(designs), borrow(loads), borrow(starts), borrow(lanes)
    place = carve_tuple(borrow(space), 0, ContactMemory, sizes)
    for number in range(lanes.size):
        lane = lanes[number]
        mechanism = formulas.design(chain, designs[lane])
        law = TendonLaw(laws.command[lane], laws.stiffness[lane], laws.low[lane], laws.high[lane])
        solvable = valid(law, loads[lane], starts[lane], formulas.stiffness_columns(mechanism))
        solvable = solvable and all_resolvable(walls.bases[lane])
        begin_place(walls, lane, solvable, place)
        if solvable:
            among = walled(mechanism, place, touched_of(walls.before, lane))
            outcome = solve_between(among, law, loads[lane], starts[lane], state)
        else:
            outcome = solve_invalid(mechanism, starts[lane], state)
        formulas.store(mechanism, state, outcome, results, lane)
        store_walls(place.touch, state, walls, lane)
        if solvable:
            walls.jumped[lane] = has_jumped(among, law, loads[lane], starts[lane], state)


@part
def solve_between(chain, law, loads, start, state):
    """formulas.solve; between rigid walls the forces that keep their gaps at zero, by an augmented Lagrangian."""
    touch = chain.touch
    outcome = formulas.solve(chain, law, loads, start, state)
    if chain.walls.rigid[0] <= 0.0:
        return outcome
    status, count, worst, escapes = outcome
    before, angles = np.inf, np.empty(start.size)
    for outer in range(_MOST_UPDATES):
        open_gap = 0.0
        for c in range(touch.gaps.size):
            touch.multipliers[c] = touch.normals[c]
            if touch.normals[c] > 0.0:
                open_gap = max(open_gap, abs(touch.gaps[c]))
        if open_gap <= _GAP_GOAL or (status >= UNSTABLE and outer > 3):
            break
        if open_gap > _SLOW * before and touch.how[STIFFER] < _MOST_STIFFER:
            touch.how[STIFFER] *= 10.0
        before = open_gap
        for i in range(angles.size):
            angles[i] = state.angle[i]
        status, more, worst, escapes = formulas.solve(chain, law, loads, angles, state)
        count += more
    return NO_ROOM if open_gap > _MOST_GAP else status, count, worst, escapes


@part
def has_jumped(chain, law, loads, start, state):
    """1 where a joint moved much farther than the tangent at the start promises, else 0; overwrites the state.

    The start is meant to be an equilibrium under other inputs: Newton's first step is the tangent.
    """
    n, farthest = start.size, 0.0
    way = np.empty(n)
    for i in range(n):
        way[i] = abs(state.angle[i] - start[i])
        farthest = max(farthest, way[i])
    if farthest <= JUMP:
        return 0
    for i in range(n):
        state.angle[i] = min(max(start[i], chain.joints[i, 0]), chain.joints[i, 1])
    formulas.evaluate(chain, law, loads, state)
    free, step = np.ones(n, np.bool_), np.empty(n)
    mark_free(chain, state, 0.0, state.residual, free)
    if n > DENSE_JOINTS:
        sweep = new_sweep(n, formulas.generator_columns(chain, loads) + law.low.size)
        formulas.fill_generators(chain, loads, state, 0.0, sweep)
        long_step(sweep, free, state.residual, step)
    else:
        H = np.empty((n, n))
        formulas.stiffness(chain, loads, state, H)
        if not lu_step(H, free, state.residual, step):
            return 1
    for i in range(n):
        if way[i] > 3.0 * abs(step[i]) + JUMP:
            return 1
    return 0


@part
def begin_place(walls, lane, solvable, place):
    """Fill the walls of a lane as seen from its base, without friction; forget the last solve."""
    begin_touch(place.touch)
    walls.jumped[lane] = 0
    if solvable:
        for c in range(place.touch.gaps.size):
            if walls.walls.rigid[walls.which[lane]] > 0.0:
                place.touch.multipliers[c] = walls.before.normals[lane, c]
        see(walls.walls, walls.which[lane], walls.bases[lane], place.seen)


@part
def store_walls(touch, state, walls, lane):
    """Copy the contact of a solved state into the outputs."""
    for c in range(touch.gaps.size):
        walls.gaps[lane, c], walls.after.normals[lane, c] = touch.gaps[c], touch.normals[c]
        walls.after.states[lane, c] = touch.states[c]
    link_forces(touch, state, walls.forces[lane])
    walls.work[lane] = 0.0


@kernel(short_loops=True, title="the contact with walls")
def touch_again(chain, designs, angles, walls, places):
    """Evaluate every candidate at joint angles (B, J).

    Fills gaps, forces of compliant walls without friction, and memory of contacts that have not slipped; and of every
    candidate its contact point on the wall and the normal of the wall there, base frame: places (B, C, 4).
    """
    sizes = contact_sizes(walls.walls, angles.shape[1])
    memory, state = (
        np.zeros(size_of(ContactMemory, sizes)),
        formulas.new_state(chain, sizes.J, chain.tendon_joints.size),
    )
    _touch_each(chain, designs, angles, walls, places, state, memory, sizes)


@part
def _touch_each(chain, designs, angles, walls, places, state, space, sizes):
    chain, state, walls, angles = borrow(chain), borrow(state), borrow(walls), borrow(angles)
    designs, places = borrow(designs), borrow(places)
    place = carve_tuple(borrow(space), 0, ContactMemory, sizes)
    touch = place.touch
    for lane in range(angles.shape[0]):
        mechanism = formulas.design(chain, designs[lane])
        for i in range(state.angle.size):
            state.angle[i] = angles[lane, i]
        begin_place(walls, lane, True, place)
        formulas.evaluate_geometry(mechanism, state)
        among = walled(mechanism, place, touched_of(walls.before, lane))
        touch.how[PLACES] = 1.0
        touch_walls(among, state, True)
        for c in range(touch.gaps.size):
            walls.gaps[lane, c], walls.after.slips[lane, c] = touch.gaps[c], touch.slips[c]
            walls.after.normals[lane, c], walls.after.states[lane, c] = touch.normals[c], 0.0
            walls.after.sides[lane, c] = touch.sides[c] if touch.normals[c] > 0.0 else 0.0
            for column in range(4):
                places[lane, c, column] = touch.places[c, column]


@kernel(short_loops=True, title="the stiffness among walls")
def walled_stiffness_of(chain, designs, tensions, elastic, loads, angles, walls, H, S):
    """Fill H, (B, J, J), at joint angles under tensions and their rates, among walls without friction.

    S (B, J, 3): d residual / d velocity of the base in its own frame: x, y, turn about its origin.
    """
    sizes = contact_sizes(walls.walls, angles.shape[1])
    memory, state = np.zeros(size_of(ContactMemory, sizes)), formulas.new_state(chain, sizes.J, tensions.shape[1])
    _stiffness_each(chain, designs, tensions, elastic, loads, angles, walls, H, S, state, memory, sizes)


@part
def _stiffness_each(chain, designs, tensions, elastic, loads, angles, walls, H, S, state, space, sizes):
    chain, state, walls, angles, H, S = (
        borrow(chain),
        borrow(state),
        borrow(walls),
        borrow(angles),
        borrow(H),
        borrow(S),
    )
    designs, tensions, elastic, loads = borrow(designs), borrow(tensions), borrow(elastic), borrow(loads)
    place = carve_tuple(borrow(space), 0, ContactMemory, sizes)
    for lane in range(angles.shape[0]):
        mechanism = formulas.design(chain, designs[lane])
        begin_place(walls, lane, True, place)
        among = walled(mechanism, place, touched_of(walls.before, lane))
        evaluate_at(among, tensions[lane], elastic[lane], loads[lane], angles[lane], state)
        formulas.stiffness(among, loads[lane], state, H[lane])
        base_stiffness(among, state, S[lane])
