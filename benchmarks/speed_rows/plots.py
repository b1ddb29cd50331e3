"""The pictures of the speed page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from speed_rows.row import number

COLOURS = ("#1f5fa8", "#d1751c", "#3a8a4d")


def log_log(
    path: Path,
    x_label: str,
    y_label: str,
    curves: Mapping[str, Sequence[tuple[float, float]]],
    lines: Mapping[str, Sequence[tuple[float, float]]] | None = None,
) -> None:
    """Draw named curves of points (x, y), and dashed lines without points, on logarithmic axes into a PNG."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, NullFormatter

    figure = Figure(figsize=(6.4, 3.8), layout="constrained")
    axes = figure.subplots()
    for colour, (name, points) in zip(COLOURS, curves.items(), strict=False):
        axes.plot(*zip(*points, strict=True), "o-", color=colour, markersize=4, label=name)
    for name, points in (lines or {}).items():
        axes.plot(*zip(*points, strict=True), "--", color="0.35", linewidth=1.2, label=name)
    heights = [y for points in curves.values() for _, y in points]
    decades = 10.0 ** np.floor(np.log10(min(heights))), 10.0 ** np.ceil(np.log10(max(heights)))
    axes.set(xscale="log", yscale="log", xlabel=x_label, ylabel=y_label, ylim=decades)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: number(value)))
        axis.set_minor_formatter(NullFormatter())
    axes.grid(True, which="major", color="0.88")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
