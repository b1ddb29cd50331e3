"""Solid bodies: outlines with a thickness and channels cut out, for STL and STEP."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rollingjoint.cad.body import Body
from rollingjoint.cad.channel import Channel
from rollingjoint.cad.kits import Faceted, Kit
from rollingjoint.errors import MechanismError

TURNS = (0.5, 0.31, 0.17, 0.43)  # tried in turn: a channel's corner on an edge of the outline leaves no closed body


def solid(body: Body, tolerance: float = 1e-3) -> Any:
    """The body as a trimesh.Trimesh in its link's frame [mm]: z from 0 to the thickness, channels at their depths.

    Corners have 32 bits, as in STL; the mesh is closed.

    Args:
        body: the body.
        tolerance: largest distance of a channel's flat faces from the round hole [mm].
    Raises:
        MechanismError: corners too close for a closed body with 32 bits.
    """
    for turn in TURNS:
        kit = Faceted(tolerance, turn)
        mesh = kit.mesh(carved(body, kit))
        if mesh.is_watertight:
            return mesh
    corners = "corners that are apart in 32 bits"
    raise MechanismError("solid body", len(body.outline), corners, "Raise the tolerance, or move the holes a little.")


def write_stl(path: Path, body: Body, tolerance: float) -> None:
    """Writes the solid body as binary STL in mm."""
    solid(body, tolerance).export(path, file_type="stl")


def carved(body: Body, kit: Kit) -> Any:
    """The block less its channels, made with a kit."""
    block = kit.prism([body.parent, body.child[::-1]], body.thickness)
    for channel in body.channels:
        block = kit.cut(block, _drill(channel, kit))
    return block


def _drill(channel: Channel, kit: Kit) -> Any:
    """The cylinder that cuts a channel."""
    begin, end = channel.drill
    length = float(np.hypot(*(end - begin)))
    along, (x, y) = (end - begin) / length, begin
    frame = [[0.0, -along[1], along[0], x], [0.0, along[0], along[1], y], [-1.0, 0.0, 0.0, channel.depth]]
    return kit.placed(kit.cylinder(0.5 * channel.diameter, length), np.array(frame))
