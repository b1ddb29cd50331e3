"""Policies whose actions vanish with the tip error: our own learners' and Stable-Baselines3's, in torch and NumPy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

from agents import train
from agents.learners.feed_forward import FeedForwardActor
from agents.learners.gain import GAIN_MM, SCALE_MM, GainHead
from agents.policies.errors import PolicyError
from agents.policies.export import check_against_torch, export_policy
from agents.policies.gain import GainForm, GainNetwork
from agents.policies.shipped import ShippedPolicy
from agents.policies.trained import load_trained
from agents.runs.config import TrainConfig
from agents.runs.folder import RunFolder
from agents.training.build import build_model, close
from agents.training.learn import learn
from agents.training.start import fresh_model
from rj_gym import IDS, ObservedError
from rollingjoint.checked_yaml import dump_yaml
from rollingjoint.errors import ConfigError
from tests.agents.learners.checks import check_that_a_stopped_run_ends_with_the_same_weights

torch.set_num_threads(1)

STEPS, LANES = 12, 8
SEEN = ("FlexibleArm", "LatePose", "PitchYaw", "RollingJoint", "SlowCamera")
EXACT = ("rj_gym/FlexibleArm-v0", "rj_gym/PitchYaw-v0", "rj_gym/RollingJoint-v0")  # elsewhere it is late, or noisy
TRAINING = {"config": {}, "steps": 0, "seed": 0, "versions": {}}
PARAMETERS: dict[str, dict[str, Any]] = {
    "apg": {"learning_rate": 1.0e-2, "optimizer": "muon"},
    "distill": {"gradient_steps": 2, "batch_size": 8},
    "ppo": {"n_steps": STEPS, "batch_size": LANES * STEPS},
    "sac": {"learning_starts": 50, "buffer_size": 1000, "gradient_steps": 4, "batch_size": 64},
}


def settings(algorithm: str = "apg", updates: int = 2, **changes: Any) -> dict[str, Any]:
    """A small run on RollingJoint."""
    env = {"id": "rj_gym/RollingJoint-v0", "n_envs": LANES, "settings": {"episode_steps": STEPS}}
    return {
        "algorithm": algorithm,
        "total_timesteps": updates * LANES * STEPS,
        "env": env | changes.pop("env", {}),
        "parameters": PARAMETERS[algorithm],
        "policy": {"form": "gain", "memory": None, "hidden": [24, 16]} | changes.pop("policy", {}),
        "normalise": {"reward": False},
        **changes,
    }


def made(algorithm: str, **changes: Any) -> tuple[TrainConfig, Any]:
    """A configuration and its model after a few updates, with outputs large enough to differ from each other."""
    config = TrainConfig.from_dict(settings(algorithm, **changes))
    model = build_model(config)
    learn(model, config, [])
    for module in model.policy.modules():
        if isinstance(module, GainHead):
            module.layer.weight.data.mul_(8)
    return config, model


def test_environments_say_where_the_error_is() -> None:
    for env_id in IDS:
        scalar = gymnasium.make(env_id).unwrapped
        vector = gymnasium.make_vec(env_id, 2, "vector_entry_point").unwrapped
        if env_id.removeprefix("rj_gym/").rpartition("-")[0] not in SEEN:
            for env in (scalar, vector):
                with pytest.raises(ConfigError, match="tip error") as refused:
                    _ = env.observed_error
                assert "\n" not in str(refused.value)
            continue
        error: ObservedError = scalar.observed_error
        assert vector.observed_error == error
        if env_id in EXACT:
            observation, info = scalar.reset(seed=3)
            seen = error.unit_mm * observation[list(error.places)]
            np.testing.assert_allclose(seen, info["target"] - info["tip"], atol=1e-4)


def test_head_is_the_formula() -> None:
    torch.manual_seed(0)
    head = GainHead(5, 2, ObservedError((1, 3), 10.0))
    hidden, observation = torch.randn(4, 5), torch.randn(4, 6)
    y = head.layer(hidden).detach().numpy().astype(float)
    error = 10.0 * observation[:, [1, 3]].numpy().astype(float)
    size = np.linalg.norm(error, axis=1, keepdims=True)
    expected = np.einsum("bij,bj->bi", y[:, :4].reshape(4, 2, 2), error) / GAIN_MM + y[:, 4:] * size / (size + SCALE_MM)
    np.testing.assert_allclose(head(head.seen(hidden, observation)).detach().numpy(), expected, rtol=1e-4, atol=1e-5)


def test_gradients_are_finite_at_zero_error_and_meet_differences_elsewhere() -> None:
    torch.manual_seed(0)
    actor = FeedForwardActor(6, 2, [8, 8], error=ObservedError((4, 5), 10.0)).double()
    x = torch.randn(3, 6, dtype=torch.float64)
    x[0, 4:] = 0.0
    actor(x)[0].sum().backward()
    assert all(torch.isfinite(parameter.grad).all() for parameter in actor.parameters())
    assert torch.autograd.gradcheck(lambda z: actor(z)[0], x[1:].clone().requires_grad_())


@pytest.mark.parametrize("algorithm", list(PARAMETERS))
def test_no_error_no_action_whatever_else_is_seen(algorithm: str) -> None:
    config, model = made(algorithm)
    policy = export_policy(model, model.get_vec_normalize_env(), config.env, "own", TRAINING)
    assert isinstance(policy.network, GainNetwork)
    observation = model.observation_space.sample()
    observation[list(policy.network.error.places)] = 0.0
    assert np.abs(policy(observation)).max() == 0.0
    observation[policy.network.error.places[0]] = 0.1
    assert np.abs(policy(observation)).max() > 0.0
    close(model)


@pytest.mark.parametrize("algorithm", list(PARAMETERS))
def test_numpy_gives_the_actions_of_torch(algorithm: str) -> None:
    config, model = made(algorithm)
    normaliser = model.get_vec_normalize_env()
    policy = export_policy(model, normaliser, config.env, "own", TRAINING)
    assert policy.algorithm == algorithm and not policy.has_memory
    assert 0 < check_against_torch(policy, model, normaliser) < 1e-5
    assert ShippedPolicy.from_bytes(policy.to_bytes()).network.error == policy.network.error
    close(model)


def test_error_keeps_its_zero_and_its_unit_in_training() -> None:
    _, model = made("apg")
    running = model.get_vec_normalize_env().obs_rms
    places = list(model.policy.actor.head.error.places)
    assert running.count > 50 and not running.mean[places].any() and (running.var[places] == 1.0).all()
    others = np.setdiff1d(np.arange(len(running.mean)), places)
    assert (running.mean[others] != 0.0).any() and (running.var[others] != 1.0).all()
    close(model)


@pytest.mark.slow
def test_analytic_gradients_bring_the_tip_to_the_target_within_a_few_updates() -> None:
    parameters = {"learning_rate": {"linear": [1.6e-2, 1.0e-4]}, "optimizer": "muon"}
    env = {"n_envs": 16, "settings": {"episode_steps": 30}}
    values = settings(updates=30 * 5, env=env, parameters=parameters, policy={"hidden": [64, 64]})
    config = TrainConfig.from_dict(values)
    model = build_model(config)
    errors: list[float] = []
    loss = model.loss
    model.loss = lambda played: errors.append(played.errors[-5:].mean().item()) or loss(played)
    learn(model, config, [])
    assert np.mean(errors[-3:]) < 0.05 * np.mean(errors[:3])
    close(model)


@pytest.mark.parametrize("algorithm", ["apg", "ppo"])
@pytest.mark.parametrize(
    ("env_id", "key"), [("rj_gym/Instrument-v0", "tip error"), ("rj_gym/RollingJointGoal-v0", "tip error")]
)
def test_worlds_without_an_observed_error_are_refused_in_one_line(algorithm: str, env_id: str, key: str) -> None:
    with pytest.raises(ConfigError, match=key) as refused:
        build_model(TrainConfig.from_dict(settings(algorithm, env={"id": env_id})))
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("values", "key"),
    [
        (settings("apg", policy={"memory": 16}), "policy.memory"),
        (settings("apg", policy={"hidden": []}), "policy.hidden"),
        (settings("apg", parameters={"estimate_weight": 0.1}), "parameters.estimate_weight"),
        (settings("ppo", policy={"critic": "privileged"}), "policy.form"),
        (settings("sac", parameters={"use_sde": True}), "policy.form"),
        (settings("ppo", policy={"frames": 4}), "policy.form"),
        (settings("ppo", env={"id": "rj_gym/CurvatureDesign-v0", "settings": {}}), "policy.form"),
        (settings("ppo") | {"algorithm": "tqc", "parameters": {}}, "policy.form"),
        (settings("ppo") | {"algorithm": "recurrent_ppo", "policy": {"memory": None}}, "policy.memory"),
    ],
)
def test_settings_that_do_not_go_together_are_refused(values: dict[str, Any], key: str) -> None:
    with pytest.raises(ConfigError, match=key):
        TrainConfig.from_dict(values)


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["apg", "ppo"])
def test_a_run_that_was_stopped_ends_with_the_same_weights(
    algorithm: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    values = settings(
        algorithm, 6, evaluation={"every": 3 * LANES * STEPS, "episodes": 4}, checkpoint_every=2 * LANES * STEPS
    )
    check_that_a_stopped_run_ends_with_the_same_weights(values, tmp_path, monkeypatch)


def test_a_run_starts_as_the_policy_of_an_earlier_one(tmp_path: Path) -> None:
    (tmp_path / "run.yaml").write_text(dump_yaml(settings(evaluation={"every": LANES * STEPS, "episodes": 4})))
    assert train.main(["--config", str(tmp_path / "run.yaml"), "--run-dir", str(tmp_path / "first")]) == 0
    model = fresh_model(TrainConfig.from_dict(settings(start_from=str(tmp_path / "first"))))
    policy = load_trained(RunFolder.open(tmp_path / "first"))
    again = export_policy(model, model.get_vec_normalize_env(), TrainConfig.from_dict(settings()).env, "own", TRAINING)
    observation = model.observation_space.sample()[None]
    np.testing.assert_allclose(again(observation), policy.act(observation), atol=1e-6)
    close(model)


def test_a_damaged_form_is_refused_in_one_line() -> None:
    form = {"places": [1, 2], "unit_mm": 10.0, "gain_mm": 5.0, "scale_mm": 1.5}
    assert GainForm.from_dict(form).places == (1, 2)
    for change in ({"places": []}, {"places": [-1]}, {"unit_mm": 0.0}, {"scale_mm": "1"}, {"more": 1}):
        with pytest.raises((ConfigError, PolicyError)) as refused:
            GainForm.from_dict(form | change)
        assert "\n" not in str(refused.value)
