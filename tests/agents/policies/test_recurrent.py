"""Policies with memory: NumPy computes what torch computes over whole episodes, files keep it, reset() forgets."""

from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch
from stable_baselines3.common.vec_env import VecNormalize

from agents.controllers.policy import Policy
from agents.evaluation.rollout import run_episodes
from agents.learners.recurrent import RecurrentActor
from agents.policies.cells import Gru, Lstm
from agents.policies.conversion import recurrent_network
from agents.policies.export import check_against_torch
from agents.policies.file import pack, unpack
from agents.policies.network import PolicyError
from agents.policies.recorded_score import RecordedScore
from agents.policies.recurrent import RecurrentNetwork
from agents.policies.shipped import ShippedPolicy, entry_names, standalone
from agents.shipped import load_policy
from rj_gym import settings_of
from rj_gym.sb3 import make_sb3_env

torch.set_num_threads(1)

FLAT, GOAL = "rj_gym/RollingJoint-v0", "rj_gym/RollingJointGoal-v0"
CHANGES = {"episode_steps": 12, "load": {"magnitude": (0.0, 1.0)}}
TRAINING = {"config": {}, "steps": 0, "seed": 0, "versions": {}}


def random_actor(entries, actions=2, width=16):
    """An actor that has learned nothing, with weights so large that gates saturate and actions are clipped."""
    torch.manual_seed(0)
    actor = RecurrentActor(entries, actions, width)
    for parameter in actor.parameters():
        parameter.data.mul_(2.5)
    return actor


def random_normaliser():
    rng = np.random.default_rng(2)
    normaliser = VecNormalize(make_sb3_env(FLAT, 1, **CHANGES), training=False, clip_obs=2.0)
    normaliser.obs_rms.mean = rng.normal(0.0, 0.3, normaliser.obs_rms.mean.shape)
    normaliser.obs_rms.var = rng.uniform(0.05, 2.0, normaliser.obs_rms.var.shape)
    return normaliser


def policy_of(network, env_id=FLAT):
    config = standalone(settings_of(env_id)(**CHANGES))
    return ShippedPolicy("own", "distill", network, env_id, config, entry_names(config, env_id == GOAL), TRAINING)


@pytest.fixture(scope="module")
def normaliser():
    return random_normaliser()


@pytest.fixture
def actor():
    return random_actor(24)


@pytest.fixture
def policy(actor, normaliser):
    return policy_of(recurrent_network(actor, normaliser))


def observations(steps, rows, entries=24):
    return np.random.default_rng(1).normal(size=(steps, rows, entries)).astype(np.float32) * 2


def actions_of(policy, sequence):
    return np.stack([policy(observation) for observation in sequence])


def test_numpy_and_torch_give_the_same_actions_over_an_episode(normaliser):
    actor, seen = random_actor(24, width=128), observations(50, 7)
    network = recurrent_network(actor, normaliser)
    memory = state = None
    actions, expected = [], []
    for observation in seen:
        action, memory = network.advance(observation, memory)
        correct, state = actor.predict(normaliser.normalize_obs(observation), state)
        actions.append(action)
        expected.append(correct)
    assert actions[0].dtype == np.float32
    assert 0.1 < np.mean(np.abs(expected)) < 0.9 and np.max(np.abs(actions)) == 1
    assert np.abs(np.array(actions) - expected).max() < 1e-5


@pytest.mark.parametrize(("cell", "module"), [(Gru, torch.nn.GRU), (Lstm, torch.nn.LSTM)])
def test_cells_are_those_of_torch(cell, module):
    torch.manual_seed(0)
    layer = module(5, 8, batch_first=True)
    for parameter in layer.parameters():
        parameter.data.mul_(4)
    arrays = [parameter.detach().numpy() for parameter in layer.parameters()]
    numpy_cell, seen = cell(*arrays), observations(50, 3, 5)
    memory = np.zeros((3, 8 * cell.STATES), np.float32)
    outputs = []
    for x in seen:
        memory = numpy_cell.step(x, memory)
        outputs.append(memory[:, :8])
    with torch.no_grad():
        expected = layer(torch.as_tensor(seen).transpose(0, 1))[0].numpy().transpose(1, 0, 2)
    assert np.abs(expected).max() > 0.9
    assert np.abs(np.array(outputs) - expected).max() < 1e-5


def test_whole_sequences_give_the_actions_of_single_steps(actor):
    seen, state, singles = observations(9, 3), None, []
    for x in seen:
        action, state = actor.predict(x, state)
        singles.append(action)
    with torch.no_grad():
        together, memory = actor(torch.as_tensor(seen).transpose(0, 1))
    assert np.allclose(together.clamp(-1, 1).numpy().transpose(1, 0, 2), singles, atol=1e-6)
    assert np.allclose(memory[0], state, atol=1e-6)


def test_torch_module_forgets_where_an_episode_starts(actor):
    first, second = observations(2, 3)
    state = actor.predict(first)[1]
    action, _ = actor.predict(second, state, np.array([True, False, True]))
    fresh, later = actor.predict(second)[0], actor.predict(second, state)[0]
    assert np.allclose(action, np.stack([fresh[0], later[1], fresh[2]]), atol=1e-6)
    assert np.abs(fresh - later).max() > 1e-3


def test_actions_depend_on_the_episode_and_reset_begins_another(policy):
    seen = observations(5, 3)
    first, goes_on = actions_of(policy, seen), actions_of(policy, seen)
    policy.reset()
    again = actions_of(policy, seen)
    policy.reset(3)
    once_more = actions_of(policy, seen)
    assert np.abs(first - goes_on).max() > 1e-3
    assert np.array_equal(first, again) and np.array_equal(first, once_more)
    assert policy.has_memory


def test_rows_remember_their_own_episode(policy):
    seen = observations(5, 3)
    together = actions_of(policy, seen)
    for row in range(3):
        policy.reset()
        alone = actions_of(policy, seen[:, row])
        assert alone.shape == (5, 2)
        assert np.allclose(alone, together[:, row], atol=1e-5)


def test_other_number_of_rows_than_the_memory_has_is_refused(policy):
    policy(np.zeros((3, 24)))
    for rows in (np.zeros(24), np.zeros((4, 24))):
        with pytest.raises(PolicyError, match=r"observations = \d: expected 3.*reset\(\)") as raised:
            policy(rows)
        assert "\n" not in str(raised.value)
    policy.reset(4)
    with pytest.raises(PolicyError, match="expected 4"):
        policy(np.zeros(24))
    assert policy(np.zeros((4, 24))).shape == (4, 2)


def test_observation_that_is_refused_does_not_advance_the_memory(policy):
    seen = observations(2, 1)[:, 0]
    expected = actions_of(policy, seen)
    policy.reset()
    policy(seen[0])
    with pytest.raises(PolicyError, match="finite"):
        policy(np.full(24, np.nan))
    assert np.array_equal(policy(seen[1]), expected[1])


def test_episodes_to_begin_are_a_count(policy):
    for episodes in (0, -1, 1.5, "x"):
        with pytest.raises(PolicyError, match="episodes"):
            policy.reset(episodes)
        with pytest.raises(PolicyError, match="episodes"):
            load_policy("fixed_target").reset(episodes)


def test_policy_without_memory_is_reset_without_effect():
    policy = load_policy("fixed_target")
    observation = policy.make_env().reset(seed=0)[0]
    first = policy(observation)
    policy.reset(7)
    assert np.array_equal(policy(observation), first)
    assert not policy.has_memory
    assert policy(np.stack([observation] * 3)).shape == (3, 2)


def test_episodes_begin_without_memory_whatever_the_batch(policy):
    seeds = range(20_000, 20_006)
    first = run_episodes(policy.environment, policy, seeds)
    again = run_episodes(policy.environment, policy, seeds, batch=4)
    assert np.allclose(first.errors, again.errors, atol=1e-4)


def test_torch_policy_carries_its_memory_through_an_episode_and_begins_without(policy, actor, normaliser):
    trained, seeds = Policy(actor, normaliser), range(20_000, 20_004)
    errors = [run_episodes(policy.environment, one, seeds).errors for one in (policy, trained, trained)]
    assert np.abs(errors[1] - errors[0]).max() < 1e-3
    assert np.array_equal(errors[1], errors[2])


def test_check_against_torch_runs_whole_episodes_with_memory(policy, actor, normaliser):
    assert check_against_torch(policy, actor, normaliser, episodes=3) < 1e-5
    assert policy(np.zeros(24)).shape == (2,)  # a new episode, whatever number of them the check had
    actor.cell.weight_hh_l0.data.add_(1e-3)  # of no effect in the first step
    with pytest.raises(PolicyError, match="NumPy minus torch"):
        check_against_torch(policy, actor, normaliser, episodes=3)


def test_written_policy_is_read_back_to_the_last_bit_and_scores_again(policy):
    seeds = range(20_000, 20_005)
    policy = replace(policy, score=RecordedScore.of(policy.score_on(seeds), seeds))
    again = ShippedPolicy.from_bytes(policy.to_bytes())
    assert again.to_bytes() == policy.to_bytes() and again.sha256 == policy.sha256
    assert isinstance(again.network, RecurrentNetwork)
    assert again.network.hidden == [16, 16, 16]
    assert again.score.complaints(again.rescore()) == []
    forgetful = replace(again.network.cell, memory_weights=np.zeros_like(again.network.cell.memory_weights))
    worse = replace(again, network=replace(again.network, cell=forgetful))
    assert again.score.complaints(worse.rescore())


def test_goals_are_concatenated_before_the_encoder():
    entries = {"observation": 20, "achieved_goal": 2, "desired_goal": 2}
    network = replace(recurrent_network(random_actor(24)), inputs=entries)
    policy = ShippedPolicy.from_bytes(policy_of(network, GOAL).to_bytes())
    observation = gymnasium.make(GOAL, **CHANGES).reset(seed=0)[0]
    flat = np.concatenate([observation[key] for key in entries])
    assert np.array_equal(policy(observation), replace(network, inputs={}).advance(flat, None)[0])


def test_cell_without_encoder_or_shortcut_is_kept_in_a_file(policy):
    rng = np.random.default_rng(0)
    arrays = [rng.normal(size=shape).astype(np.float32) for shape in ((32, 24), (32, 8), (32,), (32,), (2, 8), (2,))]
    changes = {"encoder": [], "cell": Lstm(*arrays[:4]), "layers": [tuple(arrays[4:])], "shortcut": False}
    own = policy_of(replace(policy.network, **changes))
    again, seen = ShippedPolicy.from_bytes(own.to_bytes()), observations(5, 2)
    assert again.network.hidden == [8]
    assert np.array_equal(actions_of(again, seen), actions_of(own, seen))


def test_files_with_memory_have_a_format_of_their_own(policy):
    data = policy.to_bytes()
    assert data.count(b'\\"format\\":2') == 1
    assert load_policy("fixed_target").to_bytes().count(b'\\"format\\":1') == 1
    with pytest.raises(PolicyError, match="format = 1: expected 2"):
        ShippedPolicy.from_bytes(data.replace(b'\\"format\\":2', b'\\"format\\":1'))


def test_kind_of_a_network_without_memory_may_be_spelt_out():
    policy = load_policy("fixed_target")
    content, tensors = unpack(policy.to_bytes(), "x")
    content["network"]["kind"] = "feedforward"
    assert ShippedPolicy.from_bytes(pack(content, tensors)).to_bytes() == policy.to_bytes()


def set_tensor(name, values):
    return lambda content, tensors: tensors.update({name: np.array(values, np.float32)})


def describe(**changes):
    return lambda content, tensors: content["network"].update(changes)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (describe(kind="transformer"), "network.kind = 'transformer': expected"),
        (describe(kind="feedforward"), "feedforward|cell"),
        (describe(cell="rnn"), "cell = 'rnn': expected one of gru, lstm"),
        (describe(cell="lstm"), r"cell\.memory_weights = \(48, 16\)"),
        (describe(shortcut=1), "shortcut = 1: expected true or false"),
        (describe(shortcut=False), "layer 0"),
        (describe(activation="gelu"), "activation = 'gelu'"),
        (lambda content, tensors: content["network"].pop("cell"), "'cell'"),
        (lambda content, tensors: tensors.pop("cell.memory_biases"), "tensors"),
        (lambda content, tensors: tensors.pop("encoder.biases.0"), "tensors|encoder"),
        (set_tensor("extra", np.zeros(3)), "tensors"),
        (set_tensor("cell.input_biases", np.full(48, np.nan)), "cell.input_biases = 'NaN or infinity'"),
        (set_tensor("cell.memory_weights", np.zeros((48, 15))), r"cell\.memory_weights = \(48, 15\)"),
        (set_tensor("cell.memory_biases", np.zeros(47)), r"cell\.memory_biases = \(47,\)"),
        (set_tensor("encoder.weights.0", np.zeros((16, 23))), "encoder layer 0"),
        (set_tensor("weights.0", np.zeros((16, 31))), "layer 0"),
    ],
)
def test_file_whose_parts_do_not_fit_is_a_clear_error(change, message, policy):
    content, tensors = unpack(policy.to_bytes(), "x")
    change(content, tensors)
    with pytest.raises(PolicyError, match=message) as raised:
        ShippedPolicy.from_bytes(pack(content, tensors), "own.safetensors")
    assert "own.safetensors" in str(raised.value) and "\n" not in str(raised.value)


def test_page_on_policies_names_every_key_and_tensor_of_a_policy_with_memory(policy):
    page = Path("docs/policies.md").read_text()
    content, tensors = unpack(policy.to_bytes(), "")
    network = content["network"]
    names = {*network, network["kind"], network["cell"], *tensors} - {"weights.1", "biases.1"}
    assert [name for name in sorted(names) if f"`{name}`" not in page] == []
