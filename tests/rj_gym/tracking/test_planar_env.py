"""The scalar environments against both checkers, and what Gymnasium and users rely on."""

import pickle
import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

import rj_gym
from rj_gym import IDS, RollingJointEnv, RollingJointGoalEnv
from rollingjoint.chain.presets import five_link, flexible_arm
from rollingjoint.chain.status import Status
from rollingjoint.errors import ConfigError, InvalidInput
from tests.rj_gym.rollouts import rollout, same
from tests.rj_gym.watched_solver import watch_solver

ROOT = Path(__file__).resolve().parents[3]
RANDOMISED = {
    "position_noise_mm": 0.5,
    "angle_noise_rad": 0.02,
    "stiffness_spread": 0.3,
    "link_tolerance_mm": 0.1,
    "link_tolerance_rad": 0.01,
    "actuator_offset_mm": 0.5,
}
VARIANTS = {
    "default": {},
    "two_segment": {"mechanism": "two_segment"},
    "loads seen": {"observe_load": True, "observe_tensions": False, "load": {"link": "tip", "process": "step"}},
    "path and ou": {"target": {"process": "path"}, "load": {"process": "ou", "magnitude": (0, 1.5)}},
    "no load, random start": {"load": {"magnitude": (0, 0)}, "observe_load": True, "start": "random"},
    "randomised": {"randomization": RANDOMISED},
    "sparse goal": {"reward": {"goal": "sparse"}},
    "two steps": {"episode_steps": 2},
}
ARM_RANDOMISED = {
    "position_noise_mm": 2.0,
    "angle_noise_rad": 0.02,
    "stiffness_spread": 0.3,
    "hinge_stiffness_spread": 0.2,
    "weight_spread": 0.2,
    "actuator_offset_mm": 0.5,
}
ARM_VARIANTS = {
    "default": {},
    "small arm, orientation": {"mechanism": "small_arm", "orientation": True},
    "loads seen": {"observe_load": True, "observe_tensions": False, "load": {"process": "step"}},
    "path and ou": {"target": {"process": "path"}, "load": {"process": "ou"}, "orientation": True},
    "no load, random start": {"load": {"magnitude": (0, 0)}, "observe_load": True, "start": "random"},
    "randomised": {"randomization": ARM_RANDOMISED, "orientation": True},
    "sparse goal": {"reward": {"goal": "sparse"}, "orientation": True},
    "two steps": {"episode_steps": 2},
}
SPATIAL_VARIANTS = ARM_VARIANTS | {"small arm, orientation": {"mechanism": "pitch_yaw", "orientation": True}}
ids = pytest.mark.parametrize("env_id", IDS)


def variants_of(env_id):
    if "PitchYaw" in env_id:
        return SPATIAL_VARIANTS
    return ARM_VARIANTS if "Arm" in env_id else VARIANTS


CASES = {
    f"{env_id[7:-3]}, {name}": (env_id, settings) for env_id in IDS for name, settings in variants_of(env_id).items()
}
variants = pytest.mark.parametrize(("env_id", "settings"), CASES.values(), ids=CASES.keys())


def make(env_id="rj_gym/RollingJoint-v0", **settings):
    return gymnasium.make(env_id, **settings)


def passes_checker(env_id, settings, renders):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(make(env_id, **settings).unwrapped, skip_render_check=not renders)


@variants
def test_gymnasium_checker_passes_without_a_warning(env_id, settings):
    passes_checker(env_id, settings, renders=not settings)


@pytest.mark.slow
@pytest.mark.parametrize(("env_id", "settings"), [case for case in CASES.values() if case[1]])
def test_gymnasium_checker_passes_with_pictures_of_every_variant(env_id, settings):
    passes_checker(env_id, settings, renders=True)


@variants
def test_stable_baselines_checker_passes_without_a_warning(env_id, settings):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(make(env_id, **settings).unwrapped)


def test_registration_can_be_repeated_and_leaves_truncation_to_the_environment():
    rj_gym.register_envs()
    for env_id in IDS:
        assert gymnasium.spec(env_id).max_episode_steps is None


def test_the_spec_tells_how_long_episodes_are_to_wrappers_that_ask():
    from gymnasium.wrappers import TimeAwareObservation

    env = TimeAwareObservation(make(episode_steps=4), flatten=True, normalize_time=True)
    assert env.spec.max_episode_steps == 4
    env.reset(seed=0)
    ends = [env.step(env.action_space.sample())[0][-1] for _ in range(4)]
    assert ends == [0.25, 0.5, 0.75, 1.0]
    lanes = gymnasium.make_vec("rj_gym/RollingJoint-v0", 2, "vector_entry_point", episode_steps=4)
    assert lanes.spec.max_episode_steps == 4
    again = gymnasium.make(make(episode_steps=3).spec)
    assert again.unwrapped.config.episode_steps == 3


@variants
def test_same_seed_gives_the_same_rollout_also_after_other_episodes(env_id, settings):
    settings = settings | {"episode_steps": 12}
    first, second = make(env_id, **settings), make(env_id, **settings)
    rollout(second, seed=99, steps=7)
    assert same(rollout(first, seed=5), rollout(second, seed=5))
    assert same(rollout(first, seed=5), rollout(second, seed=5))


def test_unseeded_episodes_differ():
    env = make()
    assert not same(env.reset(seed=1), env.reset())


def test_writing_into_what_was_returned_changes_nothing_inside():
    env, untouched = make(load={"process": "ou"}).unwrapped, make(load={"process": "ou"}).unwrapped
    for observation, *_, info in rollout(env, seed=2, steps=2):
        arrays = [observation, info["load"]["force"], *(info[key] for key in ("tip", "target", "tensions", "command"))]
        arrays += [value for value in info.get("sampled", {}).values() if isinstance(value, np.ndarray)]
        for array in arrays:
            array[...] = 99.0
    rollout(untouched, seed=2, steps=2)
    assert same(env.step(np.ones(2)), untouched.step(np.ones(2)))


@ids
def test_a_pickled_environment_goes_on_where_it_was(env_id):
    randomised = RANDOMISED if variants_of(env_id) is VARIANTS else ARM_RANDOMISED
    env = make(env_id, render_mode="rgb_array", randomization=randomised)
    rollout(env, seed=3, steps=4)
    picture = env.render()
    copy = pickle.loads(pickle.dumps(env))
    assert np.array_equal(copy.render(), picture)
    action = np.resize(np.array([0.3, -0.8], np.float32), env.action_space.shape)
    assert same(env.step(action), copy.step(action))
    assert same(env.reset(), copy.reset())


def test_the_environment_truncates_by_itself_and_then_wants_a_reset():
    env = make(episode_steps=3).unwrapped
    env.reset(seed=0)
    ends = [env.step(np.zeros(2))[2:4] for _ in range(3)]
    assert ends == [(False, False), (False, False), (False, True)]
    with pytest.raises(ResetNeeded, match="reset"):
        env.step(np.zeros(2))


def test_stepping_or_drawing_before_the_first_reset_is_refused():
    env = RollingJointEnv(render_mode="rgb_array")
    with pytest.raises(ResetNeeded, match="reset"):
        env.step(np.zeros(2))
    with pytest.raises(ResetNeeded, match="reset"):
        env.render()


@pytest.mark.parametrize(
    "action", [[np.nan, 0.0], [np.inf, 0.0], [0.1], [0.1, 0.2, 0.3], 0.3, [[0.1, 0.2]], "up", [None, 1.0]]
)
def test_an_invalid_action_is_refused_before_anything_changes(action):
    env, untouched = make().unwrapped, make().unwrapped
    rollout(env, seed=2, steps=3)
    rollout(untouched, seed=2, steps=3)
    with pytest.raises(InvalidInput, match=r"action = .*expected 2"):
        env.step(action)
    assert same(env.step(np.ones(2)), untouched.step(np.ones(2)))


def test_reward_is_the_sum_of_its_terms_and_info_says_what_happened():
    env = make(load={"magnitude": (0.5, 1.0)})
    env.reset(seed=4)
    _, reward, _, _, info = env.step(np.array([0.5, -0.5], np.float32))
    assert type(reward) is float and reward == sum(info["reward_terms"].values())
    assert all(type(value) is float for value in info["reward_terms"].values())
    assert info["reward_terms"].keys() == {"tracking", "effort", "smoothness", "failure"}
    assert info["status"] in Status.__members__
    assert info["error_mm"] == pytest.approx(np.linalg.norm(info["tip"] - info["target"]))
    assert 0.5 <= np.linalg.norm(info["load"]["force"]) <= 1.0 and 1 <= info["load"]["link"] <= 4
    assert info["tensions"].shape == info["command"].shape == (2,)


def test_options_hold_target_load_mechanism_and_start_fixed():
    env = make(load={"process": "ou"}, target={"process": "path"}, randomization=RANDOMISED)
    chain = five_link(stiffness=2.0)
    options = {
        "target": (-20.0, 70.0),
        "load": {"link": -1, "force": (0.3, -0.2)},
        "mechanism": chain,
        "start": (2.0, 4.0),
    }
    _, info = env.reset(seed=0, options=options)
    sampled = info["sampled"]
    assert np.all(sampled["targets"] == [-20.0, 70.0]) and np.all(sampled["forces"] == [0.3, -0.2])
    assert sampled["link"] == 4 and np.all(sampled["stiffnesses"] == 2.0) and not sampled["surface_offsets"].any()
    assert np.all(sampled["start_tensions"] == [2.0, 4.0])
    for _ in range(3):
        info = env.step(np.zeros(2, np.float32))[4]
        assert np.all(info["target"] == [-20.0, 70.0]) and np.all(info["load"]["force"] == [0.3, -0.2])


def test_sampled_values_put_back_as_options_repeat_the_episode():
    env = make(load={"process": "step"}, target={"process": "path"}, start="random")
    first = rollout(env, seed=8)
    sampled = first[0][1]["sampled"]
    options = {
        "target": sampled["targets"],
        "load": {"link": sampled["link"], "force": sampled["forces"]},
        "start": sampled["start_tensions"],
    }
    env.reset(seed=1234)
    rng = np.random.default_rng(8)
    again = [env.reset(options=options)]
    again += [env.step(rng.uniform(-1, 1, 2).astype(np.float32)) for _ in range(12)]
    assert same(first, again)


@pytest.mark.parametrize(
    "options",
    [
        {"targets": (0, 0)},
        {"target": (0, 0, 0)},
        {"target": "far"},
        {"target": (np.nan, 0)},
        {"target": np.zeros((50, 2))},
        {"target": (1e300, 1e300)},
        {"target": (0, -2e12)},
        {"load": (0, 1)},
        {"load": {"force": (0, 1)}},
        {"load": {"link": 0, "force": (0, 1)}},
        {"load": {"link": 9, "force": (0, 1)}},
        {"load": {"link": 1.5, "force": (0, 1)}},
        {"load": {"link": 1, "force": (0, np.inf)}},
        {"load": {"link": 1, "force": (0, 1e300)}},
        {"mechanism": "two_segment"},
        {"mechanism": "no such mechanism"},
        {"mechanism": 3},
        {"mechanism": "flexible_arm"},
        {"mechanism": flexible_arm()},
        {"start": (3.0,)},
        {"start": (0.1, 3.0)},
        {"start": (3.0, 99.0)},
        [],
    ],
)
def test_bad_reset_options_are_refused_before_anything_changes(options):
    env, untouched = make().unwrapped, make().unwrapped
    rollout(env, seed=2, steps=3)
    rollout(untouched, seed=2, steps=3)
    with pytest.raises(InvalidInput, match="expected"):
        env.reset(seed=7, options=options)
    assert same(env.step(np.ones(2)), untouched.step(np.ones(2)))
    assert same(env.reset(), untouched.reset())


@pytest.mark.parametrize("seed", [1.5, -1, "1", True, np.float64("nan"), [1], np.arange(2)])
def test_a_bad_seed_is_refused_before_anything_changes(seed):
    env, untouched = make().unwrapped, make().unwrapped
    rollout(env, seed=2, steps=3)
    rollout(untouched, seed=2, steps=3)
    with pytest.raises(InvalidInput, match=r"seed.*: expected a whole number, 0 or more, or None") as raised:
        env.reset(seed=seed)
    assert "\n" not in str(raised.value)
    assert same(env.step(np.ones(2)), untouched.step(np.ones(2)))
    assert same(env.reset(), untouched.reset())


@pytest.mark.parametrize("seed", [np.int64(7), np.uint8(7), 7.0])
def test_whole_numbers_of_any_type_are_seeds(seed):
    assert same(make().reset(seed=seed), make().reset(seed=7))


def test_settings_come_as_object_dictionary_or_keywords():
    config = rj_gym.TrackingConfig(episode_steps=7, load={"link": "tip"})
    for env in (
        RollingJointEnv(config=config, action_scale_mm=0.5),
        RollingJointEnv(config={"episode_steps": 7, "load": {"link": "tip"}}, action_scale_mm=0.5),
        make(episode_steps=7, load={"link": "tip"}, action_scale_mm=0.5).unwrapped,
    ):
        assert env.config == config.updated({"action_scale_mm": 0.5})
    with pytest.raises(ConfigError, match="episode_steps"):
        make(episode_step=7)


@pytest.mark.parametrize("arm", ["flexible_arm", str(ROOT / "configs/mechanism/flexible_arm.yaml"), flexible_arm()])
def test_an_arm_of_beads_is_refused_where_the_task_is_planar(arm):
    with pytest.raises(ConfigError, match=r"mechanism = .*expected .*(planar chain|RollingChain)"):
        make(mechanism=arm)


def test_positive_action_pulls_its_tendon_and_bends_to_its_side():
    env = make(load={"magnitude": (0, 0)})
    _, start = env.reset(seed=0)
    for _ in range(4):
        *_, left = env.step(np.array([1.0, -1.0], np.float32))
    assert left["tip"][0] < start["tip"][0] - 5  # tendon 0 is the left one


@ids
@pytest.mark.parametrize("load", [{"magnitude": (0, 1e4)}, {"magnitude": (0, 20), "process": "step", "hold_steps": 1}])
def test_huge_loads_and_random_actions_never_break_anything(env_id, load):
    env = make(env_id, load=load, action_scale_mm=30.0, episode_steps=15, observe_load=True).unwrapped
    rng = np.random.default_rng(0)
    for seed in range(15):
        observation, _ = env.reset(seed=seed)
        over = False
        while not over:
            assert observation in env.observation_space
            observation, reward, terminated, truncated, info = env.step(rng.uniform(-3, 3, env.action_space.shape))
            assert np.isfinite(reward) and np.isfinite(info["error_mm"])
            assert terminated == (info["status"] not in ("CONVERGED", "AT_LIMIT"))
            over = terminated or truncated
        assert observation in env.observation_space


def test_a_failed_solve_ends_the_episode_with_status_penalty_and_last_good_observation():
    env = make(reward={"failure_penalty": 7.0}).unwrapped
    rollout(env, seed=0, steps=2)
    before = env.step(np.zeros(2))
    watch_solver(env._buffer, after=lambda: env._buffer.solver.results.status.fill(Status.NOT_CONVERGED))
    observation, reward, terminated, truncated, info = env.step(np.ones(2))
    assert (terminated, truncated, info["status"]) == (True, False, "NOT_CONVERGED")
    assert np.array_equal(observation, before[0]) and info["reward_terms"]["failure"] == -7.0 and reward < -7.0
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(2))


@pytest.mark.parametrize("goal", ["dense", "sparse"])
def test_goal_reward_of_a_batch_equals_the_scalar_to_the_last_bit(goal):
    env = RollingJointGoalEnv(reward={"goal": goal, "goal_tolerance_mm": 20.0})
    rng = np.random.default_rng(0)
    achieved, desired = rng.uniform(-1, 1, (2, 400, 2)).astype(np.float32)
    desired[:100] = achieved[:100] + rng.uniform(-0.2, 0.2, (100, 2)).astype(np.float32)
    batch = env.compute_reward(achieved, desired, [{}] * 400)
    assert batch.shape == (400,)
    assert [env.compute_reward(*pair, {}) for pair in zip(achieved, desired, strict=True)] == batch.tolist()
    if goal == "sparse":
        assert set(batch.tolist()) == {0.0, -1.0}


def test_goals_are_tip_and_target_over_the_length_and_observation_hides_the_goal():
    env = make("rj_gym/RollingJointGoal-v0")
    first, _ = env.reset(seed=1, options={"target": (10.0, 60.0)})
    second, info = env.reset(seed=1, options={"target": (-40.0, 50.0)})
    assert np.array_equal(first["observation"], second["observation"])
    assert np.allclose(second["achieved_goal"] * 100, info["tip"], atol=1e-4)
    assert np.allclose(second["desired_goal"] * 100, (-40.0, 50.0), atol=1e-4)
    observation, reward, *_, info = env.step(np.zeros(2, np.float32))
    assert reward == env.unwrapped.compute_reward(observation["achieved_goal"], observation["desired_goal"], {})
    assert reward == pytest.approx(-info["error_mm"] / 10, abs=1e-5) and info["is_success"] is False


@pytest.mark.parametrize(
    "goals",
    [
        ("x", "x"),
        ("x", (0.0, 1.0)),
        ((0.0, 1.0), None),
        ((0.0, 1.0, 0.0), (0.0, 1.0, 0.0)),
        (0.5, 0.5),
        ((0.0, np.nan), (0.0, 1.0)),
        (np.zeros((3, 2)), np.zeros((4, 2))),
    ],
)
def test_goals_without_a_reward_are_refused_with_one_line(goals):
    for env in (RollingJointGoalEnv(reward={"goal": "sparse"}), rj_gym.RollingJointGoalVectorEnv(2)):
        with pytest.raises(InvalidInput, match=r"_goal.*finite numbers of shape \(2,\)") as raised:
            env.compute_reward(*goals, {})
        assert "\n" not in str(raised.value)
