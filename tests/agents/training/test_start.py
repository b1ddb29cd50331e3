"""Runs, trials and campaigns that start as the policy of an earlier run, which is never unpickled."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stable_baselines3.common.base_class as base_class
import torch

from agents import campaign, train, tune
from agents.policies.conversion import network_of
from agents.policies.trained import load_trained
from agents.runs.config import TrainConfig, load_config
from agents.runs.files import RunFolderError
from agents.runs.folder import RunFolder
from agents.training.build import close
from agents.training.start import fresh_model
from rollingjoint.checked_yaml import dump_yaml
from rollingjoint.errors import ConfigError
from tests.agents.learners.test_distill import LANES, STEPS, settings


@pytest.fixture(scope="module")
def distilled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run."""
    folder = tmp_path_factory.mktemp("distilled")
    (folder / "run.yaml").write_text(dump_yaml(settings(2, evaluation={"episodes": 2})))
    assert train.main(["--config", str(folder / "run.yaml"), "--run-dir", str(folder / "run")]) == 0
    return folder / "run"


def refinement(start: Path, **changes: Any) -> TrainConfig:
    parameters = {"learning_rate": 1.0e-4}
    return TrainConfig.from_dict(
        settings(2) | {"algorithm": "apg", "parameters": parameters, "start_from": str(start)} | changes
    )


def test_apg_starts_as_the_distilled_policy(distilled: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module, unpickles in ((torch, "load"), (base_class, "load_from_zip_file")):
        monkeypatch.setattr(module, unpickles, None)
    earlier = load_trained(RunFolder.open(distilled))
    model = fresh_model(refinement(distilled))
    before, after = (each.tensors() for each in (earlier.network, network_of(model, model.get_vec_normalize_env())))
    assert before.keys() == after.keys()
    for name, array in before.items():
        np.testing.assert_allclose(after[name], array, rtol=1e-14 if name == "scale" else 0)
    assert model.get_vec_normalize_env().obs_rms.count == earlier.observations > 1
    assert model.num_timesteps == 0 and earlier.steps > 0
    close(model)


def test_what_a_run_cannot_start_from_is_refused(distilled: Path, tmp_path: Path) -> None:
    other_memory = {"policy": {"memory": 16}}
    raw = {"normalise": {"observation": False, "reward": False}}
    for changes in (other_memory, raw):
        with pytest.raises(ConfigError, match=r"start_from.*a run of apg or distill"):
            fresh_model(refinement(distilled, **changes))
    with pytest.raises(RunFolderError, match="run folder"):
        fresh_model(refinement(tmp_path))
    with pytest.raises(ConfigError, match=r"start_from.*with apg or distill"):
        refinement(distilled, algorithm="ppo", parameters={})


def test_a_path_to_start_from_is_relative_to_the_working_directory(
    distilled: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(distilled.parent)
    assert load_config(distilled / "config.yaml", ["start_from=run"]).start_from == str(distilled.resolve())


@pytest.fixture
def old(distilled: Path, tmp_path: Path) -> Path:
    """The run as earlier versions wrote it: its policies are in pickles."""
    run = shutil.copytree(distilled, tmp_path / "old")
    for file in run.rglob("policy.safetensors*"):
        file.unlink()
    return run


def test_a_run_whose_policy_is_in_pickles_alone_is_not_started_from(old: Path) -> None:
    with pytest.raises(RunFolderError, match=r"start_from.*/old.*Its pickle is not read") as refused:
        fresh_model(refinement(old))
    assert "\n" not in str(refused.value)


def test_a_campaign_says_so_before_its_runs_begin(
    old: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "near.yaml").write_text(dump_yaml(refinement(old).to_dict()))
    (tmp_path / "list.yaml").write_text("runs: [{config: near.yaml, seeds: [1]}]")
    begun = []
    monkeypatch.setattr(
        campaign.Campaign, "_work", lambda self, executor, waiting, signals: begun.extend(waiting) or {}
    )
    assert campaign.main([str(tmp_path / "list.yaml"), "--out", str(tmp_path / "out"), "--jobs", "1"]) == 2
    assert begun == []
    first = capsys.readouterr().err.splitlines()[0]
    assert first.startswith(f"cannot be trained: near seed 1: start_from = '{old}'")


def study(start: Path, folder: Path) -> list[str]:
    """The command of a study of one trial that learns next to nothing from its start on."""
    config = refinement(start, evaluation={"every": 2 * LANES * STEPS})
    space = {"parameters.learning_rate": {"choices": [1.0e-12]}}
    (folder / "study.yaml").write_text(dump_yaml({"train": config.to_dict(), "space": space, "episodes": 2}))
    return ["--config", str(folder / "study.yaml"), "--study", str(folder / "study"), "--trials", "1"]


def test_trials_of_a_study_start_as_the_distilled_policy(
    distilled: Path, tmp_path: Path, no_pictures: None, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tune.main(study(distilled, tmp_path)) == 0
    before, after = (
        load_trained(RunFolder.open(run)).network.tensors()
        for run in (distilled, tmp_path / "study/trials/0000/seed-1")
    )
    for name in before.keys() - {"mean", "scale"}:  # the normaliser goes on learning
        np.testing.assert_allclose(after[name], before[name], atol=1e-6)


def test_a_study_with_nothing_to_start_from_ends_before_its_trials(
    old: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tune.main(study(old, tmp_path)) == 2
    error = capsys.readouterr().err
    assert "start_from" in error and error.count("\n") == 1
    assert not (tmp_path / "study").exists()
