"""Least squares: what it ends at is a minimum within the limits, for short chains and long ones."""

from dataclasses import replace

import numpy as np
import pytest

from rollingjoint import (
    SpatialChain,
    Spring,
    Status,
    WorldForce,
    five_link,
    pitch_yaw,
    small_arm,
    solve_lengths,
    solve_tensions,
    solve_tensions_batch,
    uniform,
)
from rollingjoint.chain.random_chain import random_chain, random_loads

LOW, HIGH = 0.5, 6.0


@pytest.mark.parametrize("seed", range(24))
def test_no_tensions_nearby_bring_the_lengths_nearer(seed):
    rng = np.random.default_rng(seed)
    chain = random_chain(rng)
    loads = random_loads(rng, chain.n_links) if seed % 2 else []
    desired = chain.neutral_lengths + rng.uniform(-2.0, 2.0, chain.n_tendons)
    found = solve_lengths(chain, desired, loads, method="least_squares", tension_limits=(LOW, HIGH))
    assert found.ok
    assert np.all((found.tensions >= LOW) & (found.tensions <= HIGH))
    away = np.repeat([0.1, 1e-2, 1e-3, 1e-4], 10)[:, None] * rng.normal(size=(40, chain.n_tendons))
    others = solve_tensions_batch(
        chain, np.clip(found.tensions + away, LOW, HIGH), loads, np.repeat(found.joint_angles[None], 40, axis=0)
    )
    misses = np.sum((others.lengths - desired) ** 2, axis=1)[others.ok]
    assert len(misses) > 20
    assert misses.min() >= np.sum((found.lengths - desired) ** 2) - 1e-10


@pytest.mark.parametrize("n_links", [14, 40])
def test_a_long_chain_reaches_lengths_that_can_be_reached(n_links):
    chain = uniform(n_links)
    loads = [WorldForce(-1, (0.01, 0.02)), Spring(n_links // 2, 1e-3, (5.0, 5.0))]
    wanted = solve_tensions(chain, (3.0, 4.0), loads).require()
    found = solve_lengths(chain, wanted.lengths, loads, method="least_squares")
    assert found.status is Status.CONVERGED
    assert found.lengths == pytest.approx(wanted.lengths, abs=1e-8)
    assert found.poses == pytest.approx(wanted.poses, abs=1e-5)


@pytest.mark.parametrize(
    ("lengths", "limits", "start"),
    [
        ((np.nan, 100.0), (0.0, np.inf), None),
        ((90.0, 100.0), (5.0, 1.0), None),
        ((90.0, 100.0), (-1.0, 1.0), None),
        ((90.0, 100.0), (0.0, np.nan), None),
        ((90.0, 100.0), (0.0, 9.0), [np.nan] * 4),
    ],
)
def test_numbers_that_cannot_be_solved_are_a_status(lengths, limits, start):
    found = solve_lengths(five_link(), lengths, (), start, method="least_squares", tension_limits=limits)
    assert found.status is Status.INVALID_INPUT
    assert np.all(np.isfinite(found.poses)) and np.all(found.tensions == 0)


def test_without_a_load_only_the_ratio_is_found_and_the_largest_tension_is_near_one():
    found = solve_lengths(five_link(), (86.02, 107.82), method="least_squares")
    assert found.tensions.max() == pytest.approx(1.5, abs=0.6)
    doubled = solve_tensions(five_link(), 2.0 * found.tensions)
    assert doubled.lengths == pytest.approx(found.lengths, abs=1e-8)


ARMS = [small_arm(), replace(small_arm(), model="linear"), SpatialChain.from_arm(small_arm()), pitch_yaw()]
NAMES = ["arm", "linear", "hinges in space", "rolling joints in space"]


@pytest.mark.parametrize("arm", ARMS, ids=NAMES)
def test_chains_in_space_reach_lengths_that_can_be_reached(arm):
    tensions = np.random.default_rng(2).uniform(1.0, 5.0, arm.n_tendons)
    loads = [WorldForce(-1, (0.05, 0.02, -0.1))]
    wanted = solve_tensions(arm, tensions, loads).require()
    found = solve_lengths(arm, wanted.lengths, loads, method="least_squares").require()
    assert found.lengths == pytest.approx(wanted.lengths, abs=1e-6)
    assert found.tip == pytest.approx(wanted.tip, abs=5e-3)  # tensions that pull against each other stiffen it


@pytest.mark.parametrize("arm", ARMS, ids=NAMES)
def test_no_tensions_nearby_bring_the_lengths_of_a_chain_in_space_nearer(arm):
    rng = np.random.default_rng(3)
    desired = arm.neutral_lengths + rng.uniform(-2.0, 2.0, arm.n_tendons)
    found = solve_lengths(arm, desired, method="least_squares", tension_limits=(LOW, HIGH)).require()
    assert np.all((found.tensions >= LOW) & (found.tensions <= HIGH))
    away = np.repeat([0.1, 1e-2, 1e-3, 1e-4], 10)[:, None] * rng.normal(size=(40, arm.n_tendons))
    starts = np.repeat(found.joint_angles[None], 40, axis=0)
    others = solve_tensions_batch(arm, np.clip(found.tensions + away, LOW, HIGH), (), starts)
    misses = np.sum((others.lengths - desired) ** 2, axis=1)[others.ok]
    assert len(misses) > 20
    assert misses.min() >= np.sum((found.lengths - desired) ** 2) - 1e-10
