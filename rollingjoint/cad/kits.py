"""Solids from curves, cylinders and cuts: as facets, by manifold3d, and with exact round and smooth faces, by OCP."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rollingjoint.cad.packages import package

Array = NDArray[np.float64]
_NUMBERED = re.compile(r"PRODUCT\('(\S+) \d+','\1 \d+',")  # the writer adds a number that grows within a process
_CHORDS = 60  # of a spline, at least: sparse points let it swing

Outline = Sequence[Array]
"""Parts of a closed outline, counter-clockwise, (k, 2) each [mm]: smooth curves, straight lines in between."""


class Kit(Protocol):
    """A way to make solids; they are what its functions take and return."""

    def prism(self, outline: Outline, length: float) -> Any:
        """An outline in the x-y plane, drawn out along z."""

    def cylinder(self, radius: float, length: float, around: bool = False) -> Any:
        """A cylinder from the origin along z; with facets within the round one, or `around` it."""

    def revolved(self, half: Array) -> Any:
        """The outline (k, 2) of distances from z, 0 or more, and heights, turned about z."""

    def placed(self, solid: Any, frame: Array) -> Any:
        """The solid with its axes and origin at the columns of a frame (3, 4)."""

    def cut(self, solid: Any, tool: Any) -> Any:
        """The solid less the tool."""

    def common(self, first: Any, second: Any) -> Any:
        """What both have in common."""

    def joined(self, first: Any, second: Any) -> Any:
        """Both together."""

    def pieces(self, solid: Any) -> int:
        """The number of separate pieces."""


@dataclass(frozen=True)
class Faceted:
    """Solids of flat faces, manifold3d's Manifold.

    Args:
        tolerance: largest distance of flat faces from round ones [mm].
        turn: of the corners of round parts about their axes, by a share of a side.
    """

    tolerance: float
    turn: float

    def prism(self, outline: Outline, length: float) -> Any:
        """See Kit."""
        manifold3d = package("manifold3d")
        return manifold3d.Manifold.extrude(manifold3d.CrossSection([np.concatenate(list(outline))]), length)

    def cylinder(self, radius: float, length: float, around: bool = False) -> Any:
        """See Kit."""
        sides = self._sides(radius)
        outer = radius / np.cos(np.pi / sides) if around else radius
        return self._turned(package("manifold3d").Manifold.cylinder(length, outer, outer, sides), sides)

    def revolved(self, half: Array) -> Any:
        """See Kit."""
        manifold3d = package("manifold3d")
        sides = self._sides(float(np.sort(np.unique(half[:, 0]))[1]))
        return self._turned(manifold3d.Manifold.revolve(manifold3d.CrossSection([half]), sides), sides)

    def placed(self, solid: Any, frame: Array) -> Any:
        """See Kit."""
        return solid.transform(frame)

    def cut(self, solid: Any, tool: Any) -> Any:
        """See Kit."""
        return solid - tool

    def common(self, first: Any, second: Any) -> Any:
        """See Kit."""
        return first ^ second

    def joined(self, first: Any, second: Any) -> Any:
        """See Kit."""
        return first + second

    def pieces(self, solid: Any) -> int:
        """See Kit."""
        return len(solid.decompose())

    def mesh(self, solid: Any) -> Any:
        """The solid as a trimesh.Trimesh; corners have 32 bits, as in STL."""
        mesh = solid.to_mesh64()
        corners = mesh.vert_properties[:, :3].astype(np.float32)
        return package("trimesh").Trimesh(corners, mesh.tri_verts, process=True)

    def _sides(self, radius: float) -> int:
        """Sides of a regular polygon that is nowhere farther than the tolerance from a circle around it."""
        return int(4 * np.ceil(np.pi / (4 * np.arccos(1 - self.tolerance / radius))))

    def _turned(self, solid: Any, sides: int) -> Any:
        return solid.rotate((0.0, 0.0, self.turn * 360.0 / sides))


class Exact:
    """Solids with round faces and interpolating splines, OCP's TopoDS_Shape, for STEP."""

    def prism(self, outline: Outline, length: float) -> Any:
        """See Kit."""
        gp = _ocp("gp")
        face = self._face([np.pad(part, ((0, 0), (0, 1))) for part in outline])
        return _ocp("BRepPrimAPI").BRepPrimAPI_MakePrism(face, gp.gp_Vec(0.0, 0.0, float(length))).Shape()

    def cylinder(self, radius: float, length: float, around: bool = False) -> Any:
        """See Kit."""
        return _ocp("BRepPrimAPI").BRepPrimAPI_MakeCylinder(float(radius), float(length)).Shape()

    def revolved(self, half: Array) -> Any:
        """See Kit."""
        gp = _ocp("gp")
        corners = np.column_stack([half[:, 0], np.zeros(len(half)), half[:, 1]])
        return (
            _ocp("BRepPrimAPI")
            .BRepPrimAPI_MakeRevol(
                self._face([corners[:1], corners[1:2], *(corner[None] for corner in corners[2:])]), gp.gp.OZ_s()
            )
            .Shape()
        )

    def placed(self, solid: Any, frame: Array) -> Any:
        """See Kit."""
        transform = _ocp("gp").gp_Trsf()
        transform.SetValues(*(float(value) for value in np.asarray(frame).ravel()))
        return _ocp("BRepBuilderAPI").BRepBuilderAPI_Transform(solid, transform, True).Shape()

    def cut(self, solid: Any, tool: Any) -> Any:
        """See Kit."""
        return _ocp("BRepAlgoAPI").BRepAlgoAPI_Cut(solid, tool).Shape()

    def common(self, first: Any, second: Any) -> Any:
        """See Kit."""
        return _ocp("BRepAlgoAPI").BRepAlgoAPI_Common(first, second).Shape()

    def joined(self, first: Any, second: Any) -> Any:
        """See Kit."""
        return _ocp("BRepAlgoAPI").BRepAlgoAPI_Fuse(first, second).Shape()

    def pieces(self, solid: Any) -> int:
        """See Kit."""
        return len(solids_of(solid))

    def volume(self, solid: Any) -> float:
        """Volume of a solid [mm³]."""
        properties = _ocp("GProp").GProp_GProps()
        _ocp("BRepGProp").BRepGProp.VolumeProperties_s(solid, properties)
        return float(properties.Mass())

    def _face(self, parts: Sequence[Array]) -> Any:
        """The plane face within parts (k, 3) of a closed outline."""
        api = _ocp("BRepBuilderAPI")
        wire = api.BRepBuilderAPI_MakeWire()
        for part, following in zip(parts, [*parts[1:], parts[0]], strict=True):
            if len(part) > 1:
                wire.Add(self._edge(part if len(part) == 2 else _dense(part)))
            if np.abs(part[-1] - following[0]).max() > 0.0:
                wire.Add(self._edge(np.stack([part[-1], following[0]])))
        return api.BRepBuilderAPI_MakeFace(wire.Wire(), True).Face()

    def _edge(self, points: Array) -> Any:
        """A straight line through two points, or a spline through more."""
        api, corners = _ocp("BRepBuilderAPI"), [_ocp("gp").gp_Pnt(*map(float, point)) for point in points]
        if len(corners) == 2:
            return api.BRepBuilderAPI_MakeEdge(*corners).Edge()
        table = _ocp("collections").HArray1_gp_Pnt(1, len(corners))
        for place, corner in enumerate(corners, 1):
            table.SetValue(place, corner)
        curve = _ocp("GeomAPI").GeomAPI_Interpolate(table, False, 1e-9)
        curve.Perform()
        return api.BRepBuilderAPI_MakeEdge(curve.Curve()).Edge()


def write_step(path: Path, solids: Sequence[tuple[str, Any]]) -> None:
    """Writes named solids of `Exact` as STEP (AP214) in mm, the same file every time."""
    step, interface = _ocp("STEPControl"), _ocp("Interface")
    printers = _ocp("Message").Message.DefaultMessenger_s().ChangePrinters()
    printers.Clear()  # no statistics on the standard output
    writer = step.STEPControl_Writer()
    for name, solid in solids:
        interface.Interface_Static.SetCVal_s("write.step.product.name", name)
        writer.Transfer(solid, step.STEPControl_StepModelType.STEPControl_AsIs)
    header = _ocp("APIHeaderSection").APIHeaderSection_MakeHeader(writer.Model())
    text = _ocp("TCollection").TCollection_HAsciiString
    header.SetName(text(path.name))
    header.SetTimeStamp(text("1970-01-01T00:00:00"))
    if writer.Write(str(path)) != _ocp("IFSelect").IFSelect_ReturnStatus.IFSelect_RetDone:
        raise OSError(f"cannot write {path}")
    text_written = path.read_text("utf-8")
    path.write_text(_NUMBERED.sub(r"PRODUCT('\1','\1',", text_written), "utf-8")


def _dense(points: Array) -> Array:
    """The points with others on long chords between them, where the curve is as good as straight: (more, 3)."""
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    counts = np.ceil(chords * _CHORDS / chords.sum()).astype(int)
    pairs = zip(points, points[1:], counts.tolist(), strict=False)
    parts = [np.linspace(begin, end, count, endpoint=False) for begin, end, count in pairs]
    return np.concatenate([*parts, points[-1:]])


def solids_of(shape: Any) -> list[Any]:
    """The solids of a shape."""
    explorer = _ocp("TopExp").TopExp_Explorer(shape, _ocp("TopAbs").TopAbs_ShapeEnum.TopAbs_SOLID)
    found = []
    while explorer.More():
        found.append(explorer.Current())
        explorer.Next()
    return found


def _ocp(module: str) -> Any:
    return package(f"OCP.{module}")
