"""The lint of names and prose: its measures, and that a passed limit fails."""

import importlib.util
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[1] / ".ci" / "prose.py"


@pytest.fixture
def prose(monkeypatch):
    spec = importlib.util.spec_from_file_location("prose", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(sys, "argv", ["prose.py"])
    return module


@pytest.fixture
def small_house(prose, monkeypatch, tmp_path):
    """Three packages of one file each, as a root of the lint."""
    for package in ("rollingjoint", "rj_gym", "agents"):
        (tmp_path / package).mkdir()
        (tmp_path / package / "tensions.py").write_text(
            '"""Tensions of the tendons."""\n\nlimits = (0.0, 15.0)\n', "utf-8"
        )
    monkeypatch.setattr(prose, "ROOT", tmp_path)
    return tmp_path


def test_plain_sources_pass(prose, small_house, capsys):
    assert prose.main() == 0 and capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ('"""What is pulled."""\n', "rj_gym: what"),
        ('"""Tensions."""\n\nlimits = 1.0  # nobody sets them\n', "rj_gym: nothing, nobody"),
        ('"""Tensions."""\n\nfound = 1.0\n', "rj_gym: names"),
    ],
)
def test_a_mannerism_or_a_name_that_is_no_noun_fails(prose, small_house, capsys, source, said):
    (small_house / "rj_gym" / "tensions.py").write_text(source, "utf-8")
    assert prose.main() == 1
    assert said in capsys.readouterr().err


def test_a_class_name_with_two_meanings_is_counted(prose, small_house, monkeypatch):
    for package in ("rollingjoint", "agents"):
        (small_house / package / "step.py").write_text('"""Steps."""\n\n\nclass Step:\n    """A step."""\n', "utf-8")
    assert prose.double_classes() == {"Step": ["rollingjoint/step.py", "agents/step.py"]}
    monkeypatch.setattr(prose, "MOST_DOUBLE_CLASSES", 0)
    assert prose.main() == 1
