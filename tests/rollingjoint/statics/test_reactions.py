"""What hinges carry: the balance of the links beyond them, and the reactions of the same arm as a chain in space."""

from dataclasses import replace

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint import CapstanFriction, InvalidInput, SpatialChain, small_arm
from rollingjoint.statics.reactions import hinge_frames, hinge_reactions

RNG = np.random.default_rng(0)
BEADS = [replace(bead, weight=0.3, axis=(1.0, 0.4 * (-1) ** i, 0.2)) for i, bead in enumerate(small_arm(5).beads)]
ARM = small_arm(5).replace(beads=BEADS, springs=(rj.Spring(4, 0.2, (10.0, 5.0, 80.0)),))
LOADS = [
    ARM.gravity(),
    rj.WorldForce(-1, (0.3, 0.2, -0.1), point=(1.0, 2.0, 3.0)),
    rj.BodyWrench(2, (0.1, 0.2, 0.0), (0.0, 1.0, 5.0)),
]
TENSIONS = RNG.uniform(1.0, 4.0, (6, ARM.n_tendons))


def test_reactions_are_those_of_the_arm_as_a_chain_in_space():
    chain = SpatialChain.from_arm(ARM)
    many = rj.solve_tensions_batch(ARM, TENSIONS, LOADS)
    found = hinge_reactions(many)
    assert many.ok.all() and found.shape == (6, ARM.n_joints, 6)
    expected = rj.solve_tensions_batch(chain, TENSIONS, LOADS).reactions
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)
    np.testing.assert_allclose(hinge_reactions(many.row(2)), found[2], rtol=0, atol=0)


@pytest.mark.slow
def test_after_a_step_with_friction_tendons_pull_with_the_tensions_of_their_gaps():
    arm = ARM.replace(friction=CapstanFriction(0.2, 0.05))
    chain = SpatialChain.from_arm(arm)
    first, other = (rj.solve_tensions(each, TENSIONS[0], LOADS) for each in (arm, chain))
    bent = rj.solve_tensions(arm, TENSIONS[1], LOADS, history=first)
    expected = rj.solve_tensions(chain, TENSIONS[1], LOADS, history=other).reactions
    np.testing.assert_allclose(hinge_reactions(bent), expected, rtol=0, atol=1e-7)
    assert np.abs(hinge_reactions(bent) - hinge_reactions(rj.solve_tensions(arm, TENSIONS[1], LOADS))).max() > 0.1


def test_the_first_hinge_balances_loads_and_tendons():
    arm = ARM.replace(springs=())
    force, place = np.array([0.3, 0.2, -0.1]), np.array([1.0, 2.0, 3.0])
    bent = rj.solve_tensions(arm, TENSIONS[0], [rj.WorldForce(-1, force, point=place)]).require()
    chain, poses = SpatialChain.from_arm(arm), bent.poses
    held, turned = force.copy(), np.cross(poses[-1, :3, 3] + poses[-1, :3, :3] @ place, force)
    for points, tension in zip(chain.hole_points, TENSIONS[0], strict=True):
        upper = poses[1, :3, 3] + poses[1, :3, :3] @ points[1, 0]
        pull = tension * (points[0, 1] - upper) / np.linalg.norm(points[0, 1] - upper)
        held, turned = held + pull, turned + np.cross(upper, pull)
    reaction = hinge_reactions(bent)[0].reshape(2, 3) @ hinge_frames(arm)[0]
    np.testing.assert_allclose(reaction, -np.array([held, turned]), rtol=0, atol=1e-9)


def test_rows_may_have_arms_of_their_own_and_invalid_rows_are_nan():
    other = ARM.scaled(*(RNG.uniform(0.5, 2.0, size) for size in (ARM.n_joints, ARM.n_tendons, ARM.n_joints)))
    tensions = np.vstack([TENSIONS[:2], np.full((1, ARM.n_tendons), np.nan)])
    found = hinge_reactions(rj.solve_tensions_batch([ARM, other, ARM], tensions, LOADS))
    alone = hinge_reactions(rj.solve_tensions(other, TENSIONS[1], LOADS))
    np.testing.assert_allclose(found[1], alone, rtol=0, atol=1e-8)
    assert np.isnan(found[2]).all() and np.isfinite(found[:2]).all()


@pytest.mark.parametrize("mechanism", [small_arm(4, "linear"), rj.pitch_yaw()], ids=["linear", "no arm"])
def test_other_mechanisms_are_refused_in_one_line(mechanism):
    with pytest.raises(InvalidInput, match=r"exact|reactions") as refusal:
        hinge_reactions(rj.solve_tensions(mechanism, np.ones(mechanism.n_tendons)))
    assert "\n" not in str(refusal.value)
