"""Run folders written before modules moved: their policies are used, and resuming is refused in one line."""

import base64
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from agents import evaluate, export, train
from agents.evaluation.controller import Seen
from agents.policies.trained import load_trained
from agents.runs.command_line import exit_code
from agents.runs.files import hash_file
from agents.runs.folder import RunFolder
from agents.runs.pickles import PickleWarning
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
    changed = [path.name for path in [*run.rglob("policy.zip"), *run.rglob("training.pkl")] if rewritten(path)]
    assert {"policy.zip", "training.pkl"} == set(changed)
    for file in [*run.rglob("policy.safetensors*")]:  # which older runs do not have
        file.unlink()
    return run, action


def acted(run: Path) -> np.ndarray:
    policy = load_trained(RunFolder.open(run))
    return policy.act(Seen(np.linspace(-1, 1, policy.network.entries)[None].astype(np.float32)))


def test_a_policy_whose_schedules_were_of_another_module_acts_as_before(runs):
    run, action = runs
    with pytest.warns(PickleWarning, match="best/policy.zip and .*best/normaliser.pkl: reading a pickle can run any"):
        assert np.array_equal(acted(run), action)


def test_an_old_run_is_evaluated_and_exported(runs, tmp_path, capsys, no_pictures):
    run, _ = runs
    assert evaluate.main([str(run), "--episodes", "2", "--out", str(tmp_path)]) == 0
    assert export.main([str(run), "--name", "old", "--episodes", "2", "--out", str(tmp_path)]) == 0
    assert (tmp_path / "old.safetensors").is_file()
    warnings = capsys.readouterr().err.splitlines()
    assert len(warnings) == 2 and all(f"warning: {run}/best/policy.zip and {run}/best/n" in line for line in warnings)
    assert evaluate.main([str(run), "--episodes", "2", "--out", str(tmp_path), "--trust"]) == 0
    assert capsys.readouterr().err == ""


def test_a_pickle_that_is_read_again_is_warned_of_once(runs, capsys):
    run, _ = runs
    assert exit_code(lambda: len([acted(run) for _ in range(2)])) == 2
    assert capsys.readouterr().err.count("warning: ") == 1


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
