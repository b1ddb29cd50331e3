"""Batched rollouts: the same episodes as the scalar environment, and what a controller sees of them."""

import gymnasium
import numpy as np
import pytest

from agents.controllers import DoNothing, JacobianFeedback
from agents.controllers.controller import Controller, Reading
from agents.controllers.policy import Policy
from agents.evaluate import evaluate_controllers
from agents.evaluation.rollout import film, run_episodes, run_with_options
from agents.runs.environment import EnvConfig, make_env
from rollingjoint.errors import ConfigError, InvalidInput

IDS = ["rj_gym/RollingJoint-v0", "rj_gym/RollingJointGoal-v0"]
ARM_IDS = ["rj_gym/FlexibleArm-v0", "rj_gym/FlexibleArmGoal-v0"]
MECHANISMS = [("small_arm", "flexible_arm"), ("five_link", "two_segment")]
VARIED = {
    "episode_steps": 12,
    "load": {"process": "step", "hold_steps": 3},
    "target": {"process": "path"},
    "randomization": {"position_noise_mm": 0.2, "stiffness_spread": 0.2},
}


def batched(observation):
    """An observation of a scalar environment as one of a vector environment with one lane."""
    if isinstance(observation, dict):
        return {key: batched(value) for key, value in observation.items()}
    return np.asarray(observation)[None]


def scalar_episode(config, controller, seed):
    """Errors, sum of rewards and infos of the scalar environment's episode."""
    env = make_env(config)
    observation, info = env.reset(seed=seed)
    controller.begin(env.unwrapped.task, 1)
    infos, total, over = [info], 0.0, False
    while not over:
        action = controller.act(batched(observation))[0]
        observation, reward, terminated, truncated, info = env.step(action)
        infos.append(info)
        total += reward
        over = terminated or truncated
    return [info["error_mm"] for info in infos], total, infos


@pytest.mark.slow
@pytest.mark.parametrize(("env_id", "mechanism"), [*((i, "five_link") for i in IDS), (ARM_IDS[0], "small_arm")])
@pytest.mark.parametrize("lanes", [1, 2, 5, 100])
def test_every_episode_is_that_of_the_scalar_environment_whatever_the_lanes(env_id, mechanism, lanes):
    config, seeds = EnvConfig(env_id, settings=VARIED | {"mechanism": mechanism}), [7, 3, 11, 4, 20]
    episodes = run_episodes(config, JacobianFeedback(), seeds, lanes)
    assert episodes.seeds.tolist() == seeds
    for k, seed in enumerate(seeds):
        errors, total, infos = scalar_episode(config, JacobianFeedback(), seed)
        np.testing.assert_allclose(episodes.errors[k], errors, atol=1e-9)
        assert episodes.rewards[k] == pytest.approx(total, abs=1e-9)
        np.testing.assert_array_equal(episodes.loads[k], [info["load"]["force"] for info in infos])
        np.testing.assert_array_equal(episodes.targets[k], [info["target"] for info in infos])
        assert episodes.link[k] == infos[0]["load"]["link"]


@pytest.mark.parametrize("env_id", [*IDS, *ARM_IDS])
@pytest.mark.parametrize("size", ["small", "large"])
@pytest.mark.parametrize("observe", [True, False])
def test_what_is_seen_is_what_info_says_in_millimetres_and_newtons(env_id, size, observe):
    """Unobserved tensions are known where the pose is, which an arm does not show."""
    planar = env_id in IDS
    settings = {
        "mechanism": MECHANISMS[planar][size == "large"],
        "observe_tensions": observe,
        "observe_load": True,
        "load": {"magnitude": (0.5, 0.5)},
        **({} if planar else {"orientation": size == "large"}),
    }
    env = gymnasium.make_vec(env_id, 6, "vector_entry_point", **settings)
    observation, _ = env.reset(seed=0)
    for _ in range(4):
        observation, *_, info = env.step(env.action_space.sample())
    seen = Reading(observation, env.task)
    names = [("tip", "tip"), ("target", "target"), ("commands", "command"), ("tensions", "tensions")]
    for name, known in names if planar or observe else names[:3]:
        np.testing.assert_allclose(getattr(seen, name), info[known], atol=2e-4, err_msg=name)
    np.testing.assert_allclose(np.linalg.norm(seen.error, axis=1), info["error_mm"], atol=2e-4)
    if planar:
        np.testing.assert_allclose(seen.poses, env._buffer.state.poses, atol=1e-4)
        np.testing.assert_allclose(env.task.mechanism.poses(seen.joint_angles), seen.poses, atol=1e-3)


def test_joint_angles_are_seen_beyond_half_a_turn_of_the_tip():
    env = gymnasium.make_vec(IDS[0], 1, "vector_entry_point", mechanism="two_segment")
    observation, _ = env.reset(seed=0)
    angles = np.full(env.task.mechanism.n_joints, 0.7)
    poses = env.task.mechanism.poses(angles)
    turned = observation.copy()
    turned[0, : 4 * len(angles)] = np.column_stack(
        [poses[1:, :2] / env.task.length, np.cos(poses[1:, 2]), np.sin(poses[1:, 2])]
    ).ravel()
    assert poses[-1, 2] > 4.0
    np.testing.assert_allclose(Reading(turned, env.task).joint_angles[0], angles, atol=1e-6)


def test_a_film_shows_the_start_and_every_step():
    frames = film(EnvConfig(settings={"episode_steps": 3}), DoNothing(), 5)
    assert [frame.shape for frame in frames] == [(600, 720, 3)] * 4
    assert not np.array_equal(frames[0], frames[-1])


class Countdown(gymnasium.Env):
    """Ends by itself after as many steps as its seed says; error and reward are the number of steps that are left."""

    observation_space = gymnasium.spaces.Box(-10.0, 10.0, (1,))
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,))

    def __init__(self, says="error_mm"):
        self.says = says

    def reset(self, seed=None, options=None):
        super().reset(seed=seed)
        self.left = 3 if seed is None else seed
        return np.full(1, self.left, np.float32), {self.says: float(self.left)}

    def step(self, action):
        self.left -= 1
        return np.full(1, self.left, np.float32), float(self.left), self.left == 1, False, {self.says: float(self.left)}


@pytest.fixture
def countdown():
    gymnasium.register("test/Countdown-v0", Countdown)
    yield "test/Countdown-v0"
    gymnasium.registry.pop("test/Countdown-v0")


class Zeros(Controller):
    """No task, no action."""

    def reset(self, mask):
        self.lanes = len(mask)

    def act(self, observations):
        return np.zeros((self.lanes, 1))


@pytest.mark.parametrize("lanes", [1, 2, 3])
def test_an_early_end_keeps_its_last_error_and_adds_no_reward(countdown, lanes):
    controller = Zeros()
    episodes = run_episodes(EnvConfig(countdown), controller, [4, 2, 3], lanes)
    assert episodes.errors.tolist() == [[4, 3, 2, 1], [2, 1, 1, 1], [3, 2, 1, 1]]
    assert episodes.rewards.tolist() == [6, 1, 3]
    assert episodes.terminated.all()
    assert episodes.final_errors.tolist() == [1, 1, 1]
    assert (controller.task, episodes.loads, episodes.link, episodes.targets) == (None, None, None, None)


def test_a_policy_drives_an_environment_of_another_package(countdown):
    class Model:
        def predict(self, observation, deterministic):
            assert deterministic and observation.shape == (3, 1)
            return np.zeros((3, 1)), None

    assert len(run_episodes(EnvConfig(countdown), Policy(Model()), [4, 2, 3])) == 3


def test_a_report_on_an_environment_of_another_package_has_no_floor(countdown):
    report = evaluate_controllers(EnvConfig(countdown), {"zeros": Zeros()}, [4, 2])
    assert (report.floors, report.length_mm) == (None, None)
    assert [row[0] for row in report.table()] == ["controller", "zeros"]


def test_a_controller_that_needs_a_task_says_so_elsewhere(countdown):
    with pytest.raises(InvalidInput, match="needs its task"):
        _ = Reading(np.zeros((1, 1))).tip


def test_an_environment_without_a_tip_error_is_refused(countdown):
    with pytest.raises(ConfigError, match="error_mm"):
        run_episodes(EnvConfig(countdown, settings={"says": "distance"}), Zeros(), [3])


def test_an_unknown_id_of_ours_is_refused_in_one_line():
    with pytest.raises(ConfigError, match="expected one of rj_gym/RollingJoint-v0"):
        run_episodes(EnvConfig("rj_gym/RollingJoint-v9"), Zeros(), [3])


@pytest.mark.slow
def test_lanes_with_reset_options_of_their_own_are_the_episodes_of_scalar_environments_with_them():
    config = EnvConfig(settings={"episode_steps": 6, "randomization": {"stiffness_spread": 0.2}})
    still, pulled = {"load": {"link": -1, "force": (0.0, 0.0)}}, {"start": (2.0, 5.0), "mechanism": "five_link"}
    options, seeds = [still, still, pulled, {}, pulled], [3, 4, 4, 5, 6]
    found = run_with_options(config, DoNothing(), seeds, options)
    env = make_env(config)
    for errors, seed, option in zip(found.errors, seeds, options, strict=True):
        expected = [env.reset(seed=seed, options=option)[1]["error_mm"]]
        expected += [env.step([0.0, 0.0])[-1]["error_mm"] for _ in range(6)]
        np.testing.assert_array_equal(errors, expected)
    assert found.targets is None
    with pytest.raises(InvalidInput, match="one per seed"):
        run_with_options(config, DoNothing(), seeds, options[:2])
