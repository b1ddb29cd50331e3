"""Shared by the commands: errors in one line, exit codes, signals, progress bars, the typed command."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from agents.runs.consent import Consent, allowing
from rollingjoint.errors import RollingJointError, named, one_line
from rollingjoint.interrupts import INTERRUPTED, interrupted, interruptible
from rollingjoint.tables import print_any_character, readers_may_leave

FAILED = 2
STOPPING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGBREAK") if hasattr(signal, name))
"""Signals that ask a command to stop; SIGBREAK is the one that Windows has in place of SIGTERM."""


def exit_code(command: Callable[[], int], consent: Consent | None = None, extra: str = "") -> int:
    """The exit code of `command`, called with this consent; Ctrl-C is one line and code 130.

    Errors that a user can fix become one line and code 2.

    Args:
        extra: named where a package is missing that it and other extras bring.
    """

    def allowed() -> int:
        with allowing(consent or Consent()), readers_may_leave():
            return command()
        return 0

    print_any_character()
    try:
        return interruptible(allowed)
    except (RollingJointError, OSError) as error:
        print("error:", one_line(str(error)), file=sys.stderr)
        return FAILED
    except ModuleNotFoundError as error:
        if not isinstance(missing := named(error, extra), RollingJointError):
            raise
        print("error:", missing, file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:  # after the command
        return interrupted()


@contextmanager
def signals_seen() -> Iterator[list[int]]:
    """Collects the signals that ask to stop as they arrive, in place of their usual effect."""
    numbers: list[int] = []
    before = {number: signal.signal(number, lambda arrived, frame: numbers.append(arrived)) for number in STOPPING}
    try:
        yield numbers
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def note(text: str) -> None:
    """Print a line about a result to standard error."""
    print("note:", text, file=sys.stderr)


def progress_bar(total: int, unit: str, **arguments: Any) -> Any:
    """A progress bar on the terminal; hidden where standard error is not a terminal, and in CI."""
    from tqdm import tqdm  # comes with the extras that train and search

    hidden = not sys.stderr.isatty() or "CI" in os.environ
    return tqdm(total=total, unit=unit, disable=hidden, dynamic_ncols=True, **arguments)


def finished(runs: int, failed: Mapping[Any, str], signals: Sequence[int], command: Sequence[str]) -> int:
    """The exit code of a command that works on many runs; says why some are not finished, and how to continue."""
    again = " ".join(word for word in command if word != "--force")
    for run, reason in failed.items():
        print(f"failed: {run}: {reason}", file=sys.stderr)
    if signals:
        print(f"stopped by {signal.Signals(signals[0]).name}; to go on: {again}")
        return INTERRUPTED
    if failed:
        print(f"{len(failed)} of {runs} runs failed; to try them again: {again}", file=sys.stderr)
        return FAILED
    return 0


def typed_command(command: str, argv: Sequence[str] | None) -> list[str]:
    """Words of the command line: `command`, such as "rj train", and its arguments (None: this process's)."""
    return [*command.split(), *(sys.argv[1:] if argv is None else argv)]
