"""The command `rj camera`: the view of a camera from a picture of a board of dots."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from rollingjoint.errors import InvalidInput


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    kinds = ("dark", "bright", "red", "green", "blue")  # of rollingjoint.camera, which is slow to import
    parser.add_argument(
        "board", metavar="BOARD", help="picture of a square grid of dots, which lies where balls will be"
    )
    parser.add_argument("--pitch", type=float, required=True, metavar="MM", help="from dot to dot [mm]")
    parser.add_argument("--kind", choices=kinds, default="dark", help="of the dots (default dark)")
    parser.add_argument("--output", type=Path, required=True, metavar="VIEW.yaml", help="file for the view")


def run(args: argparse.Namespace) -> None:
    """Write the view, and print how well it explains the board."""
    from rollingjoint.camera import read_picture, save_view, view_of_board

    if not args.output.absolute().parent.is_dir():
        raise InvalidInput("--output", str(args.output), "a file in a folder that exists")
    board = view_of_board(read_picture(args.board), args.pitch, args.kind)
    view = board.view
    save_view(view, args.output)
    largest = float(np.linalg.norm(board.errors, axis=1).max())
    width, height = view.size
    corners = np.array([[0.0, 0.0], [width - 1.0, 0.0], [0.0, height - 1.0], [width - 1.0, height - 1.0]])
    bare = type(view)(view.size, view.homography)
    moved = np.nanmax(np.linalg.norm(bare.pixels(view.places(corners)) - corners, axis=1))
    print(f"{len(board.pixels)} dots, off by {board.rms:.4f} mm rms and {largest:.4f} mm at most")
    print(
        f"{view.pixels_per_mm():.2f} pixels per mm; the lens moves corners of the picture by up to {moved:.1f} pixels"
    )
    print(f"view: {args.output}")
