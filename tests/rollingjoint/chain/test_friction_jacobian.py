"""Derivatives of steps with friction: Jacobian and potential of the solver, sensitivities, and long chains."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from rollingjoint import (
    BodyWrench,
    CapstanFriction,
    Gravity,
    InvalidInput,
    Spring,
    Status,
    TorsionSpring,
    WorldForce,
    five_link,
    solve_lengths,
    solve_tensions,
    two_segment,
    uniform,
)
from rollingjoint._numba.jit import standalone
from rollingjoint.chain.random_chain import random_chain, random_loads
from rollingjoint.kernels import long_chain, long_lu, planar_loads, rolling, rubbed_chain
from rollingjoint.kernels.arrays import TendonLaw
from rollingjoint.kernels.friction import FrictionLaw, History, Rubbing
from rollingjoint.kernels.rubbed_chain import Jacobian, RollingResistance, StepFriction
from rollingjoint.load import LOAD_COLUMNS, load_table
from rollingjoint.statics import sensitivity

LIMITS = (0.5, 15.0)
STEP = 1e-6
new_state, one_design = standalone(rolling.new_state), standalone(rolling.design)
generator_columns = standalone(planar_loads.generator_columns)
new_sweep, factor = standalone(long_chain.new_sweep), standalone(long_chain.factor)
rubbed, lower_columns = standalone(rubbed_chain.rubbed), standalone(rubbed_chain.lower_columns)
evaluate, renew = standalone(rubbed_chain.evaluate), standalone(rubbed_chain.renew)
stiffness, fill_generators = standalone(rubbed_chain.stiffness), standalone(rubbed_chain.fill_generators)
factor_lu, substitute_lu = standalone(long_lu.factor_lu), standalone(long_lu.substitute_lu)


class Moment:
    """A random chain with friction at a moment of a step, some holes stuck and some sliding."""

    def __init__(self, rng, friction, loads, chain=None, low=0.0):
        chain = (chain or random_chain(rng)).replace(friction=friction)
        self.n, self.m = n, m = chain.n_joints, chain.n_tendons
        self.loads, self.state = load_table(loads(rng, chain.n_links), chain.n_links), new_state(n, m)
        ends = chain.joint_limits[np.arange(n), rng.integers(0, 2, n)]
        self.angles = chain.joint_angles(rng.uniform(0.2, 0.7, n) * ends)
        command = chain.tendon_lengths(self.angles) - rng.uniform(0.2, 2.0, m)
        self.law = TendonLaw(command, chain.stiffnesses.copy(), np.full(m, low), np.full(m, 1e3))
        self.one = one_design(chain.arrays, 0)
        hole, joint = partial(np.zeros, (n, m)), partial(np.zeros, n)
        per_hole = [hole() for _ in range(9)]
        now = Rubbing(np.zeros((n, m, 4)), *per_hole, np.zeros((n, m, 2)), hole(), np.zeros(m))
        law = FrictionLaw(chain.friction_coefficients.copy(), chain.rolling_coefficients.copy())
        self.memory = StepFriction(law, now, RollingResistance(joint(), joint(), joint(), hole(), joint()))
        angles = self.angles + rng.normal(0.0, 5e-4, n)
        self.before = History(rng.uniform(-1.0, 1.0, (n, m)), hole(), hole(), angles, rng.uniform(-1.0, 1.0, n))
        self.chain = self.with_friction(0)
        self.at(self.angles)
        self.before.slips[:] = now.slips + rng.normal(0.0, 1.0, (n, m)) * law.tendons[:, 1]

    def with_friction(self, n_long):
        columns = self.m + generator_columns(np.zeros((0, len(LOAD_COLUMNS))), self.loads)
        lower, dense = lower_columns(self.memory.law, columns), np.empty((self.n - n_long, self.n - n_long))
        p, q = (n_long, lower), (n_long, columns)
        lu = long_lu.LongLu(*map(np.zeros, (p, p, q, q, p, q, n_long)))
        sweeps = new_sweep(n_long, columns), new_sweep(n_long, lower + columns)
        jacobian = Jacobian(dense, dense.copy(), sweeps[0], lu, sweeps[1])
        return rubbed(self.one, self.before, self.memory, jacobian, False)

    def at(self, angles, afresh=True):
        """Potential, with what line searches hold constant as it was or (afresh) as it is here, and residual."""
        self.state.angle[:] = angles
        energy, magnitude, _ = evaluate(self.chain, self.law, self.loads, self.state)
        if afresh:
            energy, _ = renew(self.chain, self.state, energy, magnitude)
        return energy, self.state.residual.copy()

    def jacobian(self):
        """A, evaluated, and by central differences."""
        exact, numeric = np.empty((self.n, self.n)), np.empty((self.n, self.n))
        for i, along in enumerate(STEP * np.eye(self.n)):
            numeric[:, i] = (self.at(self.angles + along)[1] - self.at(self.angles - along)[1]) / (2 * STEP)
        self.at(self.angles)
        stiffness(self.chain, self.loads, self.state, exact)
        return exact, numeric

    def gradient(self):
        """Residual, and the gradient of the potential that a line search from here goes by."""
        _, residual = self.at(self.angles)
        ways = STEP * np.eye(self.n)
        rises = [self.at(self.angles + way, False)[0] - self.at(self.angles - way, False)[0] for way in ways]
        return residual, np.array(rises) / (2 * STEP)


def no_loads(rng, n_links):
    return []


def dead_and_follower_loads(rng, n_links):
    return random_loads(rng, n_links, follower=True)


def springs(rng, n_links):
    return [Spring(-1, 0.1, (10.0, 60.0)), TorsionSpring(-1, 20.0, 0.1)]


ALL = {"constant": 0.02, "compliance": 0.05, "extra_turn": 0.1}
KINDS = {
    "friction": (CapstanFriction(0.15), no_loads),
    "loads": (CapstanFriction(0.1), dead_and_follower_loads),
    "springs": (CapstanFriction(0.1), springs),
    "constant force, stretch and turn": (CapstanFriction(0.1, **ALL), no_loads),
}
ROLLING = {"rolling": (CapstanFriction(0.1, rolling=0.1), no_loads)}  # its Jacobian leaves out a small term


@pytest.mark.slow
@pytest.mark.parametrize("friction, loads", KINDS.values(), ids=KINDS)
def test_the_jacobian_is_the_derivative_of_the_residual(friction, loads):
    rng = np.random.default_rng(3)
    sticking, asymmetry = [], 0.0
    for _ in range(8):
        moment = Moment(rng, friction, loads)
        exact, numeric = moment.jacobian()
        assert exact == pytest.approx(numeric, rel=0, abs=2e-5 * np.abs(exact).max())
        sticking.append(np.mean(np.abs(moment.memory.now.states) < 1.0))
        asymmetry = max(asymmetry, np.abs(exact - exact.T).max() / np.abs(exact).max())
    assert 0.1 < np.mean(sticking) < 0.9 and asymmetry > 0.01


@pytest.mark.slow
@pytest.mark.parametrize("friction, loads", (KINDS | ROLLING).values(), ids=KINDS | ROLLING)
def test_the_residual_is_the_gradient_of_the_potential_of_a_line_search(friction, loads):
    rng = np.random.default_rng(4)
    for _ in range(6):
        moment = Moment(rng, friction, springs if loads is springs else no_loads)
        residual, gradient = moment.gradient()
        assert residual == pytest.approx(gradient, rel=0, abs=1e-6 * (1.0 + np.abs(residual).max()))


@pytest.mark.parametrize("n", [16, *(pytest.param(n, marks=pytest.mark.slow) for n in (60, 200))])
@pytest.mark.parametrize("coefficients", [{}, {"constant": 0.01, "compliance": 0.02}], ids=["plain", "stretch"])
def test_the_sweep_makes_the_dense_step(n, coefficients):
    rng = np.random.default_rng(n)

    def loads(rng, n_links):
        weight = [1e-4] * n_links
        return [WorldForce(-1, (0.01, 0.02)), Gravity(weight, (1.0, 0.0)), Spring(n_links // 2, 1e-4, (5.0, 9.0))]

    whole = uniform(n)
    chain = whole.replace(tendons=(whole.tendons[0], replace(whole.tendons[1], end=n // 2)))
    moment = Moment(rng, CapstanFriction(0.1, **coefficients), loads, chain, low=1.0)
    joints, small = n - 1, 0.1 * rng.normal(0.0, 1.0, n - 1) / n
    moment.at(small)
    moment.before.slips[:] = moment.memory.now.slips + 0.02 * rng.normal(0.0, 1.0, (joints, 2))
    _, residual = moment.at(small)
    A = np.empty((joints, joints))
    stiffness(moment.chain, moment.loads, moment.state, A)
    free, step = rng.random(joints) < 0.9, np.empty(joints)
    long = moment.with_friction(joints)
    sweep = new_sweep(joints, long.lu.U.shape[1] + long.base.U.shape[1])
    fill_generators(long, moment.loads, moment.state, 0.0, sweep)
    symmetric = 0.5 * (A + A.T)[np.ix_(free, free)]
    shift = max(0.0, 1.0 - np.linalg.eigvalsh(symmetric)[0])
    assert factor_lu(long.lu, sweep.diagonal, free, shift) > 0.0
    substitute_lu(long.lu, free, residual, step)
    shifted = (A + shift * np.eye(joints))[np.ix_(free, free)]
    wanted = np.linalg.solve(shifted, -residual[free])
    assert step[free] == pytest.approx(wanted, rel=1e-6, abs=1e-8 * np.abs(wanted).max())
    assert np.all(step[~free] == 0.0)
    assert factor(sweep, free, shift) > 0.0  # the Sweep has the symmetric part
    assert shift == 0.0 or factor(sweep, free, shift - 2.0) < 0.0


@pytest.mark.parametrize("n", [16, 60, 200])
def test_long_chains_end_where_the_balance_says(n):
    chain = uniform(n).replace(friction=CapstanFriction(0.05, constant=0.001, compliance=0.01))
    begin = solve_tensions(chain, (5.0, 5.0))
    step = solve_tensions(chain, (5.0, 4.8), [WorldForce(-1, (0.2 / n, 0.0))], history=begin)
    assert step.status is Status.CONVERGED and step.iterations < 40
    for i in range(n - 1):  # moments of gap tensions and tip load about every contact
        arm = step.tip - step.contact_points[i]
        lever = step.gap_tensions[i] @ step.tendon_rates[i]
        assert lever == pytest.approx(-arm[1] * 0.2 / n, abs=1e-8)
    assert np.all(step.slip[0] * (1.0, -1.0) > 0.0)


def test_springs_and_follower_forces_act_beside_friction():
    chain = five_link().replace(friction=CapstanFriction(0.1))
    begin = solve_tensions(chain, (4.0, 4.0))
    loads = [TorsionSpring(-1, 30.0, 0.1), Spring(2, 0.05, (10.0, 40.0)), BodyWrench(-1, (0.1, -0.05))]
    step = solve_tensions(chain, (5.0, 4.0), loads, history=begin)
    assert step.status is Status.CONVERGED and step.residual < 1e-8
    assert np.any(step.friction_states != 0.0)
    free = solve_tensions(five_link(), (5.0, 4.0), loads)
    assert np.linalg.norm(step.tip - free.tip) > 0.1


def central(function, x, step=1e-5):
    columns = [(function(x + step * e) - function(x - step * e)) / (2 * step) for e in np.eye(len(x))]
    return np.stack(columns, axis=-1)


def moved(chain, way, loads=(), presteps=()):
    """The equilibrium and the command before a step, and those after it."""
    begin = solve_tensions(chain, np.full(chain.n_tendons, 3.0))
    command = begin.lengths - begin.tensions / chain.stiffnesses
    for each in presteps:
        command = command + each
        begin = solve_lengths(chain, command, loads, tension_limits=LIMITS, history=begin)
    return begin, command + way


STATES = {
    "sliding": ((-2.0, 2.0), (), (0.0, 0.0)),
    "stuck": ((-0.004, 0.003), (), (1.0, 1.0)),
    "mixed": ((0.4, -0.3), ((-2.0, 2.0),), (0.2, 0.8)),
}
LAWS = {
    "plain": {},
    "stretch and constant force": {"constant": 0.02, "compliance": 0.05, "extra_turn": 0.05},
}


@pytest.mark.parametrize("way, presteps, share", STATES.values(), ids=STATES)
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_sensitivities_of_a_step(law, way, presteps, share):
    chain = five_link().replace(friction=CapstanFriction(0.1, **law))
    begin, command = moved(chain, way, (), presteps)
    step = solve_lengths(chain, command, tension_limits=LIMITS, history=begin)
    assert step.status is Status.CONVERGED
    assert share[0] <= step.sticking.mean() <= share[1]

    def by_length(command):
        return solve_lengths(chain, command, tension_limits=LIMITS, history=begin)

    exact = pytest.approx
    numeric = central(lambda c: by_length(c).poses, command)
    assert sensitivity.dposes_dlengths(step) == exact(numeric, rel=1e-4, abs=1e-4)
    numeric = central(lambda c: by_length(c).tensions, command)
    assert sensitivity.dtensions_dlengths(step) == exact(numeric, rel=1e-4, abs=1e-4)
    tip, rates = sensitivity.tip_and_tensions_dlengths(step)
    assert tip == exact(sensitivity.dposes_dlengths(step)[-1, :2], abs=1e-12)
    assert rates == exact(sensitivity.dtensions_dlengths(step), abs=1e-12)

    held = solve_tensions(chain, step.tensions, history=begin)
    numeric = central(lambda t: solve_tensions(chain, t, history=begin).poses, step.tensions)
    assert sensitivity.dposes_dtensions(held) == exact(numeric, rel=1e-4, abs=1e-3)
    numeric = central(lambda t: solve_tensions(chain, t, history=begin).lengths, step.tensions)
    assert sensitivity.dlengths_dtensions(held) == exact(numeric, rel=1e-4, abs=1e-3)

    def by_load(load):
        loads = [WorldForce(2, load[:2], moment=load[2], point=(1.0, 2.0))]
        return solve_lengths(chain, command, loads, tension_limits=LIMITS, history=begin).poses

    numeric = central(by_load, np.zeros(3))
    assert sensitivity.dposes_dload(step, 2, (1.0, 2.0)) == exact(numeric, rel=1e-4, abs=1e-4)


def test_sensitivities_of_tendons_that_end_half_way_and_of_loads_that_act():
    chain = two_segment().replace(friction=CapstanFriction(0.15, compliance=0.03))
    loads = [WorldForce(-1, (0.2, -0.1)), WorldForce(2, (0.1, 0.0))]
    begin, command = moved(chain, np.array((-0.5, 0.2, 0.03, -0.02)), loads, (np.array((-1.0, 1.0, 1.0, -1.0)),))
    step = solve_lengths(chain, command, loads, tension_limits=LIMITS, history=begin)
    assert step.ok and step.sticking.any()
    numeric = central(lambda c: solve_lengths(chain, c, loads, tension_limits=LIMITS, history=begin).poses, command)
    assert sensitivity.dposes_dlengths(step) == pytest.approx(numeric, rel=1e-4, abs=1e-4)


def test_sensitivities_are_refused_where_rolling_resists():
    chain = five_link().replace(friction=CapstanFriction(0.1, rolling=0.1))
    begin, command = moved(chain, np.array((-1.0, 1.0)))
    step = solve_lengths(chain, command, tension_limits=LIMITS, history=begin)
    assert step.ok
    for function in (sensitivity.dposes_dlengths, sensitivity.dtensions_dlengths, sensitivity.dlengths_dtensions):
        with pytest.raises(InvalidInput, match="rolling") as refusal:
            function(step)
        assert "\n" not in str(refusal.value)
    sensitivity.dposes_dlengths(solve_lengths(chain, command, tension_limits=LIMITS))  # no history, no friction
