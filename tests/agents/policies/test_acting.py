"""What a policy does with observations, and which environments it refuses to drive."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest

from agents.policies.file import pack, unpack
from agents.policies.network import Network, PolicyError
from agents.policies.shipped import ShippedPolicy
from rj_gym import TrackingConfig
from rj_gym.registry import task_of
from rj_gym.tracking.planar import PlanarTask
from rollingjoint.io.mechanism_file import load_mechanism
from tests.agents.policies.made_up import ARM, FILE, FLAT, GOAL, random_network, random_policy


@pytest.mark.parametrize(("activation", "output"), [("tanh", "clip"), ("relu", "tanh"), ("elu", "tanh")])
def test_batch_of_observations_gives_the_actions_of_its_rows(activation, output):
    network = random_network({}, 24, 2, activation, output)
    batch = np.random.default_rng(1).normal(size=(7, 24)).astype(np.float32) * 3
    actions = network(batch)
    assert actions.shape == (7, 2) and actions.dtype == np.float32
    assert np.abs(actions).max() <= 1
    assert np.allclose([network(row) for row in batch], actions, atol=1e-6)


def test_activations_are_those_of_their_definition():
    x = np.linspace(-3, 3, 13, dtype=np.float32)
    eye, zeros, wide = np.eye(13, dtype=np.float32), np.zeros(13, np.float32), np.full(13, 9, np.float32)
    for activation, expected in {
        "tanh": np.tanh(x),
        "relu": np.where(x > 0, x, 0),
        "elu": np.where(x > 0, x, np.exp(x) - 1),
    }.items():
        layers = [(eye, zeros), (eye, zeros)]
        network = Network({}, np.zeros(13), np.ones(13), np.full(13, 9.0), layers, activation, "clip", -wide, wide)
        assert np.allclose(network(x), expected, atol=1e-6), activation


def test_observation_is_normalised_and_clipped_before_the_first_layer():
    one, zero = np.ones((1, 1), np.float32), np.zeros(1, np.float32)
    wide = np.full(1, 99, np.float32)
    network = Network({}, np.array([2.0]), np.array([0.5]), np.array([3.0]), [(one, zero)], "tanh", "clip", -wide, wide)
    assert network(np.array([[2.5], [9.0], [-9.0]])).ravel().tolist() == [1.0, 3.0, -3.0]


def test_dictionary_is_concatenated_in_the_order_of_the_file_not_of_the_observation():
    policy = random_policy(GOAL)
    observation = policy.make_env().reset(seed=0)[0]
    backwards = dict(reversed(observation.items()))
    flat = np.concatenate([observation[key] for key in ("observation", "achieved_goal", "desired_goal")])
    assert np.array_equal(policy(backwards), replace(policy.network, inputs={})(flat))


@pytest.mark.parametrize(
    ("env_id", "observation", "message"),
    [
        (FLAT, np.zeros(23), r"\(23,\): expected finite numbers \(24,\)"),
        (FLAT, np.zeros((1, 1, 24)), r"\(24,\) or \(B, 24\)"),
        (FLAT, np.full(24, np.nan), "finite"),
        (FLAT, {"observation": np.zeros(24)}, "finite numbers"),
        (FLAT, "nonsense", "finite numbers"),
        (FLAT, [[1.0], [1.0, 2.0]], "finite numbers"),
        (GOAL, np.zeros(24), "a dictionary with the keys observation, achieved_goal, desired_goal"),
        (GOAL, {"observation": np.zeros(20)}, "dictionary with the keys"),
        (GOAL, {"observation": np.zeros((2, 20)), "achieved_goal": np.zeros(2), "desired_goal": np.zeros(2)}, "rows"),
    ],
)
def test_observation_that_does_not_fit_is_a_clear_error(env_id, observation, message):
    with pytest.raises(PolicyError, match=message):
        random_policy(env_id)(observation)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mechanism": "two_segment"}, "the mechanism that 'random' was trained on, 'five_link'"),
        ({"observe_load": True}, "load x .*the 24 observation entries that 'random' was trained on"),
        ({"observe_tensions": False}, "22 entries"),
        ({"command_scale_mm": 10}, r"tendon 0 command \[10 mm\]"),
        ({"action_scale_mm": 2}, "action_scale_mm = 2.0: expected 1, as in training"),
    ],
)
def test_policy_refuses_to_drive_another_environment(changes, message):
    with pytest.raises(PolicyError, match=message):
        random_policy().begin(PlanarTask(TrackingConfig(**changes)), 1)


def test_policy_refuses_a_mechanism_of_the_same_name_with_other_numbers():
    links = load_mechanism("five_link")
    other = type(links)(links.links, [replace(tendon, stiffness=9.0) for tendon in links.tendons], name=links.name)
    with pytest.raises(PolicyError, match="in every number"):
        random_policy().begin(PlanarTask(TrackingConfig(mechanism=other)), 1)
    with pytest.raises(PolicyError, match="not one of rj_gym"):
        random_policy().begin(None, 1)


def test_policy_drives_harder_episodes_of_its_environment():
    harder = TrackingConfig(load={"magnitude": (0, 1.5)}, randomization={"position_noise_mm": 1}, episode_steps=9)
    policy = random_policy()
    policy.begin(PlanarTask(harder), 1)
    with gymnasium.make(FLAT, config=harder) as env:
        assert policy.act(env.reset(seed=0)[0][None]).shape == (1, 2)


def test_policy_of_an_arm_and_one_of_a_chain_refuse_each_other_s_environment():
    arm, chain = random_policy(ARM), random_policy()
    for policy, other in ((arm, chain), (chain, arm)):
        with pytest.raises(PolicyError, match="in every number"):
            policy.begin(task_of(other.settings), 1)
    content, tensors = unpack(FILE, "x")
    content["environment"]["id"] = ARM
    with pytest.raises(PolicyError, match="PayloadConfig key = 'link'"):
        ShippedPolicy.from_bytes(pack(content, tensors))
