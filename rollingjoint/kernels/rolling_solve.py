"""One equilibrium of a planar chain from one start, one step with friction, and where their results go."""

from __future__ import annotations

import numpy as np

from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import UNSTABLE
from rollingjoint.kernels.descent import most_descent_steps
from rollingjoint.kernels.formulas import formula
from rollingjoint.kernels.long_chain import new_sweep
from rollingjoint.kernels.newton import MAX_ITERATIONS
from rollingjoint.kernels.planar_loads import N_COLUMNS, STIFFNESSES, has_potential
from rollingjoint.kernels.rolling import Chain, contact_forces, new_state
from rollingjoint.kernels.rubbed_chain import settle_rubbed
from rollingjoint.kernels.settle import MOST_ESCAPES, long_joints, settle
from rollingjoint.kernels.walled_chain import Walled


@formula(formulas.new_state, Chain)
def state_of(chain, n_joints, n_tendons):
    """An empty State."""
    return new_state(n_joints, n_tendons)


@formula(formulas.middle, Chain)
def middle(chain, i):
    """The middle of a joint's angles."""
    return 0.5 * (chain.joints[i, 0] + chain.joints[i, 1])


@formula(formulas.load_columns, Chain)
def load_columns(chain):
    """Number of columns of a load table."""
    return N_COLUMNS


@formula(formulas.stiffness_columns, Chain)
def stiffness_columns(chain):
    """Columns of the stiffnesses of springs."""
    return STIFFNESSES


@formula(formulas.solve, Chain, Walled)
def solve(chain, law, loads, start, state):
    """Equilibrium from joint angles `start`; fills the state; returns (status, iterations, largest free |r|, 0)."""
    conservative = has_potential(chain.standing, loads)
    n = long_joints(start.size, conservative)
    sweep = new_sweep(n, formulas.generator_columns(chain, loads) + law.low.size)
    H = np.empty((start.size - n, start.size - n))
    how = chain, conservative, MOST_ESCAPES, MAX_ITERATIONS, False
    status, count, worst = settle(*how, law, loads, start, state, H, sweep)
    if status < UNSTABLE or most_descent_steps(start.size) == 0:
        return status, count, worst, 0
    how = chain, conservative, MOST_ESCAPES, MAX_ITERATIONS, True
    status, more, worst = settle(*how, law, loads, start, state, H, sweep)
    return status, count + more, worst, 0


@formula(formulas.solve_step, Chain, Walled)
def solve_step(chain, friction, before, law, loads, start, state, memory):
    """The step with friction; fills the state and the memory (rubbed_chain); returns as `solve`."""
    columns = formulas.generator_columns(chain, loads) + law.low.size
    conservative = has_potential(chain.standing, loads)
    how = conservative, MOST_ESCAPES, columns
    status, count, worst = settle_rubbed(chain, friction, before, *how, law, loads, start, state, memory)
    return status, count, worst, 0


@formula(formulas.store, Chain)
def store(chain, state, outcome, results, lane):
    """Copy a solved state and its outcome into the results."""
    for i in range(state.angle.size):
        results.joint_angles[lane, i] = state.angle[i]
        if results.contacts.shape[0] > 0:
            along, across, ex, ey = contact_forces(chain.tendon_joints, state, state.tension, i)
            results.contact_forces[lane, i, 0], results.contact_forces[lane, i, 1] = along, across
            results.contacts[lane, i, 0], results.contacts[lane, i, 1] = state.contact[i, 0], state.contact[i, 1]
            results.contacts[lane, i, 2], results.contacts[lane, i, 3] = ex, ey
            for j in range(state.tension.size):
                results.rates[lane, i, j] = state.gap[i, j, 1]
        if results.responses.shape[0] > 0:
            for j in range(state.tension.size):
                results.responses[lane, i, j] = 0.0
    for i in range(state.angle.size + 1):
        for k in range(3):
            results.poses[lane, i, k] = state.pose[i, k]
    for j in range(state.tension.size):
        results.tensions[lane, j], results.lengths[lane, j] = state.tension[j], state.length[j]
        results.elastic[lane, j] = state.elastic[j]
    results.status[lane], results.iterations[lane], results.residual[lane], _ = outcome


@formula(formulas.store_friction, Chain)
def store_friction(chain, state, memory, results, lane):
    """Contact forces under the tensions that friction has left in the gaps."""
    if results.contacts.shape[0] > 0:
        for i in range(state.angle.size):
            along, across, _, _ = contact_forces(chain.tendon_joints, state, memory.now.tension[i], i)
            results.contact_forces[lane, i, 0], results.contact_forces[lane, i, 1] = along, across
