"""Run folders written before modules moved: their policies are used, and resuming is refused in one line."""

import base64
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch

from agents import evaluate, export, train
from agents.controllers.controller import Reading
from agents.policies.trained import load_trained
from agents.runs.consent import Consent, allowing
from agents.runs.files import RunFolderError, hash_file, seal
from agents.runs.folder import RunFolder
from agents.runs.schedules import Linear

NOW, THEN = Linear.__module__.encode(), b"agents.gone.schedules"
CHANGES = "total_timesteps=80 env.n_envs=2 env.settings.episode_steps=10 policy.hidden=[8] evaluation.every=80 "
CHANGES += "evaluation.episodes=2 checkpoint_every=40"
PARAMETERS = (
    "parameters={n_steps: 20, batch_size: 20, learning_rate: {linear: [1e-2, 0]}, clip_range: {linear: [1, 0]}}"
)


def rewritten(path: Path) -> bool:
    """Whether the pickles in a zip name the module of the schedules; now they name it as it was called THEN."""
    with zipfile.ZipFile(path) as archive:
        contents = {name: archive.read(name) for name in archive.namelist()}
    named = any(NOW in content for content in contents.values())
    contents = {name: content.replace(NOW, THEN) for name, content in contents.items()}
    values = json.loads(contents.get("data", b"{}"))
    for value in values.values():
        if isinstance(value, dict) and ":serialized:" in value:
            pickled = base64.b64decode(value[":serialized:"])
            named |= NOW in pickled
            value[":serialized:"] = base64.b64encode(pickled.replace(NOW, THEN)).decode()
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in contents.items():
            archive.writestr(name, json.dumps(values) if name == "data" else content)
    hash_file(path).unlink()  # older runs have none
    return named


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> tuple[Path, np.ndarray]:
    """A run as it would be had its schedules been of a module that is gone, and an action of it before that."""
    run = tmp_path_factory.mktemp("old") / "run"
    changes = [word for change in [*CHANGES.split(), PARAMETERS] for word in ("--set", change)]
    assert len(NOW) == len(THEN)
    assert train.main(["--config", "configs/train/demo.yaml", "--run-dir", str(run), *changes]) == 0
    action = acted(run)
    for folder in run.rglob("resume"):
        for file in folder.glob("training.safetensors*"):
            file.unlink()
        torch.save({"model": {"rate": Linear(1.0, 0.0)}}, folder / "training.pkl")
        seal(folder / "training.pkl")
    changed = [path.name for path in [*run.rglob("policy.zip"), *run.rglob("training.pkl")] if rewritten(path)]
    assert {"policy.zip", "training.pkl"} == set(changed)
    for file in [*run.rglob("policy.safetensors*")]:  # which older runs do not have
        file.unlink()
    return run, action


def acted(run: Path) -> np.ndarray:
    policy = load_trained(RunFolder.open(run))
    return policy.act(Reading(np.linspace(-1, 1, policy.network.entries)[None].astype(np.float32)))


def test_a_policy_whose_schedules_were_of_another_module_acts_as_before(runs):
    run, action = runs
    with pytest.raises(RunFolderError, match=r"best/policy.zip and .*best/normaliser.pkl.*any code.*--trust reads it"):
        acted(run)
    with allowing(Consent(pickles=True)):
        assert np.array_equal(acted(run), action)


def test_an_old_run_is_evaluated_and_exported_where_it_is_trusted(runs, tmp_path, capsys, no_pictures):
    run, _ = runs
    assert evaluate.main([str(run), "--episodes", "2", "--out", str(tmp_path), "--trust"]) == 0
    assert export.main([str(run), "--name", "old", "--episodes", "2", "--out", str(tmp_path), "--trust"]) == 0
    assert (tmp_path / "old.safetensors").is_file()
    assert capsys.readouterr().err == ""


def test_resuming_an_old_run_is_refused_in_one_line_that_says_how_to_go_on(runs, capsys):
    run, _ = runs
    assert train.main(["--resume", str(run), "--set", "total_timesteps=120", "--trust"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    for words in (
        "agents.gone",
        "begun with rollingjoint",
        "evaluated and exported",
        f"--config {run / 'config.yaml'}",
    ):
        assert words in error
