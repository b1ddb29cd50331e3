"""A chain with friction: the formulas of its class and, on top of them, the terms of friction.

Newton's method runs on it as on any chain. Residual r and Jacobian A = dr/dangle are exact but for one term: how the
normal forces between the links change as tendons, loads and contacts turn, where there is rolling resistance. A is not
symmetric. The line search goes by the incremental potential, whose gradient is r as long as the grips of the holes are
held at their values where the search begins (`renew`). Source: docs/theory.md, section 9.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from rollingjoint._numba.borrowed import borrow, pointed
from rollingjoint._numba.jit import part
from rollingjoint._numba.layout import Floats
from rollingjoint._numba.pins import carve_tuple, size_of
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import INDETERMINATE, NOT_CONVERGED, UNSTABLE
from rollingjoint.kernels.bounds import begin, moved
from rollingjoint.kernels.descent import most_descent_steps, relax
from rollingjoint.kernels.formulas import formula
from rollingjoint.kernels.friction import (
    ARM,
    COMPLIANCE,
    CONSTANT,
    MU,
    N_COEFFICIENTS,
    PRESLIDING,
    ROLLING_PRESLIDING,
    FrictionLaw,
    History,
    Rubbing,
    evaluate_holes,
    evaluate_slips,
    evaluated_energy,
    freeze,
    friction_energy,
    overshoots_kink,
    slide,
    tension_rate,
    work_per_grip,
)
from rollingjoint.kernels.linear import descent_step, downhill_step
from rollingjoint.kernels.long_chain import Sweep, SweepSizes, new_sweep
from rollingjoint.kernels.long_lu import LongLu, LongLuSizes, lu_long_step
from rollingjoint.kernels.newton import MAX_ITERATIONS, classify, minimise
from rollingjoint.kernels.settle import long_joints, settle

_FEW_ITERATIONS = 40
_SOFTER = (64.0, 16.0, 4.0, 1.0)  # multiples of the presliding on the way to a step that fails


class RollingResistance(NamedTuple):
    """Rolling resistance evaluated at one configuration."""

    states: Annotated[Floats, "J"]
    pressing: Annotated[Floats, "J"]  # normal force between the links, 0 where they separate [N]
    frozen: Annotated[Floats, "J"]  # likewise, where the line search began
    per_tension: Annotated[Floats, "J", "m"]  # d normal force / d tension of the gap
    of_loads: Annotated[Floats, "J"]  # normal force of the loads


class Rubbed(NamedTuple):
    """A chain with friction, its history, and the quantities of friction at the State's configuration."""

    chain: Any
    joints: Floats  # of the chain
    law: FrictionLaw
    before: History
    now: Rubbing
    rolling: RollingResistance
    A: Floats  # (J, J) Jacobian of short chains
    base: Sweep  # generators of the chain
    lu: LongLu
    in_holes: bool  # whether there is friction in the chain itself, not at walls alone
    symmetric: bool  # whether H is to be the symmetric part of A: where the loads have a potential


class StepFriction(NamedTuple):
    """Friction evaluated in a step, and the coefficients in use, which a softer presliding may have replaced."""

    law: FrictionLaw
    now: Rubbing
    rolling: RollingResistance


class StepFrictionSizes(NamedTuple):
    """Lengths of the axes of StepFriction."""

    J: int
    m: int


class Jacobian(NamedTuple):
    """Memory of the Jacobian of a step, dense or of the generators of a long chain; the other part is empty."""

    A: Annotated[Floats, "D", "D"]
    H: Annotated[Floats, "D", "D"]
    base: Sweep  # generators of the chain
    lu: LongLu
    sweep: Sweep  # of the symmetric part


class _DenseSizes(NamedTuple):
    """Lengths of the axes of the dense part of a Jacobian."""

    D: int


class _Dense(NamedTuple):
    A: Annotated[Floats, "D", "D"]
    H: Annotated[Floats, "D", "D"]


@part
def lower_columns(law, columns):
    """Number of generators below the diagonal; columns: of the chain without friction."""
    for j in range(law.tendons.shape[0]):
        if law.tendons[j, COMPLIANCE] != 0.0 or law.tendons[j, CONSTANT] != 0.0:
            return columns + 2 * law.tendons.shape[0]
    return columns


@part
def jacobian_size(n_dense, n_long, lower, columns):
    """Count of numbers in a Jacobian."""
    dense, lu = size_of(_Dense, _DenseSizes(n_dense)), size_of(LongLu, LongLuSizes(n_long, lower, columns))
    sweeps = size_of(Sweep, SweepSizes(n_long, columns)) + size_of(Sweep, SweepSizes(n_long, lower + columns))
    return dense + lu + sweeps


@part
def jacobian_in(memory, n_dense, n_long, lower, columns):
    """A Jacobian in borrowed memory of `jacobian_size`."""
    dense_sizes, lu_sizes = _DenseSizes(n_dense), LongLuSizes(n_long, lower, columns)
    base_sizes, sweep_sizes = SweepSizes(n_long, columns), SweepSizes(n_long, lower + columns)
    dense, at = carve_tuple(memory, 0, _Dense, dense_sizes), size_of(_Dense, dense_sizes)
    base, at = carve_tuple(memory, at, Sweep, base_sizes), at + size_of(Sweep, base_sizes)
    lu, at = carve_tuple(memory, at, LongLu, lu_sizes), at + size_of(LongLu, lu_sizes)
    return Jacobian(dense.A, dense.H, base, lu, carve_tuple(memory, at, Sweep, sweep_sizes))


@part(inline=True)
def rubbed(chain, before, memory, jacobian, symmetric):
    """The chain with friction; jacobian: pointed."""
    law, now, rolling, in_holes = memory.law, memory.now, memory.rolling, rubs_in_holes(chain, memory.law)
    A, base, lu = jacobian.A, jacobian.base, jacobian.lu
    return Rubbed(chain, chain.joints, law, before, now, rolling, A, base, lu, in_holes, symmetric)


@part
def rubs_in_holes(chain, law):
    """Whether there is friction in the chain itself; a chain without walls has a history for nothing else."""
    if not formulas.is_among_walls(chain) or law.rolling[ARM] > 0.0:
        return True
    for j in range(law.tendons.shape[0]):
        if law.tendons[j, MU] > 0.0 or law.tendons[j, COMPLIANCE] > 0.0 or law.tendons[j, CONSTANT] > 0.0:
            return True
    return False


@formula(formulas.evaluate, Rubbed)
def evaluate(chain, law, loads, state):
    """Fill the state at its angles; returns (incremental potential, magnitude of its terms, force scale)."""
    state, before, now, rolling = borrow(state), borrow(chain.before), borrow(chain.now), borrow(chain.rolling)
    coefficients, tendon_joints = borrow(chain.law.tendons), borrow(chain.chain.tendon_joints)
    energy, magnitude, scale = formulas.evaluate(chain.chain, law, loads, state)
    if not chain.in_holes:
        return energy, magnitude, scale
    formulas.fill_turns(chain.chain, state, now.turn)
    evaluate_slips(coefficients, tendon_joints, state, now)
    evaluate_holes(coefficients, before, tendon_joints, state, now)
    if chain.law.rolling[ARM] > 0.0:
        _evaluate_rolling(chain, state)
        for i in range(state.angle.size):
            per_pressing = _rolling_work(chain.law, before, rolling, state, i)
            term = chain.law.rolling[ARM] * rolling.frozen[i] * per_pressing
            energy, magnitude = energy + term, magnitude + abs(term)
            state.residual[i] += chain.law.rolling[ARM] * rolling.of_loads[i] * rolling.states[i]
    for j in range(tendon_joints.size):
        for i in range(tendon_joints[j]):
            state.residual[i] += now.tension[i, j] * now.lever[i, j] - state.tension[j] * state.gap[i, j, 1]
    term, size = friction_energy(coefficients, before, tendon_joints, state, now, now.frozen, now.frozen_tension)
    return energy + term, magnitude + size, scale


@part
def _rolling_work(law, before, rolling, state, i):
    """Work against the rolling resistance of a joint, per newton of normal force and millimetre of its arm."""
    way = state.angle[i] - before.angles[i]
    return work_per_grip(-before.rolling[i], -rolling.states[i], way, law.rolling[ROLLING_PRESLIDING])


@part
def _evaluate_rolling(chain, state):
    """Fill the rolling resistance, and the levers with its share; a joint with separated links has none."""
    before, now, rolling, tendon_joints = chain.before, chain.now, chain.rolling, chain.chain.tendon_joints
    arm, presliding = chain.law.rolling[ARM], chain.law.rolling[ROLLING_PRESLIDING]
    formulas.fill_normals(chain.chain, state, rolling)
    for i in range(state.angle.size):
        rolling.states[i] = -slide(-before.rolling[i], state.angle[i] - before.angles[i], presliding)
        force = rolling.of_loads[i]
        for j in range(tendon_joints.size):
            if i < tendon_joints[j]:
                force += now.tension[i, j] * rolling.per_tension[i, j]
        rolling.pressing[i] = max(force, 0.0)
        if force <= 0.0:
            rolling.of_loads[i] = 0.0
            continue
        for j in range(tendon_joints.size):
            if i < tendon_joints[j]:
                now.lever[i, j] += arm * rolling.states[i] * rolling.per_tension[i, j]


@formula(formulas.renew, Rubbed)
def renew(chain, state, energy, magnitude):
    """(incremental potential, magnitude) with grips and tensions frozen at the present state."""
    state, before, now, rolling = borrow(state), borrow(chain.before), borrow(chain.now), borrow(chain.rolling)
    coefficients, tendon_joints = borrow(chain.law.tendons), borrow(chain.chain.tendon_joints)
    energy, magnitude = formulas.renew(chain.chain, state, energy, magnitude)
    if not chain.in_holes:
        return energy, magnitude
    old, _ = friction_energy(coefficients, before, tendon_joints, state, now, now.frozen, now.frozen_tension)
    freeze(tendon_joints, state, now)
    new, _ = friction_energy(coefficients, before, tendon_joints, state, now, now.frozen, now.frozen_tension)
    if chain.law.rolling[ARM] > 0.0:
        for i in range(state.angle.size):
            per_pressing = _rolling_work(chain.law, before, rolling, state, i)
            new += chain.law.rolling[ARM] * (rolling.pressing[i] - rolling.frozen[i]) * per_pressing
            rolling.frozen[i] = rolling.pressing[i]
    return energy + (new - old), magnitude + abs(new - old)


@formula(formulas.shorten, Rubbed)
def shorten(chain, state, step, is_newtons):
    """Shorten a step that would move the chain too far."""
    return formulas.shorten(chain.chain, state, step, is_newtons)


@formula(formulas.rubs_at_walls, Rubbed)
def rubs_at_walls(chain):
    """Whether any wall in space rubs in this solve."""
    return formulas.rubs_at_walls(chain.chain)


@formula(formulas.overshoots, Rubbed)
def overshoots(chain, slope, new_slope):
    """Whether a step ends too far beyond the minimum along it."""
    return overshoots_kink(slope, new_slope)


@part
def _rolling_stiffness(chain, state, i):
    """Stiffness of a joint against turning while its rolling resistance builds up [N·mm/rad]."""
    arm, presliding = chain.law.rolling[ARM], chain.law.rolling[ROLLING_PRESLIDING]
    if arm > 0.0 and abs(chain.rolling.states[i]) < 1.0:
        return arm * chain.rolling.pressing[i] / presliding
    return 0.0


@formula(formulas.stiffness, Rubbed)
def stiffness(chain, loads, state, H):
    """Fill A, and H with A or its symmetric part."""
    state, H, A, now = borrow(state), borrow(H), borrow(chain.A), borrow(chain.now)
    tendon_joints, n_joints = borrow(chain.chain.tendon_joints), state.angle.size
    formulas.stiffness(chain.chain, loads, state, A)
    if chain.in_holes:
        for j in range(tendon_joints.size):
            for i in range(tendon_joints[j]):
                _add_tension_rates(state, now, i, j, tendon_joints[j], A)
                A[i, i] += (now.tension[i, j] - state.tension[j]) * state.gap[i, j, 2]
        for i in range(n_joints):
            A[i, i] += _rolling_stiffness(chain, state, i)
    for i in range(n_joints):
        for m in range(n_joints):
            H[i, m] = 0.5 * (A[i, m] + A[m, i]) if chain.symmetric else A[i, m]


@part(inline=True)
def _add_tension_rates(state, now, i, j, count, A):
    """Add a tendon's terms with friction (`tension_rate`) to row i, less its stretch term without friction."""
    lever, carried, stretch = now.lever[i, j], now.carried[i, j], state.elastic[j] * now.passed[i, j]
    pull = state.elastic[j] * state.gap[i, j, 1]
    for m in range(i):
        rate = state.gap[m, j, 1]
        slipping = carried * (now.give[m, j] * rate - now.bend[m, j, 1]) + now.flat[m, j] * rate
        A[i, m] += lever * (stretch * rate + slipping) - pull * rate
    per_rate = lever * (stretch + carried * now.give[i, j] + now.flat[i, j]) - pull
    for m in range(i, count):
        A[i, m] += per_rate * state.gap[m, j, 1]
    A[i, i] -= lever * carried * now.bend[i, j, 0]


@formula(formulas.fill_generators, Rubbed)
def fill_generators(chain, loads, state, prox, sweep):
    """Fill the generators of A, and in the Sweep the generators of its symmetric part."""
    state, now, base, lu, sweep = borrow(state), borrow(chain.now), borrow(chain.base), borrow(chain.lu), borrow(sweep)
    n_joints, columns, width = state.angle.size, base.U.shape[1], lu.U.shape[1]
    elastic = np.empty(state.elastic.size)
    for j in range(elastic.size if chain.in_holes else 0):
        elastic[j], state.elastic[j] = state.elastic[j], 0.0
    formulas.fill_generators(chain.chain, loads, state, prox, base)
    formulas.fill_upper_generators(chain.chain, state, base.U, lu.Q)
    for j in range(elastic.size if chain.in_holes else 0):
        state.elastic[j] = elastic[j]
    first = columns - elastic.size
    for i in range(n_joints):
        for a in range(columns):
            lu.U[i, a], lu.V[i, a], lu.P[i, a] = base.U[i, a], base.V[i, a], base.V[i, a]
        sweep.diagonal[i] = base.diagonal[i] + (_rolling_stiffness(chain, state, i) if chain.in_holes else 0.0)
        for j in range(elastic.size if chain.in_holes else 0):
            sweep.diagonal[i] += _fill_tendon_columns(
                chain.chain.tendon_joints[j], state, now, lu, i, j, first, columns
            )
        for a in range(width):
            sweep.U[i, a], sweep.V[i, a] = 0.5 * lu.U[i, a], lu.V[i, a]
        for a in range(columns):
            sweep.U[i, width + a], sweep.V[i, width + a] = 0.5 * lu.Q[i, a], lu.P[i, a]


@part
def _fill_tendon_columns(crossed, state, now, lu, i, j, first, columns):
    """Fill the generators of one tendon at joint i; returns its term on the diagonal."""
    split, a, b = lu.U.shape[1] > columns, first + j, columns + 2 * j
    lu.U[i, a] = lu.V[i, a] = lu.P[i, a] = lu.Q[i, a] = 0.0
    if split:
        lu.U[i, b] = lu.V[i, b] = lu.U[i, b + 1] = lu.V[i, b + 1] = 0.0
    if i >= crossed:
        return 0.0
    lever, rate, motor = now.lever[i, j], state.gap[i, j, 1], state.tension[j]
    carried, stretch = now.carried[i, j], state.elastic[j] * now.passed[i, j]
    own_rate = now.give[i, j] * rate - now.bend[i, j, 1]
    lu.P[i, a], lu.Q[i, a] = lever * (stretch + carried * now.give[i, j] + now.flat[i, j]), rate
    if split:
        lu.U[i, a], lu.V[i, a] = lever * carried, own_rate
        lu.U[i, b], lu.V[i, b] = lever * stretch, rate
        lu.U[i, b + 1], lu.V[i, b + 1] = lever, now.flat[i, j] * rate
    else:  # stretch and carried tension are both multiples of the tension that passes the holes
        lu.U[i, a], lu.V[i, a] = lever * now.passed[i, j], state.elastic[j] * rate + motor * own_rate
    return lever * tension_rate(state, now, i, i, j) + (now.tension[i, j] - motor) * state.gap[i, j, 2]


@formula(formulas.direction, Rubbed)
def direction(chain, H, sweep, free, residual, L, step):
    """Newton's step on A; where it does not descend, with |eigenvalues| of A's symmetric part, or a shift."""
    if sweep.diagonal.size > 0:
        lu_long_step(chain.lu, sweep, free, residual, step)
        return
    for i in range(free.size):
        chain.A[i, i] = H[i, i]  # with the proximal term
    if not downhill_step(chain.A, free, residual, L, step):
        descent_step(H, free, residual, L, step)


@formula(formulas.reconsider, Rubbed)
def reconsider(chain, loads, state, free, kind):
    """By the eigenvalues of A: the pose can be stable although A's symmetric part is not positive definite."""
    n = state.angle.size
    A = np.empty((n, n))
    law, now, rolling = chain.law, chain.now, chain.rolling
    where = chain.in_holes, False
    dense = Rubbed(chain.chain, chain.joints, law, chain.before, now, rolling, A, chain.base, chain.lu, *where)
    formulas.stiffness(dense, loads, state, A)
    return classify(A, new_sweep(0, 0), free, np.empty((n, n)))


@part
def settle_rubbed(chain, friction, before, conservative, most_escapes, columns, law, loads, start, state, memory):
    """The step with friction from its history, begun at joint angles `start`; returns as `settle`.

    Where it fails, Newton's method goes by the magnitude of the residual, then the step is solved with a softer
    presliding first, then by the slow descent: only the way to the equilibrium differs.
    """
    n_joints, n = start.size, long_joints(start.size, conservative)
    _soften(friction, 1.0, memory.law)
    lower = lower_columns(memory.law, columns)
    own = np.empty(jacobian_size(n_joints - n, n, lower, columns))
    dense = own if n == 0 else np.empty(jacobian_size(n_joints, 0, lower, columns))
    sizes = n, lower, columns
    how = conservative, most_escapes, law, loads, start, state, memory
    return _settle_rubbed(chain, friction, before, own, dense, sizes, *how)


@part
def _settle_rubbed(
    chain, friction, before, own, dense, sizes, conservative, most_escapes, law, loads, start, state, memory
):
    """settle_rubbed in the memory of the Jacobians of Newton's method, and of its fallbacks, which are dense."""
    n, lower, columns = sizes
    own = pointed(jacobian_in(borrow(own), start.size - n, n, lower, columns))
    dense = pointed(jacobian_in(borrow(dense), start.size, 0, lower, columns))
    formulas.soften(chain, 1.0)
    friction_chain = rubbed(chain, before, memory, own, conservative)
    how = friction_chain, conservative, most_escapes, _patience(friction), False
    status, count, worst = settle(*how, law, loads, start, state, own.H, own.sweep)
    if status == NOT_CONVERGED and conservative:
        outcome = _by_residual(chain, before, memory, dense, law, loads, start, state)
        count += outcome[1]
        if outcome[0] < UNSTABLE:
            return outcome[0], count, outcome[2]
        if formulas.is_among_walls(chain):
            outcome = _relaxed(chain, before, memory, dense, law, loads, start, state)
            count += outcome[1]
            if outcome[0] < UNSTABLE:
                return outcome[0], count, outcome[2]
    if status == NOT_CONVERGED:
        begin(friction_chain, start, state.angle)
        for softness in _SOFTER:
            _soften(friction, softness, memory.law)
            formulas.soften(chain, softness)
            how = friction_chain, law, loads, conservative, most_escapes, MAX_ITERATIONS
            status, iterations, worst = minimise(*how, 0.0, start, state, own.H, own.sweep)
            count += iterations
    follows = conservative or formulas.rubs_at_walls(chain)  # where a contact at a round end is lost, a chain snaps off
    if status == NOT_CONVERGED and follows and most_descent_steps(start.size) > 0:
        how = rubbed(chain, before, memory, dense, conservative), conservative, most_escapes, MAX_ITERATIONS, True
        status, iterations, worst = settle(*how, law, loads, start, state, dense.H, dense.sweep)
        count += iterations
    return status, count, worst


@part
def _patience(friction):
    """Iterations of Newton's method on the incremental potential: under constant friction forces it may cycle."""
    for j in range(friction.tendons.shape[0]):
        if friction.tendons[j, CONSTANT] > 0.0:
            return _FEW_ITERATIONS
    return MAX_ITERATIONS


@part
def _by_residual(chain, before, memory, jacobian, law, loads, start, state):
    """The step from its start by Newton's method with a line search on |r|; returns as `minimise`.

    The incremental potential changes with the grips after every search, and constant friction forces that use up a
    tension make it jump; the residual does not. It also leads to unstable equilibria.
    """
    dense = rubbed(chain, before, memory, jacobian, False)
    begin(dense, start, state.angle)
    how = dense, law, loads, False, 0, MAX_ITERATIONS
    return minimise(*how, 0.0, start, state, jacobian.H, jacobian.sweep)


@part
def _relaxed(chain, before, memory, jacobian, law, loads, start, state):
    """The step by the overdamped motion from its start, then by Newton's method on |r|; returns as `minimise`."""
    dense = rubbed(chain, before, memory, jacobian, False)
    begin(dense, start, state.angle)
    count = relax(dense, law, loads, state, jacobian.H, jacobian.sweep)
    how = dense, law, loads, False, 0, MAX_ITERATIONS
    status, iterations, worst = minimise(*how, 0.0, start, state, jacobian.H, jacobian.sweep)
    return status, count + iterations, worst


@part
def _soften(friction, softness, law):
    """Copy the coefficients, the presliding with a factor."""
    for j in range(law.tendons.shape[0]):
        for column in range(N_COEFFICIENTS):
            law.tendons[j, column] = friction.tendons[j, column]
        law.tendons[j, PRESLIDING] *= softness
    law.rolling[ARM] = friction.rolling[ARM]
    law.rolling[ROLLING_PRESLIDING] = softness * friction.rolling[ROLLING_PRESLIDING]


@part
def remember(chain, before, memory, status, state, after):
    """Fill the history after a step; returns the work of friction in it [N·mm].

    Where the pose is indeterminate the friction states stay as they were; without an equilibrium all of it does.
    """
    now, rolling, law = memory.now, memory.rolling, memory.law
    rubs = rubs_in_holes(chain, law)
    stands, holds, work = status <= INDETERMINATE and rubs, status < INDETERMINATE and rubs, 0.0
    if holds:
        _, _, _, work = evaluated_energy(law.tendons, before, chain.tendon_joints, now)
    for i in range(state.angle.size):
        after.angles[i] = state.angle[i] if status <= INDETERMINATE else before.angles[i]
        after.rolling[i] = before.rolling[i]
        if holds and law.rolling[ARM] > 0.0:
            work += law.rolling[ARM] * rolling.pressing[i] * _rolling_work(law, before, rolling, state, i)
            after.rolling[i] = rolling.states[i]
        for j in range(state.tension.size):
            after.slips[i, j] = now.slips[i, j] if stands else before.slips[i, j]
            after.states[i, j] = now.states[i, j] if holds else before.states[i, j]
            after.grips[i, j] = now.grips[i, j] if holds else before.grips[i, j]
    return work


@part
def begin_history(chain, friction, state, memory, history):
    """Fill the history of an evaluated state before any slip."""
    _soften(friction, 1.0, memory.law)
    for i in range(state.angle.size):
        history.rolling[i] = 0.0
        for j in range(state.tension.size):
            history.states[i, j] = 0.0
    _hold(chain, state, memory, history)
    for i in range(state.angle.size):
        for j in range(state.tension.size):
            history.grips[i, j] = memory.now.grips[i, j]


@part
def _hold(chain, state, memory, history):
    """Evaluate the friction of a state reached with the friction states of a history; fill its other fields."""
    formulas.fill_turns(chain, state, memory.now.turn)
    evaluate_slips(memory.law.tendons, chain.tendon_joints, state, memory.now)
    for i in range(state.angle.size):
        history.angles[i] = state.angle[i]
        for j in range(state.tension.size):
            history.slips[i, j] = memory.now.slips[i, j]
    evaluate_holes(memory.law.tendons, history, chain.tendon_joints, state, memory.now)


@part
def rubbed_stiffness(chain, friction, loads, state, memory, history, A, torques):
    """Fill A, and d residual / d tension at the motor, (J, m), at an evaluated state.

    The state is the one that left this history, or another one, which a step from this history did not bring to rest.
    """
    _soften(friction, 1.0, memory.law)
    space = np.empty(jacobian_size(state.angle.size, 0, 0, 0))
    _fill_stiffness(chain, friction, loads, state, memory, history, space, A, torques)


@part
def _fill_stiffness(chain, friction, loads, state, memory, history, space, A, torques):
    """rubbed_stiffness with its scratch space."""
    jacobian = pointed(jacobian_in(borrow(space), state.angle.size, 0, 0, 0))
    friction_chain = rubbed(chain, history, memory, jacobian, False)
    if not friction_chain.in_holes:
        formulas.stiffness(chain, loads, state, A)
        for i in range(state.angle.size):
            for j in range(state.tension.size):
                torques[i, j] = state.gap[i, j, 1] if i < chain.tendon_joints[j] else 0.0
        return
    if moved(state.angle, history.angles):
        formulas.fill_turns(chain, state, memory.now.turn)
        evaluate_slips(memory.law.tendons, chain.tendon_joints, state, memory.now)
        evaluate_holes(memory.law.tendons, history, chain.tendon_joints, state, memory.now)
    else:
        _hold(chain, state, memory, history)
    if friction.rolling[ARM] > 0.0:
        _evaluate_rolling(friction_chain, state)
    formulas.stiffness(friction_chain, loads, state, A)
    for i in range(state.angle.size):
        for j in range(state.tension.size):
            torques[i, j] = memory.now.lever[i, j] * memory.now.passed[i, j] if i < chain.tendon_joints[j] else 0.0
