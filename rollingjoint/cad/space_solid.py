"""Solid bodies of links in space, as STL: a round block less the room of its neighbours and its channels."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.cad.packages import package
from rollingjoint.cad.solid import TURNS
from rollingjoint.cad.space_body import SET_BACK, SpatialBody, SpatialChannel, SpatialFace
from rollingjoint.errors import MechanismError

Array = NDArray[np.float64]


def spatial_solid(body: SpatialBody, link: int, tolerance: float = 1e-3) -> Any:
    """The body as a trimesh.Trimesh in its link's frame [mm]; corners have 32 bits, as in STL, and the mesh is closed.

    Args:
        body: the body. link: its index, for messages.
        tolerance: largest distance of flat faces from round ones [mm].
    Raises:
        MechanismError: a body of no or several pieces; corners too close for a closed body with 32 bits.
    """
    for turn in TURNS:
        mesh = _cut(body, link, tolerance, turn)
        if mesh.is_watertight:
            return mesh
    hint = "Raise the tolerance, or move the holes a little."
    raise MechanismError(f"solid body of link {link}", len(mesh.vertices), "corners that are apart in 32 bits", hint)


def write_mesh(path: Path, mesh: Any) -> None:
    """Writes a trimesh.Trimesh as binary STL in mm."""
    mesh.export(path, file_type="stl")


def placed(meshes: list[Any], poses: Array) -> Any:
    """All bodies at their poses (n, 4, 4) as one mesh, the trimesh.Trimesh of an assembly."""
    return package("trimesh").util.concatenate(
        [mesh.copy().apply_transform(pose) for mesh, pose in zip(meshes, poses, strict=True)]
    )


def _cut(body: SpatialBody, link: int, tolerance: float, turn: float) -> Any:
    trimesh = package("trimesh")
    block = _block(body, tolerance, turn)
    for channel in body.channels:
        block -= _drill(channel, body, tolerance, turn)
    if body.bore:
        block -= _cylinder(body, 0.5 * body.bore, tolerance, turn)
    pieces = block.decompose()
    if len(pieces) != 1:
        hint = "Move its surfaces apart, or narrow their limits."
        raise MechanismError(f"number of pieces of the body of link {link}", len(pieces), "1", hint)
    mesh = block.to_mesh64()
    corners = mesh.vert_properties[:, :3].astype(np.float32)
    return trimesh.Trimesh(corners, mesh.tri_verts, process=True)


def _block(body: SpatialBody, tolerance: float, turn: float) -> Any:
    """The body without channels, as manifold3d's Manifold; its outline is turned by a share of a side."""
    reach, (bottom, top) = body.radius + 1.0, _extent(body)
    block = _cylinder(body, body.radius, tolerance, turn)  # the corners of contact surfaces lie on its circle
    for face in body.faces:
        room = _half_space(face, reach, (bottom, top), SET_BACK if face.rolls else 0.0)
        block ^= room + _half_space(face, reach, (bottom, top), 0.0, face.half_width) if face.rolls else room
    return block


def _cylinder(body: SpatialBody, radius: float, tolerance: float, turn: float) -> Any:
    """A cylinder around a circle about z, longer than the body, as manifold3d's Manifold."""
    bottom, top = _extent(body)
    count = _sides(radius, tolerance)
    outer = radius / np.cos(np.pi / count)
    cylinder = package("manifold3d").Manifold.cylinder(top - bottom, outer, outer, count)
    return cylinder.rotate((0.0, 0.0, turn * 360.0 / count)).translate((0.0, 0.0, bottom))


def _extent(body: SpatialBody) -> tuple[float, float]:
    """Lowest and highest z that a body may reach, with some room [mm]."""
    heights = np.concatenate([face.continued(body.radius + 2.0)[:, 1] for face in body.faces])
    return float(heights.min() - 1.0), float(heights.max() + 1.0)


def _half_space(
    face: SpatialFace, reach: float, extent: tuple[float, float], back: float, half_width: float | None = None
) -> Any:
    """The space on the body's side of a face that is moved back into the body; within a half width, if there is one."""
    manifold3d = package("manifold3d")
    curve = face.continued(reach + 1.0) - [0.0, face.side * back]
    end = extent[0] - 1.0 if face.side > 0 else extent[1] + 1.0
    outline = np.concatenate([curve, [[curve[-1, 0], end], [curve[0, 0], end]]])[:: -face.side]
    middle, half = (0.0, reach) if half_width is None else (face.middle, half_width)
    prism = manifold3d.Manifold.extrude(manifold3d.CrossSection([outline]), 2.0 * half)
    lateral, axial, axis = face.frame
    return prism.transform(np.column_stack([lateral, axial, axis, (middle - half) * axis]))


def _drill(channel: SpatialChannel, body: SpatialBody, tolerance: float, turn: float) -> Any:
    """The round tool that cuts a channel with its flares, as manifold3d's Manifold."""
    manifold3d = package("manifold3d")
    parent, child = channel.holes
    length, radius = float(np.linalg.norm(child - parent)), 0.5 * channel.diameter
    bottom, top = _extent(body)
    reach = top - bottom + 2.0 * body.radius
    entry, leaving = channel.flares
    half = [(0.0, -reach), (radius + reach * np.tan(entry), -reach)]
    half += [(radius, tolerance)] if entry > 0.0 else []  # within the body: a flat face may pass through the hole
    half += [(radius, length - tolerance)] if leaving > 0.0 else []
    half += [(radius + reach * np.tan(leaving), length + reach), (0.0, length + reach)]
    sides = _sides(radius, tolerance)
    tool = manifold3d.Manifold.revolve(manifold3d.CrossSection([half]), sides).rotate((0.0, 0.0, turn * 360.0 / sides))
    along = (child - parent) / length
    across = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    across /= np.linalg.norm(across)
    return tool.transform(np.column_stack([across, np.cross(along, across), along, parent]))


def _sides(radius: float, tolerance: float) -> int:
    """Sides of a regular polygon that is nowhere farther than the tolerance from a circle around it."""
    return int(4 * np.ceil(np.pi / (4 * np.arccos(1 - tolerance / radius))))
