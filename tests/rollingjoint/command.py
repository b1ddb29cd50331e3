"""The command `rj` in this process."""

import shlex

from rollingjoint.cli import main


def rj(command: str) -> int:
    """Exit code of the command line, argparse's own exits included."""
    try:
        return main(shlex.split(command))
    except SystemExit as stop:
        assert isinstance(stop.code, int)
        return stop.code
