"""Chains: kinematics in closed form, the joint tables, and what build-time validation refuses."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from scipy.optimize import minimize

from rollingjoint import (
    Gravity,
    InvalidInput,
    Link,
    MechanismError,
    OnSurface,
    Profile,
    RollingChain,
    Surface,
    Tendon,
    five_link,
    small_arm,
    solve_tensions,
    two_segment,
    uniform,
)
from rollingjoint.chain.random_chain import random_chain
from rollingjoint.io.mechanism_file import dump_mechanism, mechanism_from_dict

CIRCLE, CUP = Profile.constant(-1 / 20), Profile.constant(1 / 20)
LINK = Link(Surface(CUP, (0.0, -10.0)), Surface(CIRCLE, (0.0, 10.0)))
TENDONS = (Tendon.on_surfaces(-10), Tendon.on_surfaces(10))


def test_a_circle_rolls_round_a_circle():
    a, b = 12.0, 30.0  # radius of the child and the parent surface
    below = Link(Surface(CUP, (0.0, -10.0)), Surface(Profile.constant(-1 / a), (0.0, 10.0)))
    above = Link(Surface(Profile.constant(1 / b), (0.0, -10.0)), Surface(CIRCLE))
    chain = RollingChain([below, above], TENDONS)
    for s in (-15.0, -4.0, 0.0, 9.0):
        phi = chain.joint_angles([s])
        assert phi == pytest.approx(-s / a - s / b, abs=1e-13)
        x, y, angle = chain.poses(phi)[1]
        centre = np.array([0.0, 10.0 - a]) + (a + b) * np.array([np.sin(s / a), np.cos(s / a)])
        arm = (b - 10.0) * np.array([-np.sin(angle), np.cos(angle)])  # from the origin to the parent circle's centre
        assert angle == pytest.approx(phi[0])
        assert np.array([x, y]) == pytest.approx(centre - arm, abs=1e-11)


def test_tables_reproduce_the_exact_surfaces():
    rng = np.random.default_rng(3)
    for _ in range(30):
        chain = random_chain(rng, 4)
        low, high = chain.joint_limits[0]
        for s in rng.uniform(low, high, 5):
            child, parent = chain.links[0].child, chain.links[1].parent
            phi = float(child.tangent_angle(s) - parent.tangent_angle(s))
            turn = np.array([[np.cos(phi), -np.sin(phi)], [np.sin(phi), np.cos(phi)]])
            exact = child.point(s) - turn @ parent.point(s)
            angles = chain.neutral_angles.copy()
            angles[0] = phi
            assert chain.poses(angles)[1] == pytest.approx([*exact, phi], abs=2e-11)
            assert chain.arc_lengths(angles)[0] == pytest.approx(s, abs=1e-9)


@pytest.mark.parametrize("mechanism", [five_link(), uniform(), two_segment(), small_arm()], ids=lambda one: one.name)
def test_no_pose_has_a_tendon_shorter_than_the_shortest_and_one_pose_has_each(mechanism):
    rng = np.random.default_rng(5)
    limits = mechanism.arrays.joints[0, :, :2]
    poses = rng.uniform(*limits.T, (3000, mechanism.n_joints))
    lengths, shortest = mechanism.tendon_lengths(poses), mechanism.shortest_lengths
    assert (lengths > shortest - 0.01).all()
    for j, start in enumerate(poses[lengths.argmin(axis=0)]):
        found = minimize(lambda phi, j=j: mechanism.tendon_lengths(phi)[j], start, bounds=limits)
        assert found.fun == pytest.approx(shortest[j], abs=0.01)


def test_joint_angle_falls_as_the_contact_moves_right():
    chain = five_link()
    s = np.linspace(-15, 15, 301)
    phi = chain.joint_angles(np.repeat(s[:, None], 4, axis=1))
    assert np.all(np.diff(phi, axis=0) < 0)
    assert chain.arc_lengths(phi) == pytest.approx(np.repeat(s[:, None], 4, axis=1), abs=1e-11)


def test_angles_beyond_the_surface_stop_at_its_end():
    assert five_link().arc_lengths([9.0, -9.0, 9.0, -9.0]) == pytest.approx([-15, 15, -15, 15])


def test_lengths_are_gaps_and_channels():
    chain = uniform(2)  # radius 20, holes at s = ±10: everything in closed form
    x, dip = 20 * np.sin(0.5), 20 * (1 - np.cos(0.5))
    assert chain.neutral_lengths == pytest.approx([2 * (20 - 2 * dip) + 2 * dip] * 2, abs=1e-11)
    left, right = chain.tendon_polyline(chain.poses(chain.neutral_angles))
    assert left[0] == pytest.approx([-x, -10 + dip])
    assert right[-1] == pytest.approx([x, 30 - dip])
    assert np.linalg.norm(np.diff(left, axis=0), axis=1).sum() == pytest.approx(chain.neutral_lengths[0])


@pytest.mark.slow
def test_neutral_lengths_from_the_surfaces_are_those_of_the_tables():
    rng = np.random.default_rng(0)
    for chain in (five_link(), two_segment(), *(random_chain(rng) for _ in range(20))):
        assert chain.neutral_lengths == pytest.approx(chain.tendon_lengths(chain.neutral_angles), abs=1e-11)
        assert not chain.neutral_lengths.flags.writeable


def test_a_tendon_that_ends_early_does_not_see_the_joints_beyond():
    chain = two_segment()
    moved = chain.joint_angles([0, 0, 0, 2.0, 1.0, -3.0])
    change = chain.tendon_lengths(moved) - chain.neutral_lengths
    assert change[:2] == pytest.approx([0, 0], abs=1e-12)
    assert np.all(np.abs(change[2:]) > 0.1)


def test_five_link_is_a_hundred_millimetres_long():
    assert five_link().length == pytest.approx(100.0)
    assert five_link().neutral_lengths.shape == (2,)


@pytest.mark.parametrize(
    "links, tendons, words",
    [
        ([LINK], TENDONS, "2 or more"),
        ([LINK, LINK], [], "1 or more"),
        ([LINK, Link(Surface(Profile.constant(-0.06)), LINK.child)], TENDONS, "u_child - u_parent < 0"),
        (
            [LINK, Link(Surface(Profile.piecewise_constant([-15, 5, 15], [0.0, -0.06]), (0, -10)), LINK.child)],
            TENDONS,
            r"joint 0 \(link 0 on link 1\) at s = 5 mm",
        ),
        ([LINK, LINK], [Tendon.on_surfaces(16)], r"\[-15, 15\]"),
        ([LINK, LINK], [Tendon.on_surfaces(5, end=0)], "a moving link"),
        ([LINK, LINK], [Tendon([(OnSurface(3), (9.0, 20.0))])], "holes cross"),
        ([LINK] * 3, [Tendon([(OnSurface(3), OnSurface(3))] * 2)], "links 0 to 2"),
        (LINK, TENDONS, "a list of Link objects"),
        ([LINK, None], TENDONS, r"links\[1\] = None"),
        ([LINK, LINK], TENDONS[0], "a list of Tendon objects"),
    ],
)
def test_mechanisms_that_cannot_work_are_refused_with_the_reason(links, tendons, words):
    with pytest.raises(MechanismError, match=words):
        RollingChain(links, tendons)


@pytest.mark.parametrize(
    "build",
    [
        lambda: Tendon([]),
        lambda: Tendon([(1.0, 2.0)]),
        lambda: Tendon([((0, np.nan), (0, 0))]),
        lambda: Tendon.on_surfaces(np.inf),
        lambda: Tendon.on_surfaces(1.0, stiffness=0.0),
        lambda: Tendon.on_surfaces(1.0, stiffness="stiff"),
        lambda: Tendon.on_surfaces(1.0, end=1.5),
        lambda: Tendon.on_surfaces(1.0, end="tip"),
    ],
)
def test_tendons_that_cannot_work_are_refused(build):
    with pytest.raises(MechanismError):
        build()


@pytest.mark.parametrize("build", [lambda: uniform(2.5), lambda: uniform("five"), lambda: two_segment(n_distal=0.5)])
def test_presets_refuse_a_number_of_links_that_is_not_whole(build):
    with pytest.raises(InvalidInput, match="or more"):
        build()


@pytest.mark.parametrize("name", ["neutral_lengths", "neutral_angles", "stiffnesses", "joint_limits"])
def test_what_a_mechanism_computes_once_cannot_be_changed_by_its_reader(name):
    with pytest.raises(ValueError, match="read-only"):
        getattr(five_link(), name)[...] += 1.0


def test_a_mechanism_prints_as_one_short_line():
    assert repr(five_link()) == "<RollingChain 'five_link': 5 links, 2 tendons, 100 mm>"
    assert len(repr(five_link().links[1])) < 300


def test_replacing_tendons_checks_them_anew():
    with pytest.raises(MechanismError):
        uniform(3).replace(tendons=[Tendon.on_surfaces(99)])


def test_a_narrow_peak_of_relative_curvature_is_found():
    peak = Profile.polynomial([-1e-9, 0.0, -1e-3, 0.0, -1e-3])  # kappa = peak + 2e-9 > 0 within 1e-3 mm of s = 0
    above = Surface(Profile.constant(-2e-9), (0.0, -10.0))
    with pytest.raises(MechanismError, match=r"at s = -?\d"):
        RollingChain([Link(LINK.parent, Surface(peak, (0.0, 10.0))), Link(above, LINK.child)], TENDONS)


def test_weights_of_links_are_a_load_that_acts_at_their_centres():
    chain = five_link()
    links = [replace(link, weight=0.1 * i, centre=(1.0, 2.0)) for i, link in enumerate(chain.links)]
    heavy = chain.replace(links=links)
    assert heavy.gravity() == Gravity([0.0, 0.1, 0.2, 0.1 * 3, 0.4], (0.0, -1.0), [(1.0, 2.0)] * 5)
    own, load = (
        solve_tensions(heavy, (3.0, 2.0), [heavy.gravity()]),
        solve_tensions(chain, (3.0, 2.0), [heavy.gravity()]),
    )
    assert np.array_equal(own.poses, load.poses)
    assert not np.allclose(own.poses, solve_tensions(chain, (3.0, 2.0)).poses)
    assert chain.own_weight((0.0, -1.0)) is None and heavy.own_weight((1.0, 0.0)) == heavy.gravity((1.0, 0.0))
    again = mechanism_from_dict(yaml.safe_load(dump_mechanism(heavy)), "a file")
    assert [link.weight for link in again.links] == [link.weight for link in heavy.links]
    assert [link.centre for link in again.links] == [(1.0, 2.0)] * 5


@pytest.mark.parametrize("wrong", [{"weight": -0.1}, {"weight": np.nan}, {"centre": (1.0, 2.0, 3.0)}])
def test_a_weight_that_cannot_be_is_refused(wrong):
    with pytest.raises(MechanismError, match=r"link (weight|centre)"):
        replace(five_link().links[0], **wrong)
