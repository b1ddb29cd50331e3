"""Turns of tendons at the holes of beads: second geometry, closed form, small angles, differences."""

import numpy as np
import pytest

from rollingjoint import Bead, BeadTendon, HingeChain, flexible_arm, small_arm
from rollingjoint._numba.jit import standalone
from rollingjoint.kernels import hinges, turns
from rollingjoint.kernels.friction import ABOVE_RATE, BELOW_RATE, N_TURN, TURN

new_state, fill_turns = standalone(hinges.new_hinge_state), standalone(turns.fill_hinge_turns)


def turns_at(chain, theta):
    """(n - 1, m, 3): columns TURN, BELOW_RATE, ABOVE_RATE; NaN where nothing was filled."""
    shape = chain.n_joints, chain.n_tendons
    state, turn = new_state(*shape), np.full((*shape, N_TURN), np.nan)
    state.angle[:] = theta
    one = hinges.Hinges(*(table[0] for table in chain.arrays))._replace(tendon_joints=chain.arrays.tendon_joints)
    fill_turns(one, state, turn)
    return turn


def oblique_arm():
    """Beads of any axis, twisted ones too; tendons whose holes differ from bead to bead, one that ends earlier."""
    rng = np.random.default_rng(4)
    beads = [Bead(20.0, axis, 500.0, gap=7.0) for axis in [*rng.normal(size=(3, 3)), (0, 0, 1), "x"]]
    tendons = [BeadTendon(12 * np.array([np.cos(a), np.sin(a)]) + rng.normal(size=(6, 2))) for a in (0.3, 2.0, 4.5)]
    return HingeChain(beads, [*tendons, BeadTendon(rng.normal(size=(4, 2)), 3)])


def angle(u, v):
    return np.arctan2(np.linalg.norm(np.cross(u, v)), u @ v)


@pytest.mark.slow
@pytest.mark.parametrize("arm", [small_arm(), oblique_arm(), flexible_arm()], ids=["small", "oblique", "flexible"])
def test_turns_are_the_angles_between_channels_and_segments_in_the_world(arm):
    theta = np.random.default_rng(1).uniform(-0.3, 0.3, arm.n_joints)
    poses, turn = arm.poses(theta), turns_at(arm, theta)
    for j, line in enumerate(arm.tendon_polyline(poses)):
        entry = 0.0
        for i in range(arm.last_links[j]):
            v = line[2 * i + 1] - line[2 * i]
            assert turn[i, j, TURN] == pytest.approx(entry + angle(poses[i, :3, 2], v), abs=1e-13)
            entry = angle(v, poses[i + 1, :3, 2])
        assert np.all(np.isnan(turn[arm.last_links[j] :, j]))


def test_slopes_of_the_turns_are_their_differences():
    arm = oblique_arm()
    for theta in np.random.default_rng(2).uniform(-0.3, 0.3, (5, 5)):
        for i, step in enumerate(1e-6 * np.eye(5)):
            slope = (turns_at(arm, theta + step) - turns_at(arm, theta - step))[..., TURN] / 2e-6
            rates = turns_at(arm, theta)
            assert rates[i, :, BELOW_RATE] == pytest.approx(slope[i], abs=1e-7, nan_ok=True)
            for j in np.flatnonzero(i + 1 < np.array(arm.last_links)):
                assert rates[i, j, ABOVE_RATE] == pytest.approx(slope[i + 1, j], abs=1e-7)


def test_a_straight_channel_across_the_hinge_turns_by_half_the_angle_at_each_hole():
    for theta in (0.3, -0.2, 1e-3, 1e-12, -1e-100):
        turn = turns_at(small_arm(2), [theta, theta])
        assert turn[..., TURN] == pytest.approx(
            np.array([4 * [0.5 * abs(theta)], 4 * [abs(theta)]]), rel=1e-13, abs=0.0
        )
        assert turn[..., BELOW_RATE:] == pytest.approx(np.full((2, 4, 2), 0.5 * np.sign(theta)), rel=1e-13, abs=0.0)


def test_a_straight_tendon_does_not_turn_and_has_no_slope():
    assert np.array_equal(turns_at(flexible_arm(), np.zeros(32))[:16], np.zeros((16, 8, N_TURN)))
