"""Ctrl-C ends a command in one line with exit code 130, whatever becomes of the exception."""

import signal
import subprocess
import sys

import pytest

from rollingjoint.cli import main
from rollingjoint.interrupts import interruptible
from tests.conftest import sources_first

pytestmark = pytest.mark.posix
RJ = "import signal, sys; sys.argv[0] = 'rj'; import rollingjoint; from rollingjoint.interrupts import interruptible\n"
SWALLOWED = """
import time
def command():
    print("begun", flush=True)
    while True:
        try:
            time.sleep(60)
        except KeyboardInterrupt:
            pass
sys.exit(interruptible(command))
"""
IN_A_DELETION = """
class Deleted:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)
def command():
    deleted = Deleted()
    del deleted
    while True:
        pass
sys.exit(interruptible(command))
"""
IN_AN_EXEC = """
def command():
    exec("signal.raise_signal(signal.SIGINT)")
sys.exit(interruptible(command))
"""
HALF_MADE = """
class HalfMade:
    def __init__(self):
        signal.raise_signal(signal.SIGINT)
        self.pointer = 1
    def __del__(self):
        del self.pointer
kept = []
def command():
    kept.append(HalfMade.__new__(HalfMade))  # deleted when the process ends
    HalfMade()
sys.exit(interruptible(command))
"""
AFTERWARDS = """
interruptible(lambda: 0)
signal.raise_signal(signal.SIGINT)
"""


def press():
    signal.raise_signal(signal.SIGINT)
    return 0


def ended(program, press_at=None):
    """Exit code and errors of a program; Ctrl-C is pressed when it has printed something."""
    command, pipe = [sys.executable, "-c", program], subprocess.PIPE
    with subprocess.Popen(command, env=sources_first(), stdout=pipe, stderr=pipe, text=True) as process:
        if press_at:
            assert process.stdout.readline() == press_at
            process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
        return process.returncode, errors


def test_ctrl_c_is_one_line_and_exit_code_130(capsys):
    before = signal.getsignal(signal.SIGINT)
    assert interruptible(press) == 130
    assert capsys.readouterr() == ("", "interrupted\n")
    assert signal.getsignal(signal.SIGINT) is before


def test_what_an_interrupted_import_raises_instead_counts_as_ctrl_c(capsys):
    def command():
        try:
            return press()
        except KeyboardInterrupt:
            raise ImportError("a module in compiled code failed to import") from None

    assert interruptible(command) == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_other_errors_pass():
    with pytest.raises(ZeroDivisionError):
        interruptible(lambda: 1 // 0)


def test_further_presses_do_not_disturb_the_end(capsys):
    def command():
        try:
            return press()
        finally:
            press()
            press()

    assert interruptible(command) == 130
    assert capsys.readouterr().err == "interrupted\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    "program", [IN_A_DELETION, IN_AN_EXEC, AFTERWARDS, "press = signal.raise_signal(signal.SIGINT)"]
)
def test_ctrl_c_is_neither_lost_in_callbacks_nor_outside_the_command(program):
    assert ended(RJ + program) == (130, "interrupted\n")


@pytest.mark.slow
def test_objects_whose_making_was_interrupted_are_deleted_in_silence():
    assert ended(RJ + HALF_MADE) == (130, "interrupted\n")


def test_a_command_in_which_the_exception_is_lost_ends_all_the_same():
    assert ended(RJ + SWALLOWED, press_at="begun\n") == (130, "interrupted\n")


def test_an_import_as_a_library_leaves_ctrl_c_to_python(run_python):
    program = (
        "import signal, rollingjoint, agents; print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)"
    )
    assert run_python("-c", program) == "True\n"


def test_rj_loop_is_interrupted_in_one_line(monkeypatch, capsys):
    monkeypatch.setattr("rollingjoint.cli.loop_command.trace_loop", lambda *arguments, **options: press())
    assert main(["loop", "five_link", "--friction", "0.1"]) == 130
    assert capsys.readouterr().err == "interrupted\n"
