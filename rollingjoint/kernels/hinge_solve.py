"""One equilibrium of a chain in space from one start: Newton's method, and the fallbacks for a non-converged pose.

Long chains whose loads all have a potential take the O(n) steps of long_chain.py. Where the energy decides, an unstable
equilibrium is left downhill and counted, here and not in Newton's method. Where a load has no potential, or Newton's
method does not converge, the overdamped motion from the start follows, then loads and tendons grow from zero; the slow
descent comes last, and again from starts near its end.
"""

from __future__ import annotations

import math

import numpy as np

from rollingjoint._numba.borrowed import borrow, pointed
from rollingjoint._numba.jit import kernel, part
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import UNSTABLE, TendonLaw
from rollingjoint.kernels.bounds import begin, mark_free, move
from rollingjoint.kernels.contacts import (
    ContactJoints,
    design,
    fill_reaction,
    load_force,
    new_contact_state,
    store_poses,
)
from rollingjoint.kernels.descent import most_descent_steps, relax
from rollingjoint.kernels.formulas import evaluate, formula, stiffness
from rollingjoint.kernels.hinges import (
    ANCHOR,
    FORCE,
    N_COLUMNS,
    SPRING,
    TORSION,
    Hinges,
    new_hinge_state,
)
from rollingjoint.kernels.long_chain import new_sweep
from rollingjoint.kernels.newton import MAX_ITERATIONS, escape_direction, minimise, most_staged_iterations
from rollingjoint.kernels.rubbed_chain import jacobian_in, jacobian_size, rubbed, settle_rubbed
from rollingjoint.kernels.settle import MOST_ESCAPES, long_joints, settle
from rollingjoint.kernels.spatial_loads import has_potential, load_moment
from rollingjoint.kernels.spatial_walled_chain import SpatialWalled

STIFFNESSES = (SPRING, TORSION)  # columns of a load table
_MAX_STAGES = 200
_SHORTEST_STAGE = 1e-4  # of the whole load
_ASIDE = 1e-4  # rad
_WAYS_ASIDE = 4
_STEPS_PER_ESCAPE = 10  # dense steps that take as long as the eigenvectors of an escape


@part
def _escape(chain, law, loads, state, free, step, before):
    """Leave a saddle along the most negative curvature, so far that the energy falls; returns whether it did."""
    n = state.angle.size
    energy, _, _ = evaluate(chain, law, loads, state)
    mark_free(chain, state, 0.0, state.angle, free)
    H = np.empty((n, n))
    stiffness(chain, loads, state, H)
    escape_direction(H, free, step)
    for i in range(n):
        before[i] = state.angle[i]
    t = 1.0
    for _ in range(30):
        move(chain, before, step, t, state.angle)
        lower, _, _ = evaluate(chain, law, loads, state)
        if lower < energy:
            return True
        t *= 0.5
    move(chain, before, step, 0.0, state.angle)
    return False


@part
def _descend(chain, law, loads, conservative, state, H, sweep):
    """Newton from the state's angles, leaving unstable equilibria; (status, iterations, residual, escapes)."""
    n = state.angle.size
    anchor = np.zeros(n)
    free, step = np.ones(n, np.bool_), np.empty(n)
    count, escapes = 0, 0
    while True:
        status, iterations, worst = minimise(
            chain, law, loads, conservative, 0, MAX_ITERATIONS, 0.0, anchor, state, H, sweep
        )
        count += iterations
        if status != UNSTABLE or not conservative or escapes == MOST_ESCAPES:
            break
        if not _escape(chain, law, loads, state, free, step, anchor):
            break
        escapes += 1
    return status, count, worst, escapes


@part
def _grow(chain, law, loads, conservative, state, H, sweep, share_of_law, share_of_loads):
    """Equilibrium by letting loads and tendons grow from zero at the rest pose, each stage from the one before.

    Without a potential an unstable equilibrium is followed too. The last two arguments are scratch space.
    """
    n, m = state.angle.size, state.length.size
    spent, max_iterations = 0, most_staged_iterations(n)
    last, slack = np.empty(n), np.empty(m)
    for i in range(n):
        last[i] = middle(chain, i)
    part_loads = borrow(share_of_loads)
    scratch = borrow(share_of_law)
    part_law = TendonLaw(scratch[0], law.stiffness, scratch[1], scratch[2])
    begin(chain, last, state.angle)
    evaluate(chain, law, loads, state)
    for j in range(m):
        slack[j] = state.length[j]
    done, stage, count, status, worst, escapes = 0.0, 0.125, 0, UNSTABLE, np.inf, 0
    for _ in range(_MAX_STAGES):
        share = min(1.0, done + stage)
        for j in range(m):
            part_law.command[j] = slack[j] + share * (law.command[j] - slack[j])
            part_law.low[j] = share * law.low[j]
            part_law.high[j] = share * law.high[j] if law.low[j] == law.high[j] else law.high[j]
        for row in range(loads.shape[0]):
            for column in range(N_COLUMNS):
                part_loads[row, column] = loads[row, column] * (share if FORCE <= column < ANCHOR else 1.0)
            part_loads[row, TORSION] = loads[row, TORSION] * share
        for i in range(n):
            last[i] = state.angle[i]
        status, iterations, worst, n_left = _descend(chain, part_law, part_loads, conservative, state, H, sweep)
        count += iterations
        spent += _STEPS_PER_ESCAPE * n_left + (iterations if H.size > 0 else 0)
        if status < UNSTABLE or (status == UNSTABLE and not conservative):
            done, stage, escapes = share, 2.0 * stage, escapes + n_left
            if share == 1.0:
                break
        elif stage > _SHORTEST_STAGE:
            stage *= 0.25
            for i in range(n):
                state.angle[i] = last[i]
        else:
            break
        if spent > max_iterations:
            break
    if done < 1.0:
        status, iterations, worst, n_left = _descend(chain, law, loads, conservative, state, H, sweep)
        count, escapes = count + iterations, escapes + n_left
    return status, count, worst, escapes


@formula(formulas.new_state, Hinges)
def state_of(chain, n_joints, n_tendons):
    """An empty HingeState."""
    return new_hinge_state(n_joints, n_tendons)


@formula(formulas.new_state, ContactJoints)
def state_of_contacts(chain, n_joints, n_tendons):
    """An empty ContactState."""
    return new_contact_state(n_joints, n_tendons)


@formula(formulas.middle, Hinges, ContactJoints)
def middle(chain, i):
    """The rest angle of a joint, or the limit nearest to it."""
    return min(max(chain.joints[i, 2], chain.joints[i, 0]), chain.joints[i, 1])


@formula(formulas.load_columns, Hinges, ContactJoints)
def load_columns(chain):
    """Number of columns of a load table."""
    return N_COLUMNS


@formula(formulas.stiffness_columns, Hinges, ContactJoints)
def stiffness_columns(chain):
    """Columns of the stiffnesses of springs."""
    return STIFFNESSES


@formula(formulas.solve, Hinges, ContactJoints, SpatialWalled)
def solve(chain, law, loads, start, state):
    """Equilibrium from joint angles `start`; fills the state; returns (status, iterations, residual, escapes)."""
    conservative = has_potential(chain, loads)
    n = long_joints(start.size, conservative)
    sweep = new_sweep(n, formulas.generator_columns(chain, loads) + law.low.size)
    H = np.empty((start.size - n, start.size - n))
    begin(chain, start, state.angle)
    status, count, worst, escapes = _descend(chain, law, loads, conservative, state, H, sweep)
    if status >= UNSTABLE and not conservative:
        begin(chain, start, state.angle)
        count += relax(chain, law, loads, state, H, sweep)
        status, more, worst, escapes = _descend(chain, law, loads, conservative, state, H, sweep)
        count += more
    if status >= UNSTABLE and not formulas.is_among_walls(chain):  # from the rest pose, which may be beyond a wall
        scratch = np.empty((3, law.low.size)), np.empty(loads.shape)
        status, more, worst, escapes = _grow(chain, law, loads, conservative, state, H, sweep, *scratch)
        count += more
    if status >= UNSTABLE and conservative and most_descent_steps(start.size) > 0:
        how = chain, conservative, MOST_ESCAPES, MAX_ITERATIONS, True
        status, more, worst = settle(*how, law, loads, start, state, H, sweep)
        count += more
        aside = np.empty(start.size)
        for way in range(_WAYS_ASIDE):
            if status < UNSTABLE:
                break
            _step_aside(state.angle, way, aside)
            status, more, worst = settle(*how, law, loads, aside, state, H, sweep)
            count += more
    return status, count, worst, escapes


@part
def _step_aside(angle, way, aside):
    """Fill a start near the angles, with another offset in every hinge: equal hinges meet saddles together."""
    for i in range(angle.size):
        aside[i] = angle[i] + _ASIDE * math.sin((way + 1.0) * (i + 1.0))


@formula(formulas.solve_step, Hinges, ContactJoints, SpatialWalled)
def solve_step(chain, friction, before, law, loads, start, state, memory):
    """The step with friction; fills the state and the memory (rubbed_chain); returns as `solve`."""
    conservative, n = has_potential(chain, loads) and not formulas.rubs_at_walls(chain), start.size
    columns = formulas.generator_columns(chain, loads) + law.low.size
    angles, step, free = np.empty(n), np.empty(n), np.ones(n, np.bool_)
    for i in range(n):
        angles[i] = start[i]
    count, escapes = 0, 0
    while True:
        how = conservative, 0, columns
        status, iterations, worst = settle_rubbed(chain, friction, before, *how, law, loads, angles, state, memory)
        count += iterations
        if status != UNSTABLE or not conservative or escapes == MOST_ESCAPES:
            break
        space = np.empty(jacobian_size(n, 0, columns, columns))
        if not _escape_rubbed(chain, before, memory, space, columns, law, loads, state, free, step, angles):
            break
        for i in range(n):
            angles[i] = state.angle[i]
        escapes += 1
    return status, count, worst, escapes


@part
def _escape_rubbed(chain, before, memory, space, columns, law, loads, state, free, step, angles):
    """_escape of the chain with friction; space: memory of its Jacobian."""
    jacobian = pointed(jacobian_in(borrow(space), state.angle.size, 0, columns, columns))
    return _escape(rubbed(chain, before, memory, jacobian, True), law, loads, state, free, step, angles)


@formula(formulas.store, Hinges)
def store(chain, state, outcome, results, lane):
    """Copy a solved state and its outcome into the results."""
    _store_state(state, outcome, results, lane)


@formula(formulas.store, ContactJoints)
def store_with_contacts(chain, state, outcome, results, lane):
    """Copy a solved state, its contacts and its outcome into the results."""
    _store_state(state, outcome, results, lane)
    for i in range(state.angle.size):
        for a in range(3):
            results.contacts[lane, i, a] = state.contact[i, a]
        _fill_reaction(chain, state, state.tension, i, results.reactions[lane, i])


@part(inline=True)
def _store_state(state, outcome, results, lane):
    for i in range(state.angle.size):
        results.joint_angles[lane, i] = state.angle[i]
        for j in range(state.length.size):
            results.rates[lane, i, j] = state.gap[i, j, 1]
            results.torques[lane, i, j] = formulas.torque(state, i, j)
    store_poses(state, results.poses, lane)
    for j in range(state.length.size):
        results.tensions[lane, j], results.lengths[lane, j] = state.tension[j], state.length[j]
        results.elastic[lane, j] = state.elastic[j]
    results.status[lane], results.iterations[lane], results.residual[lane], results.escapes[lane] = outcome


@part
def _fill_reaction(chain, state, tension, i, reaction):
    """`fill_reaction` under all loads beyond the joint."""
    beyond = load_force(state, i), load_moment(state, i)
    fill_reaction(chain.frames, chain.offsets, chain.holes, chain.tendon_joints, state, tension, *beyond, i, reaction)


@kernel(short_loops=True, title="the reactions of hinges")
def reactions_of(chain, designs, tensions, loads, angles, reactions):
    """Fill reactions, (B, J, 6), at joint angles (B, J) under tensions in the gaps, (B, J, m)."""
    state = new_contact_state(angles.shape[1], chain.tendon_joints.size)
    for lane in range(angles.shape[0]):
        mechanism = design(chain, designs[lane])
        for i in range(angles.shape[1]):
            state.angle[i] = angles[lane, i]
        formulas.evaluate_geometry(mechanism, state)
        formulas.evaluate_loads(mechanism, borrow(loads[lane]), state)
        for i in range(angles.shape[1]):
            _fill_reaction(mechanism, state, tensions[lane, i], i, reactions[lane, i])


@formula(formulas.store_friction, ContactJoints)
def store_friction_of_contacts(chain, state, memory, results, lane):
    """Copy the torques per tension at the motors, and reactions under the tensions left in the gaps."""
    _store_torques(chain, state, memory, results, lane)
    for i in range(state.angle.size):
        _fill_reaction(chain, state, memory.now.tension[i], i, results.reactions[lane, i])


@formula(formulas.store_friction, Hinges)
def store_friction(chain, state, memory, results, lane):
    """Copy the torques per tension at the motors, which friction reduces."""
    _store_torques(chain, state, memory, results, lane)


@part(inline=True)
def _store_torques(chain, state, memory, results, lane):
    for i in range(state.angle.size):
        for j in range(state.tension.size):
            if i < chain.tendon_joints[j]:
                results.torques[lane, i, j] = memory.now.lever[i, j] * memory.now.passed[i, j]
