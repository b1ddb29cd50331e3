"""Where Newton's method ends without an equilibrium although there is one, the slow descent finds it."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from rollingjoint import (
    Gravity,
    Link,
    Profile,
    RollingChain,
    Spring,
    Status,
    Surface,
    Tendon,
    TorsionSpring,
    WorldForce,
    solve_lengths,
    solve_lengths_batch,
    solve_tensions,
    solve_tensions_batch,
    two_segment,
    uniform,
)

spec = importlib.util.spec_from_file_location(
    "hard_cases", Path(__file__).resolve().parents[3] / "benchmarks" / "hard_cases.py"
)
hard_cases = importlib.util.module_from_spec(spec)
spec.loader.exec_module(hard_cases)


def stands(result):
    """Every row is in equilibrium, by its own residual."""
    return bool(np.all((result.status <= Status.INDETERMINATE) & (result.residual <= 1e-8)))


@pytest.mark.parametrize("stiffness", [5.0, 40.0, 200.0])
def test_one_spring_over_slack_joints_leads_to_an_equilibrium(stiffness):
    loads = [TorsionSpring(0, stiffness, -0.4, 6), WorldForce(5, (0.0, 0.0), -0.04)]
    assert stands(solve_tensions(two_segment(), (3, 1, 0, 0), loads))
    tensions = 10.0 ** np.random.default_rng(0).uniform(-1.0, 1.0, (200, 4)) * [1, 1, 0, 0]
    assert stands(solve_tensions_batch(two_segment(), tensions, loads))


@pytest.mark.parametrize("n", [18, 40])
def test_a_slack_long_chain_on_one_spring_is_indeterminate_and_not_unstable(n):
    chain, rng = uniform(n), np.random.default_rng(n)
    for _ in range(20):
        link = int(rng.integers(1, n))
        anchor = rng.uniform(-50.0, 50.0), rng.uniform(0.0, 16.0 * link)
        start = chain.neutral_angles + rng.normal(0.0, 0.1, n - 1)
        slack = chain.neutral_lengths + 0.3 * chain.length
        result = solve_lengths(chain, slack, [Spring(link, 0.05, anchor)], start=start)
        assert result.status is Status.INDETERMINATE
        assert result.smallest_eigenvalue > -1e-9 * np.abs(result.stiffness).max()


@pytest.mark.parametrize("stiffness", [2.1e3, 2e4])
def test_tendons_a_million_times_stiffer_than_the_loads_are_solved(stiffness):
    chain = two_segment(stiffness=stiffness)
    change = chain.length * np.random.default_rng(0).uniform(-0.15, 0.05, (400, 4))
    assert stands(solve_lengths_batch(chain, chain.neutral_lengths + change, [Gravity([0.004] * 7)]))


def test_a_joint_finds_back_over_thirty_turns():
    curvature, limits = 5.6, (-40.0, 40.0)
    flat, sharp = Profile.constant(0.0, limits), Profile.constant(-curvature, limits)
    link = Link(Surface(flat, (0.0, -10.0)), Surface(sharp, (0.0, 10.0)))
    chain = RollingChain([link, link], [Tendon([((0.0, -9.0), (0.0, 10.0 - 1.0 / curvature))])])
    start = chain.joint_angles([35.0])
    assert abs(start[0]) > 30 * 2 * np.pi
    result = solve_tensions(chain, [5.0], start=start)
    assert result.status is Status.CONVERGED and result.arc_lengths == pytest.approx([0.0], abs=1e-9)


def test_a_saddle_of_a_long_chain_is_left():
    chain = uniform(20)
    straight = solve_tensions(chain, (1, 1), [WorldForce(-1, (0.0, -2.0))])
    assert straight.ok and abs(straight.tip[0]) > 5.0


@pytest.mark.slow
def test_no_hard_case_with_a_potential_ends_without_an_equilibrium():
    followers = failed = 0
    for kind, load, result in hard_cases.cases(seed=1, rows=6000):
        if load == "follower":
            followers, failed = followers + len(result.status), failed + int(np.sum(result.status >= Status.UNSTABLE))
        else:
            assert stands(result), f"{kind}, {load}"
    assert failed <= 0.01 * followers


@pytest.mark.slow
def test_the_report_of_the_hard_cases_counts_every_row():
    text = hard_cases.table(hard_cases.cases(seed=2, rows=64))
    assert f"of {2 * 64 * len(hard_cases.HARD_KINDS):,} |" in text.splitlines()[-1]
