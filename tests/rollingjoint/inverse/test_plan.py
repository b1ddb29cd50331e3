"""Plans lead along paths within limits, and say where they cannot."""

import contextlib
import io
import json
from pathlib import Path

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint.cli import main
from rollingjoint.errors import InvalidInput
from rollingjoint.inverse.constrained import constrained_least_squares
from rollingjoint.plan import PlanStatus
from tests.pages import examples

PAGE = Path(__file__).parents[3] / "docs" / "planning.md"
LOADS, LIMITS = [rj.WorldForce(-1, (0.2, 0.0))], (1.0, 8.0)
PATH = [(-30.0, 82.0), (-21.0, 82.9)]


def wall():
    arm = rj.two_segment(4, 4, height=10, radius=7, half_width=5)
    return arm, rj.Surroundings([rj.HalfPlane((1, 0), -25, stiffness=2.0)], rj.Sleeve(5.0), rj.WallFriction(0.2))


@pytest.fixture(scope="module")
def plan():
    return rj.plan_path(rj.two_segment(), PATH, LOADS, LIMITS)


def test_a_plan_is_a_trace_of_its_lengths_within_tensions_and_rates(plan):
    assert plan.ok and len(plan.times) == 10 and plan.waypoints.tolist() == [0, 9]
    way = rj.trace(rj.two_segment(), plan.lengths, LOADS, tension_limits=LIMITS)
    np.testing.assert_allclose(way.tip, plan.tip, atol=1e-7)
    np.testing.assert_allclose(plan.targets[plan.waypoints], PATH)
    assert np.linalg.norm(way.tip - plan.targets, axis=1).max() < 1e-3
    assert (way.tensions >= LIMITS[0] - 1e-9).all() and (way.tensions <= LIMITS[1] + 1e-9).all()
    speeds = np.abs(np.diff(plan.lengths, axis=0)) / np.diff(plan.times)[:, None]
    np.testing.assert_allclose(speeds.max(axis=1), 10.0)  # mm/s: one tendon at the default rate


def test_a_plan_has_the_tensions_that_reach_prefers(plan):
    there = rj.reach_batch(rj.two_segment(), plan.targets, LOADS, LIMITS)
    np.testing.assert_allclose(plan.tensions, there.tensions, atol=0.02)


def test_times_that_are_too_short_bind_the_rate():
    plan = rj.plan_path(rj.two_segment(), PATH, LOADS, LIMITS, times=[0.0, 0.2])
    assert not plan.ok and "highest rate" in plan.binding and plan.times[-1] == 0.2
    assert (np.abs(np.diff(plan.lengths, axis=0)) <= 10.0 * np.diff(plan.times)[:, None] + 1e-9).all()
    assert rj.plan_path(rj.two_segment(), PATH, LOADS, LIMITS, times=[0.0, 10.0]).ok


def test_a_path_out_of_reach_is_missed_by_as_much_as_reach_misses_it():
    plan = rj.plan_path(rj.two_segment(), [(-14.5, 83.5), (-8.0, 84.2)], LOADS, LIMITS, starts=1)
    nearest = rj.reach_batch(rj.two_segment(), plan.targets, LOADS, LIMITS)
    assert (plan.status == PlanStatus.MISSED).all() and "tendon" in plan.binding
    np.testing.assert_allclose(plan.distance, nearest.distance, atol=1e-5)


@pytest.mark.parametrize("chain", [rj.five_link(), rj.small_arm(), rj.pitch_yaw(2)], ids=["planar", "arm", "space"])
def test_poses_along_a_way_of_equilibria_are_followed(chain):
    tensions = np.linspace(1.5, 2.5, 9)[:, None] * np.linspace(1.0, 2.0, chain.n_tendons)
    aims = rj.solve_tensions_batch(chain, tensions).require().poses[:, -1]
    plan = rj.plan_path(chain, aims, (), (1.0, 10.0), step=1e9)
    assert plan.ok, plan
    np.testing.assert_allclose(plan.equilibria.poses[:, -1], aims, atol=2e-3)


def test_a_start_is_where_the_plan_begins():
    chain = rj.two_segment()
    start = rj.reach(chain, (-31.0, 81.0), LOADS, LIMITS)
    plan = rj.plan_path(chain, PATH, LOADS, LIMITS, start=start)
    assert plan.ok and plan.waypoints[0] > 0
    np.testing.assert_allclose(plan.tip[0], start.tip, atol=1e-9)


def test_where_one_shape_does_not_reach_all_targets_the_plan_changes_it_in_a_detour():
    chain, load = rj.two_segment(), [rj.WorldForce(-1, (0.0, -0.6))]
    angles = np.radians(np.linspace(-35, 35, 15))
    path = 84.0 * np.stack([np.sin(angles), np.cos(angles)], axis=-1)
    plan = rj.plan_path(chain, path, load, (0.2, 8.0), starts=1)
    assert not plan.ok and (plan.status == PlanStatus.DETOUR).any() and not (plan.status == PlanStatus.MISSED).any()
    assert plan.distance[plan.waypoints].max() < 1e-3
    moves = np.abs(np.diff(plan.equilibria.joint_angles, axis=0)).max(axis=1)
    assert (moves[~plan.snapped[1:]] < 0.3).all() and moves.sum() > 1.5


@pytest.mark.slow
@pytest.mark.parametrize("cap", [np.inf, 0.3])
def test_a_cap_on_wall_force_is_kept_with_friction_at_the_wall(cap):
    arm, around = wall()
    path = [(-5.0, 78.0), (-20.5, 70.0)]
    plan = rj.plan_path(arm, path, (), (0.5, 15.0), surroundings=around, wall_force=cap, starts=1)
    way = rj.trace(arm, plan.lengths, tension_limits=(0.5, 15.0), surroundings=around)
    np.testing.assert_allclose(way.tip, plan.tip, atol=1e-4)
    forces = [max([0.0, *(contact.force for contact in step)]) for step in plan.equilibria.wall_contacts]
    np.testing.assert_allclose(plan.wall_force, forces)
    if cap == np.inf:
        assert plan.wall_force.max() > 0.5
    else:
        assert 0.29 < plan.wall_force.max() < 0.301 and "wall" in plan.binding


def test_targets_are_in_the_frame_of_the_walls():
    arm, around = wall()
    turn, target = 0.1, np.array([3.0, 78.0])
    plan = rj.plan_path(arm, [target], (), (0.5, 15.0), surroundings=around, base=(2.0, 1.0, turn))
    cos, sin = np.cos(turn), np.sin(turn)
    np.testing.assert_allclose(np.array([[cos, -sin], [sin, cos]]) @ plan.tip[0] + (2.0, 1.0), target, atol=1e-3)


def test_constrained_least_squares_is_that_of_a_general_optimiser():
    from scipy.optimize import minimize

    rng = np.random.default_rng(0)
    for _ in range(20):
        A, b, G = rng.normal(size=(6, 4)), rng.normal(size=6), rng.normal(size=(9, 4))
        h = G @ rng.normal(size=4) - 0.3 * rng.random(9)
        x = constrained_least_squares(A, b, G, h)
        best = minimize(
            lambda x, A=A, b=b: np.sum((A @ x - b) ** 2),
            np.zeros(4),
            constraints={"type": "ineq", "fun": lambda x, G=G, h=h: G @ x - h},
            options={"ftol": 1e-12, "maxiter": 500},
        )
        assert x is not None and (G @ x >= h - 1e-9).all()
        np.testing.assert_allclose(np.sum((A @ x - b) ** 2), best.fun, rtol=1e-5, atol=1e-8)
    assert constrained_least_squares(np.eye(1), np.zeros(1), np.array([[1.0], [-1.0]]), np.ones(2)) is None


def test_wrong_inputs_are_one_line():
    chain = rj.five_link()
    for call in (
        lambda: rj.plan_path(chain, (1.0, 2.0)),
        lambda: rj.plan_path(chain, [(1.0, np.nan)]),
        lambda: rj.plan_path(chain, [(1.0, 2.0)] * 2, times=[1.0, 1.0]),
        lambda: rj.plan_path(chain, [(1.0, 2.0)], times=[np.nan]),
        lambda: rj.plan_path(chain, [(1.0, 2.0)] * 2, times=[1.0, np.inf]),
        lambda: rj.plan_path(chain, [(1.0, 2.0)], rate=0.0),
        lambda: rj.plan_path(chain, [(1.0, 2.0)], rate=[1.0, 2.0, 3.0]),
        lambda: rj.plan_path(chain, [(1.0, 2.0)], (), (5.0, 1.0)),
        lambda: rj.plan_path(chain, [(1.0, 80.0), (1e9, 80.0)]),
        lambda: rj.plan_path(chain, [(1.0, 2.0)], base=(1.0, 0.0, 0.0)),
        lambda: rj.plan_path(chain, [(1.0, 2.0)], prefer="margins"),
        lambda: rj.plan_path(chain, [(1.0, 2.0)], start=[0.0] * 4),
        lambda: rj.plan_path(chain, [(1.0, 2.0)], wall_force=-1.0),
    ):
        with pytest.raises(InvalidInput) as error:
            call()
        assert "\n" not in str(error.value)


@pytest.mark.slow
def test_the_page_prints_what_it_says():
    names = {}
    for program, expected in examples(PAGE.read_text("utf-8")):
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            exec(program, names)
        assert printed.getvalue() == expected


def test_the_command_prints_steps_and_draws_them(capsys, tmp_path):
    tips = [word for tip in PATH for word in ("--tip", *map(str, tip))]
    case = ["plan", "two_segment", *tips, "--force", "-1", "0.2", "0", "--tension-limits", "1", "8"]
    assert main([*case, "--plot", str(tmp_path / "plan.png")]) == 0
    assert "FOLLOWED" in capsys.readouterr().out and (tmp_path / "plan.png").stat().st_size > 10_000
    assert main([*case, "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["ok"] and len(content["time_s"]) == 10
    assert main([*case, "--csv"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 11
    assert main([*case[:-1], "1.1"]) == 3  # N: too little
    capsys.readouterr()
    assert main([*case, "--wall-force", "1"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
