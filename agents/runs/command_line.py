"""What the commands share: one line for an error, exit codes, signals, and the command that was typed."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from rollingjoint.errors import RollingJointError

FAILED, INTERRUPTED = 2, 130


def exit_code(command: Callable[[], int]) -> int:
    """The exit code of `command`; errors that a user can fix become one line and code 2."""
    try:
        return command()
    except (RollingJointError, OSError) as error:
        print("error:", " ".join(str(error).split()), file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED


@contextmanager
def signals_seen() -> Iterator[list[int]]:
    """Collects SIGINT and SIGTERM as they arrive, in place of what they do otherwise."""
    seen: list[int] = []
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.signal(number, lambda arrived, frame: seen.append(arrived)) for number in numbers}
    try:
        yield seen
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def typed_command(module: str, argv: Sequence[str] | None) -> list[str]:
    """The command line that starts `module` with these arguments (None: those of this process)."""
    return ["python", "-m", module, *(sys.argv[1:] if argv is None else argv)]
