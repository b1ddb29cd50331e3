"""Plane files: shapes of links at poses, as DXF and SVG."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from rollingjoint.cad.body import Body
from rollingjoint.cad.packages import package
from rollingjoint.chain.outline import to_world

Array = NDArray[np.float64]

LAYERS = {"OUTLINE": (7, "#000000"), "CHANNELS": (5, "#0072B2"), "AXES": (1, "#D55E00")}
"""Layers, with their AutoCAD colour index and their colour in SVG."""

_CENTRE_LINE = (6.0, 1.0, 1.0, 1.0)  # mm: dash, gap, dot, gap
_OVERHANG = 1.5  # mm that a centre line sticks out
_CROSS = 1.0  # mm, half the cross at a link's origin


class Shape(NamedTuple):
    """One polyline on a layer."""

    layer: str
    points: Array
    closed: bool


def shapes(body: Body, pose: Sequence[float] | Array = (0.0, 0.0, 0.0)) -> list[Shape]:
    """Shapes of a body at a pose (x, y, angle): outline, channel edges, centre lines, a cross at its origin."""
    drawn = [Shape("OUTLINE", body.outline, True)]
    for channel in body.channels:
        drawn += [Shape("CHANNELS", edge, False) for edge in channel.edges]
        along = np.subtract(*channel.mouths[::-1])
        over = _OVERHANG * along / np.hypot(*along)
        drawn.append(Shape("AXES", channel.mouths + np.array([-over, over]), False))
    drawn += [Shape("AXES", _CROSS * np.array([arm, np.negative(arm)], float), False) for arm in ((-1, 0), (0, -1))]
    return [shape._replace(points=to_world(np.asarray(pose, float), shape.points)) for shape in drawn]


def write_dxf(path: Path, drawn: Sequence[Shape]) -> None:
    """Writes shapes as DXF in mm: polylines (LWPOLYLINE) and lines on the layers OUTLINE, CHANNELS and AXES."""
    ezdxf = package("ezdxf")
    document = ezdxf.new("R2010", units=ezdxf.units.MM)
    document.linetypes.add("CENTRE_LINE", [sum(_CENTRE_LINE), *(np.array(_CENTRE_LINE) * [1, -1, 1, -1])])
    for layer, (color, _) in LAYERS.items():
        document.layers.add(layer, color=color, linetype="CENTRE_LINE" if layer == "AXES" else "CONTINUOUS")
    space = document.modelspace()
    for layer, points, closed in drawn:
        if len(points) == 2:
            space.add_line(*points.tolist(), dxfattribs={"layer": layer})
        else:
            space.add_lwpolyline(points.tolist(), close=closed, dxfattribs={"layer": layer})
    document.saveas(path)


def write_svg(path: Path, drawn: Sequence[Shape], title: str) -> None:
    """Writes shapes as SVG: one unit is 1 mm; y is negated, since it points up in the mechanism."""
    points = np.concatenate([shape.points for shape in drawn]) * [1.0, -1.0]
    (x, y), (width, height) = points.min(axis=0) - 2.0, np.ptp(points, axis=0) + 4.0
    box = " ".join(f"{value:.6f}" for value in (x, y, width, height))
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.6f}mm" height="{height:.6f}mm" viewBox="{box}">',
        f"<title>{escape(title)}</title>",
    ]
    for layer, (_, color) in LAYERS.items():
        dashes = f' stroke-dasharray="{" ".join(f"{d:g}" for d in _CENTRE_LINE)}"' if layer == "AXES" else ""
        lines.append(f'<g id="{layer}" fill="none" stroke="{color}" stroke-width="0.1"{dashes}>')
        lines += [_path(shape) for shape in drawn if shape.layer == layer]
        lines.append("</g>")
    path.write_text("\n".join([*lines, "</svg>", ""]), encoding="utf-8")


def _path(shape: Shape) -> str:
    corners = " L ".join(f"{x:.6f} {-y:.6f}" for x, y in shape.points + 0.0)
    return f'<path d="M {corners}{" Z" if shape.closed else ""}"/>'
