"""Pictures of an evaluation: error over time, distribution of the final error, an animation."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image, ImageDraw, ImageFont

from agents.controllers.controller import Array

COLOURS = (
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#cc79a7",
    "#e69f00",
    "#56b4e9",
    "#7f7f7f",
)  # told apart with any colour vision (Okabe and Ito)
DASHES = ("-", "--", ":")  # where lines lie on each other
SMALLEST_MM = 0.001  # smaller errors are drawn here: the axes are logarithmic
PANELS = {50: "half of the episodes below", 95: "95 % of the episodes below"}


def error_over_time(errors: Mapping[str, Array], floors: Mapping[int, Array] | None = None) -> bytes:
    """PNG: the tip error after every step that half and 95 % of the episodes stay below, per controller.

    Args:
        errors: (E, T + 1) [mm], by controller.
        floors: after some of the steps, by step, (E,) [mm]; a point each. Those that are not finite do not count.
    """
    figure = figure_of(9.5, 4.5)
    panels = figure.subplots(1, 2, sharey=True)
    for axes, (share, title) in zip(panels, PANELS.items(), strict=True):
        _error_axis(axes, "y")
        axes.axhline(1.0, color="black", linestyle=":", linewidth=1)
        for (name, values), colour, dashes in zip(errors.items(), cycle(COLOURS), cycle(DASHES), strict=False):
            below = np.percentile(np.maximum(values, SMALLEST_MM), share, axis=0)
            axes.plot(below, color=colour, linestyle=dashes, linewidth=2, label=name)
        if reached := _below(floors or {}, share):
            axes.plot(*zip(*reached, strict=True), "o", color="black", markersize=4, clip_on=False, label="floor")
        axes.set(title=title, xlabel="step")
        axes.margins(x=0)
    panels[0].set_ylabel("tip error [mm]")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right upper", frameon=False)
    return png(figure)


def _below(floors: Mapping[int, Array], share: float) -> list[tuple[int, float]]:
    """Steps, and the error that this share [%] of their known floors stays below [mm]."""
    finite = {step: values[np.isfinite(values)] for step, values in floors.items()}
    return [(step, max(np.percentile(values, share), SMALLEST_MM)) for step, values in finite.items() if len(values)]


def error_distribution(errors: Mapping[str, Array], floors: Array | None = None) -> bytes:
    """PNG: box (quartiles, whiskers 5 to 95 %) and every episode's tip error at the end, per controller and floor.

    Args:
        errors: (E, T + 1) [mm], by controller.
        floors: at the last step, (E,) [mm].
    """
    rows = {name: values[:, -1] for name, values in errors.items()} | ({} if floors is None else {"floor": floors})
    figure = figure_of(8, 1.5 + 0.6 * len(rows))
    axes = figure.add_subplot()
    _error_axis(axes, "x")
    axes.axvline(1.0, color="black", linestyle=":", linewidth=1)
    spread = np.random.default_rng(0)
    colours = dict(zip(errors, cycle(COLOURS), strict=False)) | {"floor": "black"}
    for place, (name, values) in enumerate(rows.items()):
        final = np.maximum(values, SMALLEST_MM)
        beside = place + spread.uniform(-0.3, 0.3, len(final))
        axes.scatter(final, beside, s=9, color=colours[name], alpha=0.4, linewidths=0)
        line = {"color": "black", "linewidth": 1.2}
        axes.boxplot(
            [final], positions=[place], widths=0.35, whis=(5, 95), showfliers=False, orientation="horizontal",
            boxprops=line, whiskerprops=line, capprops=line, medianprops=line | {"linewidth": 2.5},
        )  # fmt: skip
    axes.set_yticks(range(len(rows)), [f"{name}\nmedian {np.median(values):.2g} mm" for name, values in rows.items()])
    axes.invert_yaxis()
    axes.set(title="Tip error at the end of the episode", xlabel="tip error [mm]")
    return png(figure)


def animation(frames: Mapping[str, Sequence[np.ndarray]], width: int = 440, columns: int | None = None) -> bytes:
    """GIF: one episode under several controllers side by side, each under its name.

    Args:
        frames: RGB images (height, width, 3) per controller, one per step.
        width: of one controller's picture [pixels].
        columns: controllers in a row; None: all.
    """
    count = max(len(series) for series in frames.values())
    pictures = [
        _in_rows([_titled(series[min(step, len(series) - 1)], name, width) for name, series in frames.items()], columns)
        for step in range(count)
    ]
    palette = _palette(pictures[:: max(1, count // 5)])
    pictures = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    stream = io.BytesIO()
    durations = [120] * (count - 1) + [2000]
    pictures[0].save(stream, "GIF", save_all=True, append_images=pictures[1:], duration=durations, loop=0)
    return stream.getvalue()


def _palette(pictures: Sequence[Image.Image]) -> Image.Image:
    """256 colours for all the pictures: each counts once, or a thin arrow would take the colour of a large area."""
    pixels = np.concatenate([np.asarray(picture).reshape(-1, 3) for picture in pictures]).astype(np.uint32)
    colours = np.unique(pixels @ np.array([1 << 16, 1 << 8, 1], np.uint32))  # six times as fast as unique rows
    rows = np.stack([colours >> 16, colours >> 8 & 255, colours & 255], axis=1).astype(np.uint8)
    return Image.fromarray(rows[None]).quantize(256)


def _titled(frame: np.ndarray, name: str, width: int) -> Image.Image:
    scene = Image.fromarray(frame)
    scene = scene.resize((width, round(scene.height * width / scene.width)), Image.Resampling.LANCZOS)
    bar = 34
    image = Image.new("RGB", (width, scene.height + bar), "white")
    image.paste(scene, (0, bar))
    font = ImageFont.load_default(20)
    ImageDraw.Draw(image).text((width / 2, bar / 2), name, fill="black", font=font, anchor="mm")
    return image


def _in_rows(images: Sequence[Image.Image], columns: int | None) -> Image.Image:
    gap, columns = 4, columns or len(images)
    width, height = (max(image.size[axis] for image in images) + gap for axis in (0, 1))
    canvas = Image.new("RGB", (columns * width - gap, math.ceil(len(images) / columns) * height - gap), "#bbbbbb")
    for place, image in enumerate(images):
        canvas.paste(image, (place % columns * width, place // columns * height))
    return canvas


def figure_of(width: float, height: float) -> Figure:
    """A figure of this size [inches] that needs no screen."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def tidy(axes: Axes, grid: Literal["both", "x", "y"] = "both") -> None:
    """A faint grid, and no frame above and to the right."""
    axes.grid(axis=grid, alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)


def _error_axis(axes: Axes, name: Literal["x", "y"]) -> None:
    """Make one of its axes a logarithmic one of tip errors."""
    axis = axes.xaxis if name == "x" else axes.yaxis
    axes.set(**{f"{name}scale": "log"})
    axis.set_major_formatter("{x:g}")
    tidy(axes, name)


def png(figure: Figure, dpi: int = 120) -> bytes:
    """The figure as a PNG file."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=dpi)
    return stream.getvalue()
