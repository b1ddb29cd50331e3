"""Commands that other packages add to `rj`: functions from arguments to an exit code, named as entry points.

One table lists the commands of the controllers: the entry points of pyproject.toml. An installation knows them from its
metadata; in a checkout, whether it is installed or not, the file itself is read.
"""

from __future__ import annotations

import ast
import os
import sys
import tomllib
from collections.abc import Mapping, Sequence
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path

from rollingjoint.errors import named, one_line

GROUP = "rollingjoint.commands"
HERE, INSTALLED = "agents", "rj_agents"  # the controllers in a checkout and in a wheel (setup.py)
TABLE = Path(__file__).resolve().parents[2] / "pyproject.toml"  # of a checkout; a wheel has none


def extensions() -> dict[str, EntryPoint]:
    """Commands by name: those of installed packages, and of the checkout that this package lies in."""
    commands = [*entry_points(group=GROUP), *_of_checkout()]
    return {command.name: command for command in sorted(commands, key=lambda command: command.name)}


def _of_checkout() -> list[EntryPoint]:
    """Commands of the controllers that lie beside this package; empty where it is installed from a wheel."""
    if not TABLE.is_file():
        return []
    project = tomllib.loads(TABLE.read_text("utf-8")).get("project", {})  # a project that holds a copy has another one
    table = project.get("entry-points", {}).get(GROUP, {})
    return [EntryPoint(name, place.replace(INSTALLED, HERE, 1), GROUP) for name, place in table.items()]


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
    """A line per command with its purpose, for `rj --help`: the controllers', then others'; None without commands."""
    width = max(map(len, commands), default=0)
    groups: dict[str, list[str]] = {"controllers": [], "other packages": []}
    for name, command in commands.items():
        group = "controllers" if command.module.partition(".")[0] in (HERE, INSTALLED) else "other packages"
        groups[group].append(f"  {name:<{width}}  {_purpose(command)}".rstrip())
    return "\n\n".join("\n".join([f"{group}:", *lines]) for group, lines in groups.items() if lines) or None


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
