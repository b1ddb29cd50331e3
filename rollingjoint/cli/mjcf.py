"""`rj export MECHANISM --mjcf FILE`: the mechanism as a MuJoCo model, and its accuracy."""

from __future__ import annotations

import argparse
from pathlib import Path

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.errors import InvalidInput
from rollingjoint.mujoco import accuracy, mjcf
from rollingjoint.mujoco.coupling import Slides
from rollingjoint.mujoco.space import couplings


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
    return f"{path}: {_exactness(mechanism)}"


def _exactness(mechanism: AnyChain) -> str:
    """How near the model comes, in words."""
    if isinstance(mechanism, RollingChain):
        return str(accuracy(mechanism))
    if isinstance(mechanism, SpatialChain):
        joints = couplings(mechanism)
        return f"{sum(not isinstance(joint, Slides) for joint in joints)} of {len(joints)} joints exact"
    return "an arm, exactly"
