"""Commands that other packages add to `rj`."""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from rollingjoint.cli import extensions, main
from tests.rollingjoint.command import rj


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """As from a wheel: without the table of the checkout."""
    monkeypatch.setattr(extensions, "TABLE", Path("nowhere.toml"))


@pytest.fixture
def extended(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, installed: None) -> Path:
    """A working directory in which a package has added `rj greet`, and has tried to replace `rj solve`."""
    purpose = '"""Greet somebody: python -m greeting NAME."""'
    (tmp_path / "greeting.py").write_text(f"{purpose}\ndef main(argv):\n    print('hello', *argv)\n    return 7\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.delitem(sys.modules, "greeting", raising=False)
    added = [EntryPoint(name, "greeting:main", extensions.GROUP) for name in ("greet", "solve")]
    monkeypatch.setattr(extensions, "entry_points", lambda group: [one for one in added if one.group == group])
    return tmp_path


def test_another_package_adds_a_command_that_gets_its_arguments_as_they_are(
    extended: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["greet", "--loud", "-1"]) == 7
    assert capsys.readouterr().out == "hello --loud -1\n"
    assert sys.path[-1] == str(extended)  # after all that is installed


def test_a_checkout_has_the_commands_of_its_controllers_without_being_installed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(extensions, "entry_points", lambda group: [])
    monkeypatch.setattr(sys, "path", list(sys.path))
    assert rj("export-policy --list") == 0
    assert "fixed_target" in capsys.readouterr().out
    assert rj("--help") == 0
    mechanisms, controllers = capsys.readouterr().out.partition("\nmechanisms:\n")[2].split("\ncontrollers:\n")
    assert "  solve " in mechanisms and "  train          Train a controller\n" in controllers


def test_no_package_replaces_a_command_of_rj(extended: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["solve", "five_link", "--tensions", "6", "3"]) == 0
    assert "hello" not in capsys.readouterr().out


def test_help_says_what_every_added_command_does_without_importing_it(
    extended: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.syspath_prepend(str(extended))
    assert rj("--help") == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1] == "  greet  Greet somebody"  # and no second `solve`
    assert "greeting" not in sys.modules


def test_help_lists_an_added_command_whose_module_is_not_found(
    extended: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rj("--help") == 0
    assert "  greet" in capsys.readouterr().out.splitlines()


@pytest.mark.parametrize(
    ("name", "module", "line"),
    [
        ("search", "filelock", 'filelock is not installed: run pip install "rollingjoint[search]"'),
        ("search", "torch", 'torch is not installed: run pip install "rollingjoint[search]"'),
        ("campaign", "filelock", 'filelock is not installed: run pip install "rollingjoint[train]"'),
        ("view", "matplotlib", 'matplotlib is not installed: run pip install "rollingjoint[view]"'),
        ("train", "some_package", "No module named 'some_package'"),
    ],
)
def test_a_command_without_its_packages_asks_for_its_own_extra(
    name: str,
    module: str,
    line: str,
    installed: None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "needy.py").write_text(f"raise ModuleNotFoundError(\"No module named '{module}'\", name='{module}')\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    added = EntryPoint(name, "needy:main", extensions.GROUP)
    monkeypatch.setattr(extensions, "entry_points", lambda group: [added])
    assert main([name]) == 2
    assert capsys.readouterr().err == f"rj {name}: error: {line}\n"
