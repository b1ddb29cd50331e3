"""Solid bodies of links in space, for STL and STEP: a round block less the room of its neighbours and its channels."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.cad.kits import Faceted, Kit
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
        kit = Faceted(tolerance, turn)
        mesh = kit.mesh(carved_in_space(body, link, kit, tolerance))
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


def carved_in_space(body: SpatialBody, link: int, kit: Kit, tolerance: float) -> Any:
    """The body, made with a kit; raises MechanismError for one of no or several pieces."""
    block = _block(body, kit)
    for channel in body.channels:
        block = kit.cut(block, _drill(channel, body, kit, tolerance))
    if body.bore:
        block = kit.cut(block, _cylinder(body, 0.5 * body.bore, kit))
    pieces = kit.pieces(block)
    if pieces != 1:
        hint = "Move its surfaces apart, or narrow their limits."
        raise MechanismError(f"number of pieces of the body of link {link}", pieces, "1", hint)
    return block


def _block(body: SpatialBody, kit: Kit) -> Any:
    """The body without channels."""
    reach, extent = body.radius + 1.0, _extent(body)
    block = _cylinder(body, body.radius, kit)  # the corners of contact surfaces lie on its circle
    for face in body.faces:
        room = _half_space(face, reach, extent, kit, SET_BACK if face.rolls else 0.0)
        if face.rolls:
            room = kit.joined(room, _half_space(face, reach, extent, kit, 0.0, face.half_width))
        block = kit.common(block, room)
    return block


def _cylinder(body: SpatialBody, radius: float, kit: Kit) -> Any:
    """A cylinder around a circle about z, longer than the body."""
    bottom, top = _extent(body)
    frame = np.eye(3, 4)
    frame[2, 3] = bottom
    return kit.placed(kit.cylinder(radius, top - bottom, around=True), frame)


def _extent(body: SpatialBody) -> tuple[float, float]:
    """Lowest and highest z that a body may reach, with some room [mm]."""
    heights = np.concatenate([face.continued(body.radius + 2.0)[:, 1] for face in body.faces])
    return float(heights.min() - 1.0), float(heights.max() + 1.0)


def _half_space(
    face: SpatialFace, reach: float, extent: tuple[float, float], kit: Kit, back: float, half_width: float | None = None
) -> Any:
    """The space on the body's side of a face that is moved back into the body; within a half width, if there is one."""
    curve = face.continued(reach + 1.0) - [0.0, face.side * back]
    end = extent[0] - 1.0 if face.side > 0 else extent[1] + 1.0
    smooth = [curve[1:-1]] if face.rolls else [point[None] for point in curve[1:-1]]
    parts = [curve[:1], *smooth, curve[-1:], np.array([[curve[-1, 0], end]]), np.array([[curve[0, 0], end]])]
    outline = [part[:: -face.side] for part in parts[:: -face.side]]
    middle, half = (0.0, reach) if half_width is None else (face.middle, half_width)
    lateral, axial, axis = face.frame
    frame = np.column_stack([lateral, axial, axis, (middle - half) * axis])
    return kit.placed(kit.prism(outline, 2.0 * half), frame)


def _drill(channel: SpatialChannel, body: SpatialBody, kit: Kit, tolerance: float) -> Any:
    """The round tool that cuts a channel with its flares."""
    parent, child = channel.holes
    length, radius = float(np.linalg.norm(child - parent)), 0.5 * channel.diameter
    bottom, top = _extent(body)
    reach = top - bottom + 2.0 * body.radius
    entry, leaving = channel.flares
    half = [(0.0, -reach), (radius + reach * np.tan(entry), -reach)]
    half += [(radius, tolerance)] if entry > 0.0 else []  # within the body: a flat face may pass through the hole
    half += [(radius, length - tolerance)] if leaving > 0.0 else []
    half += [(radius + reach * np.tan(leaving), length + reach), (0.0, length + reach)]
    along = (child - parent) / length
    across = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    across /= np.linalg.norm(across)
    frame = np.column_stack([across, np.cross(along, across), along, parent])
    return kit.placed(kit.revolved(np.array(half)), frame)
