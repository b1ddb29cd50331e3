"""Spatial hinge chains before statics: rigid motions, kinematics, tendon lengths, and what cannot be built."""

import numpy as np
import pytest

from rollingjoint import (
    Bead,
    BeadTendon,
    HingeChain,
    InvalidInput,
    MechanismError,
    flexible_arm,
    small_arm,
    solve_tensions,
)
from rollingjoint.chain import se3

RNG = np.random.default_rng(5)
TWISTS = np.concatenate([RNG.normal(size=(20, 6)), 1e-9 * RNG.normal(size=(3, 6)), np.zeros((1, 6))])


def test_exp_is_the_matrix_exponential():
    for xi in TWISTS:
        generator = np.zeros((4, 4))
        generator[:3, :3], generator[:3, 3] = se3.skew(xi[:3]), xi[3:]
        power, series = np.eye(4), np.eye(4)
        for k in range(1, 60):
            power = power @ generator / k
            series = series + power
        assert se3.exp(xi) == pytest.approx(series, abs=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-5, 0.0099, 0.0101, 1.0, 3.0, np.pi - 1e-9, np.pi])
def test_log_undoes_exp_at_every_angle(angle):
    axis = np.array([0.6, -0.64, 0.48])
    T = se3.exp([*(angle * axis), 1.0, 2.0, 3.0])
    assert se3.exp(se3.log(T)) == pytest.approx(T, abs=1e-12)
    assert np.linalg.norm(se3.log(T)[:3]) == pytest.approx(angle, abs=1e-12)


def test_adjoints_carry_twists_and_brackets_are_their_derivative():
    T, S, xi = se3.exp(TWISTS[0]), se3.exp(TWISTS[1]), TWISTS[2]
    assert se3.adjoint(T) @ se3.adjoint(S) == pytest.approx(se3.adjoint(T @ S), abs=1e-12)
    assert T @ se3.exp(xi) @ se3.inverse(T) == pytest.approx(se3.exp(se3.adjoint(T) @ xi), abs=1e-11)
    slope = (se3.adjoint(se3.exp(1e-6 * xi)) - se3.adjoint(se3.exp(-1e-6 * xi))) / 2e-6
    assert slope == pytest.approx(se3.bracket(xi), abs=1e-9)
    lanes = se3.log(se3.exp(TWISTS))
    assert lanes.shape == TWISTS.shape


def test_a_straight_arm_points_along_z_and_its_hinges_turn_about_x_and_y():
    arm = flexible_arm()
    poses = arm.poses(np.zeros(32))
    assert poses[:, :3, 3] == pytest.approx(np.outer(np.arange(33), (0, 0, 21.875)))
    assert arm.neutral_lengths == pytest.approx([350.0] * 4 + [700.0] * 4, abs=1e-10)
    bent = np.zeros(32)
    bent[1] = 0.2  # about y: towards +x
    assert arm.poses(bent)[-1, :3, 3] == pytest.approx(
        (31 * 21.875 * np.sin(0.2), 0.0, 21.875 * (1 + 31 * np.cos(0.2)))
    )


def test_an_exact_gap_is_the_half_angle_formula():
    """gap = h cos(theta/2) - 2 r sin(theta/2), r = x at a y hinge and -y at an x hinge."""
    arm = small_arm(2)
    h, theta = 8.0, np.array([0.3, -0.2])
    rest = 2 * (20.0 - h)
    for j, (x, y) in enumerate(((15, 0), (0, 15), (-15, 0), (0, -15))):
        gaps = h * np.cos(theta / 2) - 2 * np.array([-y, x]) * np.sin(theta / 2)
        assert arm.tendon_lengths(theta)[j] == pytest.approx(rest + gaps.sum(), abs=1e-12)


def test_linear_lengths_are_tangent_to_the_exact_ones():
    exact, linear = small_arm(3), small_arm(3, "linear")
    small = 1e-4 * RNG.normal(size=3)
    assert linear.tendon_lengths(small) == pytest.approx(exact.tendon_lengths(small), abs=1e-6)
    assert linear.neutral_lengths == pytest.approx(exact.neutral_lengths, abs=1e-12)
    assert np.abs(linear.tendon_lengths(small) - linear.neutral_lengths).max() > 1e-4


def test_the_polyline_through_the_holes_is_as_long_as_the_tendon():
    twisted = [Bead(20.0, RNG.normal(size=3), 300.0, gap) for gap in (6.0, 9.0, 4.0, 7.0)]
    arm = HingeChain(twisted, [BeadTendon(RNG.normal(size=(5, 2)) * 0.1 + (9, 2)), BeadTendon([(-8, 3)], 2)])
    theta = np.array([0.1, -0.2, 0.15, 0.05])
    for line, length in zip(arm.tendon_polyline(arm.poses(theta)), arm.tendon_lengths(theta), strict=True):
        assert np.linalg.norm(np.diff(line, axis=0), axis=1).sum() == pytest.approx(length, abs=1e-9)


def test_the_polyline_through_the_holes_moves_with_the_base():
    arm = flexible_arm()
    poses, base = arm.poses(np.full(arm.n_joints, 0.1)), se3.pose(se3.rotation([0.2, -0.1, 0.3]), [1.0, 2.0, 3.0])
    for line, moved in zip(arm.tendon_polyline(poses), arm.tendon_polyline(base @ poses), strict=True):
        np.testing.assert_allclose(moved, line @ base[:3, :3].T + base[:3, 3], atol=1e-12)


def test_exact_hinges_end_where_tendon_holes_meet_and_no_sooner_than_their_own_limits():
    arm = flexible_arm()
    assert arm.joint_limits[0] == pytest.approx([-2 * np.arctan(10 / 50), 2 * np.arctan(10 / 50)], abs=1e-3)
    diagonal = 25 * 0.5**0.5  # only these tendons cross the second segment
    assert arm.joint_limits[31, 1] == pytest.approx(2 * np.arctan(5 / diagonal), abs=1e-3)
    assert flexible_arm("linear").joint_limits[0] == pytest.approx([-np.pi, np.pi])
    low = arm.replace(beads=[Bead(21.875, "x", 600.0, limits=(-0.1, 0.2))] * 32)
    assert low.joint_limits[5] == pytest.approx([-0.1, 0.2])


@pytest.mark.parametrize(
    "change",
    [
        {"stiffness": 0.0},
        {"stiffness": -1.0},
        {"stiffness": np.nan},
        {"spacing": 0.0},
        {"gap": 25.0},
        {"gap": 0.0},
        {"weight": -0.1},
        {"axis": (0, 0, 0)},
        {"axis": "w"},
        {"limits": (0.1, 0.2)},
        {"limits": (-9.0, 9.0)},
        {"rest_angle": "straight"},
    ],
)
def test_beads_that_cannot_be_are_refused(change):
    with pytest.raises(MechanismError):
        Bead(**{"spacing": 20.0, "axis": "x", "stiffness": 500.0, **change})


def test_chains_that_cannot_be_are_refused():
    bead, tendon = Bead(20.0, "x", 500.0), BeadTendon([(10, 0)])
    for beads, tendons in (([], [tendon]), ([bead], []), ([bead], [bead]), (None, [tendon])):
        with pytest.raises(MechanismError):
            HingeChain(beads, tendons)
    for tendons in ([BeadTendon([(10, 0)], 3)], [BeadTendon([(10, 0), (10, 0), (10, 0)])]):
        with pytest.raises(MechanismError):
            HingeChain([bead], tendons)
    with pytest.raises(MechanismError, match="exact, linear, end_couple"):
        HingeChain([bead], [tendon], model="magic")
    with pytest.raises(MechanismError, match="tendon holes meet"):
        HingeChain([Bead(20.0, "y", 500.0, rest_angle=1.0)], [tendon])
    for holes in ([], [(1, 2, 3)], [("a", "b")], [(np.nan, 0)]):
        with pytest.raises(MechanismError):
            BeadTendon(holes)
    with pytest.raises(InvalidInput):
        small_arm().poses(np.zeros(3))


def _planar_functions():
    from rollingjoint.cad import bodies
    from rollingjoint.design import DesignSpace, LateralStiffness, measure
    from rollingjoint.differentiable import DifferentiableChain
    from rollingjoint.plotting import plot_family, plot_mechanism

    return {
        "plot_mechanism": plot_mechanism,
        "plot_family": lambda arm: plot_family([arm], ["arm"]),
        "bodies": bodies,
        "DifferentiableChain": DifferentiableChain.from_mechanism,
        "measure": lambda arm: measure(arm, [LateralStiffness()]),
        "DesignSpace.vector": DesignSpace().vector,
    }


@pytest.mark.parametrize("arm", [small_arm(), solve_tensions(small_arm(), np.ones(4))], ids=["arm", "equilibrium"])
def test_what_is_for_planar_chains_refuses_arms_in_one_line(arm):
    message = r"mechanism = <Hinge.*: expected a planar chain of rolling links"
    for name, function in _planar_functions().items():
        with pytest.raises(InvalidInput, match=message) as caught:
            function(arm)
        assert "\n" not in str(caught.value), name
