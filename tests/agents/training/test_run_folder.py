import errno
import json
import os

import pytest

from agents.runs.config import TrainConfig
from agents.runs.files import (
    RunFolderError,
    is_as_written,
    write_file,
    write_hashed_bytes,
    write_hashed_text,
    write_text,
)
from agents.runs.folder import RunFolder
from agents.train import main
from agents.training import checkpoint
from rollingjoint.chain.presets import five_link
from rollingjoint.errors import ConfigError
from rollingjoint.io.mechanism_file import dump_mechanism


def test_a_new_run_folder_holds_all_that_repeats_the_run(tmp_path):
    config = TrainConfig(seed=5)
    run = RunFolder.create(tmp_path / "run", config, ["rj", "train", "--set", "a b=1"])
    assert run.config() == config
    assert (run.path / "command.txt").read_text() == "rj train --set 'a b=1'\n"
    assert {"python", "numpy", "torch", "stable-baselines3", "gymnasium", "platform"} <= set(
        json.loads((run.path / "versions.json").read_text())
    )
    assert json.loads((run.path / "seeds.json").read_text())["training_environments"] == [5, 20]


def test_a_run_is_replaced_only_by_force(tmp_path):
    path = tmp_path / "run"
    RunFolder.create(path, TrainConfig(seed=1), [])
    with pytest.raises(RunFolderError, match="--force"):
        RunFolder.create(path, TrainConfig(seed=2), [])
    assert RunFolder.open(path).config().seed == 1
    RunFolder.create(path, TrainConfig(seed=2), [], force=True)
    assert RunFolder.open(path).config().seed == 2


def test_force_never_replaces_a_folder_that_is_no_run(tmp_path):
    (tmp_path / "letters.txt").write_text("dear")
    with pytest.raises(RunFolderError, match="stays as it is"):
        RunFolder.create(tmp_path, TrainConfig(), [], force=True)
    assert (tmp_path / "letters.txt").read_text() == "dear"


def test_the_mechanism_file_of_a_run_is_copied_into_its_folder(tmp_path):
    (tmp_path / "mine.yaml").write_text(dump_mechanism(five_link()))
    source = tmp_path / "some.yaml"
    source.write_text("env: {settings: {mechanism: mine.yaml}}")
    from agents.runs.config import load_config

    run = RunFolder.create(tmp_path / "run", load_config(source), [])
    (tmp_path / "mine.yaml").unlink()
    assert run.config().env.settings["mechanism"] == str((run.path / "mechanism.yaml").resolve())


def test_a_file_is_written_whole_or_not_at_all(tmp_path):
    path = tmp_path / "file"
    write_text(path, "old")

    def broken(stream):
        stream.write(b"half")
        raise RuntimeError("disk full")

    with pytest.raises(RuntimeError):
        write_file(path, broken)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    "arguments",
    [
        ["--config", "nowhere.yaml"],
        ["--config", "configs/train/demo.yaml", "--set", "parameters.gamma=2"],
        ["--config", "configs/train/demo.yaml", "--set", "env.id=Nowhere-v0", "--set", "env.file=null"],
        ["--config", "configs/train/demo.yaml", "--set", "env.settings.mechanism=nowhere"],
    ],
)
def test_a_broken_config_ends_with_one_line_and_no_run_folder(arguments, tmp_path, capsys):
    assert main([*arguments, "--run-dir", str(tmp_path / "run")]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["1abc", "12.5", "00000\u0661", "notes"])
def test_other_folders_under_checkpoints_are_left_alone(tmp_path, name):
    run = RunFolder.create(tmp_path / "run", TrainConfig(), [])
    other = run.checkpoints / name / "resume"
    other.mkdir(parents=True)
    whole = run.checkpoints / "000000010"
    (whole / "resume").mkdir(parents=True)
    (whole / "resume" / "training.safetensors").touch()
    assert checkpoint.newest(run) == whole
    assert not run.is_finished
    assert [path.name for path in run.checkpoint_folders] == [whole.name]


@pytest.mark.parametrize("text", ["", "# nothing\n", "{}"])
def test_an_empty_config_is_named_with_its_keys(tmp_path, text):
    run = RunFolder.create(tmp_path / "run", TrainConfig(), [])
    write_hashed_text(run.path / "config.yaml", text)
    for read in (run.config, lambda: run.extend(100, [])):
        with pytest.raises(
            ConfigError, match=r"config.yaml = None: expected keys and values, with the keys algorithm, "
        ):
            read()


def test_a_file_too_large_names_itself(tmp_path):
    with pytest.raises(OSError, match=r"File too large: .*table.csv"):
        write_file(tmp_path / "table.csv", _too_large)


def _too_large(stream):
    raise OSError(errno.EFBIG, os.strerror(errno.EFBIG))


def test_a_write_that_is_broken_off_after_its_hash_is_no_damage(tmp_path, monkeypatch):
    path, replace = tmp_path / "file", os.replace
    write_hashed_bytes(path, b"before")

    def broken_off(source, target):
        if target == path:
            raise OSError
        replace(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", broken_off)
        for _ in range(3):
            with pytest.raises(OSError):
                write_hashed_bytes(path, b"after")
            assert path.read_bytes() == b"before" and is_as_written(path)
    write_hashed_bytes(path, b"after")
    assert path.read_bytes() == b"after" and is_as_written(path)


def test_a_damaged_file_does_not_become_known_when_its_replacement_is_broken_off(tmp_path, monkeypatch):
    path = tmp_path / "file"
    write_hashed_bytes(path, b"before")
    path.write_bytes(b"befone")
    replace = os.replace
    with monkeypatch.context() as patch, pytest.raises(OSError):
        patch.setattr(os, "replace", lambda source, target: replace(source, target) if target != path else os.stat(""))
        write_hashed_bytes(path, b"after")
    assert not is_as_written(path)
