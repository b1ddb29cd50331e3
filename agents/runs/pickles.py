"""Pickles in run folders: what is said before one is read, since reading it can run any code that is in it."""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rollingjoint.errors import one_line


class PickleWarning(UserWarning):
    """A pickle is about to be read."""


def warn_of_pickles(*paths: Path) -> None:
    """Warn (PickleWarning) that those of these files that are there are about to be unpickled."""
    files = " and ".join(str(path) for path in paths if path.is_file())
    if files:
        text = f"{files}: reading a pickle can run any code that its author put there"
        warnings.warn(text, PickleWarning, stacklevel=3)


def add_trust(parser: argparse.ArgumentParser) -> None:
    """Give a command the option --trust, for `pickle_warnings`."""
    parser.add_argument("--trust", action="store_true", help="do not warn before a pickle of a run folder is read")


@contextmanager
def pickle_warnings(trust: bool) -> Iterator[None]:
    """Show every PickleWarning as one line on standard error, once; none of them with `trust`."""
    shown: set[str] = set()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore" if trust else "always", PickleWarning)
        show = warnings.showwarning

        def in_one_line(message: Warning | str, category: type[Warning], *where: Any) -> None:
            if not issubclass(category, PickleWarning):
                show(message, category, *where)
            elif str(message) not in shown:
                shown.add(str(message))
                print(f"warning: {one_line(str(message))} (--trust: no warning)", file=sys.stderr, flush=True)

        warnings.showwarning = in_one_line  # type: ignore[assignment]
        yield
