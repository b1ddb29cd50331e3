"""Learners for what cannot be seen: recurrent PPO, critics that see the privileged state, residual policies."""

import copy
import signal
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv

from agents import evaluate, train
from agents.controllers import OpenLoop
from agents.controllers.controller import Controller
from agents.controllers.policy import Policy, model_input
from agents.controllers.residual import BaseController, ResidualPolicy, controller_of
from agents.evaluation.rollout import run_episodes
from agents.policies.export import check_against_torch, export_policy, export_run
from agents.policies.network import PolicyError
from agents.policies.shipped import ShippedPolicy
from agents.policies.trained import load_driving
from agents.runs.config import TrainConfig, load_config
from agents.runs.environment import EnvConfig
from agents.runs.folder import RunFolder
from agents.training.build import build_model
from agents.training.callbacks import Evaluator
from agents.training.checkpoint import save_policy
from agents.training.learn import learn
from agents.training.residual import ResidualVecEnv
from rj_gym.sb3 import make_sb3_env
from rollingjoint.checked_yaml import dump_yaml
from rollingjoint.errors import ConfigError
from tests.agents.training.test_resume import weights

torch.set_num_threads(1)

INSTRUMENT = "rj_gym/Instrument-v0"
STEPS = 8
TRAINING = {"config": {}, "steps": 0, "seed": 0, "versions": {}}
ASYMMETRIC = {"policy": {"hidden": [8], "critic": "privileged"}}
RECURRENT = {"algorithm": "recurrent_ppo", "policy": {"hidden": [8], "memory": 6}}
BOTH = {"algorithm": "recurrent_ppo", "policy": {"hidden": [8], "memory": 6, "critic": "privileged"}}
RESIDUAL = {"residual": "open loop", **ASYMMETRIC}
LEARNERS = {"asymmetric": ASYMMETRIC, "recurrent": RECURRENT, "both": BOTH, "residual": RESIDUAL}


def config(env_id=INSTRUMENT, **changes) -> TrainConfig:
    env = {"id": env_id, "n_envs": 4, "settings": {"episode_steps": STEPS}}
    parameters = {"n_steps": 2 * STEPS, "batch_size": 32, "n_epochs": 1}
    return TrainConfig.from_dict({"total_timesteps": 128, "env": env, "parameters": parameters, **changes})


@pytest.fixture(scope="module")
def trained():
    """A model of each, and its configuration, that has learned from two rollouts."""
    found = {}
    for name, changes in LEARNERS.items():
        settings = config(**changes)
        found[name] = settings, build_model(settings)
        learn(found[name][1], settings, [])
    return found


@pytest.mark.parametrize("name", ["asymmetric", "both"])
def test_policy_does_not_see_the_privileged_state_and_its_critic_does(name, trained):
    _, model = trained[name]
    torch.manual_seed(0)
    rows = 5
    state = [torch.zeros(1, rows, 6)] * 2
    memory = (state, torch.ones(rows)) if name == "both" else ()
    seen = {key: torch.randn(rows, *space.shape) for key, space in model.observation_space.spaces.items()}

    def outcomes(seen):
        if memory:
            mean = model.policy.get_distribution(seen, *memory)[0].distribution.mean
        else:
            mean = model.policy.get_distribution(seen).distribution.mean
        return mean, model.policy.predict_values(seen, *memory)

    mean, value = outcomes(seen)
    for part, policy_looks in (("privileged", False), ("observation", True)):
        other_mean, other_value = outcomes({**seen, part: seen[part] + 1.0})
        assert torch.equal(mean, other_mean) == (not policy_looks)
        assert not torch.equal(value, other_value)


@pytest.mark.parametrize("name", ["asymmetric", "both"])
def test_all_parameters_of_an_asymmetric_policy_learn(name):
    settings = config(**LEARNERS[name])
    model = build_model(settings)
    before = {key: value.clone() for key, value in model.policy.named_parameters()}
    learn(model, settings, [])
    after = dict(model.policy.named_parameters())
    assert [key for key, value in before.items() if torch.equal(value, after[key])] == []


def test_policy_with_a_privileged_critic_acts_on_the_plain_environment_as_in_training(trained):
    settings, model = trained["asymmetric"]
    normaliser = model.get_vec_normalize_env()
    envs = make_sb3_env(INSTRUMENT, 4, **settings.training_env.arguments())
    envs.seed(3)
    seen = envs.reset()
    expected = model.predict(normaliser.normalize_obs(seen), deterministic=True)[0]
    action = Policy(model, normaliser).act(seen["observation"])
    np.testing.assert_array_equal(action, expected)
    assert settings.env.settings == {"episode_steps": STEPS}  # what evaluations, exports and reports play


@pytest.mark.parametrize("name", ["asymmetric", "recurrent", "both"])
def test_numpy_gives_the_actions_of_the_learner_over_whole_episodes(name, trained, request):
    settings, model = trained[name]
    normaliser = model.get_vec_normalize_env()
    layer = model.policy.action_net
    request.addfinalizer(partial(layer.load_state_dict, copy.deepcopy(layer.state_dict())))
    for parameter in layer.parameters():
        parameter.data.mul_(30)  # a fresh action layer is so small that nothing would be clipped
    policy = export_policy(model, normaliser, settings.env, "own", TRAINING)
    assert 0 < check_against_torch(policy, model, normaliser) < 1e-5
    assert policy.has_memory == (name != "asymmetric")
    assert policy.settings.privileged == "off"
    again = ShippedPolicy.from_bytes(policy.to_bytes())
    assert again.algorithm == settings.algorithm
    ours, theirs = (run_episodes(settings.env, each, [7, 8, 9]) for each in (again, Policy(model, normaliser)))
    np.testing.assert_allclose(ours.errors, theirs.errors, atol=1e-3)


def test_memory_is_carried_from_step_to_step_of_an_evaluation_and_begun_anew(trained):
    settings, model = trained["recurrent"]

    class Noting(Policy):
        forgets = False

        def reset(self, mask):
            super().reset(mask)
            self.actions = []

        def act(self, observations):
            if self.forgets:
                super().reset(np.ones(len(observations), bool))
            self.actions.append(super().act(observations))
            return self.actions[-1]

    def actions(policy):
        run_episodes(settings.env, policy, [7, 8])
        return np.array(policy.actions)

    policy = Noting(model, model.get_vec_normalize_env())
    first = actions(policy)
    np.testing.assert_array_equal(actions(policy), first)
    policy.forgets = True
    forgetful = actions(policy)
    np.testing.assert_array_equal(forgetful[0], first[0])
    assert np.all(forgetful[1:] != first[1:])


class Counting(Controller):
    """A controller that knows nothing but its own past: how many steps it acted, what it saw first and last."""

    def reset(self, mask):
        self.steps, self.first = np.zeros((len(mask), 1)), None

    def act(self, observations):
        self.last = observations.copy()
        self.first = self.last if self.first is None else self.first
        self.steps += 1
        return np.full((len(self.steps), 2), 0.5)

    def estimates(self):
        return np.concatenate([self.steps, self.first[:, :1], self.last], axis=1)


class Uneven(VecEnv):
    """Lanes whose episodes have 2, 3 and 5 steps; they observe which episode it is, and the step."""

    LENGTHS, render_mode = np.array([2, 3, 5]), None

    def __init__(self):
        self.task = None
        space = spaces.Box(-np.inf, np.inf, (2,), np.float32)
        super().__init__(3, space, spaces.Box(-1.0, 1.0, (2,), np.float32))

    def reset(self):
        self.episode, self.step_ = np.zeros(3), np.zeros(3)
        return self.seen()

    def seen(self):
        return np.stack([self.episode, self.step_], axis=1).astype(np.float32)

    def step_async(self, actions):
        self.actions = actions

    def step_wait(self):
        self.step_ += 1
        done, reached = self.step_ == self.LENGTHS, self.seen()
        infos = [{"terminal_observation": reached[lane]} if done[lane] else {} for lane in range(3)]
        self.episode, self.step_ = self.episode + done, np.where(done, 0, self.step_)
        return self.seen(), np.zeros(3, np.float32), done, infos

    def get_attr(self, attr_name, indices=None):
        return [getattr(self, attr_name)]

    close = set_attr = env_method = env_is_wrapped = None


def test_controllers_see_their_own_episodes_to_the_end_where_lanes_end_apart():
    inside = Uneven()
    envs = ResidualVecEnv(inside, lambda: BaseController(Counting()), 6)
    seen, expected = envs.reset(), np.zeros((3, 2))
    for _ in range(12):
        np.testing.assert_array_equal(seen[:, :2], inside.seen())
        np.testing.assert_array_equal(seen[:, 2:4], 0.5)
        np.testing.assert_array_equal(seen[:, 4], seen[:, 1] + 1)  # asked once a step of its episode
        np.testing.assert_array_equal(seen[:, 5], seen[:, 0])  # begun with this episode
        np.testing.assert_array_equal(seen[:, 6:], seen[:, :2])
        envs.step_async(np.array([[0.1, -0.2], [0.9, -0.9], [-0.1, 0.0]]))
        np.testing.assert_allclose(inside.actions, [[0.6, 0.3], [1.0, -0.4], [0.4, 0.5]])
        episode, expected = seen[:, 0], inside.LENGTHS + 1
        seen, _, done, infos = envs.step_wait()
        for lane in np.flatnonzero(done):
            last = infos[lane]["terminal_observation"]
            np.testing.assert_array_equal(last[[0, 4, 5]], [episode[lane], expected[lane], episode[lane]])
            np.testing.assert_array_equal(last[6:], last[:2])


def test_residual_policy_that_adds_nothing_is_its_controller():
    class Nothing(Controller):
        def act(self, observations):
            return np.zeros((len(observations), 2), np.float32)

    env, seeds = EnvConfig(INSTRUMENT, settings={"episode_steps": STEPS}), [3, 4, 5]
    alone = run_episodes(env, OpenLoop(), seeds)
    np.testing.assert_array_equal(
        run_episodes(env, ResidualPolicy(BaseController(OpenLoop()), Nothing()), seeds).errors, alone.errors
    )
    inside = make_sb3_env(INSTRUMENT, 3, **env.arguments())
    envs = ResidualVecEnv(inside, lambda: BaseController(OpenLoop()), 2)
    envs.seed(3)
    envs.reset()
    for _ in range(STEPS):
        envs.step_async(np.zeros((3, 2), np.float32))
        _, _, done, infos = envs.step_wait()
    assert done.all()
    np.testing.assert_allclose([info["error_mm"] for info in infos], alone.final_errors, rtol=1e-6)


def test_policy_learns_to_add_to_the_controller_that_it_is_evaluated_with(trained):
    settings, model = trained["residual"]
    policy = controller_of(settings, Policy(model, model.get_vec_normalize_env()))
    with_it = run_episodes(settings.env, policy, [3, 4]).final_errors
    alone = run_episodes(settings.env, OpenLoop(), [3, 4]).final_errors
    assert np.any(with_it != alone)
    np.testing.assert_allclose(with_it, alone, atol=2.0)  # it has hardly learned yet


@pytest.mark.slow
@pytest.mark.parametrize("name", ["both", "residual"])
def test_a_stopped_run_goes_on_to_the_same_weights_and_scores(name, tmp_path, monkeypatch, no_pictures):
    changes = config(**LEARNERS[name], evaluation={"every": 64, "episodes": 2}, checkpoint_every=64)
    within_episodes = {"n_steps": STEPS + 2, "batch_size": 20, "n_epochs": 1}
    changes = replace(changes, total_timesteps=160, parameters=within_episodes)
    (tmp_path / "config.yaml").write_text(yaml_of(changes))
    begin = ["--config", str(tmp_path / "config.yaml"), "--run-dir"]
    whole, stopped = tmp_path / "whole", tmp_path / "stopped"
    assert train.main([*begin, str(whole)]) == 0
    evaluation = Evaluator.evaluate
    with monkeypatch.context() as patch:
        patch.setattr(Evaluator, "evaluate", lambda self: signal.raise_signal(signal.SIGTERM) or evaluation(self))
        patch.setattr(Evaluator, "_on_training_end", lambda self: None)
        assert train.main([*begin, str(stopped)]) == 128 + signal.SIGTERM
    assert train.main(["--resume", str(stopped)]) == 0
    assert weights(stopped) == weights(whole)
    assert (stopped / "evaluations.csv").read_text() == (whole / "evaluations.csv").read_text()
    run = RunFolder.open(whole)
    assert run.config() == load_config(tmp_path / "config.yaml")
    seeds = changes.evaluation.seeds
    final = float(run.evaluations.read_text().splitlines()[-1].split(",")[1])
    assert run_episodes(changes.env, load_driving(run, "last"), seeds).final_errors.mean() == final


def yaml_of(settings: TrainConfig) -> str:
    return dump_yaml(settings.to_dict())


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"algorithm": "sac", "parameters": {}, **ASYMMETRIC}, "Critics of sac see the observation"),
        ({**ASYMMETRIC, "env_id": "rj_gym/RollingJointGoal-v0"}, "without goals"),
        ({"policy": {"critic": "all"}}, "policy.critic = 'all'"),
        ({**RECURRENT, "parameters": {"n_steps": 7, "batch_size": 5}}, "divisor of n_steps x n_envs = 28"),
        ({"residual": 3}, "residual = 3"),
        ({"residual": "open loop", "env_id": "rj_gym/CurvatureDesign-v0"}, "not a tracking task"),
        ({"residual": "open lop"}, "Did you mean 'open loop'"),
        ({"residual": "jacobian feedback"}, "can act on what rj_gym/Instrument-v0 shows"),
    ],
)
def test_what_a_learner_cannot_do_is_refused_in_one_line(changes, words):
    with pytest.raises(ConfigError, match=words) as error:
        build_model(config(**changes))
    assert "\n" not in str(error.value)


def test_residual_policy_is_not_exported(tmp_path):
    settings = config(**RESIDUAL)
    run = RunFolder.create(tmp_path / "run", settings, [])
    save_policy(build_model(settings), run.policy_files("best"))
    with pytest.raises(PolicyError, match=r"rj evaluate scores the run folder"):
        export_run(run, "best", "own")


def test_zeros_in_place_of_the_privileged_state_leave_a_goal_observation_alone():
    class Model:
        observation_space = spaces.Dict(observation=spaces.Box(-1, 1, (2,)), achieved_goal=spaces.Box(-1, 1, (2,)))

    seen = {"observation": np.ones((1, 2)), "achieved_goal": np.ones((1, 2))}
    assert model_input(Model(), None, seen) is seen


def test_report_compares_a_residual_policy(tmp_path, no_pictures, capsys):
    settings = config(**RESIDUAL, evaluation={"every": 64, "episodes": 2})
    (tmp_path / "config.yaml").write_text(yaml_of(settings))
    assert train.main(["--config", str(tmp_path / "config.yaml"), "--run-dir", str(tmp_path / "run")]) == 0
    assert evaluate.main([str(tmp_path / "run"), "--episodes", "2"]) == 0
    assert "policy" in capsys.readouterr().out
