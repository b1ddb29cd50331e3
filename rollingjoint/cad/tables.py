"""The tables of the assembly drawing: sizes of the links, positions of the holes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rollingjoint.cad.assembly import Assembly
from rollingjoint.cad.sheet import ROW, Box, Sheet

_TABLE = 84.0  # mm, width of a table at most


def draw_tables(sheet: Sheet, box: Box, assembly: Assembly, link: int | None = None) -> None:
    """Draws the tables of links and holes, or of one part, side by side, or one below the other on a narrow sheet."""
    width, room = min(float(box.size[0]), _TABLE), int(box.size[1] / ROW) - 1
    columns = width * np.array([0.28, 0.2, 0.2, 0.32])
    end = sheet.table([box.left, box.top], "Links", columns, _shortened(_link_rows(assembly, link), room))
    holes = _shortened(_hole_rows(assembly, link), room)
    if len(holes) > 1:
        corner = [box.left + _TABLE + ROW, box.top] if _two_columns(box) else [box.left, end - ROW]
        columns = width * np.array([0.19, 0.17, 0.18, 0.14, 0.18, 0.14])
        sheet.table(corner, "Holes of the tendons, in the frame of the link", columns, holes)


def _shortened(rows: list[list[str]], room: int) -> list[list[str]]:
    """The rows that fit; the last one states the number of omitted rows."""
    if len(rows) <= room:
        return rows
    return [*rows[: room - 1], ["...", f"{len(rows) - room + 1} more", *[""] * (len(rows[0]) - 2)]]


def rows_left(box: Box, assembly: Assembly) -> int:
    """Free rows below the holes; negative: rows that do not fit."""
    links = 0 if _two_columns(box) else len(_link_rows(assembly)) + 2
    return int(box.size[1] / ROW) - 1 - links - len(_hole_rows(assembly))


def _two_columns(box: Box) -> bool:
    return bool(box.size[0] >= 2 * _TABLE + ROW)


def _link_rows(assembly: Assembly, link: int | None = None) -> list[list[str]]:
    rows = [["link", "width", "height", "height at s = 0"]]
    for first, links in _shown(assembly, link):
        low, high = assembly.bodies[first].bounds
        rows.append([ranges(links), *map(millimetres, [*(high - low), assembly.chain.links[first].height])])
    return rows


def _hole_rows(assembly: Assembly, link: int | None = None) -> list[list[str]]:
    rows = [["link", "tendon", "parent x", "y", "child x", "y"]]
    for first, links in _shown(assembly, link):
        for k, channel in enumerate(assembly.bodies[first].channels):
            name = "" if k else ranges(links)
            rows.append([name, str(channel.tendon), *map(millimetres, channel.holes.ravel())])
    return rows


def _shown(assembly: Assembly, link: int | None) -> list[tuple[int, list[int]]]:
    """All distinct parts, or the one of this first link."""
    return [part for part in different_parts(assembly) if link in (None, part[0])]


def different_parts(assembly: Assembly) -> list[tuple[int, list[int]]]:
    """For every distinct part, its first link and all its links."""
    alike = assembly.first_alike
    return [(first, [i for i, k in enumerate(alike) if k == first]) for first in sorted(set(alike))]


def ranges(links: Sequence[int]) -> str:
    """Numbers as text, runs of three or more shortened: 0, 2-5."""
    runs: list[list[int]] = []
    for i in links:
        if runs and runs[-1][-1] == i - 1:
            runs[-1].append(i)
        else:
            runs.append([i])
    return ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in runs)


def millimetres(length: float) -> str:
    """A length in mm to 0.01 mm, without trailing zeros."""
    return f"{round(float(length), 2) + 0.0:.2f}".rstrip("0").rstrip(".")
