"""The inverse brings every class of chains to targets, within limits, and says so where it cannot."""

import contextlib
import io
from pathlib import Path

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint.errors import InvalidInput
from tests.pages import examples

PAGE = Path(__file__).parents[3] / "docs" / "inverse.md"

CHAINS = {"planar": rj.five_link, "arm": rj.small_arm, "space": lambda: rj.pitch_yaw(2)}
LIMITS = (1.0, 10.0)
COUNT = 200


@pytest.fixture(params=CHAINS, scope="module")
def chain(request):
    return CHAINS[request.param]()


def load_of(chain):
    return [rj.WorldForce(-1, (0.2, *[0.0] * (chain.dimension - 1)))]


def targets_of(chain, count=COUNT, seed=1):
    """Equilibria under random tensions within the limits."""
    tensions = np.random.default_rng(seed).uniform(*LIMITS, (count, chain.n_tendons))
    return rj.solve_tensions_batch(chain, tensions, load_of(chain)).require()


def test_random_reachable_tips_are_reached_by_lengths_that_the_solver_confirms(chain):
    aims = targets_of(chain)
    reached = rj.reach_batch(chain, aims.tip, load_of(chain), LIMITS)
    assert np.mean(reached.ok) >= 0.99
    again = rj.solve_lengths_batch(chain, reached.lengths, load_of(chain), tension_limits=LIMITS)
    rows = np.asarray(reached.ok) & reached.from_rest
    assert np.mean(rows) >= 0.99
    assert np.abs(again.tip - aims.tip)[rows].max() < 1e-6
    np.testing.assert_array_equal(again.tip[rows], reached.tip[rows])
    assert (reached.tensions >= LIMITS[0] - 1e-9).all() and (reached.tensions <= LIMITS[1] + 1e-9).all()


def test_a_single_reach_is_the_row_of_a_batch(chain):
    aims = targets_of(chain, 3)
    many = rj.reach_batch(chain, aims.tip, load_of(chain), LIMITS)
    for row in range(3):
        one = rj.reach(chain, aims.tip[row], loads=load_of(chain), tension_limits=LIMITS)
        np.testing.assert_array_equal(one.lengths, many.lengths[row])
        assert one.status is rj.ReachStatus(int(many.status[row])) and one.distance == many.distance[row]


def test_tensions_as_inputs_hold_the_tip(chain):
    aims = targets_of(chain, 20)
    reached = rj.reach_batch(chain, aims.tip, load_of(chain), LIMITS, inputs="tensions")
    again = rj.solve_tensions_batch(chain, reached.tensions, load_of(chain))
    rows = np.asarray(reached.ok) & reached.from_rest
    assert rows.sum() >= 19 and np.abs(again.tip - aims.tip)[rows].max() < 1e-6


@pytest.mark.parametrize("what", ["poses", "positions"])
def test_whole_shapes_are_reached(chain, what):
    aims = targets_of(chain, 20)
    reached = rj.reach_batch(chain, getattr(aims, what), load_of(chain), LIMITS)
    assert np.mean(reached.ok) >= 0.9
    assert np.abs(reached.equilibrium.positions - aims.positions)[reached.ok].max() < 1e-4


def test_tip_poses_of_equilibria_are_reached(chain):
    aims = targets_of(chain, 20)
    reached = rj.reach_batch(chain, aims.poses[:, -1], load_of(chain), LIMITS)
    assert np.mean(reached.ok) >= 0.9
    assert np.abs(reached.equilibrium.poses[:, -1] - aims.poses[:, -1])[reached.ok].max() < 1e-5


def test_the_least_tensions_are_those_of_a_general_optimiser():
    from scipy.optimize import minimize

    chain = rj.two_segment()
    aim = targets_of(chain, 1, seed=4)
    reached = rj.reach(chain, aim.tip[0], load_of(chain), LIMITS)

    def miss(tensions):
        return rj.solve_tensions(chain, tensions, load_of(chain)).tip - aim.tip[0]

    best = minimize(
        lambda t: np.sum((t - LIMITS[0]) ** 2),
        aim.tensions[0],
        bounds=[LIMITS] * 4,
        constraints={"type": "eq", "fun": miss},
        options={"ftol": 1e-10, "maxiter": 500},
    )
    assert reached.ok
    assert np.sum((reached.tensions - LIMITS[0]) ** 2) <= best.fun * 1.02 + 1e-3


def test_preferences_order_the_tensions():
    chain = rj.two_segment()
    aim, limits = targets_of(chain, 1, seed=4).tip[0], LIMITS
    sums = [rj.reach(chain, aim, load_of(chain), limits, prefer=word).tensions.sum() for word in rj.inverse.PREFERENCES]
    assert sums[0] < sums[1] < sums[2]


def test_a_target_out_of_reach_gives_the_nearest_pose_and_the_limits_that_bind():
    chain = rj.five_link()
    far = rj.reach(chain, (200.0, 80.0), load_of(chain), LIMITS)
    assert far.status is rj.ReachStatus.OUT_OF_REACH and not far.ok and "tendon" in far.binding
    sampled = rj.solve_tensions_batch(
        chain, np.stack(np.meshgrid(*2 * [np.linspace(*LIMITS, 60)]), -1).reshape(-1, 2), load_of(chain)
    )
    assert far.distance <= np.linalg.norm(sampled.tip - (200.0, 80.0), axis=1).min() + 1e-6
    assert far.distance == pytest.approx(np.linalg.norm(far.tip - (200.0, 80.0)))


def test_a_search_that_creeps_along_a_fold_goes_on_until_it_has_settled():
    chain, rng = rj.two_segment(), np.random.default_rng(2)
    force = rng.uniform(-1.0, 1.0, (30, 2))[14]
    target = chain.poses(rng.uniform(-0.5, 0.5, (30, 6)))[14, -1, :2]
    far = rj.reach_batch(chain, target[None], [rj.WorldForce(-1, tuple(force))], (0.5, 15.0))
    assert far.status[0] == rj.ReachStatus.OUT_OF_REACH and far.distance[0] < 1.5126


@pytest.mark.parametrize("name", ["two_segment", "small_arm"])
def test_one_target_ends_where_it_ends_among_others(name):
    chain = rj.preset(name)
    tips = rj.solve_tensions_batch(chain, np.random.default_rng(4).uniform(*LIMITS, (20, chain.n_tendons))).tip
    many = rj.reach_batch(chain, tips, (), LIMITS)
    one = [rj.reach(chain, tip, (), LIMITS) for tip in tips]
    assert all(found.ok for found in one)
    assert np.array([found.tensions for found in one]) == pytest.approx(many.tensions, abs=1e-9)


@pytest.mark.parametrize(
    ("tip", "limits"),
    [((np.nan, 1.0), LIMITS), ((1e300, 1.0), LIMITS), ((0.0, 80.0), (5.0, 1.0)), ((0.0, 80.0), (-1.0, np.nan))],
)
def test_numbers_that_cannot_be_used_give_a_status_and_no_nan(tip, limits):
    reached = rj.reach(rj.five_link(), tip, tension_limits=limits)
    assert reached.status is rj.ReachStatus.INVALID_INPUT and not reached.ok and reached.status.message
    assert np.isfinite(reached.lengths).all() and np.isfinite(reached.tip).all() and not np.isnan(reached.distance)


def test_wrong_shapes_and_words_are_one_line():
    chain = rj.five_link()
    for call in (
        lambda: rj.reach(chain, (1.0, 2.0, 3.0, 4.0)),
        lambda: rj.reach(chain, "here"),
        lambda: rj.reach(chain, (1.0, 2.0), prefer="least"),
        lambda: rj.reach(chain, (1.0, 2.0), inputs="angles"),
        lambda: rj.reach(chain, (1.0, 2.0), prefer="margins"),
        lambda: rj.reach(chain, (1.0, 2.0), starts=0),
        lambda: rj.reach(chain, (1.0, 2.0), start=[0.0, 0.0]),
        lambda: rj.reach("five_link", (1.0, 2.0)),
        lambda: rj.reach_batch([], [(1.0, 2.0)]),
    ):
        with pytest.raises(InvalidInput) as error:
            call()
        assert "\n" not in str(error.value)


def test_a_start_is_used_and_an_empty_batch_is_empty():
    chain = rj.five_link()
    aim = targets_of(chain, 2)
    first = rj.reach(chain, aim.tip[0], load_of(chain), LIMITS)
    warm = rj.reach(chain, aim.tip[0] + 0.01, load_of(chain), LIMITS, start=first)
    assert warm.status is not rj.ReachStatus.INVALID_INPUT and warm.distance < 0.1
    assert warm.iterations < rj.reach(chain, aim.tip[0] + 0.01, load_of(chain), LIMITS).iterations
    assert len(rj.reach_batch(chain, np.zeros((0, 2))).lengths) == 0


def test_all_solutions_are_different_and_hold_the_tip():
    chain = rj.two_segment()
    aim = targets_of(chain, 1, seed=4).tip[0]
    solutions = rj.all_solutions(chain, aim, load_of(chain), LIMITS, starts=32)
    assert solutions and all(one.ok for one in solutions)
    for i, one in enumerate(solutions):
        assert np.linalg.norm(one.tip - aim) < 1e-6
        assert all(np.abs(one.joint_angles - other.joint_angles).max() > 1e-3 for other in solutions[:i])


def test_each_row_has_its_own_mechanism_and_loads():
    chains = [rj.five_link(), rj.five_link(stiffness=4.0)]
    tables = np.stack([chains[0].load_table([rj.WorldForce(-1, (force, 0.0))]) for force in (0.1, 0.3)])
    aims = rj.solve_tensions_batch(chains, [[3.0, 2.0], [2.0, 6.0]], tables)
    reached = rj.reach_batch(chains, aims.tip, tables, LIMITS)
    assert reached.ok.all()
    again = rj.solve_lengths_batch(chains, reached.lengths, tables, tension_limits=LIMITS)
    assert np.abs(again.tip - aims.tip).max() < 1e-6


def test_the_page_prints_what_it_says():
    names, pairs = {}, examples(PAGE.read_text("utf-8"))
    for program, expected in pairs:
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            exec(program, names)
        assert printed.getvalue() == expected
    assert len(pairs) == 2


def test_the_command_exits_with_3_where_the_target_is_out_of_reach(capsys):
    from rollingjoint.cli import main

    assert main(["reach", "five_link", "--tip", "90", "90", "--tension-limits", "1", "10"]) == 3
    assert "OUT_OF_REACH" in capsys.readouterr().out
    assert main(["reach", "five_link", "--tip", "1"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_the_picture_of_the_command_has_a_cross_at_the_target(tmp_path):
    from matplotlib import image

    from rollingjoint.cli import main

    assert main(["reach", "five_link", "--tip", "-20", "95", "--plot", str(tmp_path / "a.png")]) == 3
    lengths = rj.reach(rj.five_link(), (-20.0, 95.0)).lengths
    assert main(["plot", "five_link", "--lengths", *map(str, lengths), "--out", str(tmp_path / "b.png")]) == 0
    orange = np.array([0xD5, 0x5E, 0x00]) / 255.0
    near = [np.abs(image.imread(tmp_path / name)[..., :3] - orange).max(axis=-1) < 0.01 for name in ("a.png", "b.png")]
    assert near[0].any() and not near[1].any()


def test_among_walls_a_target_is_reached_and_a_cap_on_their_force_kept():
    arm = rj.two_segment(4, 4, height=10, radius=7, half_width=5)
    around, limits = rj.Surroundings([rj.HalfPlane((1, 0), -25, stiffness=2.0)], rj.Sleeve(5.0)), (0.5, 15.0)
    case = {"surroundings": around, "base": (0.5, 0.0, 0.0)}
    aim = rj.solve_tensions(arm, (0.5, 4.6, 14.0, 3.7), **case).tip
    there = rj.reach(arm, aim, (), limits, **case)
    assert there.ok and there.equilibrium.wall_contacts
    again = rj.solve_lengths(arm, there.lengths, start=there.joint_angles, tension_limits=limits, **case)
    np.testing.assert_allclose(again.tip, aim, atol=1e-5)
    force = there.equilibrium.walls.normals.max()
    capped = rj.reach(arm, aim, (), limits, **case, wall_force=0.5 * force)
    assert capped.status is rj.ReachStatus.OUT_OF_REACH and 1e-4 < capped.distance < 5.0
    assert capped.equilibrium.walls.normals.max() <= 0.501 * force


def test_with_a_history_the_step_with_friction_ends_at_the_target():
    rubs = rj.two_segment().replace(friction=rj.CapstanFriction(0.1))
    loads = load_of(rubs)
    before = rj.solve_tensions(rubs, [2.0, 3.0, 4.0, 2.0], loads)
    target = before.tip + np.array([1.0, -0.5])
    there = rj.reach(rubs, target, loads, LIMITS, history=before)
    assert there.ok and there.equilibrium.friction is not None
    again = rj.solve_lengths(rubs, there.lengths, loads, tension_limits=LIMITS, history=before)
    np.testing.assert_allclose(again.tip, target, atol=1e-5)
    plain = rj.solve_lengths(rubs, there.lengths, loads, tension_limits=LIMITS)
    assert np.linalg.norm(plain.tip - target) > 1e-2  # friction counts


def test_rows_with_loads_on_different_links_are_reached():
    chain, rng = rj.two_segment(), np.random.default_rng(5)
    loads = np.array([chain.load_table([rj.WorldForce(link, (0.2, -0.1))]) for link in (2, 4, 6) * 10])
    aims = rj.solve_tensions_batch(chain, rng.uniform(*LIMITS, (30, 4)), loads).require()
    reached = rj.reach_batch(chain, aims.tip, loads, LIMITS)
    again = rj.solve_lengths_batch(chain, reached.lengths, loads, reached.joint_angles, tension_limits=LIMITS)
    assert reached.ok.all() and np.abs(again.tip - aims.tip).max() < 1e-6


def test_the_last_step_reports_no_target_as_reached_that_is_a_hair_out_of_reach():
    chain = rj.five_link()
    tensions = np.array([[LIMITS[0], LIMITS[1]]])
    edge = rj.solve_tensions_batch(chain, tensions, load_of(chain)).require()
    far = edge.tip + 1e-4 * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    reached = rj.reach_batch(chain, far, load_of(chain), LIMITS)
    out = ~np.asarray(reached.ok)
    assert out.any() and (reached.status[out] == int(rj.ReachStatus.OUT_OF_REACH)).all()
    assert (reached.distance[out] <= 1e-4 + 1e-9).all()


def test_each_row_of_a_batch_has_its_own_mechanism():
    chains = [rj.five_link(), rj.preset("uniform")]
    tips = np.array([rj.solve_tensions(chain, [3.0, 2.0]).tip for chain in chains])
    reached = rj.reach_batch(chains, tips, (), LIMITS)
    assert reached.ok.all() and reached.equilibrium.mechanism == tuple(chains)
    for row, chain in enumerate(chains):
        again = rj.solve_lengths(chain, reached.lengths[row], tension_limits=LIMITS)
        np.testing.assert_allclose(again.tip, tips[row], atol=1e-6)
