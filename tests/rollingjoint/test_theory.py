"""The formulas of docs/theory.md, written out load by load: against central differences and against the kernels."""

import itertools

import numpy as np
import pytest

from rollingjoint import TorsionSpring, five_link, solve_lengths, uniform
from rollingjoint._numba.jit import standalone
from rollingjoint.chain.random_chain import random_chain, random_loads
from rollingjoint.kernels import chain as chain_kernels
from rollingjoint.kernels import rolling
from rollingjoint.kernels.arrays import TendonLaw
from rollingjoint.kernels.joints import CX, CY, PX, PY
from rollingjoint.load import load_table

QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])  # J of the page
STEP = 1e-6

new_state, one_design = standalone(rolling.new_state), standalone(rolling.design)
evaluate, stiffness = standalone(chain_kernels.evaluate), standalone(chain_kernels.stiffness)


def problem(seed):
    """(chain, joint angles, load table, law): any loads, tendons below, between and above their tension limits."""
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, 6)
    low, high = chain.joint_limits.T
    phi = chain.joint_angles(0.8 * rng.uniform(low, high))
    springs = [TorsionSpring(-1, 20.0, 0.1), TorsionSpring(chain.n_links - 2, 15.0, -0.2, -1)] if seed % 2 else []
    loads = load_table([*random_loads(rng, chain.n_links, follower=True), *springs], chain.n_links)
    stretch, ones = rng.choice([-1.0, 0.5, 4.0], chain.n_tendons), np.ones(chain.n_tendons)
    return chain, phi, loads, TendonLaw(chain.tendon_lengths(phi) - stretch, 2.0 * ones, 0.1 * ones, 5.0 * ones)


def is_smooth(seed):
    """Whether no contact is within 0.01 mm of a curvature break, where second derivatives jump."""
    chain, phi, _, _ = problem(seed)
    return all(
        np.abs(surface.profile.breaks - s).min() > 0.01
        for (below, above), s in zip(itertools.pairwise(chain.links), chain.arc_lengths(phi), strict=True)
        for surface in (below.child, above.parent)
    )


SEEDS = [seed for seed in range(16) if is_smooth(seed)]


def at(chain, law, loads, phi):
    """(energy, state) at joint angles phi."""
    state = new_state(chain.n_joints, chain.n_tendons)
    state.angle[:] = phi
    energy, _, _ = evaluate(one_design(chain.arrays, 0), law, loads, state)
    return energy, state


def difference(function, phi):
    """d function / d phi by central differences, the new axis last."""
    steps = STEP * np.eye(len(phi))
    return np.stack([(function(phi + e) - function(phi - e)) / (2 * STEP) for e in steps], axis=-1)


def turn(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def page_stiffness(chain, loads, state):
    """H of section 3, the loads taken one by one."""
    n = chain.n_joints
    H = np.zeros((n, n))
    c, rate = state.contact[:, :2], state.contact[:, 2:]  # rate: e_t / kappa
    for link, px, py, fx, fy, bx, by, _, k, ax, ay, torsion, _, other in loads:
        x, y, angle = state.pose[int(link), :3]
        point, body = np.array([x, y]) + turn(angle) @ (px, py), turn(angle) @ (bx, by)
        force = np.array([fx, fy]) + body + k * (np.array([ax, ay]) - point)
        for i, m in np.ndindex(n, n):
            if max(i, m) < link:
                H[i, m] += (point - c[max(i, m)]) @ force - (point - c[i]) @ body
                H[i, m] += k * (point - c[i]) @ (point - c[m])
        low, high = sorted((int(link), int(other)))
        H[low:high, low:high] += torsion
        for i in range(int(link)):
            H[i, i] += (QUARTER @ rate[i]) @ force
    rates = state.gap[..., 1]
    return H + np.diag(state.gap[..., 2] @ state.tension) + rates * state.elastic @ rates.T


@pytest.mark.parametrize("seed", SEEDS)
def test_gap_derivatives_are_the_formulas_and_the_differences(seed):
    chain, phi, loads, law = problem(seed)
    _, state = at(chain, law, loads, phi)
    joint, gap, poses = state.joint[0], state.gap[0, 0, :3], chain.poses(phi)
    above = poses[1, :2] + turn(poses[1, 2]) @ chain.arrays.holes[0, 0, 0, 2:]
    v, lever = above - chain.arrays.holes[0, 0, 0, :2], QUARTER @ (above - joint[[CX, CY]])
    unit = v / np.linalg.norm(v)
    bend = (lever @ lever - (unit @ lever) ** 2) / np.linalg.norm(v)
    bend += unit @ QUARTER @ (lever - joint[[PX, PY]])
    assert gap == pytest.approx([np.linalg.norm(v), unit @ lever, bend], rel=1e-8, abs=1e-8)
    slopes = difference(lambda p: at(chain, law, loads, p)[1].gap[0, 0], phi)[:, 0]
    assert gap[1:] == pytest.approx(slopes[:2], rel=1e-4, abs=1e-3)


@pytest.mark.parametrize("seed", SEEDS)
def test_stiffness_is_the_formula_and_the_difference(seed):
    chain, phi, loads, law = problem(seed)
    _, state = at(chain, law, loads, phi)
    computed = np.empty((chain.n_joints, chain.n_joints))
    stiffness(one_design(chain.arrays, 0), loads, state, computed)
    size = np.abs(computed).max()
    assert computed == pytest.approx(page_stiffness(chain, loads, state), rel=1e-9, abs=1e-12 * size)
    numeric = difference(lambda p: at(chain, law, loads, p)[1].residual.copy(), phi)
    assert computed == pytest.approx(numeric, rel=1e-4, abs=1e-5 * size)


@pytest.mark.parametrize("seed", SEEDS)
def test_residual_is_the_slope_of_the_energy(seed):
    chain, phi, loads, law = problem(seed)
    loads[:, 5:7] = 0.0  # follower forces have no energy
    _, state = at(chain, law, loads, phi)
    slope = difference(lambda p: np.array(at(chain, law, loads, p)[0]), phi)
    assert state.residual == pytest.approx(slope, rel=1e-5, abs=1e-5 * np.abs(slope).max())


def test_least_squares_and_elastic_tendons_agree_where_the_stretch_is_positive():
    chain, lengths = five_link(), np.array([85.0, 107.0])
    nearest = solve_lengths(chain, lengths, method="least_squares").require()
    assert np.all(nearest.lengths > lengths)
    assert solve_lengths(chain, lengths).joint_angles == pytest.approx(nearest.joint_angles, abs=1e-8)


def test_a_command_of_length_minus_stretch_is_the_same_equilibrium_as_the_tensions():
    chain = five_link()
    wanted = solve_lengths(chain, (86.02, 107.82), method="least_squares").require()
    command = wanted.lengths - 3.0 * wanted.tensions / chain.stiffnesses
    elastic = solve_lengths(chain, command).require()
    assert elastic.joint_angles == pytest.approx(wanted.joint_angles, abs=1e-8)
    assert elastic.tensions == pytest.approx(3.0 * wanted.tensions, abs=1e-6)


def test_a_single_joint_reads_no_angle_beyond_its_own():
    chain = uniform(2)
    ones = np.ones(chain.n_tendons)
    law = TendonLaw(chain.neutral_lengths - 0.5, 2.0 * ones, 0.1 * ones, 5.0 * ones)
    state = new_state(1, chain.n_tendons)._replace(angle=np.array([0.1, np.nan])[:1])
    numbers = evaluate(one_design(chain.arrays, 0), law, load_table([], chain.n_links), state)
    assert np.isfinite(numbers).all() and np.isfinite(state.pose).all() and np.isfinite(state.residual).all()
