"""Commands that other packages add to `rj`: functions from arguments to an exit code, named as entry points."""

from __future__ import annotations

import ast
import os
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec

from rollingjoint.errors import named, one_line

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
        reason = named(error, command.name) if isinstance(error, ModuleNotFoundError) else error
        print(f"rj {command.name}: error: {one_line(str(reason))}", file=sys.stderr)
        return 2
    code: int = run(list(argv))
    return code


def listed(commands: Mapping[str, EntryPoint]) -> str | None:
    """A line for every command with what it does, for `rj --help`; None where there are none."""
    width = max(map(len, commands), default=0)
    lines = [f"  {name:<{width}}  {_purpose(command)}".rstrip() for name, command in commands.items()]
    return "\n".join(["commands of other packages (rj COMMAND --help lists their options):", *lines]) if lines else None


def _purpose(command: EntryPoint) -> str:
    """The first line of its module's docstring, up to a colon; empty where it cannot be read.

    The module is not imported, only the packages that it lies in.
    """
    try:
        spec = find_spec(command.module)
        source = spec.loader.get_source(command.module)  # type: ignore[union-attr]
        text = ast.get_docstring(ast.parse(source)) or ""
    except Exception:  # whatever the packages of others do
        return ""
    return one_line(text.partition("\n")[0].partition(": ")[0].rstrip("."))
