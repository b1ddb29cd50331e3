"""Imports of the optional packages that an export needs."""

from __future__ import annotations

import importlib
from typing import Any

from rollingjoint.errors import InvalidInput


def package(name: str) -> Any:
    """The module with this name.

    Raises:
        InvalidInput: a package that is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        top = name.partition(".")[0]
        allowed = "a package that is installed"
        hint = f'Run: pip install "rollingjoint[{"step" if top == "OCP" else "cad"}]".'
        raise InvalidInput("package for the export", top, allowed, hint) from None
