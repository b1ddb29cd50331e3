"""How fast the picture follows a slider of the room Explore: python benchmarks/viewer.py [--moves 200].

The time from a slider's value at the server to the last message of the new picture, and how many pictures per second a
browser draws (Chromium, on the processor where there is no GPU) while a slider takes 60 values per second.
"""

from __future__ import annotations

import argparse
import os
import shutil
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from agents.view import rooms
from agents.viewer.camera import mechanism_view
from agents.viewer.server import Viewer
from rollingjoint import five_link
from rollingjoint.tables import markdown_table

FLAGS = "--headless --no-sandbox --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader"
COUNT = "window.pictures = 0; const count = () => {window.pictures += 1; requestAnimationFrame(count)}; count()"


def tensions(move: int, n_tendons: int) -> tuple[float, ...]:
    """Those of a slow swing."""
    return tuple(float(value) for value in 4.0 + 2.0 * np.sin(0.1 * move + np.arange(n_tendons)))


def milliseconds(room: Any, moves: int) -> np.ndarray:
    """From the value to the last message, of every move."""
    times = []
    for move in range(moves):
        begun = time.perf_counter()
        room.change(tensions=tensions(move, room.explorer.mechanism.n_tendons))
        times.append(1e3 * (time.perf_counter() - begun))
    return np.array(times)


def pictures(page: Any, room: Any, seconds: float = 5.0) -> float:
    """Pictures per second while sliders move."""
    page.evaluate(COUNT)
    begun, first, move = time.perf_counter(), page.evaluate("window.pictures"), 0
    while (now := time.perf_counter()) < begun + seconds:
        room.change(tensions=tensions(move, room.explorer.mechanism.n_tendons))
        move += 1
        page.wait_for_timeout(max(0.0, 1e3 * (now + 1 / 60 - time.perf_counter())))
    return float(page.evaluate("window.pictures") - first) / (time.perf_counter() - begun)


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moves", type=int, default=200)
    moves = parser.parse_args(argv).moves
    from playwright.sync_api import sync_playwright

    viewer = Viewer(rooms(), port=0, view=mechanism_view(five_link()))
    found = os.environ.get("CHROMIUM") or shutil.which("chromium")
    rows = []
    with sync_playwright() as driver:
        page = driver.chromium.launch(executable_path=found, args=FLAGS.split()).new_page()
        page.goto(viewer.url)
        page.wait_for_timeout(5000)
        (visit,) = viewer.visits.values()
        for name in ("five_link", "two_segment", "flexible_arm"):
            visit.room.which.value = name
            page.wait_for_timeout(4000)
            times = milliseconds(visit.room, moves)
            median, worst = np.percentile(times, [50, 95])
            rows.append([name, f"{median:.1f}", f"{worst:.1f}", f"{pictures(page, visit.room):.0f}"])
        page.close()
    viewer.stop()
    print(markdown_table(["mechanism", "median [ms]", "95 % of moves [ms]", "pictures per second"], rows))


if __name__ == "__main__":
    main()
