"""What Windows and macOS lack is not used, or only where it is there; their CI runs the tests that they can run."""

import ast
import io
import os
import re
import signal
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
import yaml

from agents.runs import command_line
from agents.runs.config import TrainConfig
from agents.runs.folder import RunFolder
from agents.runs.locks import file_lock
from rollingjoint.cli import main

ROOT = Path(__file__).resolve().parent.parent
ONLY_SOMEWHERE = {"fcntl", "grp", "msvcrt", "posix", "pty", "pwd", "resource", "syslog", "termios", "winreg"}
NOT_ON_WINDOWS = {
    "os": {"fork", "forkpty", "getuid", "geteuid", "getgid", "setsid", "killpg", "getpgid", "uname", "mkfifo", "wait",
           "sched_getaffinity", "sched_setaffinity", "getloadavg", "nice", "fchmod", "chown", "statvfs", "pread"},
    "signal": {"SIGKILL", "SIGALRM", "SIGHUP", "SIGUSR1", "SIGUSR2", "SIGCHLD", "SIGQUIT", "alarm", "setitimer",
               "pthread_sigmask", "pause"},
    "time": {"tzset", "clock_gettime"},
}  # fmt: skip


@cache
def modules() -> dict[str, ast.Module]:
    """The syntax trees of all modules, by path."""
    return {
        path.relative_to(ROOT).as_posix(): ast.parse(path.read_text("utf-8"))
        for top in ("rollingjoint", "rj_gym", "agents", "examples")
        for path in sorted((ROOT / top).rglob("*.py"))
    }


def unconditional(tree: ast.Module) -> Iterator[ast.stmt]:
    """Statements that run when a module is imported, whatever the system."""
    for statement in tree.body:
        if not isinstance(statement, ast.If | ast.Try | ast.FunctionDef | ast.ClassDef):
            yield from (node for node in ast.walk(statement) if isinstance(node, ast.stmt))


@pytest.mark.slow
def test_no_module_imports_what_only_some_systems_have():
    found = set()
    for name, tree in modules().items():
        for statement in unconditional(tree):
            if isinstance(statement, ast.Import):
                found |= {(name, alias.name.partition(".")[0]) for alias in statement.names}
            elif isinstance(statement, ast.ImportFrom) and statement.module:
                found.add((name, statement.module.partition(".")[0]))
    assert len(found) > 1000
    assert {one for one in found if one[1] in ONLY_SOMEWHERE} == set()


@pytest.mark.slow
@pytest.mark.parametrize(("module", "names"), NOT_ON_WINDOWS.items())
def test_functions_that_windows_lacks_are_used_where_they_are_there(module, names):
    found = set()
    for name, tree in modules().items():
        nodes = list(ast.walk(tree))
        used = {node.attr for node in nodes if isinstance(node, ast.Attribute) and is_name(node.value, module)}
        questions = [node for node in nodes if isinstance(node, ast.Call) and is_name(node.func, "hasattr")]
        asked = {ast.unparse(question) for question in questions}
        found |= {(name, one) for one in used & names if f"hasattr({module}, {one!r})" not in asked}
    assert found == set()


def is_name(node: ast.expr, name: str) -> bool:
    return isinstance(node, ast.Name) and node.id == name


def names_no_encoding(call: ast.Call) -> bool:
    """Whether the call reads or writes text in the encoding of the system."""
    called = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    words = ast.unparse(call)
    ours = is_name(call.func, "write_text") or words.startswith(("RunFolder.open(", "tarfile.open(", "Image.open("))
    others = words.startswith("os.open(") or re.search(r"open\((.*, )?'[arwx]b'", words)
    return called in ("open", "read_text", "write_text") and not (ours or others or "utf-8" in words)


@pytest.mark.slow
def test_text_files_are_read_and_written_in_one_encoding_everywhere():
    for name, tree in modules().items():
        calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
        assert [f"{name}:{one.lineno}" for one in calls if names_no_encoding(one)] == []


@pytest.mark.slow
def test_processes_are_started_by_multiprocessing_alone():
    apart = {"start_new_session", "creationflags", "preexec_fn", "terminate"}
    for name, tree in modules().items():
        words = {node.arg for node in ast.walk(tree) if isinstance(node, ast.keyword)}
        words |= {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
        assert not words & apart, name


@pytest.fixture
def like_windows(monkeypatch):
    """Renaming as Windows has it: onto no folder that is there, and no folder in which a file is locked."""
    replace = os.replace

    def strict(source, target):
        if Path(target).is_dir():
            raise PermissionError(13, "Access is denied", str(target))
        if (lock := Path(source, "lock")).exists():
            with file_lock(lock):
                pass
        replace(source, target)

    monkeypatch.setattr(os, "replace", strict)
    monkeypatch.setattr(os, "rename", strict)


def test_run_folders_are_made_and_replaced_as_windows_renames(like_windows, tmp_path):
    (tmp_path / "run").mkdir()
    run = RunFolder.create(tmp_path / "run", TrainConfig(seed=1), [])
    with run.locked():
        pass
    assert (run.path / "lock").exists()
    assert RunFolder.create(run.path, TrainConfig(seed=2), [], force=True).config().seed == 2
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_ctrl_c_and_termination_ask_a_command_to_stop_on_every_system():
    assert {signal.SIGINT, signal.SIGTERM} <= set(command_line.STOPPING)


@pytest.mark.parametrize("encoding", ["ascii", "cp1252"])
def test_a_terminal_without_all_characters_gets_a_question_mark(encoding, monkeypatch):
    terminal = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    monkeypatch.setattr(sys, "stdout", terminal)
    monkeypatch.setitem(main.__globals__["PRESETS"], "λ-joint", main.__globals__["PRESETS"]["five_link"])
    assert main(["mechanisms"]) == 0
    assert b"?-joint" in terminal.buffer.getvalue()


def test_every_system_has_its_ci():
    jobs = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text("utf-8"))["jobs"]
    assert {"run": ".ci/run"} in jobs["linux"]["steps"]
    assert jobs["portable"]["strategy"]["matrix"]["os"] == ["windows-latest", "macos-latest"]
    commands = " ".join(step.get("run", "") for step in jobs["portable"]["steps"])
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    marks = [mark.partition(":")[0] for mark in project["tool"]["pytest"]["ini_options"]["markers"]]
    assert set(re.findall(r"not (\w+)", commands)) <= set(marks)
    extras = re.findall(r"--extra (\w+)", commands)
    assert "dev" in extras and set(extras) <= set(project["project"]["optional-dependencies"])
