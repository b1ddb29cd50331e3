"""The learning algorithms on many lanes of the native environments, hindsight replay among them."""

import csv
from pathlib import Path

import numpy as np
import pytest

from agents.runs.config import TrainConfig
from agents.training.build import build_model
from agents.training.callbacks import Evaluator
from agents.training.learn import learn
from agents.training.learn import train as train_run
from rollingjoint.errors import ConfigError

GOAL = "rj_gym/RollingJointGoal-v0"
LEARNING = {"learning_starts": 40, "batch_size": 16, "buffer_size": 200, "gradient_steps": 3}


def config(algorithm: str, env: dict | None = None, settings: dict | None = None, **others) -> TrainConfig:
    env = {"n_envs": 4, "settings": {"episode_steps": 10, **(settings or {})}, **(env or {})}
    parameters = {} if algorithm == "ppo" else LEARNING
    values = {"algorithm": algorithm, "total_timesteps": 120, "env": env, "parameters": parameters}
    return TrainConfig.from_dict({**values, "policy": {"hidden": [8]}, **others})


def trained(settings: TrainConfig):
    model = build_model(settings)
    learn(model, settings, [])
    return model


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["sac", "tqc", "crossq"])
def test_gradient_steps_are_those_of_a_step_of_all_lanes(algorithm):
    model = trained(config(algorithm))
    assert model.num_timesteps == 120
    assert model._n_updates == 3 * (120 - 40) // 4


def test_minus_one_gradient_steps_are_as_many_as_steps_of_the_lanes():
    assert trained(config("sac", parameters={**LEARNING, "gradient_steps": -1}))._n_updates == 80


@pytest.mark.slow
@pytest.mark.parametrize(
    ("algorithm", "kind", "normalised"), [("sac", "dense", True), ("sac", "sparse", False), ("tqc", "sparse", True)]
)
def test_hindsight_rewards_are_those_of_the_task_for_the_relabelled_goals(algorithm, kind, normalised):
    normalise = {"observation": normalised, "reward": False}
    settings = {"reward": {"goal": kind, "goal_tolerance_mm": 10.0}}
    model = trained(config(algorithm, {"id": GOAL}, settings, her={"goals": 3}, normalise=normalise))
    normaliser, buffer = model.get_vec_normalize_env(), model.replay_buffer
    np.random.seed(0)
    sample = buffer.sample(400, env=normaliser)
    after = {key: value.numpy().astype(float) for key, value in sample.next_observations.items()}
    if normaliser is not None:
        after = normaliser.unnormalize_obs(after)
    goals = after["achieved_goal"], after["desired_goal"]
    expected = model.env.env_method("compute_reward", *goals, None, indices=[0])[0]
    np.testing.assert_allclose(sample.rewards.numpy()[:, 0], expected, atol=1e-4)
    assert 0.02 < np.mean(np.all(np.isclose(*goals, atol=1e-4), axis=1)) < 0.6  # states that became goals
    assert sample.dones.sum() == 0  # episodes that time cut short do not end
    if kind == "sparse":
        assert set(sample.rewards.numpy()[:, 0].tolist()) == {-1.0, 0.0}


def test_transitions_of_all_lanes_are_stored_with_the_reward_of_the_task():
    model = trained(config("sac", {"id": GOAL, "n_envs": 3}, her={}))
    buffer = model.replay_buffer
    rows = buffer.size()
    shape = (rows * 3, 2)
    goals = [buffer.next_observations[key][:rows].reshape(shape) for key in ("achieved_goal", "desired_goal")]
    expected = model.env.env_method("compute_reward", *goals, None, indices=[0])[0]
    np.testing.assert_allclose(buffer.rewards[:rows].ravel(), expected, atol=1e-6)
    assert len(np.unique(buffer.next_observations["desired_goal"][rows - 1], axis=0)) == 3


@pytest.mark.parametrize(("observation", "reward"), [(True, False), (False, True), (True, True)])
def test_only_what_the_configuration_says_is_normalised(observation, reward):
    normaliser = build_model(
        config("sac", normalise={"observation": observation, "reward": reward})
    ).get_vec_normalize_env()
    assert (normaliser.training, normaliser.norm_obs, normaliser.norm_reward) == (True, observation, reward)


def test_value_functions_may_have_layers_of_their_own():
    for algorithm, value in (("ppo", "vf"), ("tqc", "qf"), ("crossq", "qf")):
        model = build_model(config(algorithm, policy={"hidden": [8], "value_hidden": [16, 4]}))
        assert model.policy.net_arch == {"pi": [8], value: [16, 4]}


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (lambda: config("crossq", {"id": GOAL}), "no CrossQ policy"),
        (lambda: config("sac", her={}), "Goal-v0"),
        (lambda: config("sac", {"id": GOAL}, parameters={**LEARNING, "n_steps": 3}), "N-step"),
    ],
)
def test_what_an_algorithm_cannot_learn_from_is_refused(settings, words):
    with pytest.raises(ConfigError, match=words):
        build_model(settings())


def test_lanes_that_end_together_make_one_row_of_the_log(tmp_path, monkeypatch):
    monkeypatch.setattr(Evaluator, "evaluate", lambda self: {})
    settings = config("sac", {"n_envs": 16}, total_timesteps=640, evaluation={"every": 10_000})
    assert train_run(settings, tmp_path / "run") == 0
    rows = list(csv.DictReader(Path(tmp_path / "run/logs/progress.csv").read_text().splitlines()))
    steps = [int(row["time/total_timesteps"]) for row in rows if row["time/total_timesteps"]]
    assert steps == [160, 320, 480, 640]
