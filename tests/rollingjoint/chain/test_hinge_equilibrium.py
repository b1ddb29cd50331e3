"""Equilibria of hinge chains: reference values, closed forms, a second formulation, buckling, lanes and hard cases."""

import json
from pathlib import Path

import numpy as np
import pytest

from rollingjoint import (
    Bead,
    BeadTendon,
    BodyWrench,
    HingeChain,
    InvalidInput,
    Spring,
    Status,
    WorldForce,
    five_link,
    flexible_arm,
    sensitivity,
    set_threads,
    small_arm,
    solve_lengths,
    solve_lengths_batch,
    solve_tensions,
    solve_tensions_batch,
)

REFERENCE = json.loads((Path(__file__).parent / "flexible_arm_reference.json").read_text("utf-8"))["cases"]
CASES = [(case, model) for case in REFERENCE for model in case["models"]]
HANG, UPRIGHT, HORIZONTAL = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)


@pytest.mark.parametrize("case, model", CASES, ids=[f"{case['name']}-{model}" for case, model in CASES])
def test_flexible_arm_reference_equilibria(case, model):
    arm, expected = flexible_arm(model, stiffness=case["stiffness"]), case["models"][model]
    loads = [WorldForce(-1, case["tip_force"])]
    if any(case["gravity"]):
        loads.append(arm.gravity(case["gravity"]))
    if "tensions" in case:
        found = solve_tensions(arm, case["tensions"], loads)
    else:
        found = solve_lengths(arm, case["lengths"], loads)
        assert found.tensions == pytest.approx(expected["tensions"], abs=1e-6)
    assert found.status is Status.CONVERGED
    assert found.iterations <= 10  # quadratic: the O(n) step is Newton's
    assert found.joint_angles == pytest.approx(expected["joint_angles"], abs=1e-10)
    assert found.tip == pytest.approx(expected["tip"], abs=1e-6)
    assert found.lengths == pytest.approx(expected["lengths"], abs=1e-6)


def problem(seed, model="exact", potential=True):
    """(chain, tensions, loads): beads of any axis, tendons of any holes and end."""
    rng = np.random.default_rng(seed)
    n = 5
    beads = [Bead(20.0, rng.normal(size=3), rng.uniform(400, 900), 7.0, 0.2, rng.uniform(-0.1, 0.1)) for _ in range(n)]
    around = rng.uniform(0, 2 * np.pi, 3)
    ends = [5, 3, -1]
    tendons = [
        BeadTendon(12 * np.array([np.cos(a), np.sin(a)]) + 0.3 * rng.normal(size=(end % 6 + 1, 2)), end)
        for a, end in zip(around, ends, strict=True)
    ]
    loads = [WorldForce(4, rng.normal(size=3), point=rng.normal(size=3)), WorldForce(0, (5, 5, 5))]
    loads += [Spring(3, 0.4, (9, -8, 70), point=(1, 2, 3)), Spring(-1, 0.2, (-20, 5, 90)), Spring(0, 3.0, (5, 5, 5))]
    if not potential:
        loads += [WorldForce(5, (0, 0, 0), moment=20 * rng.normal(size=3))]
        loads += [BodyWrench(3, rng.normal(size=3), moment=20 * rng.normal(size=3), point=(1, 2, 3))]
    chain = HingeChain(beads, tendons, model)
    return chain, rng.uniform(0.5, 4, 3), [chain.gravity(rng.normal(size=3)), *loads]


def energy(chain, tensions, loads, theta):
    """V of docs/theory.md, section 2, from products of exponentials and tendon lengths."""
    springs = np.array([bead.stiffness for bead in chain.beads])
    value = 0.5 * springs @ (theta - chain.neutral_angles) ** 2 + tensions @ chain.tendon_lengths(theta)
    poses = chain.poses(theta)
    for row in solve_tensions(chain, tensions, loads).loads:
        T = poses[int(row[0])]
        x = T[:3, :3] @ row[1:4] + T[:3, 3]
        value += 0.5 * row[16] * (row[17:20] - x) @ (row[17:20] - x) - row[4:7] @ x
    return value


def differences(function, at, step):
    steps = step * np.eye(len(at))
    return np.stack([(function(at + e) - function(at - e)) / (2 * step) for e in steps], axis=-1)


def unbalanced(chain, tensions, loads, theta):
    """r by virtual work: every load on the motion of its point and link, by differences of the poses."""
    poses = chain.poses(theta)
    rates = differences(chain.poses, theta, 1e-5)
    residual = np.array([b.stiffness for b in chain.beads]) * (theta - chain.neutral_angles)
    rows = [*solve_tensions(chain, tensions, loads).loads]
    if chain.model == "end_couple":
        for tendon, tension in zip(chain.tendons, tensions, strict=True):
            x, y = tendon.link_holes(chain.n_links)[-1]
            couple = tension * np.array([-y, x, 0.0])
            rows.append([tendon.last_link(chain.n_links), *[0.0] * 12, *couple, *[0.0] * 7])
    else:
        residual += differences(chain.tendon_lengths, theta, 1e-5).T @ tensions
    for row in np.array(rows):
        T, dT = poses[int(row[0])], rates[int(row[0])]
        turn = np.einsum("abi,cb->aci", dT[:3, :3], T[:3, :3])  # [omega] of every hinge
        omega = np.array([turn[2, 1], turn[0, 2], turn[1, 0]])
        velocity = np.einsum("abi,b->ai", dT[:3, :3], row[1:4]) + dT[:3, 3]
        held = row[16] * (row[17:20] - T[:3, :3] @ row[1:4] - T[:3, 3])
        residual -= (row[4:7] + held + T[:3, :3] @ row[10:13]) @ velocity + (row[7:10] + T[:3, :3] @ row[13:16]) @ omega
    return residual


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("model", ["exact", "linear"])
def test_an_equilibrium_is_where_the_energy_is_level_and_its_stiffness_is_the_curvature(seed, model):
    chain, tensions, loads = problem(seed, model)
    found = solve_tensions(chain, tensions, loads)
    assert found.status is Status.CONVERGED
    slope = differences(lambda theta: energy(chain, tensions, loads, theta), found.joint_angles, 1e-5)
    assert slope == pytest.approx(np.zeros(5), abs=1e-5)
    assert found.stiffness == pytest.approx(found.stiffness.T, rel=1e-12)
    curvature = differences(lambda t: unbalanced(chain, tensions, loads, t), found.joint_angles, 1e-4)
    assert found.stiffness == pytest.approx(curvature, abs=2e-5 * np.abs(curvature).max())
    assert found.smallest_eigenvalue == pytest.approx(np.linalg.eigvalsh(found.stiffness)[0])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("model", ["exact", "end_couple"])
def test_loads_without_potential_balance_and_have_the_right_stiffness(seed, model):
    chain, tensions, loads = problem(seed, model, potential=False)
    found = solve_tensions(chain, tensions, loads)
    assert found.status is Status.CONVERGED
    at = found.joint_angles
    assert unbalanced(chain, tensions, loads, at) == pytest.approx(np.zeros(5), abs=1e-5)
    slope = differences(lambda theta: unbalanced(chain, tensions, loads, theta), at, 1e-4)
    assert found.stiffness == pytest.approx(slope, abs=2e-5 * np.abs(slope).max())
    assert np.abs(found.stiffness - found.stiffness.T).max() > 1.0


def test_stretching_tendons_stiffen_the_arm_by_what_the_differences_say():
    chain, tensions, loads = problem(1)
    pulled = solve_tensions(chain, tensions, loads)
    by_length = solve_lengths(chain, pulled.lengths - tensions / chain.stiffnesses, loads)
    assert by_length.tensions == pytest.approx(tensions, abs=1e-8)
    assert by_length.joint_angles == pytest.approx(pulled.joint_angles, abs=1e-9)
    stretch = by_length.tendon_rates * chain.stiffnesses @ by_length.tendon_rates.T
    assert by_length.stiffness == pytest.approx(pulled.stiffness + stretch, rel=1e-6)


def test_springs_hold_a_long_arm_whose_steps_are_still_newtons():
    """32 hinges: steps in O(n), whose generators have columns for springs."""
    arm = flexible_arm()
    loads = [arm.gravity(HANG), Spring(-1, 0.01, (150.0, -80.0, 600.0)), Spring(14, 0.05, (-60, 20, 300), (5, 0, 0))]
    tensions = np.array([8.0, 0, 0, 0, 3, 3, 0, 0])
    for found in (
        solve_tensions(arm, tensions, loads),
        solve_lengths(arm, arm.neutral_lengths - (12, 0, -9, 0, 4, 5, 0, 0), loads),
    ):
        assert found.status is Status.CONVERGED
        assert found.iterations <= 7
        assert unbalanced(arm, found.tensions, loads, found.joint_angles) == pytest.approx(np.zeros(32), abs=2e-5)
    free = solve_tensions(arm, tensions, loads[:1])
    assert np.linalg.norm(free.tip - solve_tensions(arm, tensions, loads).tip) > 50.0
    pinned = free.tip + np.array([1.0, 2.0, -3.0])
    stiff = solve_tensions(arm, tensions, [loads[0], Spring(-1, 1e6, pinned)])
    assert stiff.tip == pytest.approx(pinned, abs=1e-4)


def test_a_spring_of_one_newton_per_millimetre_is_no_special_case():
    arm = small_arm(6)
    x, y, z = arm.poses(arm.neutral_angles)[-1][:3, 3]
    tips = [
        solve_tensions(arm, np.full(arm.n_tendons, 2.0), [Spring(-1, k, (x + 3.0, y, z))]).tip
        for k in (1.0 - 1e-9, 1.0, 1.0 + 1e-9)
    ]
    np.testing.assert_allclose(tips[1], 0.5 * (tips[0] + tips[2]), atol=1e-7)
    assert abs(tips[1][0] - x) > 0.1


def test_a_negative_spring_is_a_status():
    assert solve_tensions(small_arm(), np.ones(4), [Spring(1, -1.0, (0, 0, 0))]).status is Status.INVALID_INPUT


def test_a_slack_tendon_carries_nothing_and_limits_hold_and_give_way():
    arm = flexible_arm()
    load = [arm.gravity(HANG), WorldForce(-1, (0.1, -0.25, 0.0))]
    slack = solve_lengths(arm, arm.neutral_lengths + 30.0, load)
    free = solve_tensions(arm, np.zeros(8), load)
    assert slack.tensions == pytest.approx(np.zeros(8))
    assert slack.joint_angles == pytest.approx(free.joint_angles, abs=1e-9)
    held = solve_lengths(arm, arm.neutral_lengths + 30.0, load, tension_limits=(0.5, 6.0))
    assert held.tensions == pytest.approx(np.full(8, 0.5))
    short = arm.neutral_lengths - (20, 0, 0, 0, 0, 0, 0, 0)
    assert solve_lengths(arm, short, load, tension_limits=(0.0, 6.0)).tensions[0] == pytest.approx(6.0)


def test_a_hinge_with_a_weight_is_a_pendulum_on_a_spring():
    """k theta = w L / 2 sin(theta - theta_vertical): upright it buckles at w = 2 k / L."""
    stiffness, spacing = 500.0, 20.0
    for weight, buckles in ((49.0, False), (51.0, True)):
        arm = HingeChain([Bead(spacing, "y", stiffness, weight=weight)], [BeadTendon([(5, 0)])], "linear")
        found = solve_tensions(arm, [0.0], [arm.gravity(UPRIGHT)])
        theta = found.joint_angles[0]
        assert found.status is Status.CONVERGED
        assert stiffness * theta == pytest.approx(0.5 * weight * spacing * np.sin(theta), abs=1e-8)
        assert (found.escapes > 0) == buckles == (abs(theta) > 0.1)
        assert found.smallest_eigenvalue > 0


def test_co_contraction_softens_the_hinge_and_buckles_it_at_four_k_over_h():
    """k_eff = k - h/4 sum of tensions: 272.6 N for h = 10 mm and k = 681.6 N·mm/rad."""
    around = [(25.0, 0.0), (-25.0, 0.0), (0.0, 25.0), (0.0, -25.0)]
    arm = HingeChain([Bead(21.875, "y", 681.6134)], [BeadTendon([hole]) for hole in around])
    for total in (0.0, 100.0, 272.0):
        found = solve_tensions(arm, np.full(4, total / 4))
        assert (found.status, found.escapes) == (Status.CONVERGED, 0)
        assert found.smallest_eigenvalue == pytest.approx(681.6134 - 2.5 * total, abs=1e-6)
    buckled = solve_tensions(arm, np.full(4, 273.5 / 4))
    assert buckled.escapes == 1
    theta = buckled.joint_angles[0]
    assert 681.6134 * theta == pytest.approx(5.0 * 273.5 * np.sin(theta / 2), abs=1e-6)
    assert solve_tensions(arm, np.full(4, 100.0)).status is Status.AT_LIMIT  # holes meet first
    linear = solve_tensions(arm.replace(model="linear"), np.full(4, 100.0))
    assert linear.smallest_eigenvalue == pytest.approx(681.6134)


def test_mirrored_tensions_give_the_mirrored_arm():
    arm, load = flexible_arm(), [flexible_arm().gravity(HORIZONTAL)]
    stiff = flexible_arm(stiffness=6000.0)
    tension = np.array([3.0, 1, 20, 5, 2, 9, 14, 0])
    mirrored = tension[[0, 3, 2, 1, 7, 6, 5, 4]]  # y to -y
    one, other = (solve_tensions(stiff, tau, load) for tau in (tension, mirrored))
    assert one.status is Status.CONVERGED
    assert other.tip == pytest.approx(one.tip * (1, -1, 1), abs=1e-8)
    assert solve_tensions(arm, [6, 0, 0, 0, 0, 0, 0, 0]).tip[0] > 10.0  # a tendon at +x bends towards +x


@pytest.mark.parametrize("direction", [HANG, HORIZONTAL, UPRIGHT])
@pytest.mark.parametrize("model", ["exact", "linear"])
def test_a_soft_arm_has_a_stable_equilibrium_however_it_is_held_and_pulled(direction, model):
    rng = np.random.default_rng(3)
    arm = flexible_arm(model)
    tensions = rng.uniform(0, 40, (12, 8)) * (rng.random((12, 8)) < 0.5)
    found = solve_tensions_batch(arm, tensions, [arm.gravity(direction)])
    assert np.all(found.ok)
    assert np.all(found.smallest_eigenvalue > 0)
    assert np.all(found.residual < 1e-8)
    by_length = solve_lengths_batch(arm, arm.neutral_lengths + rng.uniform(-20, 20, (12, 8)), [arm.gravity(direction)])
    assert np.all(by_length.ok)


def test_couples_on_the_last_bead_balance_an_arm_that_stands_which_newton_from_rest_does_not_find():
    rng = np.random.default_rng(3)
    arm = flexible_arm("end_couple")
    tensions = rng.uniform(0, 5, (12, 8)) * (rng.random((12, 8)) < 0.5)
    found = solve_tensions_batch(arm, tensions, [arm.gravity(UPRIGHT)])
    assert np.all(found.ok)
    assert np.median(found.iterations) > 30  # an overdamped motion, or growing loads


def test_a_growing_load_without_potential_is_followed_along_unstable_equilibria():
    rng = np.random.default_rng(0)
    arm = flexible_arm("end_couple")
    tensions = (rng.uniform(0, 30, (12, 8)) * (rng.random((12, 8)) < 0.5))[:2]
    found = solve_tensions_batch(arm, tensions, [BodyWrench(-1, (0.0, 0.3, -1.0)), arm.gravity(UPRIGHT)])
    assert np.all(found.status == Status.UNSTABLE) and found.residual.max() < 1e-8


def test_what_an_arm_has_computed_once_cannot_be_overwritten():
    arm = small_arm()
    for name in ("joint_limits", "neutral_angles", "neutral_lengths", "stiffnesses"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(arm, name)[0] = 0.0


def test_every_lane_is_the_single_solve_to_the_last_bit():
    rng = np.random.default_rng(7)
    arm, load = small_arm(), [small_arm().gravity(HORIZONTAL)]
    tensions = rng.uniform(0, 10, (9, 4))
    tensions[4, 1] = np.nan
    lengths = arm.neutral_lengths + rng.uniform(-2, 1, (9, 4))
    set_threads(3)
    for batch, single, inputs in (
        (solve_tensions_batch, solve_tensions, tensions),
        (solve_lengths_batch, solve_lengths, lengths),
    ):
        lanes = batch(arm, np.tile(inputs, (300, 1)), load)
        for lane in range(9):
            one = single(arm, inputs[lane], load)
            for name in ("joint_angles", "poses", "tensions", "lengths", "tendon_rates", "status", "iterations"):
                assert np.array_equal(getattr(lanes, name)[2691 + lane], getattr(one, name)), name
        assert np.array_equal(lanes.stiffness[-1], one.stiffness)


def test_lanes_may_have_loads_and_starts_of_their_own():
    rng = np.random.default_rng(8)
    arm, tensions = small_arm(), rng.uniform(0, 8, (3, 4))
    loads = [[WorldForce(-1, rng.normal(size=3))] for _ in range(3)]
    singles = [
        solve_tensions(arm, tau, load, start=np.full(4, 0.02 * k))
        for k, (tau, load) in enumerate(zip(tensions, loads, strict=True))
    ]
    tables = np.array([one.loads for one in singles])
    lanes = solve_tensions_batch(arm, tensions, tables, np.outer(range(3), np.full(4, 0.02)))
    assert np.array_equal(lanes.joint_angles, [one.joint_angles for one in singles])
    assert lanes.iterations.tolist() == [one.iterations for one in singles]


def test_lanes_may_have_mechanisms_of_their_own():
    arms = [small_arm(stiffness=k, model=model) for k, model in ((300.0, "exact"), (900.0, "linear"))]
    lanes = solve_tensions_batch([*arms, arms[0]], [[5.0, 0, 0, 0]] * 3)
    singles = [solve_tensions(arm, [5.0, 0, 0, 0]) for arm in (*arms, arms[0])]
    assert np.array_equal(lanes.poses, [one.poses for one in singles])
    assert lanes.smallest_eigenvalue == pytest.approx([one.smallest_eigenvalue for one in singles])
    assert "several mechanisms" in repr(lanes)
    with pytest.raises(InvalidInput, match="as the first"):
        solve_tensions_batch([small_arm(3), small_arm(4)], np.ones((2, 4)))
    with pytest.raises(InvalidInput, match="all of one kind"):
        solve_tensions_batch([small_arm(), five_link()], np.ones((2, 4)))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0, 1e300])
def test_numbers_that_mean_nothing_are_a_status_and_finite_results(bad):
    arm = small_arm()
    for found in (
        solve_tensions(arm, [bad, 1, 1, 1]),
        solve_tensions(arm, np.ones(4), [WorldForce(-1, (0, 0, bad * 1e300))]),
        solve_lengths(arm, [bad * 1e300, 80, 80, 80], start=np.full(4, np.nan)),
    ):
        assert found.status is Status.INVALID_INPUT
        assert not found.ok
        for name in ("joint_angles", "poses", "lengths", "tensions", "stiffness"):
            assert np.all(np.isfinite(getattr(found, name)))


@pytest.mark.parametrize("size", [1e3, 1e6, 1e9])
def test_huge_loads_end_in_a_status_without_an_exception(size):
    for model in ("exact", "linear", "end_couple"):
        arm = small_arm(5, model)
        for load in (WorldForce(-1, (size, -size, 0.3 * size)), BodyWrench(2, (size, 0, 0), moment=(0, size, 0))):
            found = solve_tensions(arm, [size, 1, 0, 2], [load])
            assert np.all(np.isfinite(found.poses))
            low, high = arm.joint_limits.T
            assert np.all((found.joint_angles >= low) & (found.joint_angles <= high))


def test_loads_and_inputs_of_the_wrong_form_are_refused():
    arm = small_arm()
    for load in (
        Spring(1, 1.0, (0, 0)),
        Spring(1, "stiff", (0, 0, 0)),
        WorldForce(-1, (1, 0)),
        WorldForce(9, (1, 0, 0)),
        WorldForce(1, (1, 0, 0), 3.0),
    ):
        with pytest.raises(InvalidInput):
            solve_tensions(arm, np.ones(4), [load])
    with pytest.raises(InvalidInput):
        solve_tensions(arm, np.ones(3))
    with pytest.raises(InvalidInput, match="least_squares"):
        solve_lengths(arm, arm.neutral_lengths, method="least squares")
    with pytest.raises(InvalidInput, match="load table"):
        solve_tensions_batch(arm, np.ones((2, 4)), np.zeros((2, 1, 11)))


def test_a_warm_start_finds_the_same_equilibrium_sooner():
    arm, load = flexible_arm(), [flexible_arm().gravity(HANG)]
    cold = solve_tensions(arm, [8.0, 0, 0, 0, 3, 3, 0, 0], load)
    warm = solve_tensions(arm, [8.2, 0, 0, 0, 3, 3, 0, 0], load, start=cold)
    again = solve_tensions(arm, [8.2, 0, 0, 0, 3, 3, 0, 0], load)
    assert warm.iterations < again.iterations
    assert warm.joint_angles == pytest.approx(again.joint_angles, abs=1e-9)


@pytest.mark.parametrize("model", ["exact", "end_couple"])
def test_sensitivities_are_the_differences_of_solves(model):
    chain, tensions, loads = problem(2, model, potential=False)
    found = solve_tensions(chain, tensions, loads)

    def lengths(tau):
        return solve_tensions(chain, tau, loads, start=found).lengths

    assert sensitivity.dlengths_dtensions(found) == pytest.approx(differences(lengths, tensions, 1e-4), abs=1e-5)
    wrench = np.zeros(6)

    def tip(w):
        more = WorldForce(4, w[:3], tuple(w[3:]), (1.0, -2.0, 3.0))
        return solve_tensions(chain, tensions, [*loads, more], start=found).tip

    by_load = sensitivity.dposes_dload(found, 4, (1.0, -2.0, 3.0))[-1, :3]
    assert by_load == pytest.approx(differences(tip, wrench, 1e-3), abs=1e-5 * np.abs(by_load).max() + 1e-6)
    motion = differences(chain.poses, found.joint_angles, 1e-5)[:, :3, 3]
    assert found.pose_jacobian[:, :3] == pytest.approx(motion, abs=1e-7)
    command = found.lengths - tensions / chain.stiffnesses
    elastic = solve_lengths(chain, command, loads, start=found)

    def tip_by_length(c):
        return solve_lengths(chain, c, loads, start=elastic).tip

    assert sensitivity.dposes_dlengths(elastic)[-1, :3] == pytest.approx(
        differences(tip_by_length, command, 1e-4), abs=1e-4
    )


def test_arms_that_are_drawn_together_end_in_an_equilibrium():
    rng, arm, count = np.random.default_rng(0), flexible_arm(), 6000
    pulls = rng.uniform(0.0, 1.0, (count, 8)) * np.repeat([120.0, 160.0], 4) * rng.uniform(0.0, 1.0, (count, 1))
    at_saddles = [219, 346, 498, 658, 723, 748, 796, 867]  # many hinges alike, at their limits or at a saddle
    found = solve_lengths_batch(arm, (arm.neutral_lengths - pulls)[at_saddles])
    assert np.all(found.status <= Status.AT_LIMIT)
