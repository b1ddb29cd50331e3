"""Ctrl-C in commands: one line, exit code 130, and an end within seconds. Where this is a library, Python decides.

Python raises KeyboardInterrupt between two of its instructions. That is too late where compiled code works on, and lost
where something drops exceptions, as callbacks and deletions do. So a command does not rely on it alone: its process
ends PATIENCE after the first Ctrl-C, whatever has become of the exception.
"""

from __future__ import annotations

import _thread
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from types import FrameType

INTERRUPTED = 130  # the exit code
PATIENCE = 3.0  # s from Ctrl-C to the end of the process, if the exception does not end it before
_SOON = 0.01  # s
_LINE = "interrupted"
_COMMANDS = ("rollingjoint", "rj_gym", "agents", "rj_agents")  # packages with modules that are commands


def interruptible(command: Callable[[], int]) -> int:
    """The exit code of a command, which Ctrl-C ends: 130, after one line on standard error.

    Other exceptions of the interrupted command are dropped: an import that is interrupted in compiled code says that a
    module is broken.
    """
    context = Interruptible(for_good=IS_COMMAND)
    try:
        with context:
            return command()
    except KeyboardInterrupt:
        return interrupted()
    except Exception:
        if not context.is_interrupted:
            raise
        return interrupted()


def interrupted(line: str = _LINE) -> int:
    """The exit code of an interrupted command; prints a line."""
    global _is_said
    _is_said = True
    print(line, file=sys.stderr, flush=True)
    exec("")  # Python notes an interrupted exec, as of every dataclass, until the next one, and would end by SIGINT
    return INTERRUPTED


class Interruptible:
    """A context in which SIGINT raises KeyboardInterrupt, once; the handler from before is restored afterwards.

    Where that has not ended the context after PATIENCE, `give_up` is called in a thread. Outside the main thread, and
    where SIGINT is ignored, the context has no effect.

    Args:
        give_up: ends the process; by default with the line and the exit code of a command.
        for_good: whether it is called even where the context has ended: only the rest of the process is to come.
    """

    def __init__(self, give_up: Callable[[], None] | None = None, for_good: bool = False) -> None:
        self.is_interrupted = False
        self._give_up, self._for_good = give_up or _end_process, for_good
        self._is_lost = self._is_over = False

    def __enter__(self) -> Interruptible:
        self._before: Callable[[int, FrameType | None], object] | int | None = None
        if threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGINT) != signal.SIG_IGN:
            self._report, sys.unraisablehook = sys.unraisablehook, self._raise_again
            self._before = signal.signal(signal.SIGINT, self._interrupt)
        return self

    def __exit__(self, *exception: object) -> None:
        self._is_over = True
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)
            if not (self._for_good and self.is_interrupted):
                sys.unraisablehook = self._report

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        if self._is_over or (self.is_interrupted and not self._is_lost):
            return
        if not self.is_interrupted:
            self.is_interrupted = True
            _thread.start_new_thread(self._wait, ())  # `threading` has locks, which the interrupted code may hold
        self._is_lost = False
        raise KeyboardInterrupt

    def _raise_again(self, lost: sys.UnraisableHookArgs) -> None:
        """Hook for exceptions lost in callbacks: an interrupt is raised again later, others are reported.

        After the interrupt others are dropped: half-made objects raise when they are deleted.
        """
        if not self.is_interrupted:
            self._report(lost)
        elif lost.exc_type is KeyboardInterrupt and not self._is_over:
            self._is_lost = True
            _thread.start_new_thread(_interrupt_soon, ())

    def _wait(self) -> None:
        time.sleep(PATIENCE)
        if self._for_good or not self._is_over:
            self._give_up()


def _end_process() -> None:
    """End the process at once, whatever its other threads do or hold."""
    if not _is_said:
        os.write(2, f"{_LINE}\n".encode())
    os._exit(INTERRUPTED)


def _interrupt_soon() -> None:
    """Interrupt the main thread, which may be in a place now where exceptions are dropped."""
    time.sleep(_SOON)
    _thread.interrupt_main()


def _end_at_once(number: int, frame: FrameType | None) -> None:
    _end_process()


def _is_command() -> bool:
    """True if this process was started as `rj`, or as `python -m` with a module of ours."""
    name = os.path.basename(sys.argv[0] if sys.argv else "")
    if os.path.splitext(name)[0] == "rj":
        return True
    words = sys.orig_argv[1:]
    module = words[words.index("-m") + 1] if "-m" in words[:-1] else ""
    return module.partition(".")[0] in _COMMANDS


IS_COMMAND = _is_command()
_is_said = False
_is_main = threading.current_thread() is threading.main_thread()
if IS_COMMAND and _is_main and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, _end_at_once)  # before the command begins, and after it has ended
