"""Ready-made configurations: commands take names, list them and copy them; a wrong name is one line."""

import pytest

from agents.campaign import main as campaign
from agents.codesign.__main__ import main as codesign
from agents.runs import ready_made
from agents.runs.config import load_config
from agents.runs.ready_made import (
    CAMPAIGN,
    CODESIGN,
    KINDS,
    SEARCH,
    TRAIN,
    TUNE,
    configuration_file,
    copied,
    list_of,
    names,
)
from agents.search.__main__ import main as search
from agents.train import main
from agents.tune import main as tune
from rollingjoint.errors import ConfigError


def test_every_kind_has_names_and_a_line_about_each():
    for kind in KINDS:
        lines = list_of(kind).splitlines()
        assert len(lines) == len(names(kind)) > 0 and all(len(line.split("  ", 1)[1].strip()) > 10 for line in lines)


def test_a_file_goes_before_a_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert configuration_file(TRAIN, "demo").parent.name == "train"
    (tmp_path / "demo").write_text("seed: 1")
    assert str(configuration_file(TRAIN, "demo")) == "demo"


@pytest.mark.parametrize("name", names(TRAIN))
def test_a_copy_is_the_same_configuration_wherever_it_is(name, tmp_path):
    copied(name, tmp_path / "mine.yaml")
    assert load_config(tmp_path / "mine.yaml").content() == load_config(configuration_file(TRAIN, name)).content()


def test_the_command_lists_and_copies(tmp_path, capsys):
    assert main(["--list"]) == 0
    assert "ppo_rolling_joint " in capsys.readouterr().out
    mine = tmp_path / "mine.yaml"
    assert main(["apg_instrument", "--write", str(mine)]) == 0
    assert "file: instrument\n" in mine.read_text() and f"rj train {mine}" in capsys.readouterr().out
    assert main(["apg_instrument", "--write", str(mine)]) == 2
    assert "expected a file that does not exist yet" in capsys.readouterr().err
    for arguments in (["--list"], ["--resume", str(tmp_path)]):
        assert main([*arguments, "--write", str(mine)]) == 2
        assert "expected the name of a ready-made configuration beside it" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "kind"), [(search, SEARCH), (codesign, CODESIGN), (campaign, CAMPAIGN), (tune, TUNE)]
)
def test_the_other_commands_list_theirs(command, kind, capsys):
    with pytest.raises(SystemExit) as ended:
        command(["--list"])
    assert ended.value.code == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == names(kind)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("ppo_roling_joint", "one of .*Did you mean 'ppo_rolling_joint'?"),
        ("configs/train/ppo_rolling_joint.yaml", "The ready-made one is 'ppo_rolling_joint'."),
    ],
)
def test_what_is_neither_a_file_nor_a_name_is_refused_with_the_nearest(given, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match=message):
        configuration_file(TRAIN, given)


def test_installed_they_are_inside_the_package(tmp_path, monkeypatch):
    (tmp_path / "train").mkdir()
    (tmp_path / "train/own.yaml").write_text("# Own.\nseed: 1\n")
    monkeypatch.setattr(ready_made, "_FOLDERS", (tmp_path, *ready_made._FOLDERS))
    assert names(TRAIN) == ["own"]
