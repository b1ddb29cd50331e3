"""Solid bodies: outlines with a thickness and channels cut out, as STL."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rollingjoint.cad.body import Body
from rollingjoint.cad.channel import Channel
from rollingjoint.cad.packages import package
from rollingjoint.errors import MechanismError

TURNS = (0.5, 0.31, 0.17, 0.43)  # tried in turn: a channel's corner on an edge of the outline leaves no closed body


def solid(body: Body, tolerance: float = 1e-3) -> Any:
    """The body as a trimesh.Trimesh in its link's frame [mm]: z from 0 to the thickness, channels at half thickness.

    Corners have 32 bits, as in STL; the mesh is closed.

    Args:
        body: the body.
        tolerance: largest distance of a channel's flat faces from the round hole [mm].
    Raises:
        MechanismError: corners too close for a closed body with 32 bits.
    """
    for turn in TURNS:
        mesh = _cut(body, tolerance, turn)
        if mesh.is_watertight:
            return mesh
    corners = "corners that are apart in 32 bits"
    raise MechanismError("solid body", len(body.outline), corners, "Raise the tolerance, or move the holes a little.")


def write_stl(path: Path, body: Body, tolerance: float) -> None:
    """Writes the solid body as binary STL in mm."""
    solid(body, tolerance).export(path, file_type="stl")


def _cut(body: Body, tolerance: float, turn: float) -> Any:
    """The block less its channels; the corners of every channel are turned about its axis by a share of a side."""
    manifold3d, trimesh = package("manifold3d"), package("trimesh")
    block = manifold3d.Manifold.extrude(manifold3d.CrossSection([body.outline]), body.thickness)
    for channel in body.channels:
        block -= _drill(channel, body.thickness, tolerance, turn)
    mesh = block.to_mesh64()
    corners = mesh.vert_properties[:, :3].astype(np.float32)
    return trimesh.Trimesh(corners, mesh.tri_verts, process=True)


def _drill(channel: Channel, thickness: float, tolerance: float, turn: float) -> Any:
    """The cylinder that cuts a channel, as manifold3d's Manifold."""
    begin, end = channel.drill
    length, radius = float(np.hypot(*(end - begin))), 0.5 * channel.diameter
    sides = int(4 * np.ceil(np.pi / (4 * np.arccos(1 - tolerance / radius))))
    along, (x, y) = (end - begin) / length, begin
    frame = [[0.0, -along[1], along[0], x], [0.0, along[0], along[1], y], [-1.0, 0.0, 0.0, 0.5 * thickness]]
    cylinder = package("manifold3d").Manifold.cylinder(length, radius, radius, sides)
    return cylinder.rotate((0.0, 0.0, turn * 360.0 / sides)).transform(np.array(frame))
