"""Joint limits are kept, and the tip has the wanted stiffness or force on a wall: a second method agrees."""

import numpy as np
import pytest
from scipy.optimize import least_squares, minimize

import rollingjoint as rj
from rollingjoint.errors import InvalidInput

CHAIN, LOADS, LIMITS, TIP = rj.two_segment(), [rj.WorldForce(-1, (0.2, 0.0))], (1.0, 8.0), np.array([-30.0, 82.0])
ARM = rj.two_segment(4, 4, height=10, radius=7, half_width=5)
WALL = rj.Surroundings([rj.HalfPlane((1, 0), -25, stiffness=2.0)], rj.Sleeve(5.0))
PLACE, ARM_LIMITS = np.array([-20.0, 71.0]), (0.5, 15.0)


def reach(**more):
    return rj.reach(CHAIN, TIP, LOADS, LIMITS, **more)


def under(tensions, loads=LOADS):
    return rj.solve_tensions(CHAIN, np.clip(tensions, *LIMITS), loads)


def pushed_stiffness(lengths, angles, direction, push=1e-3):
    """Stiffness of the tip by two solves with a force along a direction."""
    direction = np.asarray(direction, float)
    tips = [
        rj.solve_lengths(CHAIN, lengths, [*LOADS, rj.WorldForce(-1, tuple(sign * push * direction))], start=angles).tip
        for sign in (1.0, -1.0)
    ]
    return 2.0 * push / (direction @ (tips[0] - tips[1]))


def optimum(cost, constraints):
    """Tensions by sequential quadratic programming, from the middle of the limits."""
    settings = {"ftol": 1e-12, "maxiter": 500}
    return minimize(cost, np.full(4, 3.0), bounds=[LIMITS] * 4, constraints=constraints, options=settings)


def within(limits):
    return {
        "type": "ineq",
        "fun": lambda t: np.concatenate([under(t).joint_angles - limits[0], limits[1] - under(t).joint_angles]),
    }


def test_the_nearest_tip_within_joint_limits_is_that_of_a_general_optimiser():
    limits = (-0.2, 0.2)
    there = reach(joint_limits=limits)
    assert there.status is rj.ReachStatus.OUT_OF_REACH and "joint 5 at its limit" in there.binding
    assert (np.abs(there.joint_angles) <= 0.2 + 1e-6).all()
    best = optimum(lambda t: np.sum((under(t).tip - TIP) ** 2), [within(limits)])
    assert there.distance == pytest.approx(np.sqrt(best.fun), abs=1e-4)


def test_the_least_tensions_within_joint_limits_are_those_of_a_general_optimiser():
    limits = (-0.24, 0.24)
    assert np.abs(reach().joint_angles).max() > 0.25
    there = reach(joint_limits=limits)
    assert there.ok and there.distance < 1e-6 and (np.abs(there.joint_angles) <= 0.24 + 1e-6).all()
    again = rj.solve_lengths(CHAIN, there.lengths, LOADS, tension_limits=LIMITS)
    np.testing.assert_allclose(again.tip, TIP, atol=1e-6)
    on_target = {"type": "eq", "fun": lambda t: under(t).tip - TIP}
    best = optimum(lambda t: np.sum((t - LIMITS[0]) ** 2), [on_target, within(limits)])
    assert np.sum((there.tensions - LIMITS[0]) ** 2) <= 1.01 * best.fun


def test_rows_of_a_batch_keep_joint_limits_and_others_stay_as_they_are():
    tensions = np.random.default_rng(2).uniform(*LIMITS, (6, 4))
    tips = rj.solve_tensions_batch(CHAIN, tensions, LOADS).tip
    free, limits = rj.reach_batch(CHAIN, tips, LOADS, LIMITS), (-0.26, 0.26)
    kept = rj.reach_batch(CHAIN, tips, LOADS, LIMITS, joint_limits=limits)
    inside = (np.abs(free.joint_angles) <= 0.26).all(axis=1)
    assert 0 < inside.sum() < 6
    np.testing.assert_array_equal(kept.lengths[inside], free.lengths[inside])
    assert (np.abs(kept.joint_angles) <= 0.26 + 1e-6).all()
    row = int(np.flatnonzero(~inside)[0])
    one = rj.reach(CHAIN, tips[row], LOADS, LIMITS, joint_limits=limits)
    assert one.status == kept.status[row] and one.distance == pytest.approx(kept.distance[row], abs=1e-6)
    assert kept.row(row).joint_limits is not None


def test_joint_limits_that_no_equilibrium_keeps_have_a_status():
    there = reach(joint_limits=(0.9, 1.0))
    assert there.status is rj.ReachStatus.BEYOND_LIMITS and not there.ok and "joint" in there.binding


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.6, 0.8)])
def test_the_tip_has_the_wanted_stiffness_when_it_is_pushed(direction):
    first = reach().tip_stiffness(direction)
    there = reach(stiffness=(direction, 1.3 * first))
    assert there.ok and there.distance < 1e-6
    again = rj.solve_lengths(CHAIN, there.lengths, LOADS, tension_limits=LIMITS)
    np.testing.assert_allclose(again.tip, TIP, atol=1e-6)
    assert pushed_stiffness(there.lengths, there.joint_angles, direction) == pytest.approx(1.3 * first, rel=1e-5)
    assert there.tip_stiffness(direction) == pytest.approx(1.3 * first, rel=1e-6)


def test_a_stiffness_out_of_reach_gives_the_compromise_of_least_squares():
    wanted, lever = 0.3, 0.1 * CHAIN.length
    there = reach(stiffness=((1.0, 0.0), wanted))
    assert there.status is rj.ReachStatus.OUT_OF_REACH and there.binding

    def misses(tensions):
        at = under(tensions)
        lengths = at.lengths - at.tensions / CHAIN.stiffnesses
        stiffness = pushed_stiffness(lengths, at.joint_angles, (1.0, 0.0))
        return np.append(at.tip - TIP, lever * (stiffness / wanted - 1.0))

    second = least_squares(misses, np.full(4, 6.0), bounds=LIMITS, diff_step=1e-4)
    cost = there.distance**2 + (lever * (there.tip_stiffness((1.0, 0.0)) / wanted - 1.0)) ** 2
    assert cost == pytest.approx(2.0 * second.cost, rel=1e-3)


@pytest.mark.parametrize("force", [0.2, 1.0])
def test_the_tip_presses_on_a_wall_with_the_wanted_force_at_the_place(force):
    there = rj.reach(ARM, PLACE, (), ARM_LIMITS, surroundings=WALL, contact_force=force)
    assert there.ok
    again = rj.solve_lengths(ARM, there.lengths, start=there.joint_angles, tension_limits=ARM_LIMITS, surroundings=WALL)
    assert again.wall_forces[-1, 0] == pytest.approx(force, rel=1e-5)  # from the left wall, along x
    assert again.tip[1] == pytest.approx(PLACE[1], abs=1e-5) and abs(again.tip[0] - PLACE[0]) > 0.01


def test_a_force_out_of_reach_gives_the_compromise_of_least_squares():
    wanted, lever = 2.0, 0.1 * ARM.length
    there = rj.reach(ARM, PLACE, (), ARM_LIMITS, surroundings=WALL, contact_force=wanted)
    assert there.status is rj.ReachStatus.OUT_OF_REACH and there.binding

    def misses(tensions):
        at = rj.solve_tensions(ARM, tensions, start=there.joint_angles, surroundings=WALL)
        return np.array([at.tip[1] - PLACE[1], lever * (at.wall_forces[-1, 0] / wanted - 1.0)])

    start = np.clip(there.tensions + np.array([-1.0, 1.0, -1.0, 1.0]), 0.6, 14.9)
    second = least_squares(misses, start, bounds=ARM_LIMITS, diff_step=1e-5)
    cost = there.distance**2 + (lever * (there.contact_force / wanted - 1.0)) ** 2
    assert cost <= 2.0 * second.cost * 1.001


def test_aims_that_cannot_be_used_are_one_line():
    for more in (
        {"joint_limits": (0.2, -0.2)},
        {"joint_limits": 0.2},
        {"joint_limits": (np.nan, 1.0)},
        {"joint_limits": (-0.2, 0.2), "inputs": "tensions"},
        {"stiffness": 0.1},
        {"stiffness": ((0.0, 0.0), 0.1)},
        {"stiffness": ((1.0, 0.0, 0.0), 0.1)},
        {"stiffness": ((1.0, 0.0), 0.0)},
        {"contact_force": 0.5},
        {"contact_force": -0.5, "surroundings": WALL},
    ):
        with pytest.raises(InvalidInput) as error:
            reach(**more)
        assert "\n" not in str(error.value)
    with pytest.raises(InvalidInput, match="not all 0"):
        reach().tip_stiffness((0.0, 0.0))
    many = rj.reach_batch(CHAIN, np.stack([TIP, TIP]), LOADS, LIMITS)
    for use in (lambda: many.tip_stiffness((1.0, 0.0)), lambda: many.contact_force):
        with pytest.raises(InvalidInput, match=r"of 2 rows.*row\(i\)"):
            use()
    with pytest.raises(InvalidInput, match="beside contact_force"):
        rj.reach(ARM, np.zeros((9, 2)), surroundings=WALL, contact_force=0.5)


def test_the_command_has_words_for_joint_limits_stiffness_and_force(tmp_path, capsys):
    from rollingjoint.cli import main

    base = ["reach", "two_segment", "--tip", "-30", "82", "--force", "-1", "0.2", "0", "--tension-limits", "1", "8"]
    assert main([*base, "--joint-limits", "-0.2", "0.2"]) == 3
    assert "joint 5 at its limit" in capsys.readouterr().out
    assert main([*base, "--stiffness", "0.1", "1", "0"]) == 0
    assert "stiffness 0.1000 N/mm" in capsys.readouterr().out
    assert main([*base, "--contact-force", "1"]) == 2
    assert "--surroundings" in capsys.readouterr().err
    walls = tmp_path / "walls.yaml"
    walls.write_text("surroundings:\n  walls:\n    - half_plane: {normal: [1, 0], offset: -25, stiffness: 2.0}\n")
    pressing = [*base[:3], "-12", "86", "--tension-limits", "1", "15", "--surroundings", str(walls)]
    assert main([*pressing, "--contact-force", "0.2"]) == 0
    assert "presses on walls with 0.2000 N" in capsys.readouterr().out
