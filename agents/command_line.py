"""What the commands share: one clear line for an error, and the exit code."""

from __future__ import annotations

import sys
from collections.abc import Callable

from rollingjoint.errors import RollingJointError

FAILED, INTERRUPTED = 2, 130


def exit_code(command: Callable[[], int]) -> int:
    """The exit code of `command`; errors that a user can mend become one line and code 2."""
    try:
        return command()
    except (RollingJointError, OSError) as error:
        print("error:", " ".join(str(error).split()), file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
