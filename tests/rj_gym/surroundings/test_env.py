"""The environments among walls: checkers, scalar and vector alike, contact, success, states, what is refused."""

import copy
import pickle
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import rj_gym
from agents.controllers.among_walls import Feedback, FollowTheLeader, FreeSpacePlan, SearchedWay, Still
from agents.runs.state_file import packed, unpacked
from rj_gym.surroundings import drawing
from rj_gym.surroundings import task as tasks
from rollingjoint import ConfigError, Disc, HalfPlane, InvalidInput, Lumen, solve_lengths
from rollingjoint.chain.status import Status
from tests.rj_gym.rollouts import same

IDS = tuple(rj_gym.SURROUNDINGS_IDS)
LUMEN = "rj_gym/Lumen-v0"
every = pytest.mark.parametrize("env_id", IDS)
VARIANTS = {
    "ahead, noise": {"walls": "ahead", "noise": {"position_mm": 0.2, "angle": 0.01, "tension": 0.1, "force": 0.1}},
    "families": {"families": list(rj_gym.FAMILIES), "poses": "tip"},
    "no friction": {"mu": 0.0, "poses": "none"},
}


def made(env_id, lanes=None, **settings):
    if lanes is None:
        return gymnasium.make(env_id, **settings).unwrapped
    return gymnasium.make_vec(env_id, lanes, "vector_entry_point", **settings)


@pytest.fixture
def drawn_at_once(monkeypatch):
    """Scenes of the tasks that search for theirs are a few random numbers: for tests of everything else."""

    def discs(task, rngs, fixed):
        return [disc_scene(task, rng.uniform(-20.0, 20.0, 2)) for rng in rngs]

    def disc_scene(task, at):
        others = [Disc((60.0 + at[0], 20.0 + at[1] + 100.0 * k), 4.0, stiffness=2.0) for k in range(task.config.discs)]
        return drawing._scene_of_discs(task.config, others, np.add(at, (0.0, 70.0)), task.rest, task.rest)

    def wall(task, rngs, fixed):
        return [wall_scene(task, rng.uniform(25.0, 40.0)) for rng in rngs]

    def wall_scene(task, away):
        plane = HalfPlane((-1.0, 0.0), -away, stiffness=2.0)
        return drawing._scene_of_a_wall(task.config, plane, np.array([away, 40.0]), task.rest)

    monkeypatch.setattr(tasks, "scenes_among_discs", discs)
    monkeypatch.setattr(tasks, "scenes_at_a_wall", wall)


def actions_for(envs, count, seed=0):
    rng = np.random.default_rng(seed)
    return [rng.uniform(-1, 1, envs.action_space.shape).astype(np.float32) for _ in range(count)]


def into_the_lumen(envs, steps=25):
    """Feed and little else: presses on the wall."""
    action = np.zeros(envs.action_space.shape)
    action[..., -1] = 1.0
    return [envs.step(action) for _ in range(steps)]


@every
def test_gymnasium_and_stable_baselines_checkers_pass_without_a_warning(env_id, drawn_at_once):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", ".* is out of date", DeprecationWarning)  # both versions are maintained
        check_env(made(env_id))
        checker.check_env(made(env_id))


@pytest.mark.slow
@every
def test_the_vector_environment_passes_every_check(env_id, drawn_at_once):
    settings = {"episode_steps": 2}

    def make_env(autoreset_mode="SameStep"):
        return made(env_id, 2, render_mode="rgb_array", autoreset_mode=autoreset_mode, **settings)

    report = rj_gym.check_vector_env(make_env, n_steps=3, max_episode_steps=2, scalar=lambda: made(env_id, **settings))
    assert "equals_scalar_infos" in {outcome.check for outcome in report.passed}
    assert not report.skipped


@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("name", VARIANTS)
def test_lanes_equal_scalar_environments(name, mode):
    settings = VARIANTS[name] | {"episode_steps": 5}
    native = made(LUMEN, 3, autoreset_mode=mode, **settings)
    scalar = SyncVectorEnv([lambda: made(LUMEN, **settings)] * 3, autoreset_mode=mode)
    assert same(native.reset(seed=3), scalar.reset(seed=3))
    for actions in actions_for(native, 8):
        one, other = native.step(actions), scalar.step(actions)
        assert same(one, other)
        ended = one[3].copy()
        if mode is AutoresetMode.DISABLED and ended.any():
            options = {"reset_mask": ended, "depth": 50.0}
            assert same(native.reset(options=dict(options)), scalar.reset(options=dict(options)))


def test_a_masked_reset_leaves_the_other_lanes_alone_with_their_memory():
    first, second = (made(LUMEN, 3, autoreset_mode="Disabled") for _ in range(2))
    for envs in (first, second):
        envs.reset(seed=0)
        into_the_lumen(envs)
    before = first.step(np.zeros((3, 5)))
    second.step(np.zeros((3, 5)))
    after, infos = first.reset(options={"reset_mask": np.array([False, True, False])})
    assert np.array_equal(after[[0, 2]], before[0][[0, 2]])
    assert infos["peak_wall_force"][1] == 0.0
    for actions in actions_for(first, 4):
        one, other = first.step(actions), second.step(actions)
        assert np.array_equal(one[0][[0, 2]], other[0][[0, 2]]) and not np.array_equal(one[0][1], other[0][1])


def test_a_state_goes_on_to_the_last_bit():
    first, second = (made(LUMEN, 3, episode_steps=40, **VARIANTS["ahead, noise"]) for _ in range(2))
    first.reset(seed=5)
    into_the_lumen(first, 20)
    first.reset(options={"reset_mask": np.array([True, False, False])})
    into_the_lumen(first, 3)
    state = unpacked(packed(first.get_state()), "state")
    expected = [first.step(actions) for actions in actions_for(first, 30)]
    second.set_state(state)
    assert same([second.step(actions) for actions in actions_for(second, 30)], expected)
    twin = pickle.loads(pickle.dumps(second))
    assert same(twin.step(np.zeros((3, 5))), second.step(np.zeros((3, 5))))


@pytest.mark.parametrize(
    ("name", "change"),
    {
        "no number": ("solution.joint_angles", lambda a: a * np.nan),
        "another link": ("walls.points", lambda a: a + 1.0),
        "another lumen": ("walls.pieces", lambda a: a + 1.0),
        "half a step": ("readings", lambda a: a + 0.5),
        "a lane less": ("target", lambda a: a[1:]),
    }.values(),
)
def test_other_states_are_refused_and_change_nothing(name, change):
    envs = made(LUMEN, 2)
    envs.reset(seed=1)
    kept = envs.get_state()
    state = copy.deepcopy(kept)
    state["episodes"][name] = change(state["episodes"][name])
    with pytest.raises(InvalidInput, match="state: "):
        envs.set_state(state)
    assert same(envs.get_state(), kept)


def test_an_instrument_in_a_lumen_is_where_the_solver_has_it():
    env = made(LUMEN, mu=0.0)
    env.reset(seed=4)
    *_, info = into_the_lumen(env)[-1]
    surroundings = env.task.surroundings(env.task._scenes([gymnasium.utils.seeding.np_random(4)[0]], {})[0].walls, 0.0)
    pose = None
    for feed in range(0, 52, 2):
        pose = solve_lengths(
            env.task.mechanism,
            env.task.rest,
            start=pose,
            surroundings=surroundings,
            base=(0, feed, 0),
            tension_limits=(0.5, 15.0),
        )
    assert np.allclose(pose.poses[:, 0], info["poses"][:, 0], atol=1e-9)
    assert np.allclose(pose.poses[:, 1] + 50.0, info["poses"][:, 1], atol=1e-9)
    assert info["wall_force"] == pytest.approx(max(touch.force for touch in pose.wall_contacts))
    assert info["insertion_force"] == pytest.approx(pose.insertion_force)


def test_forces_peaks_ways_and_rewards_are_what_they_say():
    env = made(LUMEN)
    _, start = env.reset(seed=2)
    rows = into_the_lumen(env, 40)
    infos = [start, *(row[-1] for row in rows)]
    forces = [info["wall_force"] for info in infos]
    assert [info["peak_wall_force"] for info in infos] == list(np.maximum.accumulate(forces))
    assert max(forces) > 1.0
    assert infos[-1]["feed"] == 75.0 and start["path_ratio"] == 0.0
    for _, reward, _, _, info in rows:
        terms = info["reward_terms"]
        assert reward == pytest.approx(sum(terms.values()))
        assert terms["force"] == pytest.approx(-0.3 * max(0.0, info["wall_force"] - 0.2))
        assert info["error_mm"] == pytest.approx(np.hypot(*(info["tip"] - info["target"])))
        assert info["success"] == (info["error_mm"] <= 3.0 and info["peak_wall_force"] <= 2.0)
    ways = [-20.0 * row[-1]["reward_terms"]["tracking"] for row in rows]
    gained = [row[-1]["reward_terms"]["progress"] / 0.5 for row in rows[1:]]
    assert np.allclose(-np.diff(ways), gained)
    # the first way is along the centre line from the tip at rest, 10 mm before the bend
    assert ways[0] + rows[0][-1]["reward_terms"]["progress"] / 0.5 == pytest.approx(
        10 + start["sampled"]["depth"], abs=0.01
    )


def test_a_command_follows_its_tendon_at_a_limit():
    env = made(LUMEN)
    env.reset(seed=0)
    for _ in range(20):
        *_, info = env.step([1, 1, 1, 1, 0])
    assert info["tensions"].max() == pytest.approx(15.0)
    *_, info = env.step([-0.2, -0.2, -0.2, -0.2, 0])
    assert info["tensions"].max() < 15.0  # at once, not after 17 mm


@every
def test_the_tip_starts_free_and_random_actions_never_crash(env_id, drawn_at_once):
    envs = made(env_id, 16, episode_steps=20)
    _, infos = envs.reset(seed=0)
    assert not infos["wall_force"].any() and not infos["success"].any()
    for actions in actions_for(envs, 45, seed=1):
        observations, rewards, *_ = envs.step(3.0 * actions)
        assert envs.observation_space.contains(observations) and np.isfinite(rewards).all()


def test_a_step_without_a_pose_ends_the_episode_where_it_was(monkeypatch):
    env = made(LUMEN)
    env.reset(seed=0)
    *_, before = into_the_lumen(env, 10)[-1]
    solve = env.task.solve

    def failing(*arguments):
        solution = solve(*arguments)
        codes = np.full_like(solution.status, int(Status.NOT_CONVERGED))
        object.__setattr__(solution, "status", codes)
        return solution

    monkeypatch.setattr(env.task, "solve", failing)
    _, reward, terminated, truncated, info = env.step(np.ones(5))
    assert terminated and not truncated and reward < -100.0
    assert info["status"] == "NOT_CONVERGED" and not info["success"]
    assert np.array_equal(info["poses"], before["poses"]) and info["feed"] == before["feed"]
    monkeypatch.undo()
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(5))


@pytest.mark.slow
@every
def test_targets_can_be_reached_which_is_the_floor(env_id):
    if env_id == LUMEN:
        envs = made(env_id, 12)
        _, infos = envs.reset(seed=9_100_000)
        controller = FollowTheLeader()
        controller.begin(envs, infos)
        for _ in range(60):
            *_, infos = envs.step(controller.act(envs))
        assert infos["success"].all()
        return
    envs, controller = made(env_id, 3), SearchedWay()
    _, infos = envs.reset(seed=17)
    controller.begin(envs, infos)
    for _ in range(60):
        *_, infos = envs.step(controller.act(envs))
    assert infos["success"].all() and infos["error_mm"].max() < 1.0


DRAWN = {  # with the seed 17: the target, and the middle and radius of the first disc of two [mm]
    "rj_gym/Obstacles-v0": ((33.167793, 56.032501), (13.078953, 77.974354, 3.335065)),
    "rj_gym/Obstacles-v1": ((20.897378, 65.464145), (9.061286, 81.062531, 3.335065)),
}


@pytest.mark.parametrize("env_id", DRAWN)
def test_an_obstacle_is_between_the_tip_and_the_target_where_it_always_was(env_id):
    envs = made(env_id, 3)
    _, infos = envs.reset(seed=17)  # drawn fast
    _, info = made(env_id).reset(seed=19)
    assert np.array_equal(info["target"], infos["target"][2]) and np.array_equal(info["poses"], infos["poses"][2])
    disc = envs._buffer.scenes.walls.discs[:, 0]
    begin, way = infos["tip"], infos["target"] - infos["tip"]
    share = ((disc[:, :2] - begin) * way).sum(1) / np.square(way).sum(1)
    beside = np.hypot(*(disc[:, :2] - begin - share[:, None] * way).T)
    assert (np.hypot(*way.T) >= 25.0).all() and ((share > 0.1) & (share < 0.9)).all() and (beside < 12.0).all()
    target, first = DRAWN[env_id]
    assert infos["target"][0] == pytest.approx(target, abs=1e-4) and disc[0, :3] == pytest.approx(first, abs=1e-4)


def test_a_fine_search_finds_ways_that_are_passable(monkeypatch):
    found, reached = [], drawing._reached
    monkeypatch.setattr(drawing, "_reached", lambda *given: found.append(reached(*given)) or found[-1])
    made("rj_gym/Obstacles-v1", 12).reset(seed=30)
    outcomes = [each for one in found for each in one]
    assert sum(outcomes) >= 12 and np.mean(outcomes) > 0.9


def test_poses_between_poses_are_on_straight_lines():
    poses = np.array([0.0, 4.0, 8.0, 0.0])[:, None] + [0.0, 100.0]
    closer = drawing.between(poses, 4)
    assert closer.shape == (13, 2) and list(closer[:, 1] - 100.0) == [0, 1, 2, 3, 4, 5, 6, 7, 8, 6, 4, 2, 0]


def test_opponents_do_as_well_as_they_know():
    success, force = {}, {}
    for controller in (Still(), FreeSpacePlan(), Feedback(aware=False), Feedback(aware=True)):
        envs = made(LUMEN, 24)
        _, infos = envs.reset(seed=9_100_000)
        controller.begin(envs, infos)
        for _ in range(60):
            *_, infos = envs.step(controller.act(envs))
        name = type(controller).__name__ + str(getattr(controller, "aware", ""))
        success[name], force[name] = infos["success"].mean(), infos["peak_wall_force"].mean()
    assert success["Still"] == 0.0 and success["FreeSpacePlan"] < 0.2
    assert success["FeedbackFalse"] < success["FeedbackTrue"] > 0.5


def test_rates_with_contact_are_differences_of_steps():
    """Without friction, inside the limits of tensions, the answer of a small action is that of the rates."""
    big = made(LUMEN, 1, mu=0.0)
    big.reset(seed=6)
    into_the_lumen(big, 22)
    response = big.unwrapped.tangent()
    fine = gymnasium.make_vec(LUMEN, 1, "vector_entry_point", mu=0.0, action_scale_mm=1e-4, feed_scale_mm=1e-4)
    fine.reset(seed=6)
    fine.set_state(big.get_state())
    for entry in range(5):
        moves = []
        for sign in (1.0, -1.0):
            fine.set_state(big.get_state())
            action = np.zeros((1, 5))
            action[0, entry] = sign
            moves.append(fine.step(action)[-1]["poses"][0])
        difference = (moves[0] - moves[1]) / 2e-4
        wanted = response.pose_rates[0, ..., entry] * (0.5 if entry == 4 else 1.0)
        assert np.allclose(difference, wanted, atol=1e-3 * np.abs(wanted).max()), entry


@pytest.mark.parametrize(
    ("settings", "match"),
    [
        ({"families": ["wide"]}, "families"),
        ({"families": []}, "families"),
        ({"radius": 4.0}, "radius"),
        ({"radius": 4.5}, "sleeve"),
        ({"walls": "seen"}, "walls"),
        ({"poses": "some"}, "poses"),
        ({"noise": {"angle": -1}}, "noise.angle"),
        ({"feed_range": (5, 1)}, "feed_range"),
        ({"feed_range": (0, 0)}, "feed_range"),
        ({"feed_range": (10, 75)}, "feed_range.*from 0"),
        ({"mechanism": 5}, "mechanism"),
    ],
)
def test_other_settings_are_refused(settings, match):
    with pytest.raises(ConfigError, match=match):
        made(LUMEN, **settings)


@pytest.mark.parametrize(
    ("env_id", "options"),
    [
        (LUMEN, {"lumen": 3}),
        (LUMEN, {"depth": -1.0}),
        (LUMEN, {"depth": 300.0}),
        (LUMEN, {"target": (0, 1)}),
        ("rj_gym/HiddenWall-v0", {"wall": Disc((0, 0), 1)}),
        ("rj_gym/HiddenWall-v0", {"target": (0, np.nan), "wall": HalfPlane((1, 0), -60.0)}),
        ("rj_gym/HiddenWall-v0", {"target": (0, 50)}),
        ("rj_gym/Obstacles-v0", {"discs": [Disc((0, 0), 1)]}),
    ],
)
def test_other_options_are_refused_and_change_nothing(env_id, options):
    env = made(env_id)
    with pytest.raises(InvalidInput):
        env.reset(seed=1, options=options)
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(env.action_space.shape))


def test_options_fix_lumens_walls_and_targets():
    lumen = Lumen([110, 30, 60], [0, 0.02, 0], 7.0, (0, -10, np.pi / 2), stiffness=3.0)
    _, info = made(LUMEN).reset(seed=0, options={"lumen": lumen, "depth": 50.0})
    assert np.allclose(info["target"], lumen.pose(160.0)[:2])
    assert info["sampled"]["radius"] == 7.0 and info["sampled"]["stiffness"] == 3.0
    wall = HalfPlane((1, 0), -60.0)
    _, info = made("rj_gym/HiddenWall-v0").reset(seed=0, options={"wall": wall, "target": (-40.0, 60.0)})
    assert list(info["target"]) == [-40.0, 60.0]
    discs = [Disc((40, 60), 5.0), Disc((-40, 60), 5.0)]
    _, info = made("rj_gym/Obstacles-v0").reset(seed=0, options={"discs": discs, "target": (20.0, 70.0)})
    assert list(info["target"]) == [20.0, 70.0]


@every
def test_nan_actions_are_refused_and_change_nothing(env_id, drawn_at_once):
    envs = [made(env_id) for _ in range(2)]
    for env in envs:
        env.reset(seed=1)
    bad = np.zeros(envs[0].action_space.shape)
    bad[0] = np.nan
    with pytest.raises(InvalidInput, match="finite"):
        envs[0].step(bad)
    action = np.full(bad.shape, 0.3)
    assert same(envs[0].step(action), envs[1].step(action))


def test_noise_is_in_observations_alone():
    noisy, exact = made(LUMEN, noise={"position_mm": 0.5}), made(LUMEN)
    (seen, told), (true, also) = noisy.reset(seed=3), exact.reset(seed=3)
    assert np.array_equal(told["poses"], also["poses"])
    names = [entry.name for entry in rj_gym.surroundings_observation_entries(exact.config)]
    places = [names.index(f"link {k} {axis}") for k in range(1, 9) for axis in "xy"]
    errors = 90.0 * (seen - true)[places]
    assert 0.2 < errors.std() < 1.0
    assert np.array_equal(seen[names.index("tendon 0 command")], true[names.index("tendon 0 command")])


@every
def test_pictures_show_walls(env_id, drawn_at_once):
    env = made(env_id, render_mode="rgb_array")
    env.reset(seed=3)
    picture = env.render()
    assert picture.shape == (600, 720, 3)
    tissue = np.abs(picture.astype(int) - (226, 178, 172)).sum(-1) < 12
    assert tissue.mean() > 0.001
