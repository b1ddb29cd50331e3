"""Long chains: the O(n) Newton step equals the dense one, and converges for a thousand links."""

import numpy as np
import pytest

from rollingjoint import (
    BodyWrench,
    Gravity,
    Spring,
    Status,
    TorsionSpring,
    WorldForce,
    solve_lengths,
    solve_tensions,
    uniform,
)
from rollingjoint._numba.jit import standalone
from rollingjoint.chain.random_chain import random_chain, random_loads
from rollingjoint.kernels import chain as chain_kernels
from rollingjoint.kernels import long_chain, planar_loads, rolling
from rollingjoint.kernels.arrays import TendonLaw
from rollingjoint.load import LOAD_COLUMNS, load_table

new_state, one_design = standalone(rolling.new_state), standalone(rolling.design)
evaluate, stiffness = standalone(chain_kernels.evaluate), standalone(chain_kernels.stiffness)
new_sweep, fill_generators = standalone(long_chain.new_sweep), standalone(chain_kernels.fill_generators)
generator_columns = standalone(planar_loads.generator_columns)
factor, substitute = standalone(long_chain.factor), standalone(long_chain.substitute)


@pytest.mark.slow
@pytest.mark.parametrize("springs", [[], [TorsionSpring(-1, 20.0, 0.1), TorsionSpring(-1, 9.0, 0.2, 1)]])
def test_the_sweep_solves_what_the_dense_matrix_says(springs):
    rng = np.random.default_rng(0)
    solved = 0
    for _ in range(60):
        chain = random_chain(rng, 12)
        n, m = chain.n_joints, chain.n_tendons
        springs = [each for each in springs if chain.n_links > 2]
        loads = load_table([*random_loads(rng, chain.n_links), *springs], chain.n_links)
        command = chain.neutral_lengths - rng.uniform(-1, 2, m)
        law = TendonLaw(command, chain.stiffnesses.copy(), np.zeros(m), np.full(m, 20.0))
        state, H = new_state(n, m), np.empty((n, n))
        one = one_design(chain.arrays, 0)
        state.angle[:] = chain.joint_angles(rng.uniform(0.5, 0.9) * chain.joint_limits[:, 1] * rng.uniform(-1, 1, n))
        evaluate(one, law, loads, state)
        stiffness(one, loads, state, H)
        sweep = new_sweep(n, m + generator_columns(np.zeros((0, len(LOAD_COLUMNS))), loads))
        fill_generators(one, loads, state, 0.3, sweep)
        free = rng.random(n) < 0.8
        dense = (H + 0.3 * np.eye(n))[np.ix_(free, free)]
        ratio = factor(sweep, free, 0.0)
        assert (ratio > 0) == bool(np.all(np.linalg.eigvalsh(dense) > 0)) or abs(ratio) < 1e-9
        if ratio > 1e-9:
            solved += 1
            residual, step = rng.normal(size=n), np.empty(n)
            substitute(sweep, free, residual, step)
            assert step[free] == pytest.approx(np.linalg.solve(dense, -residual[free]), rel=1e-7, abs=1e-9)
            assert np.all(step[~free] == 0)
    assert solved > 20


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_generators_of_stretching_tendons_are_the_dense_stiffness_and_its_differences(seed):
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, 24)
    n, m = chain.n_joints, chain.n_tendons
    loads = load_table(random_loads(rng, chain.n_links), chain.n_links)
    state, H = new_state(n, m), np.empty((n, n))
    one = one_design(chain.arrays, 0)
    angles = chain.joint_angles(0.6 * chain.joint_limits[:, 1] * rng.uniform(-1, 1, n))
    command = chain.tendon_lengths(angles) - rng.uniform(0.1, 0.5, m)
    law = TendonLaw(command, chain.stiffnesses.copy(), np.zeros(m), np.full(m, 1e6))

    def residual(turned):
        state.angle[:] = turned
        evaluate(one, law, loads, state)
        return state.residual.copy()

    turns = 1e-6 * np.eye(n)
    differences = [(residual(angles + turn) - residual(angles - turn)) / 2e-6 for turn in turns]
    residual(angles)
    assert np.all(state.tension > 0) and np.all(state.elastic > 0)
    stiffness(one, loads, state, H)
    sweep = new_sweep(n, m + generator_columns(np.zeros((0, len(LOAD_COLUMNS))), loads))
    fill_generators(one, loads, state, 0.0, sweep)
    below = np.tril(sweep.U @ sweep.V.T, -1)
    scale = np.abs(H).max()
    assert np.abs(np.diag(sweep.diagonal) + below + below.T - H).max() < 1e-12 * scale
    assert np.abs(np.transpose(differences) - H).max() < 1e-6 * scale


@pytest.mark.parametrize("n", [14, 100, 1000])
def test_long_chains_converge(n):
    chain = uniform(n)
    weight = 2.0 / n**2
    loads = [WorldForce(-1, (0.5 / n, 0.0)), Gravity([weight] * n, (1.0, 0.0)), Spring(n // 2, 1e-6, (50.0, 10.0 * n))]
    result = solve_tensions(chain, (5.0, 4.9), loads)
    assert result.status is Status.CONVERGED
    assert result.residual < 1e-9
    assert result.iterations < 60
    by_length = solve_lengths(chain, result.lengths - result.tensions / chain.stiffnesses, loads, start=result)
    assert by_length.joint_angles == pytest.approx(result.joint_angles, abs=1e-6)


def test_an_unloaded_long_chain_shares_one_angle():
    result = solve_tensions(uniform(2000), (2.0, 1.98))
    assert result.status is Status.CONVERGED
    assert result.joint_angles == pytest.approx(np.full(1999, result.joint_angles[0]), abs=1e-9)
    assert result.joint_angles[0] == pytest.approx(solve_tensions(uniform(3), (2.0, 1.98)).joint_angles[0], abs=1e-9)


def test_slack_long_chains_say_so():
    chain = uniform(40)
    assert solve_tensions(chain, (0.0, 0.0)).status is Status.INDETERMINATE
    assert solve_lengths(chain, chain.neutral_lengths + 5.0).status is Status.INDETERMINATE


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])  # neither converges; 600 dense steps once took up to 13 s
def test_a_follower_force_on_a_long_chain_takes_a_bounded_number_of_dense_steps(seed):
    chain, rng = uniform(300), np.random.default_rng(seed)
    force = rng.normal(0.0, 1.0, 2)
    result = solve_tensions(chain, rng.uniform(0.1, 10.0, chain.n_tendons), [BodyWrench(-1, tuple(force))])
    assert result.iterations <= 3 * 80
