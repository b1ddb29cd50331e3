"""The options of `rj export`, and the files that it writes."""

from __future__ import annotations

import argparse
from pathlib import Path

from rollingjoint.cad.fabrication import Fabrication
from rollingjoint.cad.files import DEFAULT_FORMATS, FORMATS, export
from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.solution import Solution

_SIZES = (
    ("--thickness", "thickness", "of every body"),
    ("--channel", "channel_diameter", "diameter of the tendon channels, 0 for none"),
    ("--tolerance", "tolerance", "largest distance of drawn curves from the exact ones"),
    ("--wall", "wall", "thinnest wall around a channel"),
    ("--bore", "bore", "diameter of a hole along z through every link in space, 0 for none"),
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
    text = "depths of the channels from z = 0, one, or one for each tendon (default half the thickness)"
    parser.add_argument("--depths", nargs="+", type=float, default=(), metavar="MM", help=text)
    parser.add_argument("--overwrite", action="store_true", help="replace existing files")


def export_files(mechanism: AnyChain | Solution, args: argparse.Namespace) -> list[Path]:
    """The files written by the options."""
    sizes = {name: getattr(args, name) for _, name, _ in _SIZES}
    return export(mechanism, args.out, args.format, overwrite=args.overwrite, depths=args.depths, **sizes)
