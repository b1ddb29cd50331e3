"""The flexible-joint paper's iterations against the solver, and the constant-curvature kinematics it compares with."""

import numpy as np
import pytest

from rollingjoint import InvalidInput, WorldForce, flexible_arm, small_arm, solve_lengths, solve_tensions
from rollingjoint.chain import se3
from rollingjoint.spatial.constant_curvature import bends_of_lengths, constant_curvature_poses, segments_of, tip_errors
from rollingjoint.spatial.published import (
    PublishedArm,
    positive,
    positive_rate,
    solve_lengths_published_arm,
    solve_tensions_published_arm,
)

FORCE, HANG = (0.1, -0.25, 0.4), (0.0, 0.0, 1.0)
TENSIONS = np.array([4.0, 1.0, 1.5, 0.5, 3.0, 2.0, 1.0, 1.0])


def difference(function, at, step=1e-6):
    return np.stack([(function(at + e) - function(at - e)) / (2 * step) for e in step * np.eye(len(at))], axis=-1)


def test_derivatives_of_the_mended_equations_are_differences():
    rng = np.random.default_rng(0)
    arm = PublishedArm(small_arm(5), (0.3, -0.2, 1.0), FORCE, (5.0, 3.0, -2.0))
    theta, f = 0.4 * rng.normal(size=5), rng.uniform(0, 5, 4)
    tau, slope, by_tension = arm.balance(theta, f)
    size = np.abs(slope).max()
    assert slope == pytest.approx(difference(lambda t: arm.balance(t, f)[0], theta), abs=1e-7 * size)
    assert by_tension == pytest.approx(difference(lambda t: arm.balance(theta, t)[0], f), abs=1e-6)
    bent = solve_tensions(
        small_arm(5, "end_couple"),
        f,
        [small_arm(5).gravity((0.3, -0.2, 1.0)), WorldForce(-1, FORCE, (5.0, 3.0, -2.0))],
    )
    tau, slope, _ = arm.balance(bent.joint_angles, f)
    assert tau == pytest.approx(np.zeros(5), abs=1e-8)
    assert slope == pytest.approx(bent.stiffness, abs=1e-8)


def test_the_tension_kernel_is_positive_and_its_rate_is_a_difference():
    u = np.array([-1e3, -3.0, 0.0, 0.5, 1e3])
    assert np.all(positive([*u, -1e6], 0.01) > 0)
    assert positive_rate(u, 0.01) == pytest.approx(
        (positive(u + 1e-5, 0.01) - positive(u - 1e-5, 0.01)) / 2e-5, abs=1e-6
    )
    printed = u**2 / (u**2 + 0.01)
    assert printed[2] == 0.0 and positive_rate(u, 0.01)[2] == pytest.approx(0.5)


def test_given_tensions_the_published_iteration_finds_the_solvers_equilibrium():
    chain = flexible_arm("end_couple")
    published = solve_tensions_published_arm(PublishedArm(chain, HANG, FORCE), TENSIONS)
    found = solve_tensions(chain, TENSIONS, [chain.gravity(HANG), WorldForce(-1, FORCE)])
    assert published.converged
    assert published.joint_angles == pytest.approx(found.joint_angles, abs=1e-12)
    assert published.lengths == pytest.approx(found.lengths, abs=1e-9)


def test_given_lengths_it_finds_the_angles_and_the_antagonist_differences_but_no_co_contraction():
    chain = flexible_arm("end_couple")
    found = solve_tensions(chain, TENSIONS, [chain.gravity(HANG), WorldForce(-1, FORCE)])
    published = solve_lengths_published_arm(PublishedArm(chain, HANG, FORCE), found.lengths)
    assert published.converged
    assert published.joint_angles == pytest.approx(found.joint_angles, abs=1e-10)
    for pair in ((0, 2), (1, 3), (4, 6), (5, 7)):
        assert np.subtract(*published.tensions[[*pair]]) == pytest.approx(np.subtract(*TENSIONS[[*pair]]), abs=1e-6)
    assert np.abs(published.tensions - TENSIONS).max() > 0.1


def test_with_compliance_it_is_the_elastic_equilibrium_of_taut_tendons():
    chain = flexible_arm("end_couple")
    arm, load = PublishedArm(chain, HANG), [chain.gravity(HANG)]
    short = chain.neutral_lengths - (3.0, 1.0, 1.0, 1.0, 2.0, 1.0, 1.0, 1.5)
    published = solve_lengths_published_arm(arm, short, compliance=0.1, c=1e-12)
    elastic = solve_lengths(chain, short, load)
    assert np.all(elastic.tensions > 0)
    assert published.converged
    assert published.tensions == pytest.approx(elastic.tensions, abs=1e-6)
    assert published.joint_angles == pytest.approx(elastic.joint_angles, abs=1e-8)


def test_it_has_no_answer_for_slack_or_pretensioned_tendons_and_says_so():
    arm = PublishedArm(flexible_arm("end_couple"), HANG)
    for change in (5.0, -5.0):
        found = solve_lengths_published_arm(arm, arm.l0 + change, max_iterations=20)
        assert not found.converged
        assert np.all(np.isfinite([*found.joint_angles, *found.tensions, *found.lengths]))
    assert not solve_tensions_published_arm(arm, np.full(8, np.nan), max_iterations=3).residual < 0
    with pytest.raises(InvalidInput):
        solve_tensions_published_arm(arm, np.ones(3))


def test_constant_curvature_is_what_an_unloaded_couple_does_to_many_short_hinges():
    """An arc turns every pair of hinges alike: with linear tendons, no weight and one bending plane, so do couples."""
    arm = flexible_arm("end_couple").replace(
        beads=[type(bead)(bead.spacing, bead.axis, bead.stiffness) for bead in flexible_arm().beads]
    )
    found = solve_tensions(arm, [9.0, 0, 0, 0, 2.0, 0, 0, 2.0])
    bends = bends_of_lengths(arm, found.lengths)
    assert bends[:, 0] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert bends[:, 1] == pytest.approx([found.joint_angles[:16].sum(), found.joint_angles[16:].sum()], abs=1e-9)
    arc = constant_curvature_poses(arm, bends)
    assert arc[-1, :3, :3] == pytest.approx(found.rotations[-1], abs=1e-9)
    errors = tip_errors(arc[-1], found.poses[-1], arm.poses(np.zeros(32))[-1])
    assert errors.relative_position < 0.04  # 32 beads are no continuum
    assert errors.angle == pytest.approx(0.0, abs=1e-7)


def test_constant_curvature_lengths_are_those_of_the_arcs():
    arm = flexible_arm("linear")
    bends = np.array([[0.3, -0.7], [-0.2, 0.4]])
    holes = np.array([tendon.holes[0] for tendon in arm.tendons])
    slope = np.column_stack([holes[:, 1], -holes[:, 0]])
    lengths = np.array([350.0] * 4 + [700.0] * 4) + slope @ bends[0] + np.r_[np.zeros(4), slope[4:] @ bends[1]]
    assert bends_of_lengths(arm, lengths) == pytest.approx(bends, abs=1e-12)
    assert [segment.last for segment in segments_of(arm)] == [16, 32]
    poses = constant_curvature_poses(arm, bends)
    radius = 350.0 / np.linalg.norm(bends[0])
    assert np.linalg.norm(poses[16, :3, 3]) == pytest.approx(2 * radius * np.sin(175.0 / radius))


def test_tip_errors_are_those_of_the_appendix():
    straight = se3.pose(np.eye(3), (0, 0, 700))
    measured = se3.pose(se3.rotation([0, 0.8, 0]), (300, 0, 300))
    model = se3.pose(se3.rotation([0, 0.6, 0]), (300, 50, 300))
    errors = tip_errors(model, measured, straight)
    assert (errors.angle, errors.relative_angle) == pytest.approx((0.2, 0.25))
    assert (errors.position, errors.relative_position) == pytest.approx((50.0, 0.1))
    assert tip_errors(model, straight, straight).relative_position == np.inf
