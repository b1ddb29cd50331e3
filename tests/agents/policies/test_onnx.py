"""Policies as ONNX files: a runtime gives the actions of NumPy, and the contract says what the numbers mean."""

import json
import shutil
from itertools import pairwise
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest

from agents import export
from agents.policies.cells import Gru, Lstm
from agents.policies.contract import contract, contract_text
from agents.policies.loading import FOLDER
from agents.policies.network import OUTPUTS, Network
from agents.policies.onnx_file import onnx_model, write_onnx
from agents.policies.recurrent import RecurrentNetwork
from agents.policies.shipped import ShippedPolicy, entry_names, standalone
from agents.runs.environment import make_vector_env
from agents.shipped import load_policy
from rj_gym import settings_of

LARGEST_DIFFERENCE = 1e-5
TRAINING = {"config": {}, "steps": 0, "seed": 0, "versions": {}}
FLAT, GOAL, ARM_GOAL = "rj_gym/RollingJoint-v0", "rj_gym/RollingJointGoal-v0", "rj_gym/FlexibleArmGoal-v0"


def session(model):
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    return onnxruntime.InferenceSession(model.SerializeToString(), options, providers=["CPUExecutionProvider"])


@pytest.mark.parametrize("name", ["fixed_target", "two_segment", "flexible_arm", "instrument", "arm_instrument"])
def test_runtime_and_numpy_each_drive_whole_episodes_alike(name):
    """Each carries its own memory through the episodes that NumPy drives."""
    policy, largest = load_policy(name), 0.0
    runtime, envs = session(onnx_model(policy)), make_vector_env(policy.environment, 8)
    observation, _ = envs.reset(seed=20_000)
    policy.reset(8)
    memory = {"memory": policy.network.start(8)} if policy.has_memory else {}
    for _ in range(policy.settings.episode_steps):
        action = policy(observation)
        found, *after = runtime.run(None, {"observation": observation, **memory})
        largest = max(largest, float(np.abs(found - action).max()))
        memory = {"memory": after[0]} if after else {}
        observation = envs.step(action)[0]
    assert largest < LARGEST_DIFFERENCE


def random_layers(rng, *widths):
    """Weights so large that activations saturate and actions reach their bounds."""
    pairs = [(rng.normal(size=(after, before)), rng.normal(size=after)) for before, after in pairwise(widths)]
    return [(weights.astype(np.float32), biases.astype(np.float32)) for weights, biases in pairs]


def normaliser(rng, entries):
    return rng.normal(size=entries), rng.uniform(0.1, 2.0, entries), rng.uniform(0.5, 3.0, entries)


BOUNDS = np.array([-1.0, -0.5], np.float32), np.array([0.5, 1.0], np.float32)


def feedforward(activation, output, inputs=None, entries=24):
    rng = np.random.default_rng(0)
    layers = random_layers(rng, entries, 7, 5, 2)
    return Network(inputs or {}, *normaliser(rng, entries), layers, activation, output, *BOUNDS)


def recurrent(cell, activation, encoder, shortcut, entries=24):
    rng, width = np.random.default_rng(0), 6
    seen = 9 if encoder else entries
    rows = cell.GATES * width
    shapes = [(rows, seen), (rows, width), (rows,), (rows,)]
    own = cell(*(rng.normal(size=shape).astype(np.float32) for shape in shapes))
    layers = random_layers(rng, width + (seen if shortcut else 0), 5, 2)
    before = random_layers(rng, entries, 9) if encoder else []
    return RecurrentNetwork({}, *normaliser(rng, entries), before, own, layers, activation, shortcut, *BOUNDS)


def policy_of(network, env_id=FLAT, **settings):
    config = standalone(settings_of(env_id)(**settings))
    return ShippedPolicy("own", "ppo", network, env_id, config, entry_names(config, "Goal" in env_id), TRAINING)


NETWORKS = [
    *(feedforward(activation, output) for activation in ("tanh", "relu", "elu") for output in OUTPUTS),
    *(recurrent(cell, "elu", encoder, not encoder) for cell in (Gru, Lstm) for encoder in (True, False)),
    recurrent(Gru, "tanh", True, True),
]


@pytest.mark.parametrize("network", NETWORKS, ids=lambda network: f"{network.KIND} {network.activation}")
def test_every_kind_of_network_gives_the_actions_and_the_memory_of_numpy(network):
    runtime = session(onnx_model(policy_of(network)))
    rng, memory, actions = np.random.default_rng(1), network.start(40), []
    for _ in range(5):
        seen = rng.normal(0.0, 2.0, (40, 24)).astype(np.float32)
        given = {"observation": seen} | ({} if memory is None else {"memory": memory})
        action, memory = network.advance(seen, memory)
        found, *after = runtime.run(None, given)
        actions.append(action)
        assert np.abs(found - action).max() < LARGEST_DIFFERENCE
        assert memory is None or np.abs(after[0] - memory).max() < LARGEST_DIFFERENCE
    assert min(np.ptp(np.concatenate(actions), axis=0)) > 0.7  # of 1.5 between the bounds


def test_parts_of_a_dictionary_are_inputs_by_their_names():
    entries = len(entry_names(standalone(settings_of(GOAL)()), True))
    sizes = {"achieved_goal": 2, "desired_goal": 2, "observation": entries}
    policy = policy_of(feedforward("tanh", "clip", sizes, entries + 4), GOAL)
    rng = np.random.default_rng(1)
    seen = {name: rng.normal(size=(9, size)).astype(np.float32) for name, size in sizes.items()}
    (found,) = session(onnx_model(policy)).run(None, seen)
    assert np.abs(found - policy(seen)).max() < LARGEST_DIFFERENCE
    inputs = {each["name"]: each["entries"] for each in contract(policy)["inputs"]}
    assert [entry["name"] for entry in inputs["desired_goal"]] == ["target x", "target y"]
    assert [entry["normaliser"]["mean"] for entry in inputs["observation"]] == policy.network.mean[4:].tolist()


def test_goals_with_an_orientation_say_which_entries_are_positions():
    config = settings_of(ARM_GOAL)(mechanism="small_arm", orientation=True)
    entries = len(entry_names(standalone(config), True))
    sizes, rng = {"achieved_goal": 9, "desired_goal": 9, "observation": entries}, np.random.default_rng(0)
    one = np.ones(4, np.float32)
    layers = random_layers(rng, entries + 18, 4)
    network = Network(sizes, *normaliser(rng, entries + 18), layers, "tanh", "clip", -one, one)
    goal = contract(policy_of(network, ARM_GOAL, mechanism="small_arm", orientation=True))["inputs"][0]["entries"]
    assert [entry["unit"] for entry in goal] == ["mm"] * 3 + ["1"] * 6


def test_scales_of_the_contract_turn_entries_into_physical_quantities():
    policy = load_policy("late_pose")
    (seen, memory), (action, following) = (contract(policy)[key] for key in ("inputs", "outputs"))
    scale = {entry["name"]: (entry["scale"], entry["unit"]) for entry in seen["entries"]}
    assert list(scale) == [name.rpartition(" [")[0] for name in policy.entries]
    envs = make_vector_env(policy.environment, 3)
    observation, info = envs.reset(seed=5)
    values = dict(zip(scale, observation.T, strict=True))
    assert scale["target x"] == (100.0, "mm") and scale["picture age"] == (10.0, "steps")
    assert values["target x"] * 100.0 == pytest.approx(info["target"][:, 0], rel=1e-5)
    assert scale["tendon 0 tension"] == (15.0, "N") and scale["link 1 cos angle"] == (1.0, "1")
    assert action["entries"][1] == {"name": "tendon 1 pulled in", "unit": "mm", "scale": 1.0, "low": -1.0, "high": 1.0}
    assert (memory["size"], memory["start"], following["name"]) == (128, 0.0, "next_memory")


def test_contract_is_in_the_file_and_names_the_policy_and_its_training(tmp_path):
    policy = load_policy("drifting_load")
    write_onnx(policy, tmp_path / "a.onnx")
    model = onnx.load(tmp_path / "a.onnx")
    stored = json.loads({each.key: each.value for each in model.metadata_props}["contract"])
    assert stored == contract(policy) == json.loads(contract_text(contract(policy)))
    assert stored["sha256"] == policy.sha256 and stored["environment"]["id"] == policy.env_id
    assert stored["training"]["steps"] == policy.training["steps"] and stored["memory"] == 0
    first = (tmp_path / "a.onnx").read_bytes()
    write_onnx(policy, tmp_path / "a.onnx")
    assert (tmp_path / "a.onnx").read_bytes() == first


def test_command_writes_a_shipped_policy_or_a_file_and_prints_the_contract(tmp_path, capsys):
    shutil.copy(FOLDER / "noisy.safetensors", tmp_path / "copied.safetensors")
    for source in ("noisy", tmp_path / "copied.safetensors"):
        path = tmp_path / f"{Path(source).stem}.onnx"
        assert export.main([str(source), "--onnx", str(path)]) == 0
        line, _, text = capsys.readouterr().out.partition("\n")
        assert line.startswith(f"{path}: ") and json.loads(text) == contract(load_policy("noisy"))
    assert export.main(["noisy", "--onnx", str(path)]) == 2
    assert "expected a new file. Give another name, or --force." in capsys.readouterr().err
    assert export.main(["noisy", "--onnx", str(path), "--force"]) == 0


def test_command_without_a_policy_says_what_there_is(tmp_path, capsys):
    assert export.main(["nosy", "--onnx", str(tmp_path / "x.onnx")]) == 2
    assert "Did you mean 'noisy'?" in capsys.readouterr().err
