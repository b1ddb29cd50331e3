"""Hard cases: slack, contact at the end of a surface, jumps, buckling, impossible numbers, each with its status."""

import numpy as np
import pytest

from rollingjoint import (
    BodyWrench,
    Link,
    Profile,
    RollingChain,
    Spring,
    Status,
    Surface,
    Tendon,
    WorldForce,
    five_link,
    solve_lengths,
    solve_lengths_batch,
    solve_tensions,
    two_segment,
    uniform,
)


def test_slack_tendon_carries_no_tension():
    chain = five_link()
    result = solve_lengths(chain, chain.neutral_lengths - (6.0, -30.0), [WorldForce(-1, (0.2, 0.1))])
    assert result.ok
    assert result.tensions[0] > 0
    assert result.tensions[1] == 0.0


def test_pure_compression_buckles_to_the_left_from_the_straight_pose():
    chain = uniform(5)
    straight = solve_tensions(chain, (1, 1), [WorldForce(-1, (0, 1.0))])
    assert straight.status is Status.CONVERGED
    assert straight.poses[:, 0] == pytest.approx(np.zeros(5), abs=1e-9)
    buckled = solve_tensions(chain, (1, 1), [WorldForce(-1, (0, -2.0))])
    assert buckled.ok
    assert buckled.tip[0] < -5.0
    assert buckled.status is Status.AT_LIMIT or buckled.smallest_eigenvalue > 0


def test_nothing_taut_and_no_load_returns_the_start_and_says_so():
    chain = five_link()
    start = chain.joint_angles([1.0, -2.0, 0.5, 3.0])
    for result in (solve_tensions(chain, (0, 0), start=start), solve_lengths(chain, (200, 200), start=start)):
        assert result.status is Status.INDETERMINATE
        assert result.joint_angles == pytest.approx(start, abs=1e-12)
        assert not result.ok


def test_slack_commands_give_the_admissible_pose_nearest_the_start():
    chain = five_link()
    command = np.array([86.02, 107.82])  # longer than a pose on the way, so both end up slack
    result = solve_lengths(chain, command)
    assert result.status is Status.INDETERMINATE
    assert np.all(result.lengths <= command + 1e-9)
    distance = np.linalg.norm(result.joint_angles - chain.neutral_angles)
    rng = np.random.default_rng(0)
    for _ in range(2000):  # no admissible pose nearby is nearer to the start
        other = result.joint_angles + rng.normal(0, 0.02, 4)
        if np.all(chain.tendon_lengths(other) <= command):
            assert np.linalg.norm(other - chain.neutral_angles) > distance - 1e-4


def test_forces_too_small_to_hold_a_pose_count_as_slack():
    assert solve_tensions(five_link(), (2e-20, 1e-20)).status is Status.INDETERMINATE
    assert solve_tensions(five_link(), (2e-12, 1e-12)).status is Status.INDETERMINATE


@pytest.mark.parametrize("bad", [(np.nan, 1), (np.inf, 1), (-1, 1), (1e300, 1)])
def test_numbers_that_cannot_be_solved_are_a_status(bad):
    chain = five_link()
    for result in (
        solve_tensions(chain, bad),
        solve_tensions(chain, (1, 1), [WorldForce(-1, (np.nan, 0))]),
        solve_tensions(chain, (1, 1), start=[np.nan] * 4),
        solve_tensions(chain, (1, 1), [Spring(-1, -1.0, (0, 0))]),
    ):
        assert result.status is Status.INVALID_INPUT
        assert np.all(np.isfinite(result.poses))
        assert np.all(result.tensions == 0)


@pytest.mark.parametrize("force", [1e3, 1e6, 1e11])
@pytest.mark.parametrize("kind", [WorldForce, BodyWrench])
def test_huge_loads_end_truthfully(force, kind):
    for angle in np.linspace(0, 2 * np.pi, 7):
        result = solve_lengths(five_link(), (88, 98), [kind(-1, (force * np.cos(angle), force * np.sin(angle)))])
        assert np.all(np.isfinite(result.poses))
        assert np.all(np.isfinite(result.contact_forces))
        assert not (result.status is Status.CONVERGED and result.residual > 1e-8)


def test_a_surface_limit_is_reported_and_the_joint_stays_there():
    result = solve_tensions(uniform(3), (1, 1), [WorldForce(-1, (0, 0), moment=-200.0)])
    assert result.status is Status.AT_LIMIT
    assert result.ok
    assert result.arc_lengths == pytest.approx([15, 15])
    assert result.smallest_eigenvalue == np.inf


def test_nearly_flat_contact_converges():
    flat = Link(Surface(Profile.constant(1e-7), (0, -10)), Surface(Profile.constant(0.0), (0, 10)))
    chain = RollingChain([flat] * 4, [Tendon.on_surfaces(-8), Tendon.on_surfaces(8)])
    centred = solve_tensions(chain, (2, 2), [WorldForce(-1, (0.0, 0.3))])
    assert centred.status is Status.CONVERGED
    assert centred.arc_lengths == pytest.approx([0, 0, 0], abs=1e-3)
    assert solve_tensions(chain, (2, 1)).status in (Status.CONVERGED, Status.AT_LIMIT)


def test_equilibrium_on_a_curvature_jump_converges():
    result = solve_tensions(five_link(), (1, 1))
    assert result.arc_lengths[1] == pytest.approx(0, abs=1e-8)
    assert result.arc_lengths[3] == pytest.approx(0, abs=1e-8)


def test_a_closed_gap_is_no_singularity():
    result = solve_tensions(five_link(), (3, 0))  # pulls every left gap shut, where its direction is a limit
    assert result.status is Status.CONVERGED
    assert result.arc_lengths == pytest.approx([-10] * 4, abs=1e-6)


def test_no_result_holds_a_pushing_tendon_or_nan():
    chain, rng = two_segment(), np.random.default_rng(1)
    batch = solve_lengths_batch(chain, chain.neutral_lengths + rng.uniform(-10, 10, (300, 4)), [WorldForce(2, (1, 0))])
    assert np.all(batch.tensions >= 0)
    for name in ("poses", "tensions", "lengths", "contact_forces", "stiffness", "joint_angles"):
        assert np.all(np.isfinite(getattr(batch, name)))
