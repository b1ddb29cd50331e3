"""The page about own tasks: its module, training file and commands, as a reader types them (fewer steps)."""

import re
import shlex
from pathlib import Path

import gymnasium
import pytest

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "your_task.md").read_text("utf-8")


def block(language):
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)[0]


def test_the_examples_of_the_page_run_one_after_another(capsys):
    names: dict = {}
    for program in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL):
        exec(program.replace("6_400", "640").replace("n_steps=50, batch_size=800", "n_steps=5, batch_size=320"), names)
    gymnasium.registry.pop("my_lab/Swing-v0")
    (output,) = re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL)
    assert output in capsys.readouterr().out


@pytest.mark.slow
def test_a_task_of_ones_own_is_trained_and_evaluated_by_the_commands_of_the_page(run_python, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("my_task.py").write_text(block("python"), "utf-8")
    Path("swing.yaml").write_text(block("yaml").replace("96_000", "3_200").replace("16_000", "1_600"), "utf-8")
    monkeypatch.setenv("PYTHONPATH", f".:{Path(__file__).resolve().parents[2]}")
    for line in block("sh").splitlines():
        _, command, *words = shlex.split(line)
        assert command == "rj"
        printed = run_python("-m", "rollingjoint", *words)
    assert "policy" in printed and Path("swing", "evaluation", "report.md").exists()


@pytest.mark.slow
def test_without_import_the_module_of_the_task_is_refused(run_python, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("my_task.py").write_text("raise SystemExit('it has run')", "utf-8")
    Path("swing.yaml").write_text(block("yaml"), "utf-8")
    with pytest.raises(Exception, match=r"--import"):
        run_python("-m", "agents.train", "--config", "swing.yaml", "--run-dir", "swing")
