"""Exporting policies: NumPy computes what Stable-Baselines3 computes, and the command writes files that load."""

import json
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from sb3_contrib import TQC, CrossQ
from stable_baselines3 import A2C, PPO, SAC
from stable_baselines3.common.vec_env import VecNormalize

from agents import export
from agents.policies import export as export_module
from agents.policies.conversion import network_of
from agents.policies.export import check_against_torch, export_policy, export_run
from agents.policies.file import unpack
from agents.policies.network import PolicyError
from agents.runs.config import load_config
from agents.runs.consent import Consent, allowing
from agents.runs.environment import EnvConfig
from agents.runs.files import RunFolderError, hash_file
from agents.runs.folder import RunFolder
from agents.shipped import ShippedPolicy, list_policies, load_policy
from agents.training.build import build_model
from agents.training.checkpoint import save_policy
from rj_gym.registry import version_of
from rj_gym.sb3 import make_sb3_env

torch.set_num_threads(1)

FLAT, GOAL = "rj_gym/RollingJoint-v0", "rj_gym/RollingJointGoal-v0"
ARM, ARM_GOAL = "rj_gym/FlexibleArm-v0", "rj_gym/FlexibleArmGoal-v0"
TRAINING = {"config": {}, "steps": 0, "seed": 0, "versions": {}}
ON_POLICY, OFF_POLICY = {"n_steps": 8, "batch_size": 8}, {"buffer_size": 10, "learning_starts": 0}
SMALL = {PPO: ON_POLICY, SAC: OFF_POLICY, TQC: OFF_POLICY, CrossQ: OFF_POLICY}
ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU, "elu": torch.nn.ELU}


def random_normaliser(env, **arguments):
    """VecNormalize with statistics as if it had seen something."""
    rng = np.random.default_rng(2)
    normaliser = VecNormalize(env, training=False, clip_obs=2.0, epsilon=1e-3, **arguments)
    for statistics in normaliser.obs_rms.values() if isinstance(normaliser.obs_rms, dict) else [normaliser.obs_rms]:
        statistics.mean = rng.normal(0.0, 0.3, statistics.mean.shape)
        statistics.var = rng.uniform(0.01, 2.0, statistics.var.shape)
    return normaliser


def random_model(algorithm, env, policy_kwargs=None, **arguments):
    """A model that has learned nothing, its batch renormalisation as if it had seen something."""
    kind = "MultiInputPolicy" if "Goal" in type(env.env).__name__ else "MlpPolicy"
    arguments |= SMALL.get(algorithm, {})
    model = algorithm(kind, env, seed=1, device="cpu", policy_kwargs=policy_kwargs, **arguments)
    generator = torch.Generator().manual_seed(3)
    for module in model.policy.modules():
        if type(module).__name__ == "BatchRenorm1d":
            module.ra_mean.data.uniform_(-1, 1, generator=generator)
            module.ra_var.data.uniform_(0.2, 2, generator=generator)
            module.scale.data.uniform_(0.5, 2, generator=generator)
            module.bias.data.uniform_(-1, 1, generator=generator)
    if isinstance(model, PPO):
        for parameter in model.policy.action_net.parameters():
            parameter.data.mul_(30)  # a fresh action layer is so small that nothing would be clipped
    return model


def observations(env, count=300):
    """Random observations of every size that the space allows."""
    space = env.observation_space
    space.seed(4)
    samples = [space.sample() for _ in range(count)]
    if isinstance(samples[0], dict):
        return {key: np.array([sample[key] for sample in samples]) for key in samples[0]}
    return np.array(samples)


def expected_actions(model, normaliser, seen):
    return model.predict(normaliser.normalize_obs(seen) if normaliser else seen, deterministic=True)[0]


@pytest.mark.parametrize(
    ("algorithm", "activation", "env_id"),
    [
        (PPO, "tanh", FLAT),
        (PPO, "relu", GOAL),
        (PPO, "elu", FLAT),
        (SAC, "relu", FLAT),
        (SAC, "elu", GOAL),
        (TQC, "tanh", FLAT),
        (TQC, "relu", GOAL),
        (CrossQ, "relu", FLAT),  # sb3-contrib has no CrossQ policy for dictionaries
        (CrossQ, "tanh", FLAT),
        (PPO, "tanh", ARM),
        (SAC, "relu", ARM_GOAL),
    ],
)
def test_numpy_gives_the_deterministic_action_of_stable_baselines(algorithm, activation, env_id):
    mechanism = "small_arm" if env_id in (ARM, ARM_GOAL) else "two_segment"  # four tendons each
    env = make_sb3_env(env_id, 1, mechanism=mechanism)
    normaliser = random_normaliser(env)
    model = random_model(algorithm, env, {"net_arch": [32, 16], "activation_fn": ACTIVATIONS[activation]})
    policy = export_policy(model, normaliser, EnvConfig(env_id, settings={"mechanism": mechanism}), "x", TRAINING)
    policy = ShippedPolicy.from_bytes(policy.to_bytes())
    seen = observations(env)
    expected = expected_actions(model, normaliser, seen)
    actions = policy(seen)
    assert policy.algorithm == algorithm.__name__.lower()
    assert np.mean(np.abs(expected)) > 0.05 and expected.shape == (300, 4)
    assert actions.dtype == expected.dtype
    assert np.abs(actions - expected).max() < 1e-6
    one = {key: values[0] for key, values in seen.items()} if isinstance(seen, dict) else seen[0]
    assert np.abs(policy(one) - expected[0]).max() < 1e-6
    assert check_against_torch(policy, model, normaliser, episodes=2) < 1e-6


@pytest.mark.parametrize("hidden", [[], [8]])
def test_networks_of_one_and_two_layers_are_exported(hidden):
    env = make_sb3_env(FLAT, 1)
    for algorithm in (PPO, SAC, CrossQ):
        model = random_model(algorithm, env, {"net_arch": hidden})
        network = network_of(model)
        assert network.hidden == hidden
        assert np.abs(network(seen := observations(env)) - expected_actions(model, None, seen)).max() < 1e-6


def test_policies_without_normaliser_or_with_some_keys_normalised_are_exported():
    env = make_sb3_env(GOAL, 1)
    model, seen = random_model(PPO, env), observations(env)
    plain, some = VecNormalize(env, norm_obs=False), random_normaliser(env, norm_obs_keys=["observation"])
    for normaliser in (None, plain, some):
        actions = network_of(model, normaliser)(seen)
        assert np.abs(actions - expected_actions(model, normaliser, seen)).max() < 1e-6


def test_action_bounds_other_than_one_are_kept():
    env = make_sb3_env(FLAT, 1)
    for algorithm in (PPO, SAC):
        model = random_model(algorithm, env)
        for space in (model.action_space, model.policy.action_space):
            space.low, space.high = np.array([-0.5, 0.0], np.float32), np.array([0.25, 2.0], np.float32)
        actions = network_of(model)(seen := observations(env))
        assert np.abs(actions - expected_actions(model, None, seen)).max() < 1e-6


@pytest.mark.parametrize(("algorithm", "policy"), [(PPO, {"squash_output": True}), (SAC, {}), (TQC, {})])
def test_policy_with_state_dependent_exploration_is_exported(algorithm, policy):
    env = make_sb3_env(FLAT, 1)
    model = random_model(algorithm, env, policy, use_sde=True)
    actions = network_of(model)(seen := observations(env))
    assert np.abs(actions - expected_actions(model, None, seen)).max() < 1e-6


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda env: random_model(A2C, env), "algorithm = 'a2c': expected one of ppo, sac, tqc, crossq"),
        (lambda env: random_model(PPO, env, {"activation_fn": torch.nn.GELU}), "layer = 'GELU'"),
    ],
)
def test_policy_that_has_no_form_in_numpy_is_a_clear_error(make, message):
    with pytest.raises(PolicyError, match=message):
        network_of(make(make_sb3_env(FLAT, 1)))


def test_policy_of_a_foreign_environment_is_a_clear_error():
    model = random_model(PPO, make_sb3_env(FLAT, 1))
    with pytest.raises(PolicyError, match="CartPole"):
        export_policy(model, None, EnvConfig("CartPole-v1"), "x", TRAINING)
    with pytest.raises(PolicyError, match="inputs"):
        export_policy(model, None, EnvConfig(FLAT, settings={"observe_load": True}), "x", TRAINING)


def test_numpy_that_differs_from_torch_is_not_exported():
    env = make_sb3_env(FLAT, 1)
    model = random_model(PPO, env)
    policy = export_policy(model, None, EnvConfig(FLAT), "x", TRAINING)
    model.policy.action_net.bias.data.add_(1e-3)
    with pytest.raises(PolicyError, match="NumPy minus torch"):
        check_against_torch(policy, model, None)


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A run folder, trained for 80 steps; the best policy is that after 40."""
    few = "env.settings.episode_steps=10 env.n_envs=2 parameters.n_steps=20 parameters.batch_size=20 policy.hidden=[8]"
    config = load_config("configs/train/demo.yaml", few.split())
    folder = RunFolder.create(tmp_path_factory.mktemp("run") / "tiny", config, ["python"])
    model = build_model(config)
    for names in (["best", "000000040"], ["last"]):
        model.learn(40, reset_num_timesteps=False)
        for files in map(folder.policy_files, names):
            save_policy(model, files)
    return folder.path


def run(*arguments):
    return export.main([*map(str, arguments)])


def test_command_writes_a_file_with_the_score_that_scores_again(trained, tmp_path, capsys):
    assert run(trained, "--name", "tiny", "--out", tmp_path, "--episodes", 5) == 0
    printed = capsys.readouterr().out
    policy = load_policy(tmp_path / "tiny.safetensors")
    assert policy.score.seeds == range(20_000, 20_005)
    assert policy.score.complaints(policy.rescore()) == []
    assert policy.sha256 in printed and f"{policy.score.values['mean_mm']:.3f} mm" in printed
    assert policy.training["steps"] == 40 and policy.training["seed"] == 1
    assert policy.training["config"]["policy"]["hidden"] == [8]
    assert "settings" not in policy.training["config"]["env"] and policy.settings.episode_steps == 10
    assert {"torch", "numpy"} <= policy.training["versions"].keys()
    assert policy.training["versions"].keys().isdisjoint({"platform", "processor", "cores"})
    assert [path.name for path in tmp_path.iterdir()] == ["tiny.safetensors"]


def test_command_exports_the_policy_that_is_asked_for(trained, tmp_path):
    for which, steps in (("last", 80), ("000000040", 40)):
        assert run(trained, "--name", f"p{steps}", "--policy", which, "--out", tmp_path, "--episodes", 1) == 0
        assert load_policy(tmp_path / f"p{steps}.safetensors").training["steps"] == steps


def test_command_replaces_a_file_only_with_force(trained, tmp_path, capsys):
    arguments = [trained, "--name", "tiny", "--out", tmp_path, "--episodes", 1]
    (tmp_path / "tiny.safetensors").write_text("precious")
    assert run(*arguments) == 2
    assert "--force" in capsys.readouterr().err
    assert (tmp_path / "tiny.safetensors").read_text() == "precious"
    assert run(*arguments, "--force") == 0
    assert load_policy(tmp_path / "tiny.safetensors").name == "tiny"


def without(*names):
    def harm(folder):
        for name in names:
            (folder / name).unlink()
            hash_file(folder / name).unlink(missing_ok=True)

    return harm


def old(harm=lambda folder: None):
    """As an earlier version wrote it, with pickles alone."""

    def harm_old(folder):
        without(*(str(path.relative_to(folder)) for path in folder.rglob("policy.safetensors")))(folder)
        harm(folder)

    return harm_old


def overwritten(name, text):
    def harm(folder):
        (folder / name).write_text(text)
        hash_file(folder / name).unlink(missing_ok=True)

    return harm


def with_seed(folder):
    path = folder / "config.yaml"
    path.write_text(path.read_text().replace("\nseed: 1\n", "\nseed: 19999\n"))
    hash_file(path).unlink()


@pytest.mark.parametrize(
    ("harm", "arguments", "message"),
    [
        (without("config.yaml"), "", "a folder with a config.yaml"),
        (without("best/policy.safetensors", "best/policy.zip"), "", "a saved policy"),
        (overwritten("best/policy.safetensors", "nonsense"), "", "a file that rj export-policy wrote"),
        (old(overwritten("best/policy.zip", "nonsense")), "--trust", "a zip that Stable-Baselines3 can load"),
        (old(overwritten("best/normaliser.pkl", "nonsense")), "--trust", "a zip that Stable-Baselines3 can load"),
        (overwritten("versions.json", "[]"), "", "the versions that training used"),
        (with_seed, "", "in training"),
        (lambda folder: None, "--policy 123", "a saved policy"),
        (lambda folder: None, "--episodes 0", "--episodes = 0"),
        (lambda folder: None, "--name ../x", "letters, digits"),
    ],
)
def test_command_ends_with_one_line_for_what_it_cannot_export(harm, arguments, message, trained, tmp_path, capsys):
    folder = tmp_path / "harmed"
    shutil.copytree(trained, folder)
    harm(folder)
    assert run(folder, "--name", "tiny", "--out", tmp_path / "out", *arguments.split()) == 2
    errors = capsys.readouterr().err
    assert message in errors and errors.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_command_without_a_run_says_what_it_wants(capsys):
    with pytest.raises(SystemExit, match="2"):
        run("--name", "tiny")
    assert "give a run folder and --name, or --list" in capsys.readouterr().err


def test_list_shows_every_shipped_policy_with_its_recorded_score(capsys):
    assert run("--list") == 0
    head, *rows = capsys.readouterr().out.splitlines()
    assert list(dict.fromkeys(row.split()[0] for row in rows)) == list_policies()
    for row in rows:
        policy = load_policy(row.split()[0], version=version_of(row.split()[-1]))
        assert f"{policy.score.values['mean_mm']:.3f} mm" in row
    assert "within 1 mm" in head


@pytest.mark.parametrize("which", ["last", "best", "000000040"])
def test_trusted_zip_gives_the_same_actions(which, trained):
    policy = load_policy(RunFolder(trained).policy_files(which).model, trust_pickle=True)
    exported = export_run(RunFolder(trained), which, "x")
    observation = policy.make_env().reset(seed=0)[0]
    assert np.array_equal(policy(observation), exported(observation))
    assert policy.score is None


@pytest.mark.parametrize("name", ["policy.zip", "policy.safetensors"])
def test_policy_of_a_run_outside_its_folder_is_a_clear_error(name, trained, tmp_path):
    shutil.copy(trained / name, tmp_path / name)
    with pytest.raises(PolicyError, match="in its run folder"):
        load_policy(tmp_path / name, trust_pickle=True)


def test_old_run_is_compared_with_torch(trained, tmp_path, monkeypatch):
    folder = shutil.copytree(trained, tmp_path / "old")
    old()(folder)
    with pytest.raises(RunFolderError, match=r"best/policy.zip.*--trust"):
        export_run(RunFolder(folder), "best", "x")
    with allowing(Consent(pickles=True)):
        again = export_run(RunFolder(folder), "best", "x")
    assert again.to_bytes() == export_run(RunFolder(trained), "best", "x").to_bytes()
    monkeypatch.setattr(export_module, "LARGEST_DIFFERENCE", -1.0)
    with allowing(Consent(pickles=True)), pytest.raises(PolicyError, match="NumPy minus torch"):
        export_run(RunFolder(folder), "best", "x")


def test_policy_of_a_run_is_loaded_from_its_folder(trained):
    policy = load_policy(trained / "best/policy.safetensors")
    assert policy.name == trained.name and policy.training["steps"] == 40 and policy.score is None
    assert policy.settings.episode_steps == 10


def test_onnx_file_of_a_run_is_written_beside_the_policy_file_or_alone(trained, tmp_path, capsys):
    names = "--name", "tiny", "--out", tmp_path, "--episodes", 2
    assert run(trained, *names, "--onnx", tmp_path / "both.onnx") == 0
    assert f'"sha256": "{load_policy(tmp_path / "tiny.safetensors").sha256}"' in capsys.readouterr().out
    assert run(trained, "--policy", "last", "--onnx", tmp_path / "alone.onnx") == 0
    assert '"steps": 80' in capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} == {"tiny.safetensors", "both.onnx", "alone.onnx"}


def test_json_of_a_file_can_be_read_without_this_package():
    data = Path("agents/policies/fixed_target.safetensors").read_bytes()
    header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])
    assert json.loads(header["__metadata__"]["policy"])["name"] == "fixed_target"


def test_commands_of_the_page_on_policies_run(trained, tmp_path, monkeypatch, capsys):
    page = Path("docs/policies.md").read_text()
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs/demo").symlink_to(trained)
    monkeypatch.chdir(tmp_path)
    lines = [line for block in re.findall(r"```bash\n(.*?)```", page, re.S) for line in block.splitlines()]
    commands = [shlex.split(line) for line in lines if not line.startswith("python benchmarks/tension_limit.py")]
    assert [command[:2] for command in commands] == [["rj", "export-policy"]] * 3
    assert [run(*command[2:], "--episodes", "2") for command in commands] == [0, 0, 0]
    assert {load_policy(path).name for path in (Path("mine.safetensors"), Path("exported/mine.safetensors"))} == {
        "mine"
    }
    capsys.readouterr()


def test_page_on_policies_names_every_key_and_tensor():
    page = Path("docs/policies.md").read_text()
    policy = load_policy("fixed_target")
    content, tensors = unpack(policy.to_bytes(), "")
    sections = ("network", "environment", "training", "score")
    names = {"format", "sha256", *content, *tensors, *(key for section in sections for key in content[section])}
    names |= content["score"]["values"].keys()
    later = {f"{kind}.{i}" for kind in ("weights", "biases") for i in range(1, 9)}
    assert [name for name in sorted(names - later) if f"`{name}`" not in page] == []
