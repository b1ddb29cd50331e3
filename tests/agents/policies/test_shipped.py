"""Shipped policies: each scores as recorded, runs without torch, and no foreign file gets past the loader."""

import json
from dataclasses import fields, replace
from itertools import pairwise

import gymnasium
import numpy as np
import pytest
import safetensors.numpy
from hypothesis import example, given, settings
from hypothesis import strategies as st

from agents.evaluation.controller import Seen
from agents.policies import file as policy_file
from agents.policies.file import SUFFIX, pack, unpack
from agents.policies.loading import FOLDER
from agents.policies.network import Network, PolicyError
from agents.policies.recorded_score import ERRORS, SHARES, RecordedScore
from agents.policies.shipped import ShippedPolicy, entry_names, standalone
from agents.shipped import list_policies, load_policy
from rj_gym import TrackingConfig, settings_of
from rj_gym.core.registry import task_of
from rj_gym.planar.task import PlanarTask
from rollingjoint.errors import RollingJointError
from rollingjoint.io.mechanism_file import load_mechanism

FILES = sorted(FOLDER.glob("*.safetensors"))
FLAT, GOAL = "rj_gym/RollingJoint-v0", "rj_gym/RollingJointGoal-v0"
ARM, ARM_GOAL = "rj_gym/FlexibleArm-v0", "rj_gym/FlexibleArmGoal-v0"


def random_network(inputs, entries, actions, activation="tanh", output="clip"):
    rng = np.random.default_rng(0)
    widths = [entries, 5, 4, actions]
    layers = [
        (rng.normal(size=(after, before)).astype(np.float32), rng.normal(size=after).astype(np.float32))
        for before, after in pairwise(widths)
    ]
    normaliser = rng.normal(size=entries), rng.uniform(0.5, 2.0, entries), np.full(entries, 10.0)
    bounds = -np.ones(actions, np.float32), np.ones(actions, np.float32)
    return Network(inputs, *normaliser, layers, activation, output, *bounds)


def random_policy(env_id=FLAT, **changes):
    """A policy that has learned nothing."""
    config = standalone(settings_of(env_id)(**changes))
    goal, size = env_id in (GOAL, ARM_GOAL), len(task_of(config).goal_bounds())
    entries = entry_names(config, goal)
    inputs = {"observation": len(entries), "achieved_goal": size, "desired_goal": size} if goal else {}
    network = random_network(inputs, sum(inputs.values()) or len(entries), config.mechanism.n_tendons)
    training = {"config": {"seed": 1}, "steps": 40, "seed": 1, "versions": {"python": "3"}}
    record = RecordedScore(20_000, 4, dict.fromkeys(ERRORS + SHARES, 0.5), dict.fromkeys(ERRORS + SHARES, 0.1))
    return ShippedPolicy("random", "ppo", network, env_id, config, entries, training, record)


FILE = random_policy(load={"magnitude": (0.0, 1.5)}, target={"process": "path"}).to_bytes()


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_shipped_policy_scores_within_its_recorded_band(path):
    policy = load_policy(path)
    assert policy.name == path.stem
    assert policy.score.episodes >= 200
    assert policy.score.complaints(policy.rescore()) == []


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_shipped_policy_is_small_and_says_where_it_comes_from(path):
    policy = load_policy(path)
    assert path.stat().st_size < 100_000
    assert {"torch", "stable-baselines3", "rollingjoint", "python"} <= policy.training["versions"].keys()
    assert policy.training["config"]["algorithm"] == policy.algorithm
    assert policy.training["steps"] > 0
    assert "/" not in json.dumps(policy.to_dict()).replace(policy.env_id, "").replace("[N/mm]", "")


class Noisy(ShippedPolicy):
    """A policy whose actions are off in the last bits, as on another machine."""

    def __call__(self, observation):
        action = super().__call__(observation)
        return action + np.random.default_rng(0).uniform(-1e-6, 1e-6, action.shape).astype(np.float32)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_last_bits_move_a_score_by_less_than_a_tenth_of_its_tolerance(path):
    policy = load_policy(path)
    noisy = Noisy(**{field.name: getattr(policy, field.name) for field in fields(policy)}).rescore()
    assert noisy != policy.rescore()
    tenths = {name: tolerance / 10 for name, tolerance in policy.score.tolerances.items()}
    assert replace(policy.score, tolerances=tenths).complaints(noisy) == []


def test_score_that_leaves_the_band_is_noticed():
    policy = load_policy("fixed_target")
    layers = [(weights, biases + np.float32(0.1)) for weights, biases in policy.network.layers]
    worse = replace(policy, network=replace(policy.network, layers=layers))
    assert any("mean_mm" in line for line in policy.score.complaints(worse.rescore()))


def test_nothing_but_numpy_runs_a_policy(run_python):
    program = """
import sys
from agents.shipped import load_policy
policy = load_policy("fixed_target")
env = policy.make_env()
observation, info = env.reset(seed=20000)
for _ in range(50):
    observation, reward, terminated, truncated, info = env.step(policy(observation))
print(info["error_mm"] < 1, truncated, sorted({"torch", "stable_baselines3", "pickle5"} & sys.modules.keys()))
"""
    assert run_python("-c", program).split("\n")[0] == "True True []"


@pytest.mark.parametrize(("env_id", "changes"), [(FLAT, {}), (GOAL, {}), (ARM, {}), (ARM_GOAL, {"orientation": True})])
def test_written_policy_is_read_back_to_the_last_bit(env_id, changes):
    policy = random_policy(env_id, observe_load=True, randomization={"stiffness_spread": 0.1}, **changes)
    again = ShippedPolicy.from_bytes(policy.to_bytes())
    assert again.to_bytes() == policy.to_bytes()
    assert again.sha256 == policy.sha256
    name = policy.mechanism.name
    assert again.settings.updated({"mechanism": name}) == policy.settings.updated({"mechanism": name})
    with again.make_env() as env:
        observation, _ = env.reset(seed=3)
        assert np.array_equal(again(observation), policy(observation))


def test_policy_file_stands_alone_without_the_mechanism_file(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text((FOLDER.parent.parent / "configs/mechanism/two_segment.yaml").read_text())
    policy = random_policy(mechanism=str(path))
    path.unlink()
    again = ShippedPolicy.from_bytes(policy.to_bytes())
    assert again.make_env().action_space.shape == (4,)
    again.begin(PlanarTask(policy.settings), 1)


def test_file_cannot_name_another_file_as_its_mechanism():
    content, tensors = unpack(FILE, "x")
    content["environment"]["settings"]["mechanism"] = "configs/mechanism/two_segment.yaml"
    with pytest.raises(PolicyError, match="mechanism"):
        ShippedPolicy.from_bytes(pack(content, tensors))


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
        assert policy.act(Seen(env.reset(seed=0)[0][None], env.unwrapped.task)).shape == (1, 2)


def test_policy_of_an_arm_and_one_of_a_chain_refuse_each_other_s_environment():
    arm, chain = random_policy(ARM), random_policy()
    for policy, other in ((arm, chain), (chain, arm)):
        with pytest.raises(PolicyError, match="in every number"):
            policy.begin(task_of(other.settings), 1)
    content, tensors = unpack(FILE, "x")
    content["environment"]["id"] = ARM
    with pytest.raises(PolicyError, match="PayloadConfig key = 'link'"):
        ShippedPolicy.from_bytes(pack(content, tensors))


def test_policy_that_was_never_scored_cannot_be_scored_again():
    with pytest.raises(PolicyError, match="a policy that was scored when it was exported"):
        replace(random_policy(), score=None).rescore()


def resealed(change):
    """A policy file with a valid sum whose content went through `change`."""
    content, tensors = unpack(FILE, "x")
    change(content, tensors)
    return pack(content, tensors)


def set_tensor(name, values, kind=None):
    return lambda content, tensors: tensors.update({name: np.array(values, kind or tensors[name].dtype)})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (set_tensor("biases.0", np.full(5, np.nan)), "biases.0 = 'NaN or infinity'"),
        (set_tensor("weights.1", np.full((4, 5), np.inf)), "weights.1 = 'NaN or infinity'"),
        (set_tensor("mean", np.zeros(23)), r"mean = \(23,\)|layer 0"),
        (set_tensor("scale", np.zeros(24)), "above zero"),
        (set_tensor("low", np.ones(2)), "less than high"),
        (set_tensor("low", np.zeros(3)), r"low = \(3,\)"),
        (set_tensor("weights.1", np.zeros((4, 6))), "layer 1"),
        (set_tensor("weights.1", np.zeros(20)), "layer 1"),
        (set_tensor("weights.2", np.zeros((0, 4))), "layer 2|not empty"),
        (set_tensor("biases.1", np.zeros(4), np.float64), "biases.1 = 'float64': expected float32"),
        (set_tensor("extra", np.zeros(4), np.float32), "tensors"),
        (lambda content, tensors: tensors.pop("biases.2"), "tensors"),
        (lambda content, tensors: tensors.pop("mean"), "tensors"),
        (lambda content, tensors: content.pop("training"), "'training'"),
        (lambda content, tensors: content.update(more=1), "more"),
        (lambda content, tensors: content.update(name=3), "name = 3"),
        (lambda content, tensors: content["network"].update(activation="gelu"), "activation = 'gelu'"),
        (lambda content, tensors: content["network"].update(output="exp"), "output = 'exp'"),
        (lambda content, tensors: content["network"].update(inputs={"observation": 24}), "inputs"),
        (lambda content, tensors: content["network"].update(inputs=[1]), "AttributeError|inputs"),
        (lambda content, tensors: content["environment"].update(id="CartPole-v1"), "environment = 'CartPole-v1'"),
        (lambda content, tensors: content["environment"].update(id=GOAL), "inputs"),
        (lambda content, tensors: content["environment"]["entries"].reverse(), "observation entries"),
        (lambda content, tensors: content["environment"]["settings"].update(lod={}), "lod.*load"),
        (lambda content, tensors: content["environment"]["settings"].update(start_tension=10**400), "start_tension"),
        (lambda content, tensors: content["score"]["values"].pop("mean_mm"), "mean_mm"),
        (lambda content, tensors: content["score"].update(episodes=-1), "score.episodes"),
    ],
)
def test_file_whose_parts_do_not_fit_is_a_clear_error(change, message):
    with pytest.raises(PolicyError, match=message) as raised:
        ShippedPolicy.from_bytes(resealed(change), "own.safetensors")
    assert "own.safetensors" in str(raised.value)


def edited(data, old, new):
    assert data.count(old) == 1 and len(old) == len(new)
    return data.replace(old, new)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "a file that agents.export wrote"),
        (b"\xff" * 64, "a file that agents.export wrote"),
        ((2**62).to_bytes(8, "little") + b"{}", "a file that agents.export wrote"),
        ((99_999_999).to_bytes(8, "little") + b"{" * 1000, "a file that agents.export wrote"),
        (FILE[:-1], "a file that agents.export wrote"),
        (FILE + b"\0", "a file that agents.export wrote"),
        (safetensors.numpy.save({"a": np.zeros(1)}), "a file that agents.export wrote"),
        (safetensors.numpy.save({"a": np.zeros(1)}, {"policy": "[" * 100_000}), "RecursionError"),
        (safetensors.numpy.save({"a": np.zeros(1)}, {"policy": "[]"}), "a file that agents.export wrote"),
        (edited(FILE, b'\\"format\\":1', b'\\"format\\":2'), "format = 2: expected 1"),
        (edited(FILE, b'\\"steps\\":40', b'\\"steps\\":90'), "damaged or edited"),
        (FILE[:-1] + bytes([FILE[-1] ^ 1]), "damaged or edited"),
    ],
)
def test_file_that_is_none_of_ours_or_was_edited_is_a_clear_error(data, message):
    with pytest.raises(PolicyError, match=message):
        ShippedPolicy.from_bytes(data)


def accepted(data):
    """The policy in the file, or None if the loader refused it with an error of ours."""
    try:
        return ShippedPolicy.from_bytes(data)
    except RollingJointError:
        return None


@settings(max_examples=250, deadline=None)
@given(
    start=st.integers(0, len(FILE)),
    removed=st.integers(0, 20),
    put=st.binary(max_size=20),
    end=st.integers(0, len(FILE)) | st.just(len(FILE)),
)
@example(start=0, removed=0, put=b"", end=len(FILE))
def test_damaged_bytes_never_give_another_policy_or_a_foreign_error(start, removed, put, end):
    policy = accepted((FILE[:start] + put + FILE[start + removed :])[:end])
    assert policy is None or policy.to_bytes() == FILE


@settings(max_examples=200, deadline=None)
@given(place=st.integers(0, len(FILE) - 1), bit=st.integers(0, 7))
def test_flipped_bit_never_gives_another_policy(place, bit):
    damaged = bytearray(FILE)
    damaged[place] ^= 1 << bit
    policy = accepted(bytes(damaged))
    assert policy is None or policy.to_bytes() == FILE


STRANGE = st.sampled_from(
    [None, True, -1, 0, 1e300, -1e300, 10**400, 2**63, "", "x", "\0", [], [[]], {}, {"a": 1}, [None] * 3, [1e300] * 2]
)


def places(value):
    """Every container in nested plain values, with each of its keys."""
    for key in value if isinstance(value, dict) else range(len(value)):
        yield value, key
        if isinstance(value[key], dict | list):
            yield from places(value[key])


@settings(max_examples=100, deadline=None)
@given(number=st.integers(0, 10**6), strange=STRANGE, delete=st.booleans())
def test_strange_value_anywhere_in_the_description_gives_no_foreign_error(number, strange, delete):
    content, tensors = unpack(FILE, "x")
    everywhere = list(places(content))
    container, key = everywhere[number % len(everywhere)]
    if delete:
        del container[key]
    else:
        container[key] = strange
    accepted(pack(content, tensors))


def test_file_beyond_the_largest_size_is_not_read(tmp_path, monkeypatch):
    path = tmp_path / "large.safetensors"
    path.write_bytes(FILE)
    monkeypatch.setattr(policy_file, "LARGEST_FILE", len(FILE) - 1)
    with pytest.raises(PolicyError, match="at most"):
        load_policy(path)


def test_unknown_name_gets_the_nearest_one_and_a_folder_is_no_policy(tmp_path):
    with pytest.raises(PolicyError, match="Did you mean 'fixed_target'"):
        load_policy("fixed_targt")
    with pytest.raises(PolicyError, match="a policy file or one of"):
        load_policy(tmp_path)
    assert "fixed_target" in list_policies()


def test_zip_is_refused_with_the_reason_and_the_way(tmp_path):
    (tmp_path / "policy.zip").write_bytes(b"PK")
    with pytest.raises(PolicyError, match=r"holds pickles.*run any code.*trust_pickle=True") as raised:
        load_policy(tmp_path / "policy.zip")
    assert "a .safetensors file" in str(raised.value)


def test_every_shipped_policy_goes_into_the_package():
    import tomllib

    packages = tomllib.loads((FOLDER.parent.parent / "pyproject.toml").read_text())["tool"]["setuptools"]
    assert "policies/*.safetensors" in packages["package-data"]["agents"]
    assert {path.suffix for path in FOLDER.iterdir() if path.name != "__pycache__"} == {SUFFIX, ".py"}
