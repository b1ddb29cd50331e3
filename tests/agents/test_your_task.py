"""The page about own tasks: its module, training file and commands, as a reader types them (fewer steps)."""

import re
import shlex
import sys
from pathlib import Path

import pytest

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "your_task.md").read_text("utf-8")


def block(language):
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)[0]


@pytest.mark.slow
def test_a_task_of_ones_own_is_trained_and_evaluated_by_the_commands_of_the_page(run_python, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("my_task.py").write_text(block("python"), "utf-8")
    Path("circle.yaml").write_text(block("yaml").replace("96_000", "3_200").replace("16_000", "1_600"), "utf-8")
    monkeypatch.setenv("PYTHONPATH", f".:{Path(__file__).resolve().parents[2]}")
    for line in block("sh").splitlines():
        words = shlex.split(line)[1:]
        assert words[0] == "python"
        printed = run_python(*words[1:])
    assert "policy" in printed and Path("circle", "evaluation", "report.md").exists()
    assert sys.executable


def test_without_import_the_module_of_the_task_is_refused(run_python, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("my_task.py").write_text("raise SystemExit('it has run')", "utf-8")
    Path("circle.yaml").write_text(block("yaml"), "utf-8")
    with pytest.raises(Exception, match=r"--import"):
        run_python("-m", "agents.train", "--config", "circle.yaml", "--run-dir", "circle")
