"""Equilibria: reference values, closed forms, two formulations that agree, and every status."""

import numpy as np
import pytest

from rollingjoint import (
    BodyWrench,
    Gravity,
    InvalidInput,
    Link,
    OnSurface,
    Profile,
    RollingChain,
    SolverError,
    Spring,
    Status,
    Surface,
    Tendon,
    TorsionSpring,
    WorldForce,
    five_link,
    sensitivity,
    solve_lengths,
    solve_lengths_batch,
    solve_tensions,
    solve_tensions_batch,
    two_segment,
    uniform,
)
from rollingjoint._numba.jit import standalone
from rollingjoint.chain.random_chain import random_chain, random_loads, random_tensions
from rollingjoint.kernels import rolling
from rollingjoint.kernels.arrays import TendonLaw
from rollingjoint.kernels.chain import evaluate

# Exact surfaces, converged runs of the published algorithm on refined grids: docs/theory.md, section 6.
REFERENCE = [
    (
        (1, 1),
        0.0,
        (-0.15594338, 0, 0.06710133, 0),
        (-35.03561037, 69.60112173, 0.50177674),
        (90.42168368, 100.25741404),
    ),
    (
        (3, 1),
        0.0,
        (-5.13349827, -5.07716223, -5.04360711, -5.06756391),
        (-52.50007618, 52.36303285, 1.25320624),
        (84.84775587, 109.527958),
    ),
    (
        (6, 3),
        0.5,
        (-0.34681328, -1.30887697, -2.135447, -2.87021633),
        (-40.71209929, 65.17434381, 0.78907714),
        (87.90132497, 103.43104757),
    ),
]


@pytest.mark.parametrize("tensions, force, s, tip, lengths", REFERENCE)
def test_five_link_reference_equilibria(tensions, force, s, tip, lengths):
    result = solve_tensions(five_link(), tensions, [WorldForce(-1, (force, 0.0))])
    assert result.status is Status.CONVERGED
    assert result.arc_lengths == pytest.approx(s, abs=1e-6)
    assert result.poses[-1, :2] == pytest.approx(tip[:2], abs=1e-6)
    assert result.poses[-1, 2] == pytest.approx(tip[2], abs=1e-8)
    assert result.lengths == pytest.approx(lengths, abs=1e-6)


def test_least_squares_lengths_reference():
    result = solve_lengths(five_link(), (86.02, 107.82), method="least_squares")
    assert result.status is Status.CONVERGED
    assert result.tensions[0] / result.tensions[1] == pytest.approx(2.391373, abs=1e-6)
    assert result.arc_lengths == pytest.approx((-4.245950, -4.173385, -4.131163, -4.164325), abs=1e-6)
    assert result.poses[-1] == pytest.approx((-49.982644, 55.787229, 1.120584), abs=1e-6)
    assert result.lengths == pytest.approx((85.559594, 107.627472), abs=1e-6)


def test_a_tendon_through_both_centres_leaves_a_pendulum():
    """Circle a under circle b: V = -F (a + b) cos(s/a), so H = F b² / (a + b) at s = 0."""
    a, b, force = 12.0, 30.0, 2.5
    below = Link(Surface(Profile.constant(0.01), (0, -10)), Surface(Profile.constant(-1 / a), (0, 10)))
    above = Link(Surface(Profile.constant(1 / b), (0, -10)), Surface(Profile.constant(-0.01), (0, 10)))
    chain = RollingChain([below, above], [Tendon([((0, -10), (0, 10 - a)), ((0, b - 10), (0, 10))])])
    up = solve_tensions(chain, [7.0], [WorldForce(-1, (0, force), point=(0, b - 10))], start=[0.3])
    assert up.status is Status.CONVERGED
    assert up.arc_lengths == pytest.approx([0], abs=1e-9)
    assert up.smallest_eigenvalue == pytest.approx(force * b**2 / (a + b), rel=1e-9)
    assert up.contact_forces[0] == pytest.approx([0.0, 7.0 - force], abs=1e-9)
    down = solve_tensions(chain, [7.0], [WorldForce(-1, (0, -force), point=(0, b - 10))], start=[0.3])
    assert down.status is Status.AT_LIMIT
    assert down.arc_lengths == pytest.approx([-15])


def test_unloaded_pose_depends_on_the_tension_ratio_only():
    chain = five_link()
    base = solve_tensions(chain, (3, 1))
    for scale in (1e-6, 0.1, 2.0, 1e3):
        scaled = solve_tensions(chain, (3 * scale, scale))
        assert scaled.status is Status.CONVERGED
        assert scaled.poses == pytest.approx(base.poses, abs=1e-6)


def test_more_right_tension_bends_right_and_a_right_force_bends_right():
    chain = five_link()
    tips = [solve_tensions(chain, tau).tip[0] for tau in ((3, 1), (1, 1), (1, 3))]
    assert tips == sorted(tips)
    tips = [solve_tensions(chain, (6, 3), [WorldForce(-1, (f, 0))]).tip[0] for f in (0, 0.5, 1.0, 1.5)]
    assert tips == sorted(tips)


def test_elastic_tension_is_stiffness_times_stretch():
    chain = five_link()
    result = solve_lengths(chain, chain.neutral_lengths - (1.0, 0.4), [WorldForce(2, (0.3, -0.2), moment=3.0)])
    assert result.ok
    assert result.tensions == pytest.approx(5.0 * (result.lengths - (chain.neutral_lengths - (1.0, 0.4))), abs=1e-12)
    assert np.all(result.tensions > 0)


def test_lengths_and_tensions_are_two_views_of_one_equilibrium():
    chain, loads = two_segment(), [WorldForce(-1, (0.4, -0.3)), Gravity([0.05] * 7), Spring(3, 0.02, (40.0, 40.0))]
    by_tension = solve_tensions(chain, (4, 2, 1, 3), loads)
    command = by_tension.lengths - by_tension.tensions / chain.stiffnesses
    by_length = solve_lengths(chain, command, loads)
    assert by_length.joint_angles == pytest.approx(by_tension.joint_angles, abs=1e-9)
    assert by_length.tensions == pytest.approx(by_tension.tensions, abs=1e-8)


def test_least_squares_reaches_lengths_that_can_be_reached():
    chain, loads = five_link(), [WorldForce(-1, (-0.4, 0.7))]
    wanted = solve_tensions(chain, (5, 8), loads)
    found = solve_lengths(chain, wanted.lengths, loads, method="least_squares")
    assert found.lengths == pytest.approx(wanted.lengths, abs=1e-8)
    assert found.tensions == pytest.approx([5, 8], abs=1e-5)


def test_tension_limits_hold():
    chain = five_link()
    result = solve_lengths(chain, chain.neutral_lengths - (12.0, -40.0), tension_limits=(0.5, 6.0))
    assert result.ok
    assert result.tensions == pytest.approx([6.0, 0.5])
    assert result.poses == pytest.approx(solve_tensions(chain, (6.0, 0.5)).poses, abs=1e-8)


def test_the_moment_of_every_sub_chain_balances():
    """A second formulation: forces on the links beyond each joint, summed about the world origin."""
    chain = five_link()
    loads = [
        WorldForce(3, (0.3, -0.5), moment=2.0, point=(2.0, -1.0)),
        BodyWrench(4, (0.2, 0.1), moment=-1.0, point=(0.0, 5.0)),
        Spring(2, 0.05, (30.0, 20.0), point=(1.0, 1.0)),
    ]
    result = solve_tensions(chain, (5, 4), loads)
    assert result.ok
    holes = chain.tendon_polyline(result.poses)

    def world(link, point):
        x, y, angle = result.poses[link]
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        return np.array([x, y]) + turn @ point, turn

    for joint in range(4):
        force, moment = np.zeros(2), 0.0
        for load in loads:
            if load.link <= joint:
                continue
            where, turn = world(load.link, np.array(load.point))
            if isinstance(load, Spring):
                push = load.stiffness * (np.array(load.anchor) - where)
            else:
                push = np.array(load.force) if isinstance(load, WorldForce) else turn @ np.array(load.force)
                moment += load.moment
            force += push
            moment += where[0] * push[1] - where[1] * push[0]
        for points, tension in zip(holes, result.tensions, strict=True):
            child, parent = points[2 * joint + 1], points[2 * joint + 2]
            pull = tension * (child - parent) / np.linalg.norm(child - parent)
            force += pull
            moment += parent[0] * pull[1] - parent[1] * pull[0]
        tangent = result.contact_tangents[joint]
        normal = np.array([-tangent[1], tangent[0]])
        contact = result.contact_forces[joint] @ np.stack([tangent, normal])
        at = result.contact_points[joint]
        assert force + contact == pytest.approx([0, 0], abs=1e-10)
        assert moment + at[0] * contact[1] - at[1] * contact[0] == pytest.approx(0, abs=1e-8)


def test_stiffness_is_symmetric_without_follower_forces_and_not_with_them():
    chain = five_link()
    dead = solve_tensions(chain, (6, 3), [WorldForce(-1, (0.5, 0.2)), Spring(2, 0.1, (0, 0))]).stiffness
    assert dead == pytest.approx(dead.T, abs=1e-10)
    follower = solve_tensions(chain, (6, 3), [BodyWrench(-1, (0.5, 0.2))]).stiffness
    assert np.abs(follower - follower.T).max() > 1.0


@pytest.mark.slow
def test_stiffness_is_the_derivative_of_the_residual():
    """dr/dphi against central differences of the moments that would have to be applied to hold a pose."""
    chain = five_link()
    loads = [WorldForce(3, (0.3, -0.5), point=(2, -1)), BodyWrench(4, (0.2, 0.4)), Spring(2, 0.05, (30, 20))]
    result = solve_tensions(chain, (5, 4), loads)

    def residual(phi):
        state, tau = standalone(rolling.new_state)(4, 2), np.array([5.0, 4.0])
        law, one = TendonLaw(tau * 0, tau * 0 + 1, tau, tau), standalone(rolling.design)(chain.arrays, 0)
        state.angle[:] = phi
        standalone(evaluate)(one, law, result.loads.copy(), state)
        return state.residual.copy()

    numeric = np.empty((4, 4))
    for m in range(4):
        step = 1e-5 * np.eye(4)[m]
        numeric[:, m] = (residual(result.joint_angles + step) - residual(result.joint_angles - step)) / 2e-5
    assert result.stiffness == pytest.approx(numeric, rel=1e-6, abs=1e-5)


def test_starts_are_joint_angles_or_equilibria():
    chain = five_link()
    first = solve_tensions(chain, (3, 1))
    again = solve_tensions(chain, (3, 1), start=first)
    assert again.iterations <= 1
    assert again.poses == pytest.approx(first.poses, abs=1e-9)


@pytest.mark.parametrize(
    "call",
    [
        lambda c: solve_tensions(c, (1, 2, 3)),
        lambda c: solve_tensions("five_link", (1, 1)),
        lambda c: solve_tensions(c, "ab"),
        lambda c: solve_tensions(c, (1, 1), start=[0.0]),
        lambda c: solve_tensions(c, (1, 1), [WorldForce(5, (1, 0))]),
        lambda c: solve_tensions(c, (1, 1), [Gravity([1.0])]),
        lambda c: solve_tensions(c, (1, 1), [Gravity([1.0] * 5, direction=(0, 0))]),
        lambda c: solve_tensions(c, (1, 1), ["push"]),
        lambda c: solve_tensions(c, (1, 1), None),
        lambda c: solve_tensions(c, (1, 1), WorldForce(-1, (1, 0))),
        lambda c: solve_tensions(c, (1, 1), [WorldForce("tip", (1, 0))]),
        lambda c: solve_tensions(c, (1, 1), [WorldForce(np.nan, (1, 0))]),
        lambda c: solve_tensions(c, (1, 1), [WorldForce(-1, (1, 0), (0, 5))]),
        lambda c: solve_tensions(c, (1, 1), [Spring(-1, None, (0, 5))]),
        lambda c: solve_tensions(c, (1, 1), [Gravity(0.1)]),
        lambda c: solve_tensions(c, (10**400, 1)),
        lambda c: solve_tensions(c, (1, 1), [WorldForce(-1, (10**5000, 0))]),
        lambda c: solve_tensions_batch(c, "ab"),
        lambda c: solve_tensions_batch(c, [(1, 1), (1,)]),
        lambda c: solve_lengths(c, (90, 100), method="fast"),
        lambda c: solve_lengths(c, (90, 100), tension_limits=(0, 1, 2)),
        lambda c: solve_lengths_batch(c, (90, 100)),
        lambda c: solve_lengths_batch(c, [(90, 100)], starts=np.zeros((2, 4))),
        lambda c: solve_lengths_batch(c, [(90, 100)], np.zeros((1, 1, 3))),
        lambda c: solve_lengths_batch(c, [(90, 100)], np.full((1, 1, 11), 7.0)),
    ],
)
def test_wrong_shapes_and_types_raise_before_anything_runs(call):
    with pytest.raises(InvalidInput):
        call(five_link())


def test_equilibria_print_as_one_short_line():
    chain = five_link()
    one, many = solve_tensions(chain, (6, 3)), solve_tensions_batch(chain, [(6, 3), (6, 3), (np.nan, 3)])
    assert repr(one) == "<Equilibrium of 'five_link': CONVERGED, tip at (-47.591, 58.645) mm>"
    assert repr(many) == "<Equilibrium of 'five_link', 3 rows: 2 CONVERGED, 1 INVALID_INPUT>"


def test_a_batch_starts_from_a_batch_of_equilibria():
    first = solve_tensions_batch(five_link(), [(6, 3), (3, 6)])
    again = solve_tensions_batch(five_link(), [(6, 3), (3, 6)], starts=first)
    assert again.iterations.max() <= 1
    assert again.poses == pytest.approx(first.poses, abs=1e-9)


def test_require_raises_for_an_unusable_result():
    with pytest.raises(SolverError, match="INDETERMINATE"):
        solve_tensions(five_link(), (0, 0)).require()
    assert solve_tensions(five_link(), (1, 1)).require().ok


def test_gravity_is_a_force_on_every_link():
    chain = five_link()
    pulled = solve_tensions(chain, (5, 5), [Gravity([0.1] * 5, direction=(1, 0))])
    forces = solve_tensions(chain, (5, 5), [WorldForce(i, (0.1, 0)) for i in range(5)])
    assert pulled.poses == pytest.approx(forces.poses, abs=1e-12)


def test_batch_lanes_equal_single_solves_bit_for_bit():
    chain, rng = five_link(), np.random.default_rng(0)
    commands = chain.neutral_lengths + rng.uniform(-6, 2, (20, 2))
    commands[7] = np.nan
    loads = [WorldForce(-1, (0.4, -0.2))]
    batch = solve_lengths_batch(chain, commands, loads)
    for lane, command in enumerate(commands):
        single = solve_lengths(chain, command, loads)
        assert batch.status[lane] == single.status
        assert np.array_equal(batch.poses[lane], single.poses)
        assert np.array_equal(batch.tensions[lane], single.tensions)
    assert batch.status[7] == Status.INVALID_INPUT
    tensions = solve_tensions_batch(chain, rng.uniform(1, 5, (4, 2)))
    assert tensions.ok.all() and tensions.tip.shape == (4, 2) and tensions.smallest_eigenvalue.shape == (4,)


def test_contact_margins_follow_from_the_contact_force():
    pressed = solve_tensions(five_link(), (6, 3))
    assert np.all(pressed.pressing_margins > 8.0)
    assert np.all(pressed.slip_margins(0.3) <= 0.3 * pressed.pressing_margins)
    lifted = solve_tensions(five_link(), (1, 1), [WorldForce(-1, (0, 5.0))])
    assert np.any(lifted.pressing_margins < 0)


def test_the_tip_of_two_segments_reaches_an_area_and_that_of_one_segment_a_curve():
    def independent_directions(chain, tensions):
        moves = sensitivity.dposes_dtensions(solve_tensions(chain, tensions))[-1, :2]
        first, second = np.linalg.svd(moves, compute_uv=False)
        return 1 + (second > 1e-3 * first)

    assert independent_directions(two_segment(), (4.0, 1.0, 1.0, 3.0)) == 2
    assert independent_directions(five_link(), (4.0, 1.0)) == 1


@pytest.mark.parametrize("seed", [15, 38, 86])  # seeds whose contacts once lay 1e-12 mm beyond the limit
def test_arc_lengths_at_a_limit_are_within_it_and_accepted(seed):
    rng = np.random.default_rng(seed)
    chain = random_chain(rng)
    tensions = [random_tensions(rng, chain.n_tendons) for _ in range(20)]
    found = solve_tensions_batch(chain, tensions, random_loads(rng, chain.n_links, 20.0))
    assert np.any(found.status == Status.AT_LIMIT)
    low, high = chain.joint_limits.T
    assert np.all((found.arc_lengths >= low) & (found.arc_lengths <= high))
    np.testing.assert_allclose(chain.joint_angles(found.arc_lengths), found.joint_angles, rtol=0.0, atol=1e-11)
    np.testing.assert_array_equal(chain.arc_lengths(found.joint_angles), found.arc_lengths)
    for i, link in enumerate(chain.links[:-1]):
        assert np.all(np.isfinite(link.child.point(found.arc_lengths[:, i])))
    nearly = np.where(found.arc_lengths == high, high + 5e-10, found.arc_lengths)
    np.testing.assert_array_equal(chain.joint_angles(nearly), chain.joint_angles(found.arc_lengths))
    with pytest.raises(InvalidInput, match="surface limits"):
        chain.joint_angles(high + 1e-6)


@pytest.mark.parametrize("spring", [[], [Spring(-1, 1e-6, (0.0, 100.0))]], ids=["in lanes", "by the general solver"])
@pytest.mark.parametrize("rest", [3.0, -3.0])
@pytest.mark.parametrize("joint", range(4))
def test_one_joint_alone_is_pressed_against_the_end_of_its_surface(joint, rest, spring):
    chain = five_link()
    found = solve_tensions(chain, (2.0, 2.0), [TorsionSpring(joint + 1, 1e4, rest, joint), *spring])
    assert found.status is Status.AT_LIMIT
    assert found.free_joints.tolist() == [i != joint for i in range(4)]
    assert abs(found.arc_lengths[joint]) == pytest.approx(15.0)


@pytest.mark.parametrize("s", [0.0, 4.0])
def test_a_tendon_whose_holes_meet_holds_the_joint_where_they_do(s):
    chain, h = uniform(2).replace(tendons=[Tendon([(OnSurface(s), OnSurface(s))] * 2)]), 1e-3
    met = chain.joint_angles(np.array([s]))
    found = solve_tensions(chain, [3.0], start=met + 0.05)
    assert found.status is Status.CONVERGED and found.joint_angles == pytest.approx(met, abs=1e-9)
    before, there, after = (chain.tendon_lengths(met + step)[0] for step in (-h, 0.0, h))
    assert found.stiffness[0, 0] == pytest.approx(3.0 * (before - 2.0 * there + after) / h**2, rel=1e-6)
