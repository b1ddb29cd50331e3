"""A sheet of paper in mm: frame, lines, text, dimensions, tables, title block; matplotlib is imported late."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.errors import naming_extras

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

INK, THIN_INK = "#1A1A1A", "#55606E"
_POINT = 72.0 / 25.4  # points per mm
_MARGIN = (20.0, 10.0)  # mm, filing edge on the left and the other edges
_ARROW = np.array([[0.0, 0.0], [2.2, 0.37], [2.2, -0.37]])  # mm
ROW = 4.2  # mm, height of a table's row
TITLE_BLOCK = (180.0, 33.0)  # mm, width as in ISO 7200


class PaperSize(NamedTuple):
    """A size of paper, width and height [mm]."""

    name: str
    width: float
    height: float


class Box(NamedTuple):
    """A rectangle on the sheet [mm]."""

    left: float
    bottom: float
    right: float
    top: float

    @property
    def size(self) -> Array:
        """Width and height [mm]."""
        return np.array([self.right - self.left, self.top - self.bottom])


A4, A3 = PaperSize("A4", 210.0, 297.0), PaperSize("A3", 420.0, 297.0)


def frame_of(paper: PaperSize) -> Box:
    """The frame of a sheet."""
    left, edge = _MARGIN
    return Box(left, edge, paper.width - edge, paper.height - edge)


class Sheet:
    """A figure as large as the paper, on which coordinates are mm from the lower left corner."""

    def __init__(self, paper: PaperSize) -> None:
        with naming_extras():
            from matplotlib.figure import Figure

        self.figure: Figure = Figure(figsize=(paper.width / 25.4, paper.height / 25.4))
        self.axes = self.figure.add_axes((0.0, 0.0, 1.0, 1.0))
        self.axes.set(xlim=(0.0, paper.width), ylim=(0.0, paper.height))
        self.axes.set_axis_off()
        self.rectangle(frame_of(paper), width=0.5)

    def line(self, points: ArrayLike, width: float = 0.18, color: str = INK, dashes: Sequence[float] = ()) -> None:
        """Draws a polyline (k, 2); width and dashes in mm."""
        x, y = np.asarray(points, float).T
        style = (0, tuple(d / width for d in dashes)) if dashes else "-"
        self.axes.plot(x, y, color=color, linewidth=width * _POINT, linestyle=style, solid_joinstyle="round")

    def area(self, points: ArrayLike, color: str, edge: float = 0.0) -> None:
        """Fills a polygon (k, 2); edge: width of its edge in ink [mm], 0 for none."""
        x, y = np.asarray(points, float).T
        self.axes.fill(x, y, facecolor=color, edgecolor=INK if edge else "none", linewidth=edge * _POINT)

    def rectangle(self, box: Box, width: float = 0.25) -> None:
        """Draws the outline of a box."""
        left, bottom, right, top = box
        self.line([[left, bottom], [right, bottom], [right, top], [left, top], [left, bottom]], width)

    def text(
        self, at: ArrayLike, words: str, size: float = 2.8, align: str = "left", turn: float = 0.0, **style: Any
    ) -> None:
        """Writes words at a point, size in mm; align is left, center or right."""
        x, y = np.asarray(at, float)
        place: dict[str, Any] = {"ha": align, "va": "center", "rotation": turn, "rotation_mode": "anchor"}
        self.axes.text(x, y, words, fontsize=size * _POINT, parse_math=False, **{"color": INK, **place, **style})

    def dimension(self, begin: ArrayLike, end: ArrayLike, offset: float, words: str) -> None:
        """Draws a dimension from point to point, its line at an offset to the left of that direction [mm]."""
        begin, end = np.asarray(begin, float), np.asarray(end, float)
        along = (end - begin) / np.hypot(*(end - begin))
        normal = np.array([-along[1], along[0]])
        low, high = begin + offset * normal, end + offset * normal
        for foot, top in ((begin, low), (end, high)):
            self.line([foot + np.sign(offset) * normal, top + np.sign(offset) * 1.2 * normal], 0.13, THIN_INK)
        narrow = np.hypot(*(high - low)) < 7.0
        inward = -1.0 if narrow else 1.0  # arrows of a narrow dimension point at it from outside
        for point, way in ((low, inward * along), (high, -inward * along)):
            self.area(point + _ARROW @ np.array([way, [-way[1], way[0]]]), INK)
        reach = 4.0 * along if narrow else 0.0 * along
        self.line([low - reach, high + reach], 0.13, THIN_INK)
        turn = float(np.degrees(np.arctan2(along[1], along[0])))
        upright = (turn + 89.0) % 180.0 - 89.0
        up = np.array([-np.sin(np.radians(upright)), np.cos(np.radians(upright))])
        self.text(0.5 * (low + high) + 1.9 * up, words, align="center", turn=upright)

    def table(self, corner: ArrayLike, name: str, widths: ArrayLike, rows: Sequence[Sequence[str]]) -> float:
        """Draws a name and rows below the upper left corner, the first row as the head; returns its lowest y [mm]."""
        (left, top), widths = np.asarray(corner, float), np.asarray(widths, float)
        self.text([left, top - 0.5 * ROW], name, 2.5, color=THIN_INK)
        top -= ROW
        columns = left + np.concatenate([[0.0], np.cumsum(widths)])
        bottom = top - ROW * len(rows)
        self.axes.fill_between(columns[[0, -1]], top - ROW, top, color="#E8ECF1", linewidth=0.0)
        for k, row in enumerate(rows):
            y = top - ROW * (k + 0.5)
            self.line([[columns[0], y - 0.5 * ROW], [columns[-1], y - 0.5 * ROW]], 0.13 if k else 0.25)
            for cell, right, width in zip(row, columns[1:], widths, strict=True):
                self.text([right - 0.5 * width, y - 0.1], cell, 2.5, "center", weight="bold" if k == 0 else "normal")
        self.rectangle(Box(columns[0], bottom, columns[-1], top))
        return float(bottom)

    def title_block(self, box: Box, rows: Sequence[Sequence[tuple[float, str, str]]]) -> None:
        """Draws rows of (width [mm], label, entry) that fill a box from the top; the first entry is the title."""
        height = box.size[1] / len(rows)
        for k, row in enumerate(rows):
            left, top = box.left, box.top - k * height
            for i, (width, label, entry) in enumerate(row):
                self.rectangle(Box(left, top - height, left + width, top), 0.25)
                self.text([left + 1.3, top - 2.2], label, 2.0, color=THIN_INK)
                size, weight = (4.6, "bold") if k == i == 0 else (3.2, "normal")
                self.text([left + 1.3, top - 0.66 * height], entry, size, weight=weight)
                left += width
        self.rectangle(box, 0.5)
