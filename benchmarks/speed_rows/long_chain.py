"""How the time of a Newton iteration grows with the number of links."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from long_chains import solved

from rollingjoint import Status
from speed_rows.plots import log_log
from speed_rows.row import Row, Target, quantity
from speed_rows.sizes import Sizes

TITLE = "Long chains"
TEXT = """`solve_tensions` on uniform chains under a tip force, from s = 0 (`benchmarks/long_chains.py`): time of
the whole public call over its Newton iterations. The exponent p of time ~ n^p is fitted from 100 links on."""
PICTURES = {"speed_links.png": "Time per Newton iteration over the number of links, with the fitted power law"}

FIT_FROM = 100


def measure(sizes: Sizes, images: Path) -> Iterator[Row]:
    """Rows of the section, and its picture."""
    times: list[tuple[int, float]] = []
    for n in sizes.links:
        equilibrium, seconds = solved(n)
        per_iteration = seconds / max(int(equilibrium.iterations), 1)
        times.append((n, 1e6 * per_iteration))
        if n in (sizes.links[0], FIT_FROM, sizes.links[-1]):
            whole = f"{equilibrium.iterations} iterations, {quantity(seconds, 's')}"
            note = f"{Status(int(equilibrium.status)).name} after {whole}"
            yield Row(f"iteration, {n:,} links", 1e6 * per_iteration, "µs", "best of 15", note=note)
    exponent, fit = power_law([time for time in times if time[0] >= FIT_FROM])
    curves, lines = {"measured": times}, {f"n^{exponent:.2f}": fit}
    log_log(images / "speed_links.png", "links", "time per Newton iteration [µs]", curves, lines)
    yield Row(
        "exponent from 100 links on",
        exponent,
        "",
        f"{sum(n >= FIT_FROM for n in sizes.links)} lengths of chain",
        Target(1.1),
    )


def power_law(points: list[tuple[int, float]]) -> tuple[float, list[tuple[float, float]]]:
    """The exponent p of the power law x^p nearest to points (x, y), and that law at the first and the last x."""
    x, y = np.log(np.array(points)).T
    exponent, offset = np.polyfit(x, y, 1)
    return float(exponent), [(end, float(np.exp(offset) * end**exponent)) for end in (points[0][0], points[-1][0])]
