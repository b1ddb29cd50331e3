"""Code that files name runs where the command line imports its module, and not else."""

import json
import sys

import gymnasium
import pytest

from agents import campaign, evaluate, train
from agents.runs.consent import Consent, allowing, consent
from agents.runs.environment import EnvConfig
from rollingjoint.errors import ConfigError

OWN_TASK = """
import pathlib
import gymnasium
import numpy as np

pathlib.Path(__file__).with_suffix(".ran").touch()


class Still(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(-10.0, 10.0, (3,))
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,))

    def reset(self, seed=None, options=None):
        super().reset(seed=seed)
        self.steps = 0
        return np.zeros(3, np.float32), {"error_mm": 1.0}

    def step(self, action):
        self.steps += 1
        return np.zeros(3, np.float32), -1.0, False, self.steps == 5, {"error_mm": 1.0}


gymnasium.register("own/Still-v0", Still)
"""
NAME = "own_task_of_a_stranger"
ID = f"{NAME}:own/Still-v0"
WORDS = ["--set", "env.file=null", "--set", "env.settings={}", "--set", f"env.id={ID}"]


@pytest.fixture
def ran(tmp_path, monkeypatch):
    """The mark that the module leaves when it runs; the working directory is that of the module."""
    (tmp_path / f"{NAME}.py").write_text(OWN_TASK)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path / f"{NAME}.ran"
    sys.modules.pop(NAME, None)
    gymnasium.registry.pop("own/Still-v0", None)


@pytest.fixture
def demo(tmp_path, request):
    return request.config.rootpath / "configs/train/demo.yaml"


def test_a_configuration_runs_no_code_without_consent(ran, demo, capsys):
    assert train.main(["--config", str(demo), *WORDS]) == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert f"env.id = '{ID}'" in error and f"--import {NAME}" in error
    assert not ran.exists()


@pytest.mark.slow
@pytest.mark.parametrize("module", [NAME, f"{NAME}.py"])
def test_a_module_that_the_command_imports_trains_evaluates_and_is_recorded(module, ran, demo, tmp_path, capsys):
    run = tmp_path / "run"
    allowed = ["--import", module]
    small = ["total_timesteps=40", "parameters={n_steps: 20, batch_size: 40}", "env.n_envs=2", "evaluation.every=40"]
    words = [*WORDS, *(word for each in (*small, "evaluation.episodes=2") for word in ("--set", each))]
    assert train.main(["--config", str(demo), "--run-dir", str(run), *words, *allowed]) == 0
    assert ran.exists()
    assert json.loads((run / "versions.json").read_text())["imported"] == [NAME]
    assert consent() == Consent()
    ran.unlink()
    sys.modules.pop(NAME)
    gymnasium.registry.pop("own/Still-v0")
    score, go_on = [str(run), "--episodes", "2"], ["--resume", str(run), "--set", "total_timesteps=80"]
    for main, words in ((evaluate.main, score), (train.main, go_on)):
        capsys.readouterr()
        assert main(words) == 2
        (error,) = capsys.readouterr().err.splitlines()
        assert f"--import {NAME}" in error
        assert not ran.exists()
    for main, words in ((evaluate.main, score), (train.main, go_on)):
        assert main([*words, *allowed]) == 0


@pytest.mark.slow
def test_a_campaign_passes_consent_on_to_its_workers(ran, demo, tmp_path, capsys):
    (tmp_path / "own.yaml").write_text(
        f"env: {{id: '{ID}', n_envs: 2}}\nalgorithm: ppo\ntotal_timesteps: 40\ncheckpoint_every: 40\n"
        "parameters: {n_steps: 20, batch_size: 40}\npolicy: {hidden: [8]}\nevaluation: {every: 40, episodes: 2}\n"
    )
    (tmp_path / "list.yaml").write_text("runs: [{config: own.yaml, seeds: [1]}]")
    command = ["list.yaml", "--out", "out", "--jobs", "1"]
    assert campaign.main(command) == 2
    assert "--import" in capsys.readouterr().err and not ran.exists()
    assert campaign.main([*command, "--import", NAME]) == 0
    assert (tmp_path / "out/own/seed_1/policy.safetensors").is_file()


def test_a_module_that_cannot_be_imported_is_named_in_one_line(demo, capsys):
    assert train.main(["--config", str(demo), "--import", "no_such_module"]) == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert "--import = 'no_such_module'" in error and "NAME.py" in error


@pytest.mark.parametrize(
    "name", ["os:x", "a.b:rj_gym/RollingJoint-v0", ":rj_gym/RollingJoint-v0", "own/Listed-v0", "own/Listed"]
)
def test_an_id_that_names_a_module_is_refused(name, monkeypatch):
    listed = gymnasium.envs.registration.EnvSpec("own/Listed-v0", "own_module:Listed")  # as installed packages do
    monkeypatch.setitem(gymnasium.registry, "own/Listed-v0", listed)
    with pytest.raises(ConfigError, match=r"env\.id .* --import"):
        EnvConfig(name)


def test_consent_to_a_module_is_none_to_others_that_begin_like_it():
    with allowing(Consent(modules=("json",))):
        EnvConfig("json:any/Thing-v0")
        EnvConfig("json.decoder:any/Thing-v0")
        with pytest.raises(ConfigError):
            EnvConfig("json_of_others:any/Thing-v0")
