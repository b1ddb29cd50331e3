"""Pictures of an evaluation: error over time, distribution of the final error, an animation."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image, ImageDraw, ImageFont

from agents.rollout import Episode, error_table

COLOURS = (
    "#0072b2",
    "#d55e00",
    "#7f7f7f",
    "#009e73",
    "#cc79a7",
    "#e69f00",
)  # told apart with any colour vision (Okabe and Ito)
SMALLEST_MM = 0.01  # smaller errors are drawn here: the axes are logarithmic


def error_over_time(episodes: Mapping[str, Sequence[Episode]]) -> bytes:
    """PNG: median tip error after every step, and the band that holds the middle 80 % of the episodes."""
    figure, axes = _error_axes("Tip error over the episode")
    for (name, some), colour in zip(episodes.items(), cycle(COLOURS), strict=False):
        errors = np.maximum(error_table(some), SMALLEST_MM)
        low, median, high = np.percentile(errors, [10, 50, 90], axis=0)
        steps = np.arange(errors.shape[1])
        axes.fill_between(steps, low, high, color=colour, alpha=0.18, linewidth=0)
        axes.plot(steps, median, color=colour, linewidth=2, label=name)
    axes.set_xlabel("step")
    axes.margins(x=0)
    figure.legend(title="median\nband: 10 to 90 %", loc="outside right upper", frameon=False, alignment="left")
    return _png(figure)


def error_distribution(episodes: Mapping[str, Sequence[Episode]]) -> bytes:
    """PNG: box (quartiles, whiskers 5 to 95 %) and every episode's final tip error, per controller."""
    figure, axes = _error_axes("Tip error at the end of the episode")
    spread = np.random.default_rng(0)
    for place, (some, colour) in enumerate(zip(episodes.values(), cycle(COLOURS), strict=False)):
        final = np.maximum(error_table(some)[:, -1], SMALLEST_MM)
        sideways = place + spread.uniform(-0.3, 0.3, len(final))
        axes.scatter(sideways, final, s=9, color=colour, alpha=0.4, linewidths=0)
        line = {"color": "black", "linewidth": 1.2}
        axes.boxplot(
            [final], positions=[place], widths=0.35, whis=(5, 95), showfliers=False,
            boxprops=line, whiskerprops=line, capprops=line, medianprops=line | {"linewidth": 2.5},
        )  # fmt: skip
    medians = [f"{name}\nmedian {np.median(error_table(some)[:, -1]):.2g} mm" for name, some in episodes.items()]
    axes.set_xticks(range(len(episodes)), medians)
    return _png(figure)


def animation(frames: Mapping[str, Sequence[np.ndarray]], width: int = 520) -> bytes:
    """GIF: one episode under several controllers side by side, each under its name.

    Args:
        frames: RGB images (height, width, 3) per controller, one per step.
        width: of one controller's picture [pixels].
    """
    count = max(len(some) for some in frames.values())
    pictures = [
        _side_by_side([_titled(some[min(step, len(some) - 1)], name, width) for name, some in frames.items()])
        for step in range(count)
    ]
    palette = _palette(pictures[:: max(1, count // 5)])
    pictures = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    stream = io.BytesIO()
    durations = [120] * (count - 1) + [2000]
    pictures[0].save(stream, "GIF", save_all=True, append_images=pictures[1:], duration=durations, loop=0)
    return stream.getvalue()


def _palette(pictures: Sequence[Image.Image]) -> Image.Image:
    """256 colours for all the pictures: each colour counts once, or a thin arrow would take that of a large area."""
    pixels = np.concatenate([np.asarray(picture).reshape(-1, 3) for picture in pictures])
    return Image.fromarray(np.unique(pixels, axis=0)[None]).quantize(256)


def _titled(frame: np.ndarray, name: str, width: int) -> Image.Image:
    scene = Image.fromarray(frame)
    scene = scene.resize((width, round(scene.height * width / scene.width)), Image.Resampling.LANCZOS)
    bar = 34
    image = Image.new("RGB", (width, scene.height + bar), "white")
    image.paste(scene, (0, bar))
    font = ImageFont.load_default(20)
    ImageDraw.Draw(image).text((width / 2, bar / 2), name, fill="black", font=font, anchor="mm")
    return image


def _side_by_side(images: Sequence[Image.Image]) -> Image.Image:
    gap = 4
    width = sum(image.width for image in images) + gap * (len(images) - 1)
    both = Image.new("RGB", (width, max(image.height for image in images)), "#bbbbbb")
    left = 0
    for image in images:
        both.paste(image, (left, 0))
        left += image.width + gap
    return both


def _error_axes(title: str) -> tuple[Figure, Axes]:
    """A figure with a logarithmic axis of tip errors and a line at 1 mm."""
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.set_title(title)
    axes.set_yscale("log")
    axes.set_ylabel("tip error [mm]")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.grid(axis="y", alpha=0.3)
    axes.axhline(1.0, color="black", linestyle=":", linewidth=1)
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _png(figure: Figure) -> bytes:
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=120)
    return stream.getvalue()
