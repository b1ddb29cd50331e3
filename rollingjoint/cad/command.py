"""The options of `rj export`, and the files that it writes."""

from __future__ import annotations

import argparse
from pathlib import Path

from rollingjoint.cad.fabrication import Fabrication
from rollingjoint.cad.files import DEFAULT_FORMATS, FORMATS, export
from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.equilibrium import Equilibrium
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.chain.spatial_equilibrium import SpatialEquilibrium
from rollingjoint.errors import InvalidInput

_SIZES = (
    ("--thickness", "thickness", "of every body"),
    ("--channel", "channel_diameter", "diameter of the tendon channels, 0 for none"),
    ("--tolerance", "tolerance", "largest distance of drawn curves from the exact ones"),
    ("--wall", "wall", "thinnest wall around a channel"),
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options for folder, formats and sizes."""
    parser.add_argument("--out", metavar="FOLDER", help="folder of the files; created if missing")
    formats, default = ", ".join(FORMATS), " ".join(DEFAULT_FORMATS)
    parser.add_argument(
        "--format", nargs="+", default=DEFAULT_FORMATS, metavar="F", help=f"some of {formats} (default {default})"
    )
    for option, name, text in _SIZES:
        default = getattr(Fabrication, name)
        parser.add_argument(
            option, dest=name, type=float, default=default, metavar="MM", help=f"{text} (default {default:g})"
        )
    parser.add_argument("--overwrite", action="store_true", help="replace existing files")


def manufactured(mechanism: AnyChain, name: str) -> RollingChain | SpatialChain:
    """The mechanism, of which there are manufacturing files.

    Args:
        mechanism: of any class. name: of its preset or file, for the message.
    Raises:
        InvalidInput: an arm of beads.
    """
    if not isinstance(mechanism, RollingChain | SpatialChain):
        raise InvalidInput("mechanism", name, f"a planar chain or a chain in space, not {mechanism.title}")
    return mechanism


def export_files(
    mechanism: RollingChain | SpatialChain | Equilibrium | SpatialEquilibrium, args: argparse.Namespace
) -> list[Path]:
    """The files written by the options."""
    sizes = {name: getattr(args, name) for _, name, _ in _SIZES}
    return export(mechanism, args.out, args.format, overwrite=args.overwrite, **sizes)
