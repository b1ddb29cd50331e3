"""`rj export MECHANISM --mjcf FILE`: the mechanism as a MuJoCo model, and its accuracy."""

from __future__ import annotations

import argparse
from pathlib import Path

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.errors import InvalidInput
from rollingjoint.mujoco import accuracy, mjcf


def add_option(parser: argparse.ArgumentParser) -> None:
    """Adds the option for the file."""
    parser.add_argument("--mjcf", type=Path, metavar="FILE.xml", help="a MuJoCo model, of a chain or an arm")


def write(mechanism: AnyChain, path: Path, overwrite: bool) -> str:
    """Writes the file; returns a line with its path and accuracy.

    Raises:
        InvalidInput: an existing file, or a mechanism that cannot be written.
    """
    text = mjcf(mechanism)
    if path.exists() and not overwrite:
        raise InvalidInput("--mjcf", str(path), "a new file", "--overwrite replaces it.")
    path.write_text(text + "\n", encoding="utf-8")
    exact = str(accuracy(mechanism)) if isinstance(mechanism, RollingChain) else "an arm, exactly"
    return f"{path}: {exact}"
