"""Chains in space in lanes: the numbers of a row are those of a single solve, and those of the general solver."""

import dataclasses

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint import Status
from rollingjoint._numba.jit import standalone
from rollingjoint.kernels import hinge_lanes
from rollingjoint.kernels.elementary import sine_and_cosine
from rollingjoint.load import SPATIAL_LOAD_COLUMNS
from tests.rollingjoint.chain.spatial_chains import random_chain

COLUMN = {name: place for place, name in enumerate(SPATIAL_LOAD_COLUMNS)}
FIELDS = ("joint_angles", "poses", "tensions", "lengths", "tendon_rates", "tendon_torques", "tendon_stiffness")


@pytest.fixture(scope="module", params=["small_arm", "flexible_arm", "pitch_yaw_two_segment", "random"])
def chain(request):
    if request.param == "random":
        return random_chain(np.random.default_rng(0))
    return rj.preset(request.param)


@pytest.fixture(params=[rj.small_arm, rj.pitch_yaw])
def short(request):
    return request.param()


def drawn(arm, count, seed=0):
    """Commands and load tables: two forces a row, their links other ones in every row."""
    rng = np.random.default_rng(seed)
    lengths = arm.neutral_lengths + rng.uniform(-1.0, 0.6, (count, arm.n_tendons))
    tables = np.zeros((count, 2, len(COLUMN)))
    tables[..., COLUMN["link"]] = rng.integers(0, arm.n_links, (count, 2))
    for name in ("px", "py", "pz", "fx", "fy", "fz"):
        tables[..., COLUMN[name]] = rng.uniform(-0.1, 0.1, (count, 2))
    return lengths, tables


def without_lanes(monkeypatch):
    for kind in (rj.HingeChain, rj.SpatialChain):
        kernels = dataclasses.replace(kind.kernels, most_joints=0, most_with_friction=0)
        monkeypatch.setattr(kind, "kernels", kernels)


def fields_of(chain):
    return FIELDS + ("reactions", "contact_points") * isinstance(chain, rj.SpatialChain)


def test_rows_are_single_solves_whatever_their_neighbours_and_the_links_of_their_loads(chain):
    lengths, tables = drawn(chain, 37)
    tables[5:9] = tables[5]  # here the links of all lanes are the same
    batch = rj.solve_lengths_batch(chain, lengths, tables)
    for row in range(len(lengths)):
        alone = rj.solve_lengths_batch(chain, lengths[row : row + 1], tables[row : row + 1])
        for name in fields_of(chain):
            assert np.array_equal(getattr(batch, name)[row], getattr(alone, name)[0]), (row, name)
        assert (batch.status[row], batch.iterations[row]) == (alone.status[0], alone.iterations[0])


def test_lanes_find_what_the_solver_for_all_cases_finds(chain, monkeypatch):
    lengths, tables = drawn(chain, 200, seed=1)
    fast = rj.solve_lengths_batch(chain, lengths, tables)
    without_lanes(monkeypatch)
    slow = rj.solve_lengths_batch(chain, lengths, tables)
    assert np.all(fast.status == slow.status)
    assert np.allclose(fast.poses, slow.poses, rtol=0.0, atol=1e-6)
    assert np.allclose(fast.tensions, slow.tensions, rtol=0.0, atol=1e-7)
    assert np.abs(fast.iterations - slow.iterations).max() <= 1  # a wrong stiffness would only cost steps


def test_designs_and_laws_of_their_own_are_those_of_their_rows():
    arms = [rj.small_arm().scaled(np.full(4, by), np.ones(4), np.ones(4)) for by in (0.5, 1.0, 2.0)] * 5
    lengths, _ = drawn(arms[0], len(arms))
    together = rj.solve_lengths_batch(arms, lengths)
    for row, each in enumerate(arms):
        assert np.array_equal(together.joint_angles[row], rj.solve_lengths(each, lengths[row]).joint_angles)


def test_chains_of_their_own_are_those_of_their_rows():
    chains = [rj.pitch_yaw_two_segment(stiffness=5.0 + k, joint_stiffness=2.0 + k) for k in range(3)] * 5
    lengths, _ = drawn(chains[0], len(chains))
    together = rj.solve_lengths_batch(chains, lengths)
    for row, each in enumerate(chains):
        assert np.array_equal(together.joint_angles[row], rj.solve_lengths(each, lengths[row]).joint_angles)


@pytest.mark.parametrize("solve", [rj.solve_lengths_batch, rj.solve_tensions_batch])
def test_rolling_joints_in_lanes_are_within_1e_9_of_the_solver_for_all_cases(solve, monkeypatch):
    chain, rng = rj.pitch_yaw_two_segment(), np.random.default_rng(3)
    shape = 100, chain.n_tendons
    by_lengths = solve is rj.solve_lengths_batch
    commands = chain.neutral_lengths + rng.uniform(-0.8, 0.3, shape) if by_lengths else rng.uniform(2.0, 3.0, shape)
    fast = solve(chain, commands, [chain.gravity()])
    without_lanes(monkeypatch)
    near = solve(chain, commands, [chain.gravity()], fast.joint_angles)
    assert np.all(fast.status == Status.CONVERGED)
    assert np.allclose(fast.joint_angles, near.joint_angles, rtol=0.0, atol=1e-9)


def test_responses_of_rows_in_lanes_are_those_of_differences():
    chain = rj.pitch_yaw_two_segment()
    lengths, h = chain.neutral_lengths - np.linspace(0.1, 0.5, chain.n_tendons), 1e-5
    middle = rj.solve_lengths(chain, lengths, [chain.gravity()])
    shifted = lengths + h * np.concatenate([np.eye(chain.n_tendons), -np.eye(chain.n_tendons)])
    batch = rj.solve_lengths_batch(chain, shifted, [chain.gravity()], np.tile(middle.joint_angles, (len(shifted), 1)))
    above, below = np.split(batch.tensions, 2)
    assert np.allclose(rj.sensitivity.dtensions_dlengths(middle), (above - below).T / (2 * h), rtol=1e-6, atol=1e-6)
    above, below = np.split(batch.tip, 2)
    tips, _ = rj.sensitivity.tip_and_tensions_dlengths(middle)
    assert np.allclose(tips, (above - below).T / (2 * h), rtol=1e-6, atol=1e-6)


def test_what_lanes_cannot_do_is_left_to_the_solver_for_all_cases(short, monkeypatch):
    arm = short
    lengths, tables = drawn(arm, 16, seed=2)
    tables[3, 0, COLUMN["mx"]] = 1.0  # a moment has no potential
    tables[4, 0, COLUMN["bz"]] = -0.1  # nor has a force that turns with its link
    tables[5, 0, COLUMN["k"]] = 0.05
    tables[3:6, 0, COLUMN["link"]] = 2.0
    lengths[6] = np.nan
    tables[7, 0, COLUMN["fx"]] = np.inf
    found = rj.solve_lengths_batch(arm, lengths, tables)
    assert list(found.status[[6, 7]]) == [Status.INVALID_INPUT] * 2
    assert np.all(np.delete(found.status, [6, 7]) <= Status.AT_LIMIT)
    without_lanes(monkeypatch)
    slow = rj.solve_lengths_batch(arm, lengths, tables)
    assert np.array_equal(found.joint_angles[3:8], slow.joint_angles[3:8])


def test_a_joint_that_is_pressed_against_its_limit_is_held_there(short, monkeypatch):
    arm = short
    lengths = arm.neutral_lengths + np.array([-30.0, *[30.0] * (arm.n_tendons - 1)])
    found = rj.solve_lengths_batch(arm, [lengths] * 3)
    without_lanes(monkeypatch)
    slow = rj.solve_lengths(arm, lengths)
    assert slow.status == Status.AT_LIMIT
    assert np.all(found.status == Status.AT_LIMIT)
    assert np.allclose(found.joint_angles, slow.joint_angles, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("build", [rj.small_arm, rj.flexible_arm])
def test_steps_with_friction_are_those_of_the_solver_for_all_cases(monkeypatch, build):
    arm = build().replace(friction=rj.CapstanFriction(0.15))
    assert len(arm.joint_stiffnesses) <= hinge_lanes.MOST_HINGES
    lengths, tables = drawn(arm, 64, seed=3)
    first = rj.solve_lengths_batch(arm, lengths, tables)
    there = lengths + np.random.default_rng(4).uniform(-0.2, 0.2, lengths.shape)
    fast = rj.solve_lengths_batch(arm, there, tables, history=first)
    without_lanes(monkeypatch)
    slow = rj.solve_lengths_batch(arm, there, tables, history=first)
    assert np.all(fast.status == Status.CONVERGED) and not np.array_equal(fast.poses, slow.poses)
    for name in ("poses", "tensions", "tendon_torques", "friction_states"):
        assert np.allclose(getattr(fast, name), getattr(slow, name), rtol=0.0, atol=1e-7), name
    assert np.abs(fast.joint_angles - rj.solve_lengths_batch(arm, there, tables).joint_angles).max() > 1e-4


@pytest.mark.parametrize("start", [0.0, np.pi / 4, -np.pi / 2, 2 * np.pi, 1e5])
def test_sine_and_cosine(start):
    function = standalone(sine_and_cosine)
    for x in start + np.linspace(-1.0, 1.0, 101):
        sine, cosine = function(x)
        assert abs(sine - np.sin(x)) < 2.5e-16
        assert abs(cosine - np.cos(x)) < 2.5e-16


def test_long_arms_take_the_steps_in_proportion_to_their_length():
    bead = rj.flexible_arm().beads[0]
    beads = [bead] * (hinge_lanes.MOST_HINGES + 1)
    tendons = [rj.BeadTendon(holes=((25.0, 0.0),)), rj.BeadTendon(holes=((-25.0, 0.0),))]
    arm = rj.HingeChain(beads, tendons)
    lengths = arm.neutral_lengths + np.array([-0.5, 0.2])
    assert np.array_equal(
        rj.solve_lengths_batch(arm, [lengths] * 2).joint_angles[1], rj.solve_lengths(arm, lengths).joint_angles
    )
