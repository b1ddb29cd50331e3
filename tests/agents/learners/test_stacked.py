"""Policies that see the newest observations at once: VecFrameStack in training, NumPy alone afterwards."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from agents.policies.content import network_in
from agents.policies.errors import PolicyError
from agents.policies.export import export_policy
from agents.policies.shipped import ShippedPolicy
from agents.policies.stacked import StackedNetwork
from agents.runs.config import TrainConfig, load_config
from agents.training.build import build_model, close
from agents.training.learn import learn
from rollingjoint.errors import ConfigError
from tests.agents.learners.checks import check_that_a_stopped_run_ends_with_the_same_weights

torch.set_num_threads(1)

STEPS, LANES, FRAMES = 10, 4, 3
TRAINING = {"config": {}, "steps": 0, "seed": 0, "versions": {}}


def settings(algorithm: str = "ppo", normalised: bool = False, **changes: Any) -> dict[str, Any]:
    """A small run on Instrument."""
    parameters = {"n_steps": STEPS, "batch_size": LANES * STEPS} if algorithm == "ppo" else {"learning_starts": 20}
    return {
        "algorithm": algorithm,
        "total_timesteps": 4 * LANES * STEPS,
        "env": {"id": "rj_gym/Instrument-v0", "n_envs": LANES, "settings": {"episode_steps": STEPS}},
        "parameters": parameters,
        "policy": {"hidden": [16], "frames": FRAMES},
        "normalise": {"observation": normalised, "reward": False},
        **changes,
    }


@pytest.mark.parametrize("normalised", [False, True])
@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_numpy_gives_the_actions_of_torch_through_the_ends_of_episodes(algorithm: str, normalised: bool) -> None:
    config = TrainConfig.from_dict(settings(algorithm, normalised))
    model = build_model(config)
    learn(model, config, [])
    normaliser = model.get_vec_normalize_env()
    if normaliser is not None:
        normaliser.training = False
    policy = export_policy(model, normaliser, config.env, "own", TRAINING)
    assert isinstance(policy.network, StackedNetwork) and policy.network.frames == FRAMES
    policy = ShippedPolicy.from_bytes(policy.to_bytes())
    lanes: Any = model.get_env()
    stacked, largest = lanes.reset(), 0.0
    policy.reset(LANES)
    for step in range(2 * STEPS):
        if step == STEPS:
            policy.reset(np.ones(LANES, bool))
        expected = model.predict(stacked, deterministic=True)[0]
        newest = lanes.unnormalize_obs(stacked) if normaliser is not None else stacked
        largest = max(largest, np.abs(policy(newest[:, -policy.network.entries :]) - expected).max())
        stacked, _, ended, _ = lanes.step(expected)
        assert ended.all() == (step % STEPS == STEPS - 1)
    assert largest < 1e-4
    close(model)


def test_a_run_that_was_stopped_ends_with_the_same_weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    values = settings(evaluation={"every": 2 * LANES * STEPS, "episodes": 4}, checkpoint_every=LANES * STEPS)
    check_that_a_stopped_run_ends_with_the_same_weights(values, tmp_path, monkeypatch)


@pytest.mark.parametrize(
    ("values", "key"),
    [
        (settings(residual="open loop"), "policy.frames"),
        (settings(policy={"frames": 2, "critic": "privileged"}), "policy.frames"),
        (settings() | {"algorithm": "apg", "parameters": {}}, "policy.frames"),
        (settings(policy={"frames": 0}), "policy.frames"),
    ],
)
def test_settings_that_do_not_go_together_are_refused(values: dict[str, Any], key: str) -> None:
    with pytest.raises(ConfigError, match=key):
        TrainConfig.from_dict(values)


def test_a_newcomers_configuration_is_stable_baselines3_by_default() -> None:
    config = load_config("configs/train/plain_ppo.yaml")
    model: Any = build_model(config)
    plain = type(model)("MlpPolicy", model.get_env(), device="cpu")
    for name in ("n_steps", "batch_size", "n_epochs", "gamma", "gae_lambda", "ent_coef", "vf_coef", "max_grad_norm"):
        assert getattr(model, name) == getattr(plain, name)
    assert model.learning_rate == plain.learning_rate and model.clip_range(1.0) == plain.clip_range(1.0)
    assert str(model.policy) == str(plain.policy)
    close(model)


def test_a_stack_of_another_size_is_refused_in_one_line() -> None:
    config = TrainConfig.from_dict(settings())
    model = build_model(config)
    network: Any = export_policy(model, None, config.env, "own", TRAINING).network
    for frames in (1, 5, FRAMES + 0.5):
        with pytest.raises(PolicyError) as refused:
            network_in(network.description() | {"frames": frames}, network.tensors())
        assert "\n" not in str(refused.value)
    with pytest.raises(PolicyError, match="one of every episode"):
        network.advance(np.zeros((2, network.entries), np.float32), network.start(3))
    close(model)
