"""Shipped policies: each scores as recorded, runs without torch, and is found by its name."""

import json
from dataclasses import fields, replace

import gymnasium
import numpy as np
import pytest

from agents.policies import loading
from agents.policies.file import SUFFIX
from agents.policies.loading import FOLDER
from agents.policies.network import PolicyError
from agents.policies.recorded_score import ERRORS, SHARES, RecordedScore
from agents.policies.shipped import ShippedPolicy
from agents.shipped import list_policies, load_policy
from rj_gym import InstrumentV1Config
from rj_gym.registry import version_of
from rollingjoint.errors import InvalidInput, RollingJointError
from tests.agents.policies.made_up import random_policy

FILES = sorted(FOLDER.glob("*.safetensors"))


LONG = ("arm_instrument", "flexible_arm", "obstacles-v1")  # for the arm's solver, and for drawing episodes
LONG += ("generalist_blind", "generalist_space", "generalist_space_blind")  # for drawing designs


@pytest.mark.parametrize(
    "path", [pytest.param(path, marks=[pytest.mark.slow] * (path.stem in LONG), id=path.stem) for path in FILES]
)
def test_shipped_policy_scores_within_its_recorded_band(path):
    policy = load_policy(path)
    assert path.stem.removesuffix(f"-v{version_of(policy.env_id)}") == policy.name
    assert policy.score.episodes >= 200
    assert policy.score.complaints(policy.rescore()) == []


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_shipped_policy_is_small_and_says_where_it_comes_from(path):
    policy = load_policy(path)
    with_memory = 2_500_000 if policy.name == "generalist_space_blind" else 1_000_000  # of width 256, the others 128
    assert path.stat().st_size < (with_memory if policy.has_memory else 120_000)
    assert {"torch", "stable-baselines3", "rollingjoint", "python"} <= policy.training["versions"].keys()
    assert policy.training["config"]["algorithm"] == policy.algorithm
    assert policy.training["steps"] > 0
    assert "/" not in json.dumps(policy.to_dict()).replace(policy.env_id, "").replace("/mm]", "").replace("/rad]", "")


class Noisy(ShippedPolicy):
    """A policy whose actions are off in the last bits, as on another machine."""

    def __call__(self, observation):
        action = super().__call__(observation)
        return action + np.random.default_rng(0).uniform(-1e-6, 1e-6, action.shape).astype(np.float32)


@pytest.mark.parametrize("name", [None, 3, b"instrument"])
def test_a_policy_is_named_by_text(name):
    with pytest.raises(PolicyError, match="one of arm_instrument, drifting_load") as refused:
        load_policy(name)
    assert "\n" not in str(refused.value)


def test_a_policy_begins_in_an_environment_as_with_its_task():
    policy = load_policy("instrument", version=0)
    settings = {"config": policy.settings}
    envs = gymnasium.make_vec(policy.env_id, 3, "vector_entry_point", **settings)
    for env, rows in ((gymnasium.make(policy.env_id, **settings), 1), (envs, 3)):
        observations = np.atleast_2d(env.reset(seed=0)[0])
        policy.begin(env)
        actions = policy.act(observations)
        policy.begin(env.unwrapped.task, episodes=rows)
        assert np.array_equal(policy.act(observations), actions)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("fixed_target", "expected a tracking task, env.unwrapped.task, or the environment itself"),
        (gymnasium.make("CartPole-v1"), "not one of rj_gym"),
        (gymnasium.make("rj_gym/CurvatureDesign-v0"), "not one of rj_gym"),
    ],
)
def test_a_policy_says_in_one_line_what_it_can_begin_with(given, words):
    with pytest.raises(InvalidInput, match=words) as refused:
        load_policy("fixed_target").begin(given)
    assert "\n" not in str(refused.value)


@pytest.mark.slow
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_last_bits_move_a_score_by_less_than_a_tenth_of_its_tolerance_with_memory_a_half(path):
    policy = load_policy(path)
    noisy = Noisy(**{field.name: getattr(policy, field.name) for field in fields(policy)}).rescore()
    assert noisy != policy.rescore()
    part = 0.5 if policy.has_memory else 0.1
    narrow = {name: part * tolerance for name, tolerance in policy.score.tolerances.items()}
    assert replace(policy.score, tolerances=narrow).complaints(noisy) == []


def test_score_that_leaves_the_band_is_noticed():
    policy = load_policy("fixed_target")
    layers = [(weights, biases + np.float32(0.1)) for weights, biases in policy.network.layers]
    worse = replace(policy, network=replace(policy.network, layers=layers))
    assert any("mean_mm" in line for line in policy.score.complaints(worse.rescore()))


@pytest.mark.slow
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


def test_a_policy_in_a_terminal_is_one_line():
    policy = load_policy("lumen")
    assert repr(policy) == f"<ShippedPolicy 'lumen' for {policy.env_id}: apg, feedforward, 48 - 128 - 128 - 5>"


def test_policy_that_was_never_scored_cannot_be_scored_again():
    with pytest.raises(PolicyError, match="a policy that was scored when it was exported"):
        replace(random_policy(), score=None).rescore()


def test_unknown_name_gets_the_nearest_one_and_a_folder_is_no_policy(tmp_path):
    with pytest.raises(PolicyError, match="Did you mean 'fixed_target'"):
        load_policy("fixed_targt")
    with pytest.raises(PolicyError, match="a policy file or one of"):
        load_policy(tmp_path)
    assert "fixed_target" in list_policies()


def test_every_shipped_policy_goes_into_the_package():
    import tomllib

    packages = tomllib.loads((FOLDER.parent.parent / "pyproject.toml").read_text())["tool"]["setuptools"]
    assert "policies/*.safetensors" in packages["package-data"]["rj_agents"]
    assert {path.suffix for path in FOLDER.iterdir() if path.name != "__pycache__"} == {SUFFIX, ".py"}


def test_recorded_score_is_called_a_regression_band_and_may_have_the_error_of_the_last_steps():
    policy = random_policy()
    assert policy.score.described == "regression band of 4 fixed episodes, seeds 20000 to 20003"
    score = policy.score_on(range(20_000, 20_004))
    fresh = RecordedScore.of(score, range(20_000, 20_004))
    assert fresh.values["last_10_mm"] == score.last_10_mm
    again = ShippedPolicy.from_bytes(replace(policy, score=fresh).to_bytes())
    assert again.score == fresh and again.score.complaints(score) == []
    (line,) = again.score.complaints(replace(score, last_10_mm=99.0))
    assert line.startswith("last_10_mm is 99, outside") and "regression band of 4 fixed episodes" in line
    assert "last_10_mm" not in load_policy("fixed_target").score.values  # a file of an earlier version


def test_recorded_score_with_a_tolerance_for_nothing_is_refused():
    values = dict.fromkeys(ERRORS + SHARES, 0.5)
    with pytest.raises(RollingJointError, match=r"score.tolerances = .*expected those of mean_mm"):
        RecordedScore(20_000, 4, values, values | {"last_10_mm": 0.1})


def test_the_newest_version_is_loaded_unless_another_is_asked_for(tmp_path, monkeypatch):
    first = load_policy("instrument", version=0)
    other = replace(first, env_id="rj_gym/Instrument-v1", settings=InstrumentV1Config(mechanism=first.mechanism))
    monkeypatch.setattr(loading, "FOLDER", tmp_path)
    (tmp_path / "instrument.safetensors").write_bytes(first.to_bytes())
    (tmp_path / "instrument-v1.safetensors").write_bytes(other.to_bytes())
    assert list_policies() == ["instrument"]
    for version, env_id in ((None, "rj_gym/Instrument-v1"), (1, "rj_gym/Instrument-v1"), (0, "rj_gym/Instrument-v0")):
        assert load_policy("instrument", version=version).env_id == env_id
    assert [policy.env_id for policy in loading.shipped_policies()] == ["rj_gym/Instrument-v0", "rj_gym/Instrument-v1"]
    with pytest.raises(PolicyError, match="version of the policy 'instrument' = 2: expected one of 0, 1"):
        load_policy("instrument", version=2)
    with pytest.raises(PolicyError, match="version = 0: expected None for a file"):
        load_policy(tmp_path / "instrument.safetensors", version=0)


@pytest.mark.parametrize(("name", "version"), sorted(loading._shipped()))
def test_a_shipped_policy_s_version_is_the_one_of_its_environment(name, version):
    assert version_of(load_policy(name, version=version).env_id) == version


def test_a_policy_is_refused_in_the_other_version_s_environment_in_one_line():
    policy = load_policy("instrument", version=0)
    with pytest.raises(PolicyError, match="'rj_gym/Instrument-v1': expected rj_gym/Instrument-v0") as refused:
        policy.begin(gymnasium.make("rj_gym/Instrument-v1").unwrapped.task, 1)
    assert "\n" not in str(refused.value)
    limits = {"tension_limit": 20.0, "limit_at": "motor"}  # settings are free, as play and friction are
    policy.begin(gymnasium.make("rj_gym/Instrument-v0", actuation=limits).unwrapped.task, 1)
