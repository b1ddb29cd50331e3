"""`rj export MECHANISM --mjcf FILE`: the mechanism as a MuJoCo model, and its accuracy."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.errors import InvalidInput, naming
from rollingjoint.mujoco import accuracy, mjcf
from rollingjoint.mujoco.coupling import Slides
from rollingjoint.mujoco.space import couplings


def add_option(parser: argparse.ArgumentParser) -> None:
    """Adds the option for the file."""
    parser.add_argument("--mjcf", type=Path, metavar="FILE.xml", help="a MuJoCo model, of a chain or an arm")


class ModelFile(NamedTuple):
    """A MuJoCo model that is ready to be written.

    Attributes:
        path: of the file. text: its content. line: its path and accuracy.
    """

    path: Path
    text: str
    line: str

    def write(self) -> None:
        """Writes the file."""
        with naming(self.path):
            self.path.write_text(self.text + "\n", encoding="utf-8")


def model(mechanism: AnyChain, path: Path, overwrite: bool) -> ModelFile:
    """The model of a mechanism, checked before anything is written.

    Raises:
        InvalidInput: a folder that does not exist, an existing file, or a mechanism that cannot be written.
    """
    if path.is_dir() or not path.parent.is_dir():
        hint = "It is a folder." if path.is_dir() else f"Create {path.parent} first."
        raise InvalidInput("--mjcf", str(path), "a file in an existing folder", hint)
    if path.exists() and not overwrite:
        raise InvalidInput("--mjcf", str(path), "a new file", "--overwrite replaces it.")
    return ModelFile(path, mjcf(mechanism), f"{path}: {_exactness(mechanism)}")


def _exactness(mechanism: AnyChain) -> str:
    """How near the model comes, in words."""
    if isinstance(mechanism, RollingChain):
        return str(accuracy(mechanism))
    if isinstance(mechanism, SpatialChain):
        joints = couplings(mechanism)
        return f"{sum(not isinstance(joint, Slides) for joint in joints)} of {len(joints)} joints exact"
    return "an arm, exactly"
