"""Kernels are compiled in processes side by side, which end with their parent; what is kept is not compiled again."""

import gc
import operator
import os
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest

import rj_gym.warmup
from rollingjoint import warmup
from rollingjoint._numba.cache import NotCompiled
from rollingjoint.cli import commands, warmup_command
from rollingjoint.interrupts import INTERRUPTED
from rollingjoint.warmup import Group, WarmupProgress, compile_kernels, missing

ROOT = Path(__file__).resolve().parents[2]
ALL = (*warmup.GROUPS, *rj_gym.warmup.GROUPS)


quick, late = gc.collect, gc.get_count  # functions of modules that a process imports at once
wrong = operator.add  # raises TypeError without arguments
ERROR = "TypeError: add expected 2 arguments, got 0"


class Recorded(WarmupProgress):
    """What a run has told."""

    def __init__(self):
        self.told = []

    def started(self, group):
        self.told.append(("started", group.title))

    def ended(self, group, seconds, error):
        assert seconds > 0.0
        self.told.append(("ended", group.title, error))


def test_a_group_waits_for_the_one_that_it_needs(monkeypatch):
    monkeypatch.setattr(warmup, "_processors", lambda: 2)
    record = Recorded()
    assert compile_kernels([Group("second", late, after="first"), Group("first", quick)], record)
    first, second = [("started", "first"), ("ended", "first", "")], [("started", "second"), ("ended", "second", "")]
    assert record.told == first + second


def test_groups_that_others_wait_for_come_first(monkeypatch):
    monkeypatch.setattr(warmup, "_processors", lambda: 1)
    record = Recorded()
    groups = [Group("any", quick), Group("needed", quick), Group("last", late, after="needed")]
    assert compile_kernels(groups, record)
    assert [told[1] for told in record.told if told[0] == "started"] == ["needed", "any", "last"]


def test_no_more_processes_than_processors(monkeypatch):
    monkeypatch.setattr(warmup, "_processors", lambda: 1)
    record = Recorded()
    assert compile_kernels([Group("one", quick), Group("other", quick)], record)
    assert [told[0] for told in record.told] == ["started", "ended"] * 2


@pytest.fixture
def started(monkeypatch):
    """The processes that are started."""
    processes, popen = [], subprocess.Popen
    monkeypatch.setattr(
        warmup.subprocess, "Popen", lambda *args, **given: processes.append(popen(*args, **given)) or processes[-1]
    )
    return processes


def test_a_process_goes_on_with_groups_of_its_family(monkeypatch, started):
    monkeypatch.setattr(warmup, "_processors", lambda: 1)
    record = Recorded()
    chain, arm = {"family": "planar"}, {"family": "arm"}
    groups = [Group("one", quick, **chain), Group("two", quick, **arm), Group("three", quick, **chain)]
    assert compile_kernels(groups, record)
    assert [told[1] for told in record.told if told[0] == "started"] == ["one", "three", "two"]
    assert [process.returncode for process in started] == [0]


def test_another_process_goes_on_after_one_that_has_failed(monkeypatch, started):
    monkeypatch.setattr(warmup, "_processors", lambda: 1)
    record = Recorded()
    assert not compile_kernels([Group("dies", os.abort), Group("bad", wrong), Group("good", quick)], record)
    errors = {told[1]: told[2] for told in record.told if told[0] == "ended"}
    assert errors["dies"] and errors["bad"] == ERROR and not errors["good"]
    assert len(started) == 3


def test_an_error_is_one_line_and_the_others_go_on():
    record = Recorded()
    assert not compile_kernels([Group("bad", wrong), Group("good", quick), Group("next", late, after="bad")], record)
    ended = {told[1]: told[2] for told in record.told if told[0] == "ended"}
    assert ended == {"bad": ERROR, "good": "", "next": ""}


@pytest.mark.posix
def test_an_interrupt_ends_all_processes(monkeypatch, started):
    class Interrupts(WarmupProgress):
        def waits(self):
            raise KeyboardInterrupt

    monkeypatch.setattr(warmup, "_processors", lambda: 2)
    with pytest.raises(KeyboardInterrupt):
        compile_kernels([Group("one", signal.pause), Group("other", signal.pause)], Interrupts())
    assert len(started) == 2 and all(process.returncode for process in started)


def test_what_is_not_on_disk_is_missing():
    def use():
        raise NotCompiled("the planar solver")

    def broken():
        raise ValueError("for the process that compiles it to tell")

    groups = Group("kept", quick), Group("new", use), Group("broken", broken)
    assert [group.title for group in missing(groups)] == ["new", "broken"]


def test_every_group_waits_for_one_that_there_is():
    titles = [group.title for group in ALL]
    assert len(set(titles)) == len(titles)
    assert {group.after for group in ALL} <= {*titles, ""}


def test_groups_of_chosen_mechanisms():
    assert warmup.all_groups() == ALL
    planar = warmup.all_groups(["planar"], walls=False)
    titles = {group.title for group in planar}
    assert {"the planar solver", "the environments", "motors and sheaths"} <= titles
    assert not [title for title in titles if "walls" in title or "arm" in title or "space" in title]
    assert {group.family for group in ALL} == {*warmup.FAMILIES, ""}
    assert [group.walls for group in ALL] == ["among walls" in group.title for group in ALL]


def test_the_command_compiles_kernels_of_chosen_mechanisms(monkeypatch, capsys):
    chosen = []
    monkeypatch.setattr(warmup_command, "missing", lambda groups: chosen.append(groups) or [])
    assert commands.main(["warmup", "arm", "--without-walls"]) == commands.main(["warmup"]) == commands.OK
    assert {group.family for group in chosen[0]} == {"arm", ""} and chosen[1] == ALL
    assert commands.main(["warmup", "arms"]) == commands.WRONG_INPUT
    said = "MECHANISM = 'arms': expected one of 'planar', 'arm', 'space'. Did you mean 'arm'?"
    assert said in capsys.readouterr().err


def test_environments_are_an_entry_point():
    with (ROOT / "pyproject.toml").open("rb") as file:
        named = tomllib.load(file)["project"]["entry-points"][warmup.ENTRY_POINTS]
    assert named == {"rj_gym": "rj_gym.warmup:GROUPS"}


@pytest.fixture
def only(monkeypatch):
    """A function that has `rj warmup` compile these groups, all of them missing."""

    def choose(*groups):
        monkeypatch.setattr(warmup_command, "all_groups", lambda *chosen: groups)
        monkeypatch.setattr(warmup_command, "missing", list)

    return choose


def test_the_command_has_plain_lines_where_there_is_no_terminal(only, capsys):
    only(Group("the first", quick), Group("the bad", wrong))
    assert commands.main(["warmup"]) == commands.NOT_USABLE
    printed = capsys.readouterr()
    lines = printed.out.splitlines()
    assert "\r" not in printed.out
    assert sorted(line.split(" in ")[0] for line in lines) == [
        "compiled the first",
        "compiling the bad",
        "compiling the first",
    ]
    assert printed.err == f"rj warmup: error: the bad: {ERROR}\n"


def test_at_a_terminal_the_last_line_says_what_is_compiled(only, capsys, monkeypatch):
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    only(Group("the first", quick))
    assert commands.main(["warmup"]) == commands.OK
    drawn = capsys.readouterr().out
    assert "compiling the first (0 s)\r" in drawn
    assert drawn.splitlines()[-1].startswith("kernels ready after ")


WAITING = """
import signal, sys
from rollingjoint.cli import main, warmup_command
from rollingjoint.warmup import Group
groups = Group("the first", signal.pause), Group("the second", signal.pause)
warmup_command.all_groups, warmup_command.missing = lambda *chosen: groups, list
sys.exit(main(["warmup"]))
"""


@pytest.mark.posix
def test_ctrl_c_is_one_line():
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen([sys.executable, "-c", WAITING], env=environment, start_new_session=True, **pipes)
    assert process.stdout.readline().startswith("compiling the ")
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == INTERRUPTED
    assert said == "rj warmup: interrupted; what is compiled is kept\n"
    _wait_for_the_end_of(process.pid)


@pytest.mark.posix
def test_processes_end_with_a_parent_that_is_killed():
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", WAITING]
    process = subprocess.Popen(command, env=environment, start_new_session=True, stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline().startswith("compiling the ")
    process.kill()
    process.communicate()
    _wait_for_the_end_of(process.pid)


def _wait_for_the_end_of(group):
    """Until nothing of a group of processes is left; a minute at most."""
    for _ in range(600):
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return
        time.sleep(0.1)
    os.killpg(group, signal.SIGKILL)
    raise AssertionError("processes go on")
