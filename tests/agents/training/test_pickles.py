"""What commands read of a run folder runs no code of it; they read pickles with --trust alone."""

import base64
import json
import pickle
import shutil
import sys
import zipfile
from pathlib import Path

import pytest
import stable_baselines3.common.base_class as base_class
import torch

from agents import campaign, evaluate, export, train, view
from agents.adaptation.controllers import instrument_controller
from agents.policies.trained import load_driving
from agents.results.runs import FinishedRun
from agents.runs.files import seal
from agents.runs.folder import RunFolder
from agents.shipped import load_policy
from rollingjoint.errors import ConfigError
from tests.agents.training.test_train import tiny_train


class Trap:
    """Says so, and leaves a file behind, when it is unpickled."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def __reduce__(self):
        return _spring, (str(self.file),)


def _spring(file: str) -> None:
    Path(file).touch()
    print("sprung", file=sys.stderr)


def lay_trap(path: Path, sprung: Path) -> None:
    """In place of a pickle, in the form in which Stable-Baselines3, torch or pickle would read it."""
    trap = pickle.dumps(Trap(sprung))
    if path.suffix == ".zip":
        held = {":type:": "trap", ":serialized:": base64.b64encode(trap).decode()}
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("data", json.dumps({"trap": held}))
    elif path.name == "training.pkl":
        torch.save(Trap(sprung), path)
    else:
        path.write_bytes(trap)
    seal(path)


@pytest.fixture(scope="module")
def trapped(tmp_path_factory) -> Path:
    """A finished run in which all that can be unpickled is a trap, with hashes as if it had been written so."""
    folder = tmp_path_factory.mktemp("runs") / "member" / "seed_1"
    folder.parent.mkdir()
    assert tiny_train(folder) == 0
    pickles = [*folder.rglob("*.pkl"), *folder.rglob("*.zip")]
    assert {path.name for path in pickles} == {"policy.zip", "normaliser.pkl"}
    for path in pickles:
        lay_trap(path, folder.parent / "sprung")
    return folder


def files(run: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in run.parent.rglob("*") if path.is_file()}


USES = {
    "evaluate": lambda run, out: evaluate.main([str(run), "--episodes", "2", "--out", str(out)]),
    "evaluate the last": lambda run, out: evaluate.main(
        [str(run), "--episodes", "2", "--out", str(out), "--policy", "last"]
    ),
    "export": lambda run, out: export.main([str(run), "--name", "own", "--episodes", "2", "--out", str(out)]),
    "results": lambda run, out: FinishedRun.read(run) and load_driving(RunFolder.open(run)) and 0,
    "resume": lambda run, out: train.main(
        ["--resume", str(shutil.copytree(run, out / "run")), "--set", "total_timesteps=120"]
    ),
    "policy": lambda run, out: load_policy(run / "best/policy.safetensors") and 0,
}


@pytest.mark.parametrize("use", USES.values(), ids=USES)
def test_a_run_is_used_without_unpickling(use, trapped, tmp_path, monkeypatch, no_pictures, capsys):
    def no(*anything, **more):
        raise AssertionError("unpickled")

    monkeypatch.setattr(torch, "load", no)
    monkeypatch.setattr(base_class, "load_from_zip_file", no)
    before = files(trapped)
    assert use(trapped, tmp_path) == 0
    assert capsys.readouterr().err == ""
    assert files(trapped) == before


def test_a_run_of_another_task_is_refused_as_a_driver_of_robots_without_unpickling(trapped):
    with pytest.raises(ConfigError, match="with other observations"):
        instrument_controller(str(trapped))
    assert not (trapped.parent / "sprung").exists()


def as_earlier_versions_wrote_it(trapped: Path, folder: Path) -> Path:
    """The run with pickles alone, all of them traps."""
    run = shutil.copytree(trapped, folder / "member" / "seed_1")
    for file in run.rglob("*.safetensors*"):
        file.unlink()
    for resume in run.rglob("resume"):
        lay_trap(resume / "training.pkl", trapped.parent / "sprung")
    return run


READS = {
    "evaluate": (evaluate.main, [], "best/policy.zip"),
    "export": (export.main, ["--name", "own"], "best/policy.zip"),
    "view": (lambda words: view.main(["--run", *words]), [], "best/policy.zip"),
    "resume": (
        lambda words: train.main(["--resume", *words]),
        ["--set", "total_timesteps=120"],
        "checkpoints/000000080/resume/training.pkl",
    ),
}


@pytest.mark.parametrize(("command", "words", "named"), READS.values(), ids=READS)
def test_a_pickle_is_named_and_not_read_without_trust(command, words, named, trapped, tmp_path, capsys):
    run, sprung = as_earlier_versions_wrote_it(trapped, tmp_path), trapped.parent / "sprung"
    before = files(run)
    assert command([str(run), *words]) == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert error.startswith(f"error: {run / named}") and "any code" in error and "--trust" in error
    assert not sprung.exists()
    assert files(run) == before
    assert command([str(run), *words, "--trust"]) == 2
    assert capsys.readouterr().err.splitlines()[0] == "sprung"
    sprung.unlink()


def test_a_campaign_resumes_no_run_in_pickles_without_trust(trapped, tmp_path, monkeypatch, capsys):
    run = as_earlier_versions_wrote_it(trapped, tmp_path)
    config = (run / "config.yaml").read_text().replace("total_timesteps: 80", "total_timesteps: 120")
    (tmp_path / "member.yaml").write_text(config.replace("torch_threads: 2", "torch_threads: 1"))
    for name in ("config.yaml", "config.yaml.sha256"):
        (run / name).unlink()
    (run / "config.yaml").write_text((tmp_path / "member.yaml").read_text())
    (tmp_path / "list.yaml").write_text("runs: [{config: member.yaml, seeds: [1]}]")
    resumed = []
    monkeypatch.setattr(
        campaign.Campaign, "_work", lambda self, executor, waiting, signals: resumed.extend(waiting) or {}
    )
    command = [str(tmp_path / "list.yaml"), "--out", str(tmp_path), "--jobs", "1"]
    assert campaign.main(command) == 2
    assert f"cannot be trained: member seed 1: {run}/checkpoints/0" in capsys.readouterr().err
    assert resumed == []
    assert campaign.main([*command, "--trust"]) == 0
    assert [member.folder(tmp_path) for member in resumed] == [run]
    assert capsys.readouterr().err == ""
