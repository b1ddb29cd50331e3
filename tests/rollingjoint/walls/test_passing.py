"""Steps that would pass through an obstacle: done again in parts, or refused with the pose before."""

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint import Status
from rollingjoint.chain.batch import range_among_walls, step_range_among_walls
from rollingjoint.chain.friction_step import no_friction
from rollingjoint.chain.solution import stacked
from rollingjoint.chain.wall_step import new_wall_arrays
from rollingjoint.kernels.arrays import TendonLaw
from rollingjoint.kernels.friction import new_friction_arrays
from tests.rollingjoint.walls.scenes import CHAIN, LIMITS, REST, RUBBING

HARD = rj.Disc((12.0, 45.0), 4.0, stiffness=5.0)
SOFT = rj.Disc((12.0, 45.0), 4.0, stiffness=1e-3)


def around(*walls, mu=0.0):
    return rj.Surroundings(walls, rj.Sleeve(5.0), rj.WallFriction(mu) if mu else None)


def solve(surroundings, base, mechanism=CHAIN, command=REST, **more):
    return rj.solve_lengths(mechanism, command, tension_limits=LIMITS, surroundings=surroundings, base=base, **more)


def side_of(equilibrium, disc=HARD):
    """Where the middle of the disc is from the nearest part of the chain's axis: 1 to the left, -1 to the right."""
    centre = np.array(disc.centre) - equilibrium.walls.base[:2]
    axis = np.concatenate([[[0.0, 0.0]], equilibrium.poses[:, :2]])
    ends = np.diff(axis, axis=0)
    squared = np.maximum((ends**2).sum(axis=1), 1e-12)
    share = np.clip(((centre - axis[:-1]) * ends).sum(axis=1) / squared, 0.0, 1.0)
    apart = centre - (axis[:-1] + share[:, None] * ends)
    nearest = int(np.argmin((apart**2).sum(axis=1)))
    return np.sign(ends[nearest, 0] * apart[nearest, 1] - ends[nearest, 1] * apart[nearest, 0])


@pytest.mark.parametrize("mechanism, mu", [(CHAIN, 0.0), (CHAIN, 0.2), (RUBBING, 0.2)], ids=["none", "walls", "both"])
def test_a_large_step_of_the_base_stays_on_its_side_of_a_disc(mechanism, mu):
    scene = around(HARD, mu=mu)
    first = solve(scene, (0.0, 0.0, 0.0), mechanism).require()
    past = {"history": first} if mu else {"start": first}
    cold = solve(scene, (16.0, 0.0, 0.0), mechanism, start=first.joint_angles)
    assert side_of(first) == -1.0 and cold.ok and side_of(cold) == 1.0  # what would pass
    large = solve(scene, (16.0, 0.0, 0.0), mechanism, **past)
    assert large.status is Status.CONVERGED and side_of(large) == -1.0
    assert any(contact.kind == "disc" for contact in large.wall_contacts)
    small = first
    for x in np.linspace(0.0, 16.0, 5)[1:]:
        small = solve(scene, (x, 0.0, 0.0), mechanism, **({"history": small} if mu else {"start": small}))
    np.testing.assert_allclose(large.poses, small.poses, atol=1e-8)
    assert large.dissipated_work >= -1e-9 and large.walls.parts == 4


def test_a_step_through_a_disc_is_refused_with_the_pose_before():
    scene = around(SOFT)
    first = solve(scene, (0.0, 0.0, 0.0)).require()
    refused = solve(scene, (30.0, 0.0, 0.0), start=first)
    assert refused.status is Status.PASSED_THROUGH and not refused.ok
    assert np.array_equal(refused.poses, first.poses) and np.array_equal(refused.walls.base, first.walls.base)
    assert refused.stiffness.shape == (CHAIN.n_joints,) * 2
    with pytest.raises(rj.SolverError, match="passed through"):
        refused.require()
    again = solve(scene, (30.0, 0.0, 0.0), start=refused)
    assert again.status is Status.PASSED_THROUGH
    path = rj.trace(
        CHAIN, [REST] * 3, tension_limits=LIMITS, surroundings=scene, base=[(0, 0, 0), (30, 0, 0), (2, 0, 0)]
    )
    assert list(path.ok) == [True, False, True]


def test_a_tip_does_not_pass_through_a_capsule():
    scene = around(rj.Capsule((-70.0, 100.0), (70.0, 100.0), 1.0, stiffness=1.0))
    first = solve(scene, (0.0, 0.0, 0.0)).require()
    through = solve(scene, (0.0, 40.0, 0.0), start=first.joint_angles)
    assert through.ok and through.tip[1] + 40.0 > 105.0  # the bar crosses the capsule
    step = solve(scene, (0.0, 40.0, 0.0), start=first)
    assert step.status is Status.PASSED_THROUGH or step.tip[1] + step.walls.base[1] < 100.0


def test_ways_around_a_tip_are_no_passing():
    """The tip swings past a disc that is beyond it: nothing of the chain comes over its middle."""
    scene = around(rj.Disc((0.0, 105.0), 4.0, stiffness=1.0))
    pull = np.array([1.5, -1.5, 1.5, -1.5])
    first = solve(scene, (0.0, 0.0, 0.0), command=REST + pull).require()
    second = solve(scene, (0.0, 0.0, 0.0), command=REST - pull, start=first)
    assert first.tip[0] * second.tip[0] < 0.0 and second.ok


BEND = rj.Lumen([30.0, 10.0 * np.pi, 60.0], [0.0, 0.05, 0.0], radii=8.0, stiffness=1e-3)
INSIDE, ACROSS = np.array([0.0, 0.0, -6.0, 6.0]), np.array([-6.0, 6.0, -6.0, 6.0])


@pytest.mark.parametrize("mu", [0.0, 0.2])
def test_a_chain_does_not_pass_through_the_inner_wall_of_a_bend(mu):
    scene = around(BEND, mu=mu)
    first = solve(scene, (0.0, 0.0, 0.0), command=REST + INSIDE).require()
    across = solve(scene, (0.0, 0.0, 0.0), command=REST + ACROSS, start=first.joint_angles)
    assert across.ok and across.tip[1] < 30.0 < first.tip[1]  # on the other side of the middle of the bend
    past = {"history": first} if mu else {"start": first}
    step = solve(scene, (0.0, 0.0, 0.0), command=REST + ACROSS, **past)
    assert step.status is Status.PASSED_THROUGH and np.array_equal(step.poses, first.poses)
    assert solve(scene, (0.0, 0.0, 0.0), command=REST + 0.9 * INSIDE, **past).ok


def test_the_middle_of_a_wide_bend_in_another_limb_is_no_wall():
    """The last limb of the lumen leads through the middle of its first bend, over which the chain may swing there."""
    radius, tight = 50.0, 50.0 / 3.0
    lengths, curvatures = [40.0, radius * np.pi / 3, tight * np.pi / 1.5, 110.0], [0.0, 1.0 / radius, 1.0 / tight, 0.0]
    lumen = rj.Lumen(lengths, curvatures, radii=8.0, stiffness=1e-3)
    x, y, angle = lumen.pose(lumen.length - 100.0)
    scene, base, pull = around(lumen), (x, y, angle - 0.5 * np.pi), np.array([1.0, -1.0, 1.0, -1.0])
    first = solve(scene, base, command=REST + pull).require()
    second = solve(scene, base, command=REST - pull, start=first)
    assert first.tip[0] > 0.0 > second.tip[0]  # the middle is ahead of the base, where its x is 0
    assert second.ok and second.walls.parts == 1


@pytest.mark.parametrize("rubs", [False, True])
def test_kernels_of_batches_refuse_steps_through_walls(rubs):
    """As environments call them: rows that pass end so, whose memory stays; the others, and unknown ways, do not."""
    scene = around(HARD, mu=0.2 if rubs else 0.0)
    first = solve(scene, (0.0, 0.0, 0.0))
    bases = np.array([(16.0, 0.0, 0.0), (1.0, 0.0, 0.0), (16.0, 0.0, 0.0)])
    at = np.repeat(first.poses[None], 3, axis=0), np.array([(0.0, 0.0, 0.0), (0.0, 0.0, 0.0), [np.nan] * 3])
    law = TendonLaw(*(np.tile(np.broadcast_to(v, 4), (3, 1)) for v in (REST, CHAIN.stiffnesses, *LIMITS)))
    results = CHAIN.kernels.new_results(3, CHAIN.n_joints, 4)
    starts, tables = np.repeat(first.joint_angles[None], 3, axis=0), np.zeros((3, 0, len(CHAIN.load_columns)))
    batch = CHAIN.kernels.batch_arrays(CHAIN.arrays, np.zeros(3, np.int64), law, tables, starts, results)
    walls = new_wall_arrays(scene.arrays(CHAIN), np.zeros(3, np.int64), bases, CHAIN.n_joints, None, at)
    if rubs:
        step_range_among_walls(batch, new_friction_arrays(*no_friction(starts, 4)), walls, 0, 3)
    else:
        range_among_walls(batch, walls, 0, 3)
    assert results.status.tolist() == [Status.PASSED_THROUGH, Status.CONVERGED, Status.CONVERGED]
    assert not walls.after.states[0].any()


def test_rows_of_a_batch_are_refused_one_by_one():
    scenes, bases = [around(HARD), around(SOFT), around(HARD)], [(16.0, 0.0, 0.0), (30.0, 0.0, 0.0), (1.0, 0.0, 0.0)]
    first = [solve(scene, (0.0, 0.0, 0.0)) for scene in scenes]
    batch = rj.solve_lengths_batch(
        CHAIN, [REST] * 3, tension_limits=LIMITS, surroundings=scenes, base=bases, starts=stacked(first)
    )
    assert [Status(int(code)) for code in batch.status] == [Status.CONVERGED, Status.PASSED_THROUGH, Status.CONVERGED]
    for row, (scene, base, start) in enumerate(zip(scenes, bases, first, strict=True)):
        single = solve(scene, base, start=start)
        assert single.status == batch.row(row).status
        assert np.array_equal(single.joint_angles, batch.joint_angles[row])
        assert np.array_equal(single.wall_forces, batch.wall_forces[row])
        assert np.array_equal(single.walls.base, batch.walls.base[row])
