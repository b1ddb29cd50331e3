"""The temporal convolution over past readings."""

import numpy as np
import pytest
import torch
from gymnasium import spaces

from agents.controllers.policy import Policy
from agents.policies.export import check_against_torch, export_policy
from agents.policies.shipped import ShippedPolicy
from agents.policies.trained import policy_of
from agents.runs.config import TrainConfig
from agents.training.build import build_model
from agents.training.convolution import PastConvolution, past_places
from agents.training.learn import learn
from rj_gym.core.task import Entry
from rollingjoint.errors import ConfigError

INSTRUMENT = "rj_gym/Instrument-v0"
STEPS = 8
TRAINING = {"config": {}, "steps": 0, "seed": 0, "versions": {}}
OFF_POLICY = {"buffer_size": 1000, "learning_starts": 40}
LEARNERS = {
    "ppo": {"parameters": {"n_steps": 2 * STEPS, "batch_size": 32, "n_epochs": 1}},
    "ppo with a privileged critic": {
        "parameters": {"n_steps": 2 * STEPS, "batch_size": 32, "n_epochs": 1},
        "policy": {"critic": "privileged"},
    },
    "sac": {"algorithm": "sac", "parameters": OFF_POLICY},
    "tqc": {"algorithm": "tqc", "parameters": OFF_POLICY},
    "crossq": {"algorithm": "crossq", "parameters": OFF_POLICY},
}


def config(history=5, env_id=INSTRUMENT, **changes) -> TrainConfig:
    env = {"id": env_id, "n_envs": 4, "settings": {"episode_steps": STEPS, "observe_history": history}}
    policy = {"hidden": [8], "convolution": 6} | changes.pop("policy", {})
    return TrainConfig.from_dict({"total_timesteps": 128, "env": env, "policy": policy, **changes})


def test_features_are_the_last_output_of_dilated_causal_convolutions():
    torch.manual_seed(0)
    steps, channels, present, width = 27, 2, 3, 5
    entries = present + steps * channels
    lags = [list(range(entries - channels * (age + 1), entries - channels * age)) for age in range(steps)]
    extractor = PastConvolution(box(entries), lags, width, torch.nn.Tanh)
    x = torch.randn(4, entries)
    sequence = torch.stack([x[:, places] for places in lags], -1)  # (B, channels, steps), the oldest first
    constant = x[:, :present, None].expand(-1, -1, steps)
    dilation = 1
    for layer in extractor.layers[::2]:
        of_steps = layer.linear.weight[:, : 3 * sequence.shape[1]].unflatten(1, (3, -1)).transpose(1, 2)
        padded = torch.nn.functional.pad(sequence, (2 * dilation, 0))
        sequence = torch.nn.functional.conv1d(padded, of_steps, layer.linear.bias, dilation=dilation)
        if dilation == 1:
            sequence = sequence + torch.einsum("oi,bis->bos", layer.linear.weight[:, 3 * channels :], constant)
        sequence, dilation = torch.tanh(sequence), 3 * dilation
    assert len(extractor.layers) == 6
    torch.testing.assert_close(extractor(x), sequence[..., -1])


@pytest.mark.parametrize("steps", [1, 2, 3, 4, 10, 28])
def test_every_reading_counts_whatever_their_number(steps):
    torch.manual_seed(1)
    extractor = PastConvolution(box(2 + steps), [[2 + steps - 1 - age] for age in range(steps)], 4, torch.nn.Tanh)
    x = torch.randn(1, 2 + steps, requires_grad=True)
    extractor(x).sum().backward()
    assert (x.grad != 0).all()


def test_places_of_past_readings_are_found_by_their_lags():
    names = [
        "tendon 0 command",
        "tendon 0 action, lag 1",
        "tendon 0 action, lag 4",
        "tendon 0 tension, lag 1",
        "target x",
    ]
    assert past_places([Entry(name, "", 0.0, 1.0) for name in names]) == [[2], [1, 3]]


@pytest.mark.slow
@pytest.mark.parametrize("name", LEARNERS)
def test_a_policy_with_a_convolution_learns_and_acts_alike_in_numpy(name):
    settings = config(**LEARNERS[name])
    model = build_model(settings)
    before = {key: value.clone() for key, value in model.policy.named_parameters()}
    learn(model, settings, [])
    after = dict(model.policy.named_parameters())
    if name.startswith("ppo"):
        assert [key for key, value in before.items() if torch.equal(value, after[key])] == []
    normaliser = model.get_vec_normalize_env()
    policy = export_policy(model, normaliser, settings.env, "own", TRAINING)
    assert check_against_torch(policy, model, normaliser) < 1e-5
    assert not policy.has_memory
    again = ShippedPolicy.from_bytes(policy.to_bytes())
    seen = np.random.default_rng(0).normal(size=(3, policy.network.entries)).astype(np.float32)
    ours, theirs = policy_of(model, normaliser), Policy(model, normaliser)
    np.testing.assert_allclose(again(seen), theirs.act(seen), atol=2e-6)
    np.testing.assert_array_equal(again(seen), ours.act(seen))
    assert policy.network.hidden == [12, 6, 8]  # five steps are two groups, and then one


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"history": 0},
            r"policy.convolution = 6: expected null where no past readings are observed. .*observe_history",
        ),
        ({"env_id": "CartPole-v1"}, "no past readings"),
        ({"algorithm": "recurrent_ppo"}, "a width with ppo, sac, tqc, crossq"),
        ({"algorithm": "apg"}, "a width with ppo, sac, tqc, crossq"),
        ({"residual": "open loop"}, "null with residual"),
        ({"policy": {"convolution": 0}}, "policy.convolution = 0"),
    ],
)
def test_a_convolution_that_has_nothing_to_see_or_no_place_is_refused(changes, message):
    with pytest.raises(ConfigError, match=message):
        config(**changes)


def box(entries):
    return spaces.Box(-1.0, 1.0, (entries,), np.float32)
