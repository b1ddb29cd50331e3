"""A scatter plot in the scene of a browser, with points that can be clicked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from agents.viewer.designs import DesignPoints
from agents.viewer.solids import Array
from rj_gym.rendering import FAINT, GRID, Color

COLOURS: Sequence[Color] = ((176, 184, 196), (86, 180, 233), (213, 94, 0))
"""Of the kinds of points."""

SIZES = (0.9, 1.2, 1.7)  # radii of points of every kind, in hundredths of the width
ROUND = (1.0, 2.0, 2.5, 5.0, 10.0)
TICKS = 5  # approximate number along an axis


@dataclass(frozen=True)
class Area:
    """The area of a plot: its lower left corner (x, y) in the plane z = 0, its width and height [mm]."""

    x: float
    y: float
    width: float
    height: float


class Axis:
    """Values from the lowest to the highest point of a plot, and their ticks, round numbers.

    Args:
        values: of all points. begin: where the axis begins [mm]. size: its length [mm].
    """

    def __init__(self, values: Array, begin: float, size: float) -> None:
        low, high = float(values.min()), float(values.max())
        room = 0.04 * (high - low) or 0.5 * abs(high) or 1.0
        self.low, self.high, self.begin, self.size = low - room, high + room, begin, size

    def place(self, values: Array | float) -> Any:
        """The places of values along the axis [mm]."""
        return self.begin + self.size * (np.asarray(values) - self.low) / (self.high - self.low)

    def value(self, place: float) -> float:
        """The value at a place along the axis [mm]."""
        return self.low + (place - self.begin) / self.size * (self.high - self.low)

    def has(self, place: float) -> bool:
        """Whether a place is on the axis [mm]."""
        return self.begin <= place <= self.begin + self.size

    @property
    def ticks(self) -> Array:
        """Round values along the axis."""
        step = _round_step((self.high - self.low) / TICKS)
        return np.arange(np.ceil(self.low / step), np.floor(self.high / step) + 1) * step


class Chart:
    """Points over two axes.

    Args:
        scene: of a client. area: of the plot. points: one at least. labels: of the two axes.
        chosen: called with the row of the design nearest to a click.
    """

    def __init__(
        self, scene: Any, area: Area, points: DesignPoints, labels: tuple[str, str], chosen: Callable[[int], None]
    ) -> None:
        self.scene, self.area, self.points, self.chosen = scene, area, points, chosen
        self.x = Axis(points.x, area.x, area.width)
        self.y = Axis(points.y, area.y, area.height)
        self.root = scene.add_frame("/chart", show_axes=False)
        self._lines()
        self._texts(labels)
        for kind in range(len(COLOURS)):
            self._dots(kind)
        scene.on_click()(self._clicked)

    def mark(self, name: str, row: int | None, colour: Color) -> None:
        """Put a ring around the point of a design; None, or a design without a point: takes the ring away."""
        at = np.flatnonzero(self.points.rows == (-1 if row is None else row))
        turns = np.linspace(0.0, 2 * np.pi, 33)
        radius = 0.025 * self.area.width
        ring = radius * np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=-1)
        centre = np.array([*self._place(int(at[0])), 2.0]) if len(at) else np.zeros(3)
        pieces = np.stack([ring[:-1], ring[1:]], axis=1) + centre
        handle = self.scene.add_line_segments(f"/chart/{name}", pieces, colour, thickness=3.0, thickness_units="screen")
        handle.visible = bool(len(at))

    def remove(self) -> None:
        """Take it out of the scene."""
        self.scene.remove_click_callback(self._clicked)
        self.root.remove()

    def _place(self, at: int) -> tuple[float, float]:
        return float(self.x.place(self.points.x[at])), float(self.y.place(self.points.y[at]))

    def _dots(self, kind: int) -> None:
        rows = np.flatnonzero(self.points.kinds == kind)
        if not len(rows):
            return
        places = [self.x.place(self.points.x[rows]), self.y.place(self.points.y[rows]), np.full(len(rows), 0.1 * kind)]
        self.scene.add_point_cloud(
            f"/chart/kind_{kind}",
            np.stack(places, axis=-1),
            COLOURS[kind],
            point_size=0.01 * SIZES[kind] * self.area.width,
            point_shape="circle",
            point_shading="flat",
            precision="float32",
        )

    def _clicked(self, event: Any) -> None:
        """Choose the design nearest to the point in which the ray of a click meets the plot, if it does."""
        origin, ray = np.array(event.ray_origin), np.array(event.ray_direction)
        x, y = (origin - ray * origin[2] / ray[2])[:2]
        if self.x.has(x) and self.y.has(y):
            self.chosen(self.points.nearest(self.x.value(x), self.y.value(y)))

    def _lines(self) -> None:
        (west, east), (south, north) = (axis.begin + np.array([0.0, axis.size]) for axis in (self.x, self.y))
        across = [((x, south), (x, north)) for x in self.x.place(self.x.ticks)]
        up = [((west, y), (east, y)) for y in self.y.place(self.y.ticks)]
        frame = [((west, south), (east, south)), ((west, south), (west, north))]
        for name, lines, colour in (("grid", across + up, GRID), ("axes", frame, FAINT)):
            pieces = np.append(np.array(lines), np.full((len(lines), 2, 1), -1.0), axis=2)
            self.scene.add_line_segments(f"/chart/{name}", pieces, colour, thickness=1.5, thickness_units="screen")

    def _texts(self, labels: tuple[str, str]) -> None:
        across, up = labels
        area, gap = self.area, 0.05 * self.area.width
        for k, tick in enumerate(self.x.ticks):
            self._text(f"x{k}", f"{tick:g}", (float(self.x.place(tick)), area.y - gap), "top-center")
        for k, tick in enumerate(self.y.ticks):
            self._text(f"y{k}", f"{tick:g}", (area.x - gap, float(self.y.place(tick))), "center-right")
        self._text("x", across, (area.x + 0.5 * area.width, area.y - 3 * gap), "top-center")
        self._text("y", up, (area.x, area.y + area.height + gap), "bottom-left")

    def _text(self, name: str, text: str, place: tuple[float, float], anchor: str) -> None:
        size = 0.045 * self.area.width
        self.scene.add_label(
            f"/chart/text_{name}", text, position=(*place, 0.0), anchor=anchor,
            font_size_mode="scene", font_scene_height=size,
        )  # fmt: skip


def _round_step(step: float) -> float:
    power = 10.0 ** np.floor(np.log10(step))
    return float(power * next(factor for factor in ROUND if factor * power >= step * (1 - 1e-9)))
