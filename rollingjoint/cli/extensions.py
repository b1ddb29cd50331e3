"""Commands that other packages add to `rj`: functions from arguments to an exit code, named as entry points."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib.metadata import EntryPoint, entry_points

from rollingjoint.errors import one_line

GROUP = "rollingjoint.commands"


def extensions() -> dict[str, EntryPoint]:
    """The commands by name; there are some where their packages are installed."""
    return {found.name: found for found in sorted(entry_points(group=GROUP))}


def run_extension(command: EntryPoint, argv: Sequence[str]) -> int:
    """Exit code of a command with these arguments; it finds modules in the working directory after all others."""
    sys.path.append(os.getcwd())
    try:
        run = command.load()
    except ImportError as error:
        print(f"rj {command.name}: error: {one_line(str(error))}; pip install 'rollingjoint[train]'", file=sys.stderr)
        return 2
    code: int = run(list(argv))
    return code
