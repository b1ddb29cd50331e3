"""Public names, what they take, imports on the pages, and options of the commands. Runs inside a checkout."""

from __future__ import annotations

import contextlib
import importlib
import inspect
import io
import re
import runpy
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import rj_gym
import rollingjoint
from guard_rows.drawing import Sizes
from guard_rows.record import Record
from rollingjoint import cli

AGENTS = (
    *("train", "evaluate", "tune", "campaign", "results", "export"),
    *("dataset", "enter", "robots", "adapt", "search", "view"),
)
_COMMAND = re.compile(r"^    ([a-z][\w-]*)(?:  |$)", re.M)  # in the list of `rj --help`
_IMPORT = re.compile(
    r"^(?:from (rollingjoint|rj_gym|agents)([\w.]*) import ([\w, ]+)|import (rollingjoint|rj_gym))", re.M
)


def records(sizes: Sizes, older: Path, out: Path) -> Iterator[Record]:
    """Records of all names."""
    for module in (rollingjoint, rj_gym):
        yield _names(module)
        yield _parameters(module)
    ids = Record("rj_gym: ids")
    for env_id, stem in {**rj_gym.IDS, **rj_gym.DESIGN_IDS}.items():
        ids.add(env_id, {"stem": stem})
    yield _counted(ids)
    if sizes.runs:
        yield _imports(older)
    yield _usages(sizes)


def _counted(record: Record) -> Record:
    record.count = len(record.arrays)
    return record


def _names(module: ModuleType) -> Record:
    record = Record(f"{module.__name__}.__all__")
    for name in module.__all__:
        value = getattr(module, name)
        record.add(name, {"kind": "class" if inspect.isclass(value) else type(value).__name__})
    return _counted(record)


def _parameters(module: ModuleType) -> Record:
    """Of functions, classes and the public methods of these: names, kinds and defaults; attributes of classes."""
    record = Record(f"{module.__name__}: parameters")
    for name in module.__all__:
        value = getattr(module, name)
        if callable(value) and not isinstance(value, type(rollingjoint.Profile.constant)):
            record.add(name, {"parameters": _signature(value)})
        if inspect.isclass(value):
            for part in sorted(part for part in dir(value) if not part.startswith("_")):
                found = inspect.getattr_static(value, part)
                method = getattr(value, part) if isinstance(found, staticmethod | classmethod) else found
                record.add(f"{name}.{part}", {"parameters": _signature(method) if callable(method) else "attribute"})
    return _counted(record)


def _signature(value: Any) -> str:
    """Parameters without annotations, whose modules may move."""
    try:
        found = inspect.signature(value)
    except (TypeError, ValueError):
        return "(unknown)"
    plain = [one.replace(annotation=inspect.Parameter.empty) for one in found.parameters.values()]
    text = str(found.replace(parameters=plain, return_annotation=inspect.Signature.empty))
    return re.sub(r" at 0x[0-9a-f]+", "", text)


def _imports(older: Path) -> Record:
    """Whether every import on the older checkout's pages works."""
    record = Record("imports on the pages")
    for page in sorted([*older.glob("docs/*.md"), older / "README.md"]):
        for found in _IMPORT.finditer(page.read_text("utf-8")):
            package, below, names, _ = found.groups()
            for name in re.findall(r"\w+(?= as|,|$)", names or ""):
                record.add(f"{package}{below}.{name}", {"import": _importable(package + below, name)})
    return _counted(record)


def _importable(module: str, name: str) -> str:
    try:
        found = importlib.import_module(module)
        return "works" if hasattr(found, name) or importlib.import_module(f"{module}.{name}") else ""
    except Exception as error:  # whatever an import can raise
        return type(error).__name__


def _usages(sizes: Sizes) -> Record:
    """The usage lines of `rj`, of its commands, and of the commands of the controllers."""
    record = Record("options of the commands")
    for name in _COMMAND.findall(_said(lambda: cli.main(["--help"]))):
        record.add(f"rj {name}", {"usage": _usage(lambda name=name: cli.main([name, "--help"]))})
    for name in AGENTS if sizes.runs else ():
        module = f"agents.{name}"
        sys.argv = [module, "--help"]
        run = lambda module=module: runpy.run_module(module, run_name="__main__", alter_sys=True)  # noqa: E731
        record.add(module, {"usage": _usage(run)})
    return _counted(record)


def _said(work: Any) -> str:
    """What a command prints."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        work()
    return said.getvalue()


def _usage(work: Any) -> str:
    """The options that a command prints with --help, on one line, without its own name."""
    usage = " ".join(_said(work).partition("\n\n")[0].split())
    return re.sub(r"^usage: (python -m [\w.]+|rj [\w-]+) ?", "", usage)
