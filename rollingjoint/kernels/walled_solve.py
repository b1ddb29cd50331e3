"""Equilibria of chains among walls, row by row."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint._numba.borrowed import borrow, pointed
from rollingjoint._numba.jit import kernel, part
from rollingjoint._numba.layout import Floats, Integers
from rollingjoint._numba.pins import carve_tuple, size_of
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import (
    AT_LIMIT,
    CONVERGED,
    INDETERMINATE,
    INVALID_INPUT,
    NO_ROOM,
    PASSED_THROUGH,
    UNSTABLE,
    TendonLaw,
    all_resolvable,
)
from rollingjoint.kernels.batch import evaluate_at, solve_invalid, valid
from rollingjoint.kernels.friction import friction_of, history_of, valid_friction
from rollingjoint.kernels.rubbed_chain import (
    StepFriction,
    StepFrictionSizes,
    remember,
    rubbed_stiffness,
    rubs_in_holes,
)
from rollingjoint.kernels.wall_contacts import EVALUATIONS, PENALTY, PLACES, STIFFER, Touched, begin_touch
from rollingjoint.kernels.walls import Walls

JUMP = 0.05  # rad, and thrice the tangent: motion of a joint that is a jump
_MOST_UPDATES = 60  # of the forces of rigid walls
_GAP_GOAL, _MOST_GAP = 1e-10, 1e-6  # mm: gap that is zero, that is no room
_FIRM = 1e5  # times the penalty: derivatives as between rigid walls
_SLOW, _MOST_STIFFER = 0.25, 1e6  # a gap that falls less in an update has the penalty multiplied by ten


class WallArrays(NamedTuple):
    """Walls of B lanes, what they remember, and outputs."""

    walls: Walls
    which: Annotated[Integers, "B"]  # index of each lane's walls
    bases: Annotated[Floats, "B", 3]  # pose of the base in the world [mm, rad]
    # The equilibrium before the step, to see whether the chain passes through a wall: poses of the links, x, y, angle,
    # and of the base, NaN where it is not known; no rows where none is known.
    poses_before: Annotated[Floats, "known", "n", 3]
    bases_before: Annotated[Floats, "known", 3]
    before: Annotated[Touched, "B"]
    after: Annotated[Touched, "B"]
    gaps: Annotated[Floats, "B", "C"]  # of candidates that press; else a lower bound [mm]
    forces: Annotated[Floats, "B", "n", 3]  # on every link: x, y, moment about its origin, base frame [N, N·mm]
    work: Annotated[Floats, "B"]  # dissipated at the walls in the step [N·mm]
    evaluations: Annotated[Integers, "B"]  # of energy and residual
    jumped: Annotated[Integers, "B"]  # 1 where a joint moved much farther than the tangent at the start


@kernel(nogil=True, lapack=True, title="the solver among walls")
def solve_among_walls(chain, designs, laws, loads, starts, results, walls, lanes):
    """Solve the given lanes without friction; all inputs but the stacks carry a leading lane axis."""
    sizes = formulas.contact_sizes(walls.walls, starts.shape[1])
    memory, state = formulas.new_contacts(sizes), formulas.new_state(chain, sizes.J, laws.command.shape[1])
    _solve_each(chain, designs, laws, loads, starts, results, walls, lanes, state, memory, sizes)


@part
def _solve_each(chain, designs, laws, loads, starts, results, walls, lanes, state, space, sizes):
    chain, laws, results, walls = borrow(chain), borrow(laws), borrow(results), borrow(walls)
    designs, loads, starts, lanes = borrow(designs), borrow(loads), borrow(starts), borrow(lanes)
    state, place = pointed(borrow(state)), pointed(formulas.contacts_in(sizes, borrow(space)))
    for number in range(lanes.size):
        lane = lanes[number]
        mechanism = pointed(formulas.design(chain, designs[lane]))
        law = TendonLaw(laws.command[lane], laws.stiffness[lane], laws.low[lane], laws.high[lane])
        solvable = valid(law, loads[lane], starts[lane], formulas.stiffness_columns(mechanism))
        solvable = solvable and all_resolvable(walls.bases[lane])
        begin_place(walls, lane, solvable, place)
        if solvable:
            among = formulas.walled(place, mechanism, pointed(formulas.touched_of(walls.before, lane)))
            outcome = solve_between(among, None, law, loads[lane], starts[lane], state)
            if outcome[0] <= AT_LIMIT and formulas.passes(place, state, walls, lane):
                outcome = PASSED_THROUGH, outcome[1], outcome[2], outcome[3]
        else:
            outcome = solve_invalid(mechanism, starts[lane], state)
        formulas.store(mechanism, state, outcome, results, lane)
        store_walls(place.touch, state, walls, lane)
        if solvable:
            walls.jumped[lane] = has_jumped(place.touch, starts[lane], state)


@part
def _solve_once(chain, rubbing, law, loads, start, state):
    """The equilibrium, or the step with friction unless `rubbing` is None; returns as formulas.solve."""
    if rubbing is None:
        return formulas.solve(chain, law, loads, start, state)
    friction, history, memory = rubbing
    return formulas.solve_step(chain, friction, history, law, loads, start, state, memory)


@part
def solve_between(chain, rubbing, law, loads, start, state):
    """formulas.solve; between rigid walls the forces that keep their gaps at zero, by an augmented Lagrangian.

    rubbing: (friction, history, memory) of formulas.solve_step for a step with friction, else None.
    """
    touch = chain.touch
    outcome = _solve_once(chain, rubbing, law, loads, start, state)
    if chain.walls.rigid[0] <= 0.0:
        return outcome
    status, count, worst, escapes = outcome
    before, angles = np.inf, np.empty(start.size)
    for outer in range(_MOST_UPDATES):
        open_gap = update_multipliers(touch)
        if open_gap <= _GAP_GOAL or (status >= UNSTABLE and outer > 3):
            break
        if open_gap > _SLOW * before and touch.how[STIFFER] < _MOST_STIFFER:
            touch.how[STIFFER] *= 10.0
        before = open_gap
        for i in range(angles.size):
            angles[i] = state.angle[i]
        status, more, worst, escapes = _solve_once(chain, rubbing, law, loads, angles, state)
        count += more
    return NO_ROOM if open_gap > _MOST_GAP else status, count, worst, escapes


@part
def has_jumped(touch, start, state):
    """1 where a joint moved much farther than the tangent at the start promises, else 0.

    The start is meant to be an equilibrium under other inputs: the first step of Newton's method is the tangent.
    """
    for i in range(start.size):
        if abs(state.angle[i] - start[i]) > 3.0 * abs(touch.tangent[i]) + JUMP:
            return 1
    return 0


@part
def update_multipliers(touch):
    """Keep the present normal forces of rigid walls as their multipliers; returns the largest gap that presses."""
    open_gap = 0.0
    for c in range(touch.gaps.size):
        touch.multipliers[c] = touch.normals[c]
        if touch.normals[c] > 0.0:
            open_gap = max(open_gap, abs(touch.gaps[c]))
    return open_gap


@part
def begin_place(walls, lane, solvable, place):
    """Fill the walls of a lane as seen from its base, without friction; forget the last solve."""
    begin_touch(place.touch)
    walls.jumped[lane] = 0
    if solvable:
        for c in range(place.touch.gaps.size):
            if walls.walls.rigid[walls.which[lane]] > 0.0:
                place.touch.multipliers[c] = walls.before.normals[lane, c]
        formulas.see(walls.walls, walls.which[lane], walls.bases[lane], place.seen)


@part
def store_walls(touch, state, walls, lane):
    """Copy the contact of a solved state into the outputs."""
    for c in range(touch.gaps.size):
        walls.gaps[lane, c], walls.after.normals[lane, c] = touch.gaps[c], touch.normals[c]
    formulas.store_contacts(touch, walls, lane)
    formulas.link_forces(touch, state, walls.forces[lane])
    walls.evaluations[lane] = int(touch.how[EVALUATIONS])
    walls.work[lane] = 0.0


@kernel(nogil=True, lapack=True, short_loops=True, title="the solver with friction among walls")
def step_among_walls(chain, designs, laws, loads, starts, results, friction, walls, lanes):
    """Solve the steps with friction of the given lanes; all inputs but the stacks carry a leading lane axis."""
    sizes = formulas.contact_sizes(walls.walls, starts.shape[1])
    rubbing = StepFrictionSizes(sizes.J, laws.command.shape[1])
    contacts, memory = formulas.new_contacts(sizes), np.zeros(size_of(StepFriction, rubbing))
    state = formulas.new_state(chain, rubbing.J, rubbing.m)
    where = friction, walls, lanes, state, contacts, sizes, memory, rubbing
    _step_each(chain, designs, laws, loads, starts, results, *where)


@part
def _step_each(
    chain, designs, laws, loads, starts, results, friction, walls, lanes, state, contacts, sizes, space, rubbing
):
    chain, laws, results = borrow(chain), borrow(laws), borrow(results)
    walls, friction = borrow(walls), borrow(friction)
    designs, loads, starts, lanes = borrow(designs), borrow(loads), borrow(starts), borrow(lanes)
    state, place = pointed(borrow(state)), pointed(formulas.contacts_in(sizes, borrow(contacts)))
    memory = pointed(carve_tuple(borrow(space), 0, StepFriction, rubbing))
    for number in range(lanes.size):
        lane = lanes[number]
        mechanism = pointed(formulas.design(chain, designs[lane]))
        law = TendonLaw(laws.command[lane], laws.stiffness[lane], laws.low[lane], laws.high[lane])
        coefficients = pointed(friction_of(friction.law, lane))
        before = pointed(history_of(friction.before, lane))
        touched = pointed(formulas.touched_of(walls.before, lane))
        solvable = valid(law, loads[lane], starts[lane], formulas.stiffness_columns(mechanism))
        solvable = solvable and all_resolvable(walls.bases[lane]) and valid_friction(coefficients, before)
        solvable = solvable and formulas.valid_memory(touched)
        begin_place(walls, lane, solvable, place)
        among, status = formulas.walled(place, mechanism, touched), INVALID_INPUT
        if solvable:
            formulas.begin_rubbing(place.touch, 1.0)
            rubbing = coefficients, before, memory
            outcome = solve_between(among, rubbing, law, loads[lane], starts[lane], state)
            if outcome[0] <= AT_LIMIT and formulas.passes(place, state, walls, lane):
                outcome = PASSED_THROUGH, outcome[1], outcome[2], outcome[3]
            status = outcome[0]
        else:
            outcome = solve_invalid(mechanism, starts[lane], state)
        formulas.store(mechanism, state, outcome, results, lane)
        friction.work[lane] = remember(among, before, memory, status, state, history_of(friction.after, lane))
        holds = solvable and rubs_in_holes(among, coefficients)
        for i in range(state.angle.size):
            for j in range(state.tension.size):
                friction.tension[lane, i, j] = memory.now.tension[i, j] if holds else state.tension[j]
        if holds:
            formulas.store_friction(mechanism, state, memory, results, lane)
        store_walls(place.touch, state, walls, lane)
        walls.work[lane] = remember_walls(among, status, state, walls, lane)
        if solvable:
            walls.jumped[lane] = has_jumped(place.touch, starts[lane], state)


@part
def remember_walls(chain, status, state, walls, lane):
    """Fill the memory of contacts after a step; returns the work of friction at the walls in it [N·mm].

    Where the pose is indeterminate friction states stay as they were; without an equilibrium the whole memory stays.
    Normal forces are those that `store_walls` has stored: multipliers of rigid walls have changed since.
    """
    touch, before, after, work = chain.touch, chain.before, formulas.touched_of(walls.after, lane), 0.0
    if status <= INDETERMINATE:
        formulas.touch_walls(chain, state, True)
    formulas.remember_contact(chain, state, status, after)
    for c in range(touch.gaps.size):
        if status > INDETERMINATE:
            after.normals[c] = before.normals[c]
        elif status < INDETERMINATE:
            work += 0.5 * (after.normals[c] + before.normals[c]) * touch.works[c]
    return work


@kernel(short_loops=True, title="the contact with walls")
def touch_again(chain, designs, angles, walls, places):
    """Evaluate every candidate at joint angles (B, J).

    Fills gaps, forces of compliant walls without friction, and memory of contacts that have not slipped; and of every
    candidate its place, as in `places` of its Touch, in the base frame: places (B, C, columns).
    """
    sizes = formulas.contact_sizes(walls.walls, angles.shape[1])
    memory = formulas.new_contacts(sizes)
    state = formulas.new_state(chain, sizes.J, chain.tendon_joints.size)
    _touch_each(chain, designs, angles, walls, places, state, memory, sizes)


@part
def _touch_each(chain, designs, angles, walls, places, state, space, sizes):
    chain, state, walls, angles = borrow(chain), pointed(borrow(state)), borrow(walls), borrow(angles)
    designs, places = borrow(designs), borrow(places)
    place = pointed(formulas.contacts_in(sizes, borrow(space)))
    touch = place.touch
    for lane in range(angles.shape[0]):
        mechanism = pointed(formulas.design(chain, designs[lane]))
        for i in range(state.angle.size):
            state.angle[i] = angles[lane, i]
        begin_place(walls, lane, True, place)
        formulas.begin_rubbing(touch, 0.0)
        formulas.evaluate_geometry(mechanism, state)
        among = formulas.walled(place, mechanism, pointed(formulas.touched_of(walls.before, lane)))
        touch.how[PLACES] = 1.0
        formulas.touch_walls(among, state, True)
        for c in range(touch.gaps.size):
            walls.gaps[lane, c], walls.after.normals[lane, c] = touch.gaps[c], touch.normals[c]
        formulas.remember_contact(among, state, CONVERGED, formulas.touched_of(walls.after, lane))
        for c in range(touch.gaps.size):
            for column in range(places.shape[2]):
                places[lane, c, column] = touch.places[c, column]


@kernel(short_loops=True, title="the stiffness among walls")
def walled_stiffness_of(chain, designs, law, tensions, elastic, loads, angles, history, rubs, walls, A, torques, S, F):
    """Fill A, (B, J, J), and d residual / d tension, (B, J, m), as after steps that left these histories and memories.

    law: of the friction in the chain. rubs: 1 after steps with friction at the walls, else 0.
    S (B, J, 3 or 6): d residual / d velocity of the base in its own frame: x, y, turn about its origin; in space x, y,
    z, turn. F (B, 2 or 3, J + 3 or 6): d force of all walls / d joint angle and d velocity of the base.
    """
    sizes = formulas.contact_sizes(walls.walls, angles.shape[1])
    rubbing = StepFrictionSizes(sizes.J, tensions.shape[1])
    contacts, memory = formulas.new_contacts(sizes), np.zeros(size_of(StepFriction, rubbing))
    state = formulas.new_state(chain, rubbing.J, rubbing.m)
    where = history, rubs, walls, A, torques, S, F, state, contacts, sizes, memory, rubbing
    _stiffness_each(chain, designs, law, tensions, elastic, loads, angles, *where)


@part
def _stiffness_each(
    chain,
    designs,
    law,
    tensions,
    elastic,
    loads,
    angles,
    history,
    rubs,
    walls,
    A,
    torques,
    S,
    F,
    state,
    contacts,
    sizes,
    space,
    rubbing,
):
    chain, law, history, walls = borrow(chain), borrow(law), borrow(history), borrow(walls)
    state = pointed(borrow(state))
    designs, tensions, elastic, loads = borrow(designs), borrow(tensions), borrow(elastic), borrow(loads)
    angles, A, torques, S, F = borrow(angles), borrow(A), borrow(torques), borrow(S), borrow(F)
    place = pointed(formulas.contacts_in(sizes, borrow(contacts)))
    memory = pointed(carve_tuple(borrow(space), 0, StepFriction, rubbing))
    for lane in range(angles.shape[0]):
        mechanism, past = pointed(formulas.design(chain, designs[lane])), pointed(history_of(history, lane))
        begin_place(walls, lane, True, place)
        formulas.begin_rubbing(place.touch, rubs)
        among = formulas.walled(place, mechanism, pointed(formulas.touched_of(walls.before, lane)))
        if place.seen.rigid[0] > 0.0:
            place.touch.how[STIFFER] = _FIRM
            evaluate_at(among, tensions[lane], elastic[lane], loads[lane], angles[lane], state)
            for c in range(place.touch.gaps.size):
                if place.touch.multipliers[c] > 0.0:  # the force stays as it is, whatever the gap's rounding
                    place.touch.multipliers[c] += PENALTY * _FIRM * place.touch.gaps[c]
        evaluate_at(among, tensions[lane], elastic[lane], loads[lane], angles[lane], state)
        rubbed_stiffness(among, friction_of(law, lane), loads[lane], state, memory, past, A[lane], torques[lane])
        formulas.base_stiffness(among, state, S[lane])
        formulas.force_rates(among, state, F[lane])
