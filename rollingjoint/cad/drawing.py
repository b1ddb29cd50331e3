"""The assembly drawing: the mechanism to scale, one link in two views, tables of links and holes, a title block."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint.cad.assembly import Assembly, assemble
from rollingjoint.cad.body import Body
from rollingjoint.cad.fabrication import Fabrication
from rollingjoint.cad.flat import Shape, shapes
from rollingjoint.cad.sheet import A3, A4, INK, THIN_INK, TITLE_BLOCK, Box, PaperSize, Sheet, frame_of
from rollingjoint.cad.tables import different_parts, draw_tables, millimetres, ranges, rows_left
from rollingjoint.chain.equilibrium import Equilibrium
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.errors import InvalidInput, naming
from rollingjoint.plotting.figure import check_figure_path
from rollingjoint.plotting.parts import PALETTE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

SCALES = tuple(step * 10.0**power for power in range(1, -5, -1) for step in (5.0, 2.0, 1.0))
"""Standard scales (ISO 5455), drawn length over real length: 50:1 to 1:10000."""

_DETAIL_HEIGHT, _PART_HEIGHT = 84.0, 150.0  # mm of the paper for a part beside the assembly, and on its sheet
_ASSEMBLY_ROOM, _DETAIL_ROOM = np.array([31.0, 32.0]), np.array([44.0, 36.0])  # mm for dimensions around a view
_BALLOONS_APART = 5.6  # mm; a link without this room for its number gets none
_FILL = "#DCE3EB"


class Layout(NamedTuple):
    """Places of the parts of a drawing on a sheet."""

    paper: PaperSize
    assembly: Box
    detail: Box
    tables: Box
    title: Box


def assembly_drawing(
    mechanism: RollingChain | Equilibrium,
    path: str | Path,
    *,
    thickness: float = Fabrication.thickness,
    channel_diameter: float = Fabrication.channel_diameter,
    tolerance: float = Fabrication.tolerance,
    wall: float = Fabrication.wall,
) -> Path:
    """The path, after writing the drawing there; its suffix sets the format, such as .pdf or .png.

    Args:
        mechanism: a mechanism, drawn at s = 0, or an equilibrium, drawn in its pose.
        path: of the file, which is replaced if it exists.
        thickness, channel_diameter, tolerance, wall: see Fabrication [mm].
    Raises:
        MechanismError: a link with an outline that is no valid body, or a channel that cannot be drilled.
        InvalidInput: a number beyond its range, a suffix that cannot be written, a mechanism too large for a sheet.
        SolverError: an equilibrium that is not usable.
    """
    path = check_figure_path(path)
    with naming(path):
        write_drawing(path, assemble(mechanism, Fabrication(thickness, channel_diameter, tolerance, wall)))
    return path


def write_drawing(path: Path, assembly: Assembly, link: int | None = None) -> None:
    """Writes the drawing of an assembly, or of one of its links, in the format of the path's suffix."""
    metadata = {"CreationDate": None} if path.suffix.lower() == ".pdf" else None  # the same drawing, the same file
    figure = draw_assembly(assembly) if link is None else draw_link(assembly, link)
    figure.savefig(path, dpi=200, metadata=metadata)


def draw_assembly(assembly: Assembly) -> Figure:
    """The drawing as a figure with axes in mm of paper."""
    layout, scale = _choose(assembly)
    sheet = Sheet(layout.paper)
    _draw_assembly(sheet, layout.assembly, assembly, scale)
    _draw_detail(sheet, layout.detail, assembly, max(assembly.first_alike, key=assembly.first_alike.count))
    draw_tables(sheet, layout.tables, assembly)
    sheet.title_block(layout.title, _title(assembly, layout.paper, scale))
    return sheet.figure


def draw_link(assembly: Assembly, link: int) -> Figure:
    """The sheet of a link and those identical to it: two views, its holes, a title block, on A4."""
    sheet, layout = Sheet(A4), _layout(A4)
    left, _, right, top = frame_of(A4)
    middle = top - _PART_HEIGHT
    scale = _draw_detail(sheet, Box(left, middle, right, top), assembly, link)
    draw_tables(sheet, Box(left + 4.0, layout.tables.bottom, right - 4.0, middle), assembly, link)
    sheet.title_block(layout.title, _title(assembly, A4, scale, link))
    return sheet.figure


def scale_text(scale: float) -> str:
    """A scale as text, such as 1:2."""
    return f"{scale:g}:1" if scale >= 1 else f"1:{1 / scale:g}"


def _layout(paper: PaperSize) -> Layout:
    left, bottom, right, top = frame_of(paper)
    title = Box(right - TITLE_BLOCK[0], bottom, right, bottom + TITLE_BLOCK[1])
    has_column = title.left > left
    middle, below = (title.left, bottom) if has_column else (left + 0.55 * (right - left), title.top)
    detail = Box(middle, top - _DETAIL_HEIGHT, right, top)
    tables = Box(middle + 2.0, title.top + 4.0, right - 4.0, detail.bottom)
    return Layout(paper, Box(left, below, middle, top), detail, tables, title)


def _choose(assembly: Assembly) -> tuple[Layout, float]:
    """A4 if the mechanism and its tables fit on it in full size or larger, else A3; and the scale."""
    low, high = assembly.bounds
    for layout in map(_layout, (A4, A3)):
        scale = _scale(high - low, layout.assembly.size - _ASSEMBLY_ROOM)
        if scale >= 1.0 and rows_left(layout.tables, assembly) >= 0:
            break
    if not scale:
        raise InvalidInput(
            "size of the mechanism [mm]", (high - low).round(1).tolist(), "one that fits on A3 at 1:10000"
        )
    return layout, scale


def _scale(size: Array, room: Array) -> float:
    """The largest standard scale at which a size fits into the room, 0 if none."""
    return next((scale for scale in SCALES if np.all(size * scale <= room)), 0.0)


class _SheetTransform(NamedTuple):
    """Map from mm of the mechanism to mm on the sheet."""

    scale: float
    shift: Array

    def __call__(self, points: Array) -> Array:
        return self.scale * np.asarray(points, float) + self.shift


def _draw_shapes(sheet: Sheet, view: _SheetTransform, drawn: Sequence[Shape]) -> None:
    for layer, points, closed in drawn:
        if closed:
            sheet.area(view(points), _FILL, edge=0.4)
        elif layer == "CHANNELS":
            sheet.line(view(points), 0.18, dashes=(1.4, 0.8))
        else:
            sheet.line(view(points), 0.13, THIN_INK, (3.0, 0.7, 0.5, 0.7))


def _draw_assembly(sheet: Sheet, box: Box, assembly: Assembly, scale: float) -> None:
    low, high = assembly.bounds
    centre = np.array([0.5 * (box.left + box.right) + 1.0, 0.5 * (box.bottom + box.top)])
    view = _SheetTransform(scale, centre - 0.5 * scale * (low + high))
    for body, pose in zip(assembly.bodies, assembly.poses, strict=True):
        _draw_shapes(sheet, view, shapes(body, pose))
    for j, line in enumerate(assembly.chain.tendon_polyline(assembly.poses)):
        sheet.line(view(line), 0.3, PALETTE[j % len(PALETTE)])
    numbered: list[float] = []
    for i, (outline, pose) in enumerate(zip(assembly.outlines, assembly.poses, strict=True)):
        origin = view(pose[:2])
        if all(abs(origin[1] - y) > _BALLOONS_APART for y in numbered):
            _balloon(sheet, view(outline), origin, view(high)[0] + 9.0, str(i))
            numbered.append(origin[1])
    (left, bottom), (right, top) = view(low), view(high)
    sheet.dimension([left, bottom], [left, top], 8.0, millimetres(high[1] - low[1]))
    sheet.dimension([left, bottom], [right, bottom], -8.0, millimetres(high[0] - low[0]))
    sheet.text([box.left + 4.0, box.top - 5.0], f"ASSEMBLY  {scale_text(scale)}", 3.4, weight="bold")


def _balloon(sheet: Sheet, outline: Array, origin: Array, x: float, number: str) -> None:
    """Draws the number of a link in a circle at x, level with its origin, and a line from there into the link."""
    turn = np.linspace(0.0, 2.0 * np.pi, 49)
    circle, centre = np.stack([np.cos(turn), np.sin(turn)], axis=1), np.array([x, origin[1]])
    dot = np.array([max(_right_edge(outline, origin[1]) - 2.0, origin[0]), origin[1]])
    sheet.line([dot.tolist(), [x - 2.6, origin[1]]], 0.13, THIN_INK)
    sheet.area(dot + 0.45 * circle, INK)
    sheet.line(centre + 2.6 * circle, 0.18)
    sheet.text(centre - [0.0, 0.15], number, 2.8, "center")


def _right_edge(outline: Array, y: float) -> float:
    """The largest x of an outline at this y; -inf without any."""
    begin, end = outline, np.roll(outline, -1, axis=0)
    across = (begin[:, 1] <= y) != (end[:, 1] <= y)
    (x0, y0), (x1, y1) = begin[across].T, end[across].T
    return float(np.max(x0 + (y - y0) / (y1 - y0) * (x1 - x0), initial=-np.inf))


def _draw_detail(sheet: Sheet, box: Box, assembly: Assembly, first: int) -> float:
    """Draws a part, by its first link, from the front and from the side; the scale."""
    body = assembly.bodies[first]
    low, high = body.bounds
    size = high - low + [body.thickness, 0.0]
    scale = _scale(size, box.size - _DETAIL_ROOM) or SCALES[-1]
    centre = np.array(
        [0.5 * (box.left + box.right) - 12.0 - 0.5 * scale * body.thickness, 0.5 * (box.bottom + box.top)]
    )
    view = _SheetTransform(scale, centre - 0.5 * scale * (low + high))
    _draw_shapes(sheet, view, shapes(body))
    (left, bottom), (right, top) = view(low), view(high)
    sheet.dimension([left, bottom], [right, bottom], -7.0, millimetres(high[0] - low[0]))
    sheet.dimension([right, bottom], [right, top], -7.0, millimetres(high[1] - low[1]))
    _dimension_channels(sheet, view, body, top + 6.0)
    _draw_side(sheet, Box(right + 18.0, bottom, right + 18.0 + scale * body.thickness, top), body)
    alike = dict(different_parts(assembly))[first]
    name = f"LINK{'S' if len(alike) > 1 else ''} {ranges(alike)}"
    sheet.text([box.left + 4.0, box.top - 5.0], f"{name}  {scale_text(scale)}", 3.4, weight="bold")
    if body.channels:
        depths = sorted({channel.depth for channel in body.channels})
        half = depths == [0.5 * body.thickness]
        where = "half thickness" if half else f"depths of {', '.join(map(millimetres, depths))}"
        note = f"Ø{assembly.making.channel_diameter:g} through, at {where}"
        sheet.text([box.left + 4.0, box.top - 10.0], note, 2.5)
    return scale


def _dimension_channels(sheet: Sheet, view: _SheetTransform, body: Body, y: float) -> None:
    """Draws the distance between the outermost channels on the child surface."""
    mouths = sorted((channel.mouths[1] for channel in body.channels), key=lambda mouth: mouth[0])
    if len(mouths) > 1:
        begin, end = view(mouths[0]), view(mouths[-1])
        for mouth in (begin, end):
            sheet.line([[mouth[0], mouth[1] + 1.0], [mouth[0], y - 1.0]], 0.13, THIN_INK)
        sheet.dimension([begin[0], y - 3.0], [end[0], y - 3.0], 3.0, millimetres(mouths[-1][0] - mouths[0][0]))


def _draw_side(sheet: Sheet, box: Box, body: Body) -> None:
    left, bottom, right, top = box
    sheet.area([[left, bottom], [right, bottom], [right, top], [left, top]], _FILL, edge=0.4)
    depths = {channel.depth for channel in body.channels} or {0.5 * body.thickness}
    for depth in sorted(depths):
        x = left + (right - left) * depth / body.thickness
        sheet.line([[x, bottom - 2.0], [x, top + 2.0]], 0.13, THIN_INK, (3.0, 0.7, 0.5, 0.7))
    sheet.dimension([left, bottom], [right, bottom], -7.0, millimetres(body.thickness))


def _title(
    assembly: Assembly, paper: PaperSize, scale: float, link: int | None = None
) -> list[list[tuple[float, str, str]]]:
    chain, making = assembly.chain, assembly.making
    name, label = chain.name or "mechanism", f"assembly, {assembly.state}"
    if link is not None:
        alike = dict(different_parts(assembly))[link]
        name, label = f"{name}, link {ranges(alike)}", f"part, {len(alike)} of {chain.n_links} links"
    return [
        [
            (110.0, label, name),
            (30.0, "scale", scale_text(scale)),
            (20.0, "sheet", paper.name),
            (20.0, "units", "mm"),
        ],
        [
            (30.0, "links", str(chain.n_links)),
            (30.0, "tendons", str(chain.n_tendons)),
            (50.0, "length, sum of the heights at s = 0", millimetres(chain.length)),
            (30.0, "thickness", f"{making.thickness:g}"),
            (40.0, "channels", f"Ø{making.channel_diameter:g}" if making.channel_diameter else "none"),
        ],
        [
            (60.0, "material", ""),
            (50.0, "drawn", ""),
            (30.0, "date", ""),
            (40.0, "curves within", f"{making.tolerance:g}"),
        ],
    ]
