"""The arm's environments: settings, options, goals, infos, vector form and pictures, as users meet them."""

import dataclasses
import pickle

import gymnasium
import numpy as np
import pytest

import rj_gym
from rj_gym import FlexibleArmConfig, FlexibleArmEnv, FlexibleArmGoalEnv, FlexibleArmVectorEnv
from rj_gym.rendering import SIZE
from rollingjoint import Status
from rollingjoint.chain import se3
from rollingjoint.chain.presets import five_link, flexible_arm, small_arm
from rollingjoint.errors import ConfigError, InvalidInput
from tests.rj_gym.rollouts import rollout, same
from tests.rj_gym.watched_solver import watch_solver

SMALL = {"mechanism": "small_arm"}
POSE = se3.pose(se3.rotation([0.2, -0.1, 0.3]), [10.0, -5.0, 70.0])


def test_defaults_are_the_documented_task():
    config = FlexibleArmConfig()
    assert (config.mechanism, config.episode_steps, config.action_scale_mm) == ("flexible_arm", 50, 1.0)
    assert (config.tension_range, config.gravity.tilt, config.load.magnitude) == ((0.5, 15.0), (0.0, 0.5), (0.0, 0.5))
    assert all(value == 0 for value in dataclasses.asdict(config.randomization).values())
    assert rj_gym.settings_of("rj_gym/FlexibleArmGoal-v0") is FlexibleArmConfig


def test_nested_dictionaries_keep_the_defaults_of_the_arm():
    made = FlexibleArmConfig(target={"process": "path"}, reward={"goal": "sparse"}, gravity={"tilt": (0.1, 0.2)})
    assert made == FlexibleArmConfig().updated(
        {"target": {"process": "path"}, "reward": {"goal": "sparse"}, "gravity": {"tilt": [0.1, 0.2]}}
    )
    assert made.target.tension_range == (1.0, 5.0) and made.reward.error_scale_mm == 30.0


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"gravity": {"tlt": (0, 1)}}, "Did you mean 'tilt'"),
        ({"gravity": {"tilt": (0, 4)}}, "3.14"),
        ({"gravity": {"tilt": (0.4, 0.1)}}, "low <= high"),
        ({"load": {"link": "tip"}}, "one of magnitude"),
        ({"load": {"magnitude": (-1, 1)}}, "load.magnitude"),
        ({"load": {"process": "steps"}}, "Did you mean 'step'"),
        ({"orientation": 1}, "true or false"),
        ({"reward": {"angle_scale_rad": 0}}, "angle_scale_rad"),
        ({"randomization": {"weight_spread": 1.0}}, "0.9"),
        ({"randomization": {"link_tolerance_mm": 0.1}}, "one of position_noise_mm"),
        ({"mechanism": five_link()}, "HingeChain"),
        ({"mechanism": 3}, "HingeChain"),
        ({"tension_range": (1.0, 1.0)}, "two different"),
    ],
)
def test_wrong_settings_are_refused_and_say_what_is_allowed(values, words):
    with pytest.raises(ConfigError, match=words):
        FlexibleArmConfig.from_dict(values)


def test_a_planar_chain_is_refused_where_an_arm_is_needed():
    with pytest.raises(ConfigError, match="small_arm"):
        FlexibleArmEnv(mechanism="five_link")
    with pytest.raises(ConfigError, match="a dictionary of settings"):
        FlexibleArmEnv(config=rj_gym.TrackingConfig())


def test_settings_come_as_object_dictionary_or_keywords():
    config = FlexibleArmConfig(episode_steps=7, gravity={"tilt": (0, 0.1)})
    for env in (
        FlexibleArmEnv(config=config, action_scale_mm=0.5),
        FlexibleArmEnv(config={"episode_steps": 7, "gravity": {"tilt": (0, 0.1)}}, action_scale_mm=0.5),
        gymnasium.make(
            "rj_gym/FlexibleArm-v0", episode_steps=7, gravity={"tilt": (0, 0.1)}, action_scale_mm=0.5
        ).unwrapped,
    ):
        assert env.config == config.updated({"action_scale_mm": 0.5})


def test_reward_is_the_sum_of_its_terms_and_info_says_what_happened():
    env = FlexibleArmEnv(orientation=True, load={"magnitude": (0.2, 0.5)})
    _, first = env.reset(seed=4)
    _, reward, _, _, info = env.step(np.full(8, 0.5, np.float32))
    assert type(reward) is float and reward == pytest.approx(sum(info["reward_terms"].values()), rel=1e-14)
    assert set(info["reward_terms"]) == {"tracking", "effort", "smoothness", "failure", "orientation"}
    assert info["error_mm"] == pytest.approx(np.linalg.norm(info["tip"] - info["target"]))
    force, sampled = info["load"]["force"], first["sampled"]
    assert info["load"]["link"] == 32 and np.allclose(np.linalg.norm(force) * info["gravity"], force)
    assert np.array_equal(info["gravity"], sampled["gravity"]) and np.linalg.norm(info["gravity"]) == pytest.approx(1)
    shapes = {name: np.shape(value) for name, value in sampled.items()}
    assert shapes == {
        "mechanism": (),
        "targets": (51, 3),
        "target_rotations": (51, 3, 3),
        "link": (),
        "forces": (51, 3),
        "payloads": (51,),
        "gravity": (3,),
        "start_tensions": (8,),
        "stiffnesses": (8,),
        "hinge_stiffnesses": (32,),
        "weights": (32,),
        "actuator_offsets": (8,),
    }


def test_writing_into_what_was_returned_changes_nothing_inside():
    env, untouched = (FlexibleArmEnv(load={"process": "ou"}, orientation=True, **SMALL) for _ in range(2))
    for observation, *_, info in rollout(env, seed=2, steps=2):
        arrays = [observation, info["load"]["force"], info["gravity"], info["tip"], info["target"], info["tensions"]]
        for array in [*arrays, *(one for one in info.get("sampled", {}).values() if isinstance(one, np.ndarray))]:
            array[...] = 99.0
    rollout(untouched, seed=2, steps=2)
    assert same(env.step(np.ones(4)), untouched.step(np.ones(4)))


def test_options_hold_target_load_gravity_mechanism_and_start_fixed():
    randomised = {"stiffness_spread": 0.3, "weight_spread": 0.3}
    env = FlexibleArmEnv(load={"process": "ou"}, target={"process": "path"}, randomization=randomised, **SMALL)
    arm = small_arm(stiffness=400.0)
    options = {
        "target": (5.0, 10.0, 75.0),
        "load": 0.3,
        "gravity": (1.0, 0.0, 1.0),
        "mechanism": arm,
        "start": (2.0, 4.0, 2.0, 1.0),
    }
    _, info = env.reset(seed=0, options=options)
    sampled = info["sampled"]
    assert np.all(sampled["targets"] == [5.0, 10.0, 75.0]) and np.all(sampled["payloads"] == 0.3)
    assert np.allclose(sampled["gravity"], np.array([1.0, 0.0, 1.0]) / np.sqrt(2))
    assert np.all(sampled["hinge_stiffnesses"] == 400.0) and np.all(sampled["start_tensions"] == options["start"])
    for _ in range(3):
        info = env.step(np.zeros(4, np.float32))[4]
        assert np.all(info["target"] == [5.0, 10.0, 75.0]) and np.allclose(np.linalg.norm(info["load"]["force"]), 0.3)


@pytest.mark.parametrize("orientation", [False, True])
def test_sampled_values_put_back_as_options_repeat_the_episode(orientation):
    settings = {"load": {"process": "step"}, "target": {"process": "path"}, "start": "random"} | SMALL
    env = FlexibleArmEnv(orientation=orientation, **settings)
    first = rollout(env, seed=8)
    sampled = first[0][1]["sampled"]
    target = se3.pose(sampled["target_rotations"], sampled["targets"]) if orientation else sampled["targets"]
    options = {"target": target, "load": sampled["payloads"], "gravity": sampled["gravity"]}
    options["start"] = sampled["start_tensions"]
    again = rollout(env, seed=8, options=options)
    assert np.allclose(again[0][1]["sampled"]["gravity"], sampled["gravity"], atol=1e-15)
    for one, other in zip(first, again, strict=True):
        assert np.allclose(one[0], other[0], atol=1e-5)


@pytest.mark.parametrize(
    "options",
    [
        {"targets": (0, 0, 0)},
        {"target": (0, 0)},
        {"target": "far"},
        {"target": (np.nan, 0, 0)},
        {"target": POSE},
        {"load": -0.1},
        {"load": (0.1, 0.2)},
        {"load": {"link": 4, "force": (0, 0, 1)}},
        {"load": np.inf},
        {"gravity": (0, 0, 0)},
        {"gravity": (0, 1)},
        {"gravity": "down"},
        {"mechanism": "five_link"},
        {"mechanism": "flexible_arm"},
        {"mechanism": 3},
        {"start": (3.0,)},
        {"start": (0.1, 3.0, 3.0, 3.0)},
        [],
    ],
)
def test_bad_reset_options_are_refused_before_anything_changes(options):
    env, untouched = FlexibleArmEnv(**SMALL), FlexibleArmEnv(**SMALL)
    rollout(env, seed=2, steps=3)
    rollout(untouched, seed=2, steps=3)
    with pytest.raises((InvalidInput, ConfigError), match="expected"):
        env.reset(seed=7, options=options)
    assert same(env.step(np.ones(4)), untouched.step(np.ones(4)))
    assert same(env.reset(), untouched.reset())


def test_with_orientation_targets_are_poses():
    env = FlexibleArmEnv(orientation=True, **SMALL)
    _, info = env.reset(seed=0, options={"target": POSE})
    assert np.array_equal(info["target"], POSE[:3, 3])
    assert np.array_equal(info["sampled"]["target_rotations"][0], POSE[:3, :3])
    for wrong in (POSE[:3, 3], POSE * [[1], [1], [1], [2]], POSE * [[-1], [1], [1], [1]], POSE + 1e-3):
        with pytest.raises(InvalidInput, match=r"options\['target'\]"):
            env.reset(options={"target": wrong})


def test_pulling_a_tendon_at_plus_x_bends_to_plus_x():
    env = FlexibleArmEnv(load={"magnitude": (0, 0)}, gravity={"tilt": (0, 0)})
    _, start = env.reset(seed=0)
    action = np.array([1, 0, -1, 0, 0, 0, 0, 0], np.float32)
    for _ in range(4):
        *_, bent = env.step(action)
    assert np.allclose(start["tip"], (0, 0, 700), atol=1e-6) and bent["tip"][0] > 20 and abs(bent["tip"][1]) < 2


def test_hidden_gravity_and_payload_change_the_error_and_nothing_that_is_observed_says_so():
    names = [entry.name for entry in rj_gym.arm_observation_entries(FlexibleArmConfig(), flexible_arm())]
    assert not any("gravity" in name or "payload" in name for name in names)
    env = FlexibleArmEnv()
    tips = {}
    for name, options in {
        "neither": {"gravity": (0, 0, 1), "load": 0.0},
        "gravity": {"gravity": (0.5, 0, 1), "load": 0.0},
        "both": {"gravity": (0.5, 0, 1), "load": 0.5},
    }.items():
        env.reset(seed=0, options=options)
        for _ in range(5):
            tips[name] = env.step(np.array([0.5, -0.5, -0.5, 0.5] * 2, np.float32))[4]["tip"]
    assert np.linalg.norm(tips["gravity"] - tips["neither"]) > 50
    assert np.linalg.norm(tips["both"] - tips["gravity"]) > 2


def test_a_failed_solve_ends_the_episode_with_status_penalty_and_last_good_observation():
    env = FlexibleArmEnv(reward={"failure_penalty": 7.0}, **SMALL)
    rollout(env, seed=0, steps=2)
    before = env.step(np.zeros(4))
    watch_solver(env._buffer, after=lambda: env._buffer.solver.results.status.fill(Status.NOT_CONVERGED))
    observation, reward, terminated, truncated, info = env.step(np.ones(4))
    assert (terminated, truncated, info["status"]) == (True, False, "NOT_CONVERGED") and reward < -7.0
    assert np.array_equal(observation, before[0])
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(4))


def test_random_actions_do_not_end_episodes():
    env = FlexibleArmVectorEnv(100, autoreset_mode="Disabled")
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(50):
        _, _, terminated, truncated, infos = env.step(rng.uniform(-1, 1, (100, 8)))
        assert not terminated.any() and np.all(infos["status"] == "CONVERGED")
    assert truncated.all()


@pytest.mark.parametrize("orientation", [False, True])
@pytest.mark.parametrize("goal", ["dense", "sparse"])
def test_goal_reward_of_a_batch_equals_the_scalar_to_the_last_bit(goal, orientation):
    env = FlexibleArmGoalEnv(orientation=orientation, reward={"goal": goal, "goal_tolerance_mm": 60.0}, **SMALL)
    rng = np.random.default_rng(0)
    turns = se3.rotation(rng.uniform(-1, 1, (2, 400, 3)))
    frames = np.swapaxes(turns, 2, 3).reshape(2, 400, 9)[..., :6]
    achieved, desired = np.concatenate([rng.uniform(-1, 1, (2, 400, 3)), frames], axis=-1).astype(np.float32)
    desired[:100] = achieved[:100]
    desired[50:100, :3] += rng.uniform(-0.5, 0.5, (50, 3)).astype(np.float32)
    size = 9 if orientation else 3
    achieved, desired = achieved[:, :size], desired[:, :size]
    batch = env.compute_reward(achieved, desired, [{}] * 400)
    assert batch.shape == (400,)
    assert [env.compute_reward(*pair, {}) for pair in zip(achieved, desired, strict=True)] == batch.tolist()
    if goal == "sparse":
        assert set(batch.tolist()) == {0.0, -1.0}


def test_goals_are_poses_of_tip_and_target_and_success_needs_both_errors():
    settings = {"orientation": True, "reward": {"goal_tolerance_mm": 1e4, "goal_tolerance_rad": 1e-3}} | SMALL
    env = FlexibleArmGoalEnv(**settings)
    observation, info = env.reset(seed=1, options={"target": POSE})
    assert np.allclose(observation["desired_goal"][:3] * 80, POSE[:3, 3], atol=1e-4)
    assert np.allclose(observation["desired_goal"][3:], POSE[:3, :2].T.ravel(), atol=1e-6)
    assert np.allclose(observation["achieved_goal"][:3] * 80, info["tip"], atol=1e-4)
    observation, reward, *_, info = env.step(np.zeros(4, np.float32))
    assert reward == env.compute_reward(observation["achieved_goal"], observation["desired_goal"], {})
    assert reward == pytest.approx(-info["error_mm"] / 30 - info["angle_error_rad"] / 0.3, abs=1e-5)
    assert info["is_success"] is False and info["angle_error_rad"] > 0.1
    env = FlexibleArmGoalEnv(**(settings | {"orientation": False}))
    env.reset(seed=1)
    assert env.step(np.zeros(4, np.float32))[4]["is_success"] is True


def test_a_masked_reset_leaves_the_other_lanes_alone():
    randomised = {"weight_spread": 0.3, "hinge_stiffness_spread": 0.2}
    env = FlexibleArmVectorEnv(3, autoreset_mode="Disabled", episode_steps=4, randomization=randomised, **SMALL)
    env.reset(seed=0)
    before = env.step(np.zeros((3, 4)))[0]
    options = {"reset_mask": np.array([False, True, False]), "load": 0.0, "gravity": (0.3, 0, 1)}
    after, infos = env.reset(options=options)
    assert np.array_equal(before[[0, 2]], after[[0, 2]]) and not np.array_equal(before[1], after[1])
    assert infos["_sampled"].tolist() == [False, True, False] and np.all(infos["load"]["force"][1] == 0)
    assert infos["sampled"]["weights"].shape == (3, 4)


def test_invalid_actions_of_a_batch_change_nothing():
    env, untouched = FlexibleArmVectorEnv(3, **SMALL), FlexibleArmVectorEnv(3, **SMALL)
    env.reset(seed=0), untouched.reset(seed=0)
    for actions in (np.zeros((2, 4)), np.full((3, 4), np.nan), "push", np.zeros((3, 3))):
        with pytest.raises(InvalidInput, match=r"\(3, 4\)"):
            env.step(actions)
    assert np.array_equal(env.step(np.ones((3, 4)))[0], untouched.step(np.ones((3, 4)))[0])


def frame(env, steps=5, **reset):
    env.reset(seed=0, **reset)
    for _ in range(steps):
        env.step(np.resize([0.5, -0.5], env.action_space.shape))
    return env.render()


@pytest.mark.parametrize("settings", [{}, {"orientation": True, "target": {"process": "path"}} | SMALL])
def test_a_picture_has_the_stated_size_and_shows_something(settings):
    env = FlexibleArmEnv(render_mode="rgb_array", **settings)
    picture = frame(env)
    assert picture.shape == (SIZE[1], SIZE[0], 3) and picture.dtype == np.uint8
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 100
    assert 0.5 < np.all(picture == picture[-1, -1], axis=-1).mean() < 0.95
    assert np.array_equal(picture, env.render()) and not np.array_equal(picture, frame(env, steps=6))


def test_a_hanging_arm_points_down_in_the_picture_and_only_a_payload_has_an_arrow():
    def orange(picture):
        red, green, blue = picture[150:].astype(int).transpose(2, 0, 1)  # below the captions
        return np.count_nonzero((red > 200) & (abs(green - 108) < 25) & (blue < 60))

    env = FlexibleArmEnv(render_mode="rgb_array")
    still = {"options": {"gravity": (0, 0, 1), "load": 0.0, "target": (200.0, 0.0, 600.0)}}
    picture = frame(env, steps=0, **still)
    beads = np.argwhere(np.abs(picture[:, :440].astype(int) - (70, 130, 200)).sum(axis=-1) < 60)  # slack tendons: blue
    assert beads[:, 0].min() < 0.2 * SIZE[1] and beads[:, 0].max() > 0.65 * SIZE[1]
    assert np.ptp(beads[:, 1]) < 0.15 * SIZE[0]
    assert orange(picture) == 0 and orange(frame(env, options={"load": 0.5})) > 100


def test_pictures_of_chosen_lanes_equal_those_of_scalar_environments():
    env = FlexibleArmVectorEnv(3, render_mode="rgb_array", render_lanes=[2])
    scalar = FlexibleArmEnv(render_mode="rgb_array")
    env.reset(seed=4)
    scalar.reset(seed=6)
    for action in (np.full(8, 0.3), np.resize([1.0, -1.0], 8)):
        env.step([action] * 3)
        scalar.step(action)
    (picture,) = env.render()
    assert np.array_equal(picture, scalar.render())
    assert np.array_equal(pickle.loads(pickle.dumps(env)).render()[0], picture)
