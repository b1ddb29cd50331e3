"""Permissions that only the command line gives: to read pickles, and to run modules that files name.

Run folders, configurations and policies may come from strangers, and cannot give themselves either of them.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from agents.runs.files import RunFolderError
from rollingjoint.errors import ConfigError

OWN = ("rj_gym", "gymnasium")  # environments registered by these packages need no consent


@dataclass(frozen=True)
class Consent:
    """Permission to read pickles, and to run these modules, each a dotted name or the path of a file NAME.py."""

    pickles: bool = False
    modules: tuple[str, ...] = ()

    @property
    def names(self) -> list[str]:
        """The modules under the names by which they are imported."""
        return [Path(module).stem if module.endswith(".py") else module for module in self.modules]


_given = Consent()  # of this process, whichever thread asks


def consent() -> Consent:
    """The permissions that this process has now."""
    return _given


@contextmanager
def allowing(permissions: Consent) -> Iterator[None]:
    """A context with these permissions; the modules are imported first.

    Raises:
        ConfigError: a module that cannot be imported.
    """
    global _given
    before = _given
    for module in permissions.modules:
        try:
            imported(module)
        except Exception as error:  # whatever a module raises
            reason = f"{type(error).__name__}: {error}"
            raise ConfigError("--import", module, "a module that can be imported, or a file NAME.py", reason) from error
    _given = permissions
    try:
        yield
    finally:
        _given = before


def call_with(permissions: Consent, function: Callable[..., Any], *arguments: Any) -> Any:
    """In a worker: function(*arguments), with the consent of the process that has sent it."""
    with allowing(permissions):
        return function(*arguments)


def add_consent(parser: argparse.ArgumentParser, pickles: bool = True) -> None:
    """Give a command the options --import and, where it reads policies or run folders, --trust."""
    named = "a module, or NAME.py, that configurations and run folders may name; repeatable"
    parser.add_argument("--import", dest="modules", action="append", default=[], metavar="MODULE", help=named)
    if pickles:
        parser.add_argument("--trust", action="store_true", help="read pickles of run folders, which can run any code")


def consent_of(arguments: argparse.Namespace) -> Consent:
    """The permissions that the options of a command give."""
    modules = (str(Path(name).resolve()) if name.endswith(".py") else name for name in arguments.modules)
    return Consent(getattr(arguments, "trust", False), tuple(modules))


def import_options() -> str:
    """The options --import of the modules that are allowed now, as a command that reads the run folder needs them."""
    return "".join(f" --import {shlex.quote(module)}" for module in _given.modules)


def check_pickles(*paths: Path) -> None:
    """Raise RunFolderError, unless pickles are allowed, if any of these files is there."""
    files = " and ".join(str(path) for path in paths if path.is_file())
    if files and not _given.pickles:
        hint = "Reading one can run any code that its author put there; --trust reads it."
        raise RunFolderError(files, "pickles", "files without code", hint)


def check_named(what: str, name: str, module: str, ours: str = "a name of rj_gym's registry") -> None:
    """Raise ConfigError for a name in a file that would have this module run, unless it is allowed.

    ours: the names that need no module, for the message.
    """
    if not any(f"{module}.".startswith(f"{allowed}.") for allowed in (*OWN, *_given.names)):
        top = module.partition(".")[0]
        hint = f"That is code: to run it, add --import {top} to the command; in Python import it first."
        raise ConfigError(what, name, f"{ours}, or one of a module that the command imports", hint)


def imported(module: str) -> ModuleType:
    """The module, by its name, also in the working directory, or by the path of a file NAME.py.

    Raises ImportError, or any error of the module.
    """
    path = Path(module).resolve()
    if not module.endswith(".py"):
        with _first_on_path(Path.cwd()):
            return importlib.import_module(module)
    module_at_path = sys.modules.get(path.stem)
    if module_at_path is not None and getattr(module_at_path, "__file__", None) == str(path):
        return module_at_path
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{module} is no Python file")
    loaded = importlib.util.module_from_spec(spec)
    with _first_on_path(path.parent):
        spec.loader.exec_module(loaded)
    sys.modules.setdefault(path.stem, loaded)  # where files name it
    return loaded


@contextmanager
def _first_on_path(folder: Path) -> Iterator[None]:
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        sys.path.remove(str(folder))
