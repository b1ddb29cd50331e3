"""What the README tells a reader to type works, and prints what the README says it prints."""

import re
import shlex
import tomllib
from pathlib import Path

import pytest

from tests.rollingjoint.command import rj

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text()
TARGETS = set(re.findall(r"^([a-z-]+)(?= .*:|:)", (ROOT / "Makefile").read_text(), re.MULTILINE))
EXTRAS = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"])

PYTHON_BLOCK = re.compile(r"^```python\n(.*?)^```\n(?:\n```text\n(.*?)^```)?", re.MULTILINE | re.DOTALL)
BASH_BLOCK = re.compile(r"^```bash\n(.*?)^```", re.MULTILINE | re.DOTALL)
COMMANDS = [
    words
    for block in BASH_BLOCK.findall(README)
    for line in block.replace("\\\n", " ").splitlines()
    if (words := shlex.split(line, comments=True))
]
SHORT = ("rj", "python")
LONG = ".venv/bin/rj"  # takes minutes: its options are checked, it is not run


@pytest.mark.parametrize(("program", "output"), PYTHON_BLOCK.findall(README))
def test_python_block_runs_and_prints_the_text_block_below_it(program, output, run_python):
    printed = run_python("-c", program)
    if output:
        assert printed == output


def test_commands_are_of_the_kinds_that_these_tests_check():
    assert {words[0] for words in COMMANDS} <= {*SHORT, LONG, "make", "pip", "git", "cd"}


@pytest.mark.parametrize("words", [w for w in COMMANDS if w[0] in SHORT], ids=" ".join)
def test_command_runs(words, run_python):
    if words[0] == "rj":
        assert rj(shlex.join(words[1:])) == 0
    else:
        run_python(*words[1:])


@pytest.mark.parametrize("words", [w for w in COMMANDS if w[0] == LONG], ids=" ".join)
def test_long_command_names_options_and_files_that_exist(words, run_python):
    usage = run_python("-m", "rollingjoint", words[1], "--help")
    assert [word for word in words[2:] if word.startswith("--") and word not in usage] == []
    assert [word for word in words if word.startswith("configs/") and not (ROOT / word).exists()] == []


@pytest.mark.parametrize("words", [w for w in COMMANDS if w[0] == "make"], ids=" ".join)
def test_make_target_exists(words):
    assert {word for word in words[1:] if "=" not in word} <= TARGETS


@pytest.mark.parametrize("words", [w for w in COMMANDS if w[0] == "pip"], ids=" ".join)
def test_pip_extra_exists(words):
    assert set(re.findall(r"\[(\w+)\]", " ".join(words))) <= EXTRAS
