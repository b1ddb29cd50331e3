"""Walls as seen from the base of a chain, which stays where it is: the walls of `Walls` in its frame."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint._numba.jit import part
from rollingjoint._numba.layout import Floats
from rollingjoint.kernels.walls import N_LAW

# Columns of Seen.pieces: start and its tangent, end and its tangent, curvature, length, arc length at the start, radius
# there, its slope, mean radius; of the pieces before it in its lumen: turn, and the sum of turn x mean radius
START, START_TANGENT, END, END_TANGENT = range(0, 8, 2)
CURVATURE, LENGTH, ARC, RADIUS, SLOPE, MEAN, TURNED, TURNED_MEAN, N_PIECE = range(8, 17)


class Seen(NamedTuple):
    """Walls as seen from the base, and the outline."""

    points: Annotated[Floats, "points", 5]
    bars: Annotated[Floats, "bars", 8]  # as Walls.bars, length and 1 / length
    planes: Annotated[Floats, "planes", 4 + N_LAW]  # as Walls.planes, and the place of the base along it before the law
    discs: Annotated[Floats, "discs", 3 + N_LAW]
    capsules: Annotated[Floats, "capsules", 6 + N_LAW]  # first end, unit along it, length, radius; law
    pieces: Annotated[Floats, "pieces", N_PIECE]
    lumens: Annotated[Floats, "lumens", 2 + N_LAW]  # first piece, and the one after the last; law
    steepness: Annotated[Floats, "lumens"]  # the most by which a gap changes with the way of its point
    angle: Annotated[Floats, 1]  # of the base in the world
    rigid: Annotated[Floats, 1]


@part(inline=True)
def _unturned(x, y, cos, sin):
    """A vector of the world in the base frame."""
    return cos * x + sin * y, cos * y - sin * x


@part
def see(walls, which, base, seen):
    """Fill the walls as seen from a base at (x, y, angle)."""
    cos, sin = np.cos(base[2]), np.sin(base[2])
    seen.angle[0], seen.rigid[0] = base[2], walls.rigid[which]
    for q in range(seen.points.shape[0]):
        for column in range(seen.points.shape[1]):
            seen.points[q, column] = walls.points[which, q, column]
    for q in range(seen.bars.shape[0]):
        for column in range(6):
            seen.bars[q, column] = walls.bars[which, q, column]
        x, y = seen.bars[q, 3] - seen.bars[q, 1], seen.bars[q, 4] - seen.bars[q, 2]
        seen.bars[q, 6] = np.sqrt(x * x + y * y)
        seen.bars[q, 7] = 1.0 / seen.bars[q, 6] if seen.bars[q, 6] > 0.0 else 0.0
    for w in range(seen.planes.shape[0]):
        nx, ny = walls.planes[which, w, 0], walls.planes[which, w, 1]
        seen.planes[w, 0], seen.planes[w, 1] = _unturned(nx, ny, cos, sin)
        seen.planes[w, 2] = walls.planes[which, w, 2] - (nx * base[0] + ny * base[1])
        seen.planes[w, 3] = ny * base[0] - nx * base[1]
        for column in range(N_LAW):
            seen.planes[w, 4 + column] = walls.planes[which, w, 3 + column]
    for w in range(seen.discs.shape[0]):
        x, y = walls.discs[which, w, 0] - base[0], walls.discs[which, w, 1] - base[1]
        seen.discs[w, 0], seen.discs[w, 1] = _unturned(x, y, cos, sin)
        for column in range(2, 3 + N_LAW):
            seen.discs[w, column] = walls.discs[which, w, column]
    for w in range(seen.capsules.shape[0]):
        x, y = walls.capsules[which, w, 0] - base[0], walls.capsules[which, w, 1] - base[1]
        seen.capsules[w, 0], seen.capsules[w, 1] = _unturned(x, y, cos, sin)
        x, y = (
            walls.capsules[which, w, 2] - walls.capsules[which, w, 0],
            walls.capsules[which, w, 3] - walls.capsules[which, w, 1],
        )
        x, y = _unturned(x, y, cos, sin)
        length = np.sqrt(x * x + y * y)
        per_length = 1.0 / length if length > 0.0 else 0.0
        seen.capsules[w, 2], seen.capsules[w, 3], seen.capsules[w, 4] = x * per_length, y * per_length, length
        for column in range(4, 5 + N_LAW):
            seen.capsules[w, 1 + column] = walls.capsules[which, w, column]
    for w in range(seen.lumens.shape[0]):
        seen.lumens[w, 0] = seen.lumens[w, 1] = 0.0
        seen.steepness[w] = 1.0
        for column in range(N_LAW):
            seen.lumens[w, 2 + column] = walls.lumens[which, w, column]
    for i in range(seen.pieces.shape[0]):
        _see_piece(walls.pieces[which], i, base, cos, sin, seen)


@part
def _see_piece(pieces, i, base, cos, sin, seen):
    """Fill one piece of a lumen, and its place in the lumen."""
    piece, lumen = seen.pieces[i], int(pieces[i, 8])
    length, curvature = pieces[i, 4], pieces[i, 3]
    if length <= 0.0:  # a row without effect
        return
    if seen.lumens[lumen, 1] == 0.0:
        seen.lumens[lumen, 0] = i
        turned = turned_mean = 0.0
        tx, ty = np.cos(pieces[i, 2] - base[2]), np.sin(pieces[i, 2] - base[2])
    else:
        before = seen.pieces[i - 1]
        tx, ty = before[END_TANGENT], before[END_TANGENT + 1]  # a centre line has no corners
        turn = before[CURVATURE] * before[LENGTH]
        turned, turned_mean = before[TURNED] + turn, before[TURNED_MEAN] + turn * before[MEAN]
        if pieces[i, 6] != pieces[i - 1, 7]:
            seen.steepness[lumen] = np.inf
    seen.lumens[lumen, 1] = i + 1
    x, y = _unturned(pieces[i, 0] - base[0], pieces[i, 1] - base[1], cos, sin)
    half = 0.5 * curvature * length
    c, s = (np.cos(half), np.sin(half)) if half != 0.0 else (1.0, 0.0)
    chord, mx, my = length * (s / half if half != 0.0 else 1.0), tx * c - ty * s, ty * c + tx * s
    piece[START], piece[START + 1], piece[START_TANGENT], piece[START_TANGENT + 1] = x, y, tx, ty
    piece[END], piece[END + 1] = x + chord * mx, y + chord * my
    piece[END_TANGENT], piece[END_TANGENT + 1] = mx * c - my * s, my * c + mx * s
    piece[CURVATURE], piece[LENGTH], piece[ARC] = curvature, length, pieces[i, 5]
    piece[RADIUS], piece[SLOPE] = pieces[i, 6], (pieces[i, 7] - pieces[i, 6]) / length
    piece[MEAN] = 0.5 * (pieces[i, 6] + pieces[i, 7])
    piece[TURNED], piece[TURNED_MEAN] = turned, turned_mean
    narrowing = abs(piece[SLOPE]) / max(1.0 - abs(curvature) * max(pieces[i, 6], pieces[i, 7]), 0.0)
    seen.steepness[lumen] = max(seen.steepness[lumen], 1.0 + (narrowing if piece[SLOPE] != 0.0 else 0.0))
