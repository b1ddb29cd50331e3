"""Ids registered elsewhere for classes of rj_gym are trained, resumed, evaluated, exported and loaded like ours."""

import importlib
import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from agents import evaluate, export, train
from agents.controllers import untuned_controllers
from agents.evaluation.floor import episode_floor
from agents.evaluation.report import evaluate_controllers
from agents.evaluation.rollout import run_episodes
from agents.policies.errors import PolicyError
from agents.policies.loading import load_policy
from agents.runs.environment import EnvConfig, make_vector_env
from rj_gym import Drawn, RollingJointEnv, RollingJointVectorEnv, Terms
from rj_gym.registry import registered_settings
from rollingjoint.errors import ConfigError

MODULE, ID = "hold_task", "hold_task:reader/Hold-v0"
CODE = """
import gymnasium
import numpy as np
from rj_gym import Entry, Memory, Observed, Terms

def streak(step):
    return np.where(step.error_mm <= 60.0, step.memory[:, 0] + 1, 0)

def hold(step):
    return 0.5 * (step.memory[:, 0] >= 3)

def held(step):
    return np.minimum(step.memory, 3) / 3

TERMS = Terms(rewards={"hold": hold}, observations=[Observed([Entry("held", "1", 0.0, 1.0)], held)],
              memory=Memory([0], streak))
gymnasium.register("reader/Hold-v0", entry_point="rj_gym:RollingJointEnv",
                   vector_entry_point="rj_gym:RollingJointVectorEnv", kwargs={"terms": TERMS, "episode_steps": 15})
"""
OVERRIDES = ["total_timesteps=80", "env.n_envs=2", f"env.id={ID}", "env.settings={}", "env.file=null",
             "policy.hidden=[8]", "evaluation.every=80", "evaluation.episodes=2",
             "parameters={n_steps: 10, batch_size: 20, n_epochs: 2}"]  # fmt: skip
TRAIN = ["--config", str(Path("configs/train/demo.yaml").resolve()), "--import", MODULE]
TRAIN += [word for override in OVERRIDES for word in ("--set", override)]


@pytest.fixture
def module(tmp_path, monkeypatch):
    """A module that registers an own id; the working directory of the test."""
    (tmp_path / f"{MODULE}.py").write_text(CODE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    yield
    sys.modules.pop(MODULE, None)
    gymnasium.registry.pop("reader/Hold-v0", None)


@pytest.fixture
def register():
    """Registers an id of the test."""
    names = []

    def registered(name, **arguments):
        names.append(name)
        gymnasium.register(name, **arguments)

    yield registered
    for name in names:
        gymnasium.registry.pop(name)


def forget():
    """As in a process that has not imported the module."""
    sys.modules.pop(MODULE)
    gymnasium.registry.pop("reader/Hold-v0")


@pytest.mark.slow
def test_a_run_is_resumed_to_the_last_bit_evaluated_and_loaded(module, no_pictures, capsys):
    assert train.main([*TRAIN, "--run-dir", "half"]) == 0
    assert f"Next: rj evaluate half --import {MODULE}" in capsys.readouterr().out
    assert train.main(["--resume", "half", "--import", MODULE, "--set", "total_timesteps=160"]) == 0
    assert train.main([*TRAIN, "--set", "total_timesteps=160", "--run-dir", "whole"]) == 0
    assert Path("half/policy.safetensors").read_bytes() == Path("whole/policy.safetensors").read_bytes()

    capsys.readouterr()
    assert evaluate.main(["whole", "--import", MODULE, "--episodes", "3"]) == 0
    printed, report = capsys.readouterr().out, json.loads(Path("whole/evaluation/report.json").read_text())
    assert list(report["scores"]) == ["policy", *untuned_controllers()] and "floor" in printed
    for text in (printed, Path("whole/evaluation/report.md").read_text()):
        assert "return" in text and "hold" in text and "not the one with the largest return" in text
    assert list(report["reward_terms"]["policy"]) == ["tracking", "effort", "smoothness", "failure", "hold"]
    for name, terms in report["reward_terms"].items():
        assert sum(terms.values()) == pytest.approx(report["scores"][name]["mean_reward"])

    assert export.main(["whole", "--name", "held", "--import", MODULE, "--episodes", "3"]) == 0
    forget()
    for file in ("whole/policy.safetensors", "held.safetensors"):
        with pytest.raises((ConfigError, PolicyError), match=f"--import {MODULE} to the command; in Python import it"):
            load_policy(file)
    importlib.import_module(MODULE)
    inside, exported = load_policy("whole/policy.safetensors"), load_policy("held.safetensors")
    env = exported.make_env()
    seen, _ = env.reset(seed=0)
    assert len(seen) == len(exported.entries) and exported.entries[-1] == "held [1]"
    assert env.unwrapped.config.terms.memory is not None and env.unwrapped.config.episode_steps == 15
    assert np.array_equal(inside(seen), exported(seen))
    assert exported.rescore().mean_mm == exported.score.values["mean_mm"]


def test_the_policy_file_of_a_run_says_what_it_is_where_it_was_copied(module):
    assert train.main([*TRAIN, "--run-dir", "run"]) == 0
    shutil.copy("run/policy.safetensors", "copied.safetensors")
    with pytest.raises(PolicyError, match=r"policy.safetensors of a run folder.*rj export-policy RUN --name NAME"):
        load_policy("copied.safetensors")


def test_an_id_that_nothing_has_registered_asks_to_import_its_module():
    policy = load_policy("fixed_target")
    with pytest.raises(PolicyError, match="Import the module that registers it first"):
        type(policy)(**{**vars(policy), "env_id": "reader/Nowhere-v0"})


def test_settings_of_a_run_go_on_top_of_those_of_the_registration(register):
    register("reader/Short-v0", entry_point="rj_gym:RollingJointEnv", vector_entry_point="rj_gym:RollingJointVectorEnv",
             kwargs={"episode_steps": 15, "action_scale_mm": 3.0})  # fmt: skip
    env = EnvConfig("reader/Short-v0", settings={"episode_steps": 4})
    assert env.episode_steps == 4 and env.is_tracking and not env.has_goals and not env.is_built_in
    config = make_vector_env(env, 2).config
    assert (config.episode_steps, config.action_scale_mm) == (4, 3.0)
    with pytest.raises(ConfigError, match="episode_steps"):
        EnvConfig("reader/Short-v0", settings={"episode_step": 4})


def test_a_wrapped_vector_environment_is_named_in_one_line(register, module, capsys):
    class Doubled(gymnasium.vector.VectorWrapper):
        pass

    def vector(num_envs=1, **arguments):
        return Doubled(RollingJointVectorEnv(num_envs, **arguments))

    register("reader/Wrapped-v0", entry_point="rj_gym:RollingJointEnv", vector_entry_point=vector)
    env = EnvConfig("reader/Wrapped-v0")
    assert "reader/Wrapped-v0: scalar environments are stepped in turn" in env.why_scalar
    assert isinstance(make_vector_env(env, 2), gymnasium.vector.SyncVectorEnv)
    assert EnvConfig().why_scalar == ""
    assert train.main([*TRAIN, "--set", "env.id=reader/Wrapped-v0", "--run-dir", "run"]) == 0
    assert "note: reader/Wrapped-v0: scalar" in capsys.readouterr().err


def floored(register, terms):
    register("reader/Own-v0", entry_point="rj_gym:RollingJointEnv", vector_entry_point="rj_gym:RollingJointVectorEnv",
             kwargs={"terms": terms, "episode_steps": 8, "action_scale_mm": 4.0})  # fmt: skip
    env = EnvConfig("reader/Own-v0")
    return env, evaluate_controllers(env, untuned_controllers(), range(3))


def test_own_targets_are_tracked_by_controllers_and_a_line_says_why_they_have_no_floor(register):
    targets = Drawn(lambda start: np.full((len(start.uniforms), 1, 2), 50.0))
    env, report = floored(register, Terms(targets=targets))
    assert report.floors is None and "Own targets have no floor" in report.text()
    assert report.scores["predictive"].mean_mm < report.scores["do nothing"].mean_mm
    with pytest.raises(ConfigError, match="own targets"):
        episode_floor(env, range(3))


def test_own_target_tensions_and_loads_have_floors(register):
    def pull(start):
        return np.stack((3.0 + 4.0 * start.uniforms, 7.0 - 4.0 * start.uniforms), axis=-1)

    def push(start):
        return np.stack((start.uniforms * np.linspace(0.0, 0.4, 9), np.zeros((len(start.uniforms), 9))), axis=-1)

    _, report = floored(register, Terms(target_tensions=Drawn(pull, uniforms=1), loads=Drawn(push, uniforms=1)))
    assert np.all(report.floors < 1.0) and all(score.regret_mm > -1e-6 for score in report.scores.values())


def test_built_in_ids_have_no_table_of_rewards():
    episodes = run_episodes(EnvConfig(settings={"episode_steps": 3}), untuned_controllers()["do nothing"], range(2))
    assert episodes.reward_terms == {}
    assert RollingJointEnv().config.terms == Terms()


def test_an_id_of_a_later_version_keeps_that_version_of_its_class(register):
    shipped = load_policy("instrument", version=0)
    first = registered_settings("rj_gym/Instrument-v1", {"mechanism": shipped.mechanism})
    policy = replace(shipped, env_id="rj_gym/Instrument-v1", settings=first, score=None)
    register("reader/Rig-v0", entry_point="rj_gym:InstrumentV1Env", vector_entry_point="rj_gym:InstrumentV1VectorEnv",
             kwargs={"terms": Terms(rewards={"near": lambda step: -step.error_mm})})  # fmt: skip
    settings = registered_settings("reader/Rig-v0", {"mechanism": shipped.mechanism})
    own = replace(policy, env_id="reader/Rig-v0", settings=settings, score=None)
    report = run_episodes(own.environment, own, range(2))
    assert np.array_equal(report.errors, run_episodes(policy.environment, policy, range(2)).errors)
    assert list(report.reward_terms)[-1] == "near"
    again = type(own).from_bytes(own.to_bytes())
    assert again.settings.terms.rewards.keys() == {"near"} and again.sha256 == own.sha256
