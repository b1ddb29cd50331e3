"""Chains in space: reference equilibria, the plane, stiffness, balance of links, sensitivities, wrong input."""

import json
import pickle

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.optimize import linprog

from rollingjoint import (
    Bead,
    BeadTendon,
    BodyWrench,
    CapstanFriction,
    HingeChain,
    InvalidInput,
    MechanismError,
    PointHinge,
    RollingContact,
    SpaceTendon,
    SpatialChain,
    SpatialLink,
    Spring,
    Status,
    Tendon,
    TorsionSpring,
    WorldForce,
    five_link,
    flexible_arm,
    prepare,
    preset,
    sensitivity,
    small_arm,
    solve_lengths,
    solve_lengths_batch,
    solve_tensions,
    solve_tensions_batch,
    trace,
    two_segment,
    uniform,
)
from rollingjoint.chain.contact_line import least_friction
from rollingjoint.io import report
from rollingjoint.plotting.spatial import plot_arm
from tests.rollingjoint.chain.spatial_chains import (
    alternating,
    arc,
    random_chain,
    random_loads,
    rolling_contact,
    unbalanced,
)
from tests.second_opinions import spatial_reference as reference

CASES = reference.cases()
FIELDS = ("joint_angles", "poses", "tensions", "lengths", "contact_points", "reactions", "tendon_rates", "residual")


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"][:30])
def test_reference_equilibria_are_met(case):
    equilibrium = reference.solved(case)
    assert equilibrium.status is Status.CONVERGED
    assert equilibrium.iterations <= 6
    for name, difference in reference.differences(case, equilibrium).items():
        assert difference < 2e-10, name


def in_space(planar, azimuth, rng):
    """The same planar chain in a plane of space; holes are moved along the axis, each tendon by another distance."""
    joints = [
        RollingContact(azimuth, above.parent, below.child, 3.0)
        for below, above in zip(planar.links, planar.links[1:], strict=False)
    ]
    lateral, axis = np.array([np.cos(azimuth), np.sin(azimuth), 0]), np.array([np.sin(azimuth), -np.cos(azimuth), 0])
    tendons = []
    for points, tendon in zip(planar.hole_points, planar.tendons, strict=True):
        holes = points[..., :1] * lateral + points[..., 1:] * [0, 0, 1] + rng.uniform(-3, 3) * axis
        tendons.append(SpaceTendon(holes, tendon.end, tendon.stiffness))
    return SpatialChain(joints, tendons), lateral


@pytest.mark.parametrize("planar", [five_link(), uniform(7), two_segment()], ids=lambda chain: chain.name)
def test_joints_of_one_plane_are_a_planar_chain(planar):
    rng = np.random.default_rng(3)
    for azimuth in rng.uniform(-np.pi, np.pi, 4):
        chain, lateral = in_space(planar, azimuth, rng)
        assert chain.neutral_lengths == pytest.approx(planar.neutral_lengths, abs=1e-11)
        f, m = 0.1 * rng.normal(size=2), 2.0 * rng.normal()
        flat = [WorldForce(-1, tuple(f), m, (1.0, 2.0))]
        axis = np.cross(lateral, [0, 0, 1])
        space = [
            WorldForce(-1, tuple(f[0] * lateral + f[1] * np.array([0, 0, 1])), tuple(m * axis), (*lateral[:2], 2.0))
        ]
        pulls = rng.uniform(2, 6, planar.n_tendons)
        commands = planar.neutral_lengths - rng.uniform(0, 0.5, planar.n_tendons)
        for there, here in (
            (solve_tensions(planar, pulls, flat), solve_tensions(chain, pulls, space)),
            (solve_lengths(planar, commands, flat), solve_lengths(chain, commands, space)),
        ):
            assert here.status is there.status
            assert here.positions @ lateral == pytest.approx(there.positions[:, 0], abs=5e-9)
            assert here.positions[:, 2] == pytest.approx(there.positions[:, 1], abs=5e-9)
            assert here.positions @ axis == pytest.approx(0.0, abs=1e-11)
            assert here.reactions[:, :2] == pytest.approx(there.contact_forces, abs=1e-7)
            assert here.arc_lengths == pytest.approx(there.arc_lengths, abs=1e-8)
            assert here.smallest_eigenvalue == pytest.approx(there.smallest_eigenvalue, rel=1e-7)


@pytest.mark.parametrize("seed", range(8))
def test_every_link_is_in_balance(seed):
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, n=int(rng.integers(1, 12)))
    loads = random_loads(rng, chain, potential=bool(seed % 2))
    equilibrium = solve_tensions(chain, rng.uniform(1, 4, chain.n_tendons), loads)
    assert equilibrium.ok
    assert unbalanced(chain, equilibrium) == pytest.approx((0.0, 0.0), abs=1e-9)
    free, springs = equilibrium.free_joints, [joint.stiffness for joint in chain.joints]
    rests = np.array([joint.rest_angle for joint in chain.joints])
    moment = -np.array(springs) * (equilibrium.joint_angles - rests)
    assert equilibrium.reactions[free, 5] == pytest.approx(moment[free], abs=1e-8)


def hinged(rng):
    """A rolling contact, or a tilted hinge between two links."""
    if rng.random() < 0.5:
        return rolling_contact(rng)
    axis = rng.normal(size=3) * [1.0, 1.0, 0.3]
    spring = rng.uniform(5, 30), 0.1 * rng.normal()
    return PointHinge(axis, (0.2, -0.1, 3.5), (0.1, 0.0, -3.5), *spring, (-0.5, 0.5))


@pytest.mark.parametrize("seed", range(6))
def test_every_link_of_a_mixed_chain_is_in_balance(seed):
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, n=6, joint=hinged)
    assert {type(joint) for joint in chain.joints} == {PointHinge, RollingContact}
    at = solve_tensions(chain, rng.uniform(1, 4, chain.n_tendons), random_loads(rng, chain, bool(seed % 2)))
    assert at.ok
    assert unbalanced(chain, at) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert np.array_equal(np.isnan(at.arc_lengths), [isinstance(joint, PointHinge) for joint in chain.joints])


def as_points(arm):
    """The beads of an arm as links between point hinges: the origin of a link is at its hinge below the next bead."""
    below = [(0.0, 0.0, 0.0)] * arm.n_joints
    joints = [
        PointHinge(bead.axis, place, (0.0, 0.0, -bead.spacing), bead.stiffness, bead.rest_angle, bead.limits)
        for bead, place in zip(arm.beads, below, strict=True)
    ]
    tendons = []
    for tendon in arm.tendons:
        holes = []
        for k, (x, y) in enumerate(tendon.link_holes(arm.n_links)):
            entry = -arm.beads[k - 1].spacing + 0.5 * arm.beads[k - 1].gap if k else -0.5 * arm.beads[0].gap
            leave = -0.5 * arm.beads[min(k, arm.n_joints - 1)].gap
            holes.append([(x, y, entry), (x, y, leave)])
        tendons.append(SpaceTendon(holes, tendon.end, tendon.stiffness))
    return SpatialChain(joints, tendons)


def tilted_arm():
    axes = np.random.default_rng(4).normal(size=(4, 3))
    beads = [Bead(20.0, axis, 500.0, gap=7.0, rest_angle=0.05) for axis in axes]
    return HingeChain(beads, [BeadTendon([(12 * np.cos(t), 12 * np.sin(t))]) for t in (0.3, 2.0, 4.5)])


@pytest.mark.parametrize("arm", [small_arm(5), tilted_arm(), flexible_arm()], ids=["small", "tilted", "flexible"])
def test_chains_of_hinges_are_arms(arm):
    rng, chain = np.random.default_rng(1), as_points(arm)
    assert chain.joint_limits == pytest.approx(arm.joint_limits, abs=2e-3)
    assert chain.neutral_lengths == pytest.approx(arm.neutral_lengths, abs=1e-10)
    for potential in (True, False):
        loads = [WorldForce(-1, (0.05, 0.02, -0.1), (0.0, 0.0, 0.0) if potential else (3.0, 1.0, 2.0), (1.0, 0.0, 2.0))]
        loads += [Spring(2, 0.01, (20.0, 5.0, 50.0))] + ([] if potential else [BodyWrench(-1, (0.1, 0.0, 0.0))])
        pulls, commands = rng.uniform(1, 3, arm.n_tendons), arm.neutral_lengths - rng.uniform(0, 0.2, arm.n_tendons)
        for there, here in (
            (solve_tensions(arm, pulls, loads), solve_tensions(chain, pulls, loads)),
            (solve_lengths(arm, commands, loads), solve_lengths(chain, commands, loads)),
        ):
            assert here.status is there.status
            assert here.poses == pytest.approx(there.poses, abs=2e-8)
            assert here.tensions == pytest.approx(there.tensions, abs=1e-9)
            assert here.stiffness == pytest.approx(there.stiffness, abs=1e-7)
            assert here.pose_jacobian == pytest.approx(there.pose_jacobian, abs=1e-7)
            assert here.contact_points == pytest.approx(there.positions[:-1], abs=2e-8)


@pytest.mark.parametrize(
    "wrong",
    [
        {"axis": (0.0, 0.0, 0.0)},
        {"axis": (1.0, 0.0)},
        {"below": (0.0, 0.0, np.nan)},
        {"above": "there"},
        {"limits": (0.5, -0.5)},
        {"stiffness": -1.0},
    ],
)
def test_impossible_hinges_are_refused(wrong):
    with pytest.raises(MechanismError):
        PointHinge(**{"axis": (1.0, 0.0, 0.0), "below": (0.0, 0.0, 3.0), "above": (0.0, 0.0, -3.0)} | wrong)


def test_holes_that_meet_at_a_hinge_end_its_range_or_are_refused():
    hinge = PointHinge((0.0, -1.0, 0.0), (0.0, 0.0, 3.0), (0.0, 0.0, -3.0))
    meeting = SpaceTendon([((1.0, 0.0, -2.5), (1.0, 0.0, 2.5))])
    low, high = SpatialChain([hinge], [meeting]).joint_limits[0]
    assert low == pytest.approx(-2.0 * np.arctan2(0.5, 1.0), abs=2e-3)
    assert high == pytest.approx(np.pi, abs=1e-12)
    with pytest.raises(MechanismError, match="holes meet"):
        SpatialChain([hinge], [SpaceTendon([((1.0, 0.0, -3.0), (1.0, 0.0, 3.0))])])


@pytest.mark.parametrize("potential", [True, False])
def test_stiffness_predicts_the_answer_to_tensions(potential):
    for seed in range(4):
        rng = np.random.default_rng(seed)
        chain = random_chain(rng, n=6)
        loads = random_loads(rng, chain, potential)
        equilibrium = solve_tensions(chain, rng.uniform(1, 4, 4), loads)
        free = np.flatnonzero(equilibrium.free_joints)
        response = np.linalg.inv(equilibrium.stiffness[np.ix_(free, free)])
        for j in range(4):
            step = np.zeros(4)
            step[j] = 1e-5
            ends = [solve_tensions(chain, equilibrium.tensions + sign * step, loads, equilibrium) for sign in (1, -1)]
            slope = (ends[0].joint_angles - ends[1].joint_angles) / 2e-5
            assert slope[free] == pytest.approx(-response @ equilibrium.tendon_rates[free, j], abs=1e-6)
        if potential:
            assert equilibrium.stiffness == pytest.approx(equilibrium.stiffness.T, abs=1e-12)


def test_sensitivities_turn_about_contacts():
    rng = np.random.default_rng(5)
    chain, pulls = random_chain(rng, n=4), np.array([3.0, 2.0, 2.5, 3.0])
    loads = random_loads(rng, chain)
    at = solve_tensions(chain, pulls, loads)
    rates = sensitivity.dposes_dload(at, 3, (0.5, -1.0, 2.0))
    for k in range(3):
        force = np.zeros(3)
        force[k] = 1e-5
        push = [[*loads, WorldForce(3, tuple(s * force), point=(0.5, -1.0, 2.0))] for s in (1, -1)]
        ends = [solve_tensions(chain, pulls, load, at) for load in push]
        assert rates[:, :3, k] == pytest.approx((ends[0].positions - ends[1].positions) / 2e-5, abs=1e-6)
    lengths = sensitivity.dlengths_dtensions(at)
    ends = [solve_tensions(chain, pulls + s * 1e-5 * np.eye(4)[0], loads, at) for s in (1, -1)]
    assert lengths[:, 0] == pytest.approx((ends[0].lengths - ends[1].lengths) / 2e-5, abs=1e-6)


def test_poses_and_lengths_of_angles_are_those_of_equilibria():
    chain = random_chain(np.random.default_rng(2))
    at = solve_tensions(chain, [3.0, 2.0, 3.0, 2.0])
    assert np.array_equal(chain.poses(at.joint_angles), at.poses)
    assert chain.tendon_lengths([at.joint_angles] * 2)[1] == pytest.approx(at.lengths, abs=1e-12)
    walked = [np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in chain.tendon_polyline(at.poses)]
    assert walked == pytest.approx(at.lengths, abs=1e-11)


def test_batches_prepared_problems_and_traces_are_single_solves():
    chain = alternating(8)
    loads = [chain.gravity((1.0, 0.0, 0.0)), WorldForce(-1, (0.02, 0.03, 0.0))]
    commands = chain.neutral_lengths - np.random.default_rng(1).uniform(0, 1, (5, 4))
    batch = solve_lengths_batch(chain, commands, loads)
    problem, path = prepare(chain, loads), trace(chain, commands, loads)
    for row, command in enumerate(commands):
        single = solve_lengths(chain, command, loads)
        for name in FIELDS:
            assert np.array_equal(getattr(batch.row(row), name), getattr(single, name)), name
            assert np.array_equal(getattr(problem.solve(command), name), getattr(single, name)), name
        assert path.row(row).tip == pytest.approx(single.tip, abs=1e-7)
    assert np.array_equal(pickle.loads(pickle.dumps(batch)).reactions, batch.reactions)


def test_chains_of_one_topology_stack():
    rng = np.random.default_rng(8)
    chains = [random_chain(np.random.default_rng(seed), m=2, n=1) for seed in range(3)]
    pulls = rng.uniform(1, 3, (3, 2))
    batch = solve_tensions_batch(chains, pulls)
    for row, chain in enumerate(chains):
        assert np.array_equal(batch.row(row).poses, solve_tensions(chain, pulls[row]).poses)


def test_long_chains_take_the_same_poses_as_short_steps():
    chain = alternating(40, joint_stiffness=3.0)
    at = solve_lengths(chain, chain.neutral_lengths - [0.5, 0.0, 1.0, 0.2], [WorldForce(-1, (0.01, 0.0, -0.02))])
    assert at.status is Status.CONVERGED
    assert unbalanced(chain, at) == pytest.approx((0.0, 0.0), abs=1e-8)


def test_springs_of_the_mechanism_and_rest_angles_beyond_the_range_act():
    joints = [RollingContact(0.0, arc(0.2, (0, -3)), arc(-0.2, (0, 3)), 2.5, 0.0, 5.0, 3.0)]
    tendon = SpaceTendon([((1.0, 0.0, -2.0), (1.0, 0.0, 2.0))])
    pushed = solve_tensions(SpatialChain(joints, [tendon]), [0.1])
    assert pushed.status is Status.AT_LIMIT
    assert pushed.joint_angles[0] == pushed.mechanism.joint_limits[0, 1]
    chain = alternating(4).replace(springs=[TorsionSpring(1, 20.0)])
    assert solve_tensions(chain, [3.0, 2.0, 1.0, 2.0]).stiffness[0, 0] > 20.0


BODY = {"azimuth": 0.0, "parent": arc(0.2, (0, -3)), "child": arc(-0.2, (0, 3)), "half_width": 2.0}


@pytest.mark.parametrize(
    "wrong",
    [
        {"half_width": 0.0},
        {"half_width": np.nan},
        {"azimuth": np.inf},
        {"azimuth": 90.0},
        {"rest_angle": -7.0},
        {"middle": "left"},
        {"stiffness": -1.0},
        {"rest_angle": np.nan},
        {"child": 3},
    ],
)
def test_impossible_contacts_are_refused(wrong):
    with pytest.raises(MechanismError):
        RollingContact(**BODY | wrong)


def test_impossible_chains_are_refused():
    joint, tendon = RollingContact(**BODY), SpaceTendon([((1.0, 0.0, -2.0), (1.0, 0.0, 2.0))])
    crossing = SpaceTendon([((1.0, 0.0, -3.5), (1.0, 0.0, 3.5))])
    with pytest.raises(MechanismError, match="the holes cross"):
        SpatialChain([joint], [crossing])
    with pytest.raises(MechanismError, match=r"rise of tendon 0 .* in link 0 = -4.0: .*Swap the holes"):
        SpatialChain([joint], [SpaceTendon([((1.0, 0.0, 2.0), (1.0, 0.0, -2.0))])])
    with pytest.raises(MechanismError, match="relative curvature of joint 1"):
        SpatialChain([joint, RollingContact(**BODY | {"child": arc(0.3, (0, 3))})], [tendon])
    with pytest.raises(MechanismError, match="number of links"):
        SpatialChain([joint], [tendon], [SpatialLink()])
    for holes in ([((1.0, 0.0), (1.0, 0.0))], [((1.0, 0.0, np.nan), (1.0, 0.0, 2.0))], []):
        with pytest.raises(MechanismError):
            SpaceTendon(holes)
    with pytest.raises(MechanismError):
        SpatialChain([], [tendon])
    with pytest.raises(MechanismError):
        SpatialChain([joint], [Tendon.on_surfaces(1.0)])
    with pytest.raises(InvalidInput):
        solve_tensions(SpatialChain([joint], [tendon]), [1.0], [WorldForce(5, (0.0, 0.0, 0.0))])
    with pytest.raises(MechanismError):
        SpatialLink(-1.0)
    with pytest.raises(InvalidInput, match="parallel"):
        solve_tensions(alternating(4), [1.0] * 4, [TorsionSpring(3, 1.0)])


def test_holes_beside_each_other_may_pass():
    """A gap that stays open aside is no crossing: the tendon winds round the chain."""
    joint = RollingContact(**BODY)
    winding = SpaceTendon([((1.0, -1.0, -3.2), (1.0, 1.0, 3.2))])
    assert SpatialChain([joint], [winding]).n_links == 2


def test_presets_bend_without_a_joint_at_its_limit():
    for name, rank in (("pitch_yaw", 2), ("pitch_yaw_two_segment", 3)):
        chain = preset(name)
        at = solve_lengths(chain, chain.neutral_lengths - np.random.default_rng(2).uniform(0.3, 0.8, chain.n_tendons))
        assert at.status is Status.CONVERGED and at.tensions.min() > 0.0
        sizes = np.linalg.svd(sensitivity.tip_and_tensions_dlengths(at)[0], compute_uv=False)
        assert np.sum(sizes > 1e-6) == rank


def test_a_step_with_friction_is_drawn():
    chain = preset("pitch_yaw").replace(friction=CapstanFriction(0.1))
    first = solve_tensions(chain, [2.0, 3.0, 2.0, 2.0])
    second = solve_tensions(chain, [3.0, 2.0, 2.0, 2.0], history=first)
    assert len(plot_arm(second).lines) >= 1
    assert second.gap_tensions.max() <= 3.0


@pytest.mark.slow
def test_the_benchmark_prints_the_worst_difference(run_python):
    script = reference.REFERENCE.parents[2] / "benchmarks" / "spatial_reference.py"
    output = run_python(str(script), str(reference.REFERENCE))
    words = output.splitlines()[-1].split()
    assert float(words[2]) < 1e-10 and float(words[5]) < 1e-11


def test_a_file_without_turns_is_compared_without_them():
    case = CASES[0] | {"expected": {name: value for name, value in CASES[0]["expected"].items() if name != "turns"}}
    differences = reference.differences(case, reference.solved(case))
    assert "turns" not in differences and "turns" in reference.differences(CASES[0], reference.solved(CASES[0]))


def test_margins_of_contact_lines_are_the_reference():
    for case in CASES:
        at = reference.solved(case)
        for i, checks in enumerate(case["expected"]["contact_checks"]):
            if checks is None:
                assert at.friction_required[i] == 0.0 and at.tilting_margins[i] == np.inf
                assert np.isnan(at.centres_of_pressure[i])
                continue
            assert at.pressing_margins[i] == pytest.approx(checks["pressing"], abs=1e-9)
            assert at.tilting_margins[i] == pytest.approx(checks["tilting_margin"], abs=1e-9)
            assert at.centres_of_pressure[i] == pytest.approx(checks["centre_of_pressure"], abs=1e-9)
            required = np.inf if checks["friction_required"] is None else checks["friction_required"]
            assert at.friction_required[i] == pytest.approx(required, abs=1e-8)


def carried(reaction, half_width, mu, sides=64, points=9):
    """Whether pressures and tractions at points along the line carry a reaction: a linear programme."""
    z, around = np.linspace(-half_width, half_width, points), 2 * np.pi * np.arange(sides) / sides
    # per point: a pressure, and weights of the corners of the friction cone, which circumscribes the circle
    corners = np.stack([np.cos(around), np.sin(around)]) / np.cos(np.pi / sides)
    balance, cone = [], []
    for k, place in enumerate(z):
        own = np.zeros((points, 1 + sides))
        own[k, 0], own[k, 1:] = -mu, 1.0
        cone.append(own[k : k + 1])
        pressure = np.array([0.0, 1.0, 0.0, -place, 0.0])
        traction = np.stack([corners[0], 0 * around, corners[1], 0 * around, place * corners[0]])
        balance.append(np.column_stack([pressure, traction]))
    inside = block_diag(*cone)
    done = linprog(np.zeros(points * (1 + sides)), inside, np.zeros(points), np.hstack(balance), reaction[:5])
    return done.status == 0


def test_friction_required_is_that_of_the_best_pressure_along_the_line():
    rng = np.random.default_rng(6)
    for _ in range(40):
        h = rng.uniform(1.0, 4.0)
        reaction = rng.normal(size=5) * [2.0, 0.0, 2.0, 4.0, 6.0] + [0.0, rng.uniform(2, 8), 0.0, 0.0, 0.0]
        tilt, twist = reaction[3] / h, reaction[4] / h
        normal = 0.5 * np.array([reaction[1] - tilt, reaction[1] + tilt])
        side = 0.5 * np.array([reaction[0] + twist, reaction[0] - twist])
        required = least_friction(normal, side, reaction[2])
        assert np.isinf(required) == (normal.min() <= 0.0)
        if np.isinf(required):
            assert not carried(reaction, h, 100.0)
        else:
            assert carried(reaction, h, 1.003 * required)
            assert not carried(reaction, h, 0.995 * required)


@pytest.mark.parametrize("rolling", [0.0, 0.3])
def test_steps_with_friction_keep_every_link_in_balance_and_obey_the_capstan_law(rolling):
    """All from the geometry: turns between channels and gaps in the world, tensions, slips, moments at the joints."""
    rng, mu, presliding = np.random.default_rng(9), 0.2, 0.02
    friction = CapstanFriction(mu, presliding, rolling=rolling)
    chain = random_chain(rng, n=6, joint=hinged, friction=friction)
    loads, before = random_loads(rng, chain), None
    for pulls in ([2.0, 2.0, 2.0, 2.0], [3.0, 1.5, 2.5, 2.0], [1.5, 2.5, 2.5, 3.0]):
        at = solve_tensions(chain, pulls, loads, before, history=before)
        assert at.ok
        assert unbalanced(chain, at) == pytest.approx((0.0, 0.0), abs=1e-8)
        if before is None:
            before = at
            continue
        state, past = at.friction_state, before.friction_state
        for j, line in enumerate(chain.tendon_polyline(at.poses)):
            tension, entry = at.tensions[j], 0.0
            channels, gaps = line[1::2] - line[::2], line[2::2] - line[1:-1:2]
            for i, gap in enumerate(gaps):
                turn = entry + angle_between(channels[i], gap)
                tension *= np.exp(-mu * turn * state.states[i, j])
                assert at.gap_tensions[i, j] == pytest.approx(tension, abs=1e-9)
                slid = np.clip(past.states[i, j] - at.slip[i, j] / presliding, -1.0, 1.0)
                assert state.states[i, j] == pytest.approx(slid, abs=1e-7)
                entry = angle_between(gap, channels[i + 1])
        stiffnesses, rests = np.array([(joint.stiffness, joint.rest_angle) for joint in chain.joints]).T
        springs = stiffnesses * (at.joint_angles - rests)
        rolls = np.array([isinstance(joint, RollingContact) for joint in chain.joints])
        resisted = rolling * np.where(rolls, np.maximum(at.reactions[:, 1], 0.0), 0.0) * state.rolling
        free = at.free_joints
        assert (at.reactions[:, 5] + springs + resisted)[free] == pytest.approx(0.0, abs=1e-7)
        before = at


def angle_between(u, v):
    return np.arctan2(np.linalg.norm(np.cross(u, v)), u @ v)


def test_reports_have_margins_and_null_where_there_is_none():
    chain = random_chain(np.random.default_rng(1), n=6, joint=hinged)
    at = solve_tensions(chain, [2.0] * 4)
    joints = json.loads(report.as_json(at))["joints"]
    for entry, joint in zip(joints, chain.joints, strict=True):
        assert (entry["tilting_margin_N"] is None) == isinstance(joint, PointHinge)
    assert "tilting margin" in report.as_table(at)
