"""Centre lines of arcs through points by least squares."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rollingjoint.errors import InvalidInput
from rollingjoint.profile import Profile, Surface

Array = NDArray[np.float64]

_MOST_STEPS = 50
_RENEWALS = 8  # of the nearest points; each squares their error


def fitted_line(points: Array, tolerance: float) -> tuple[Array, Array, tuple[float, float, float], Array]:
    """Lengths and curvatures of arcs of equal lengths, the start of their line and the places of the points along it.

    Args:
        points: in order along the line, (k, 2) [mm].
        tolerance: largest distance of a point from the line [mm].
    Raises:
        InvalidInput: points that k - 2 arcs do not fit so well, or that stand still or are not in order.
    """
    from scipy.optimize import least_squares

    steps = np.hypot(*np.diff(points, axis=0).T)
    if not bool((steps > 0.0).all()):
        raise InvalidInput("Lumen points", points, "neighbours in different places", "Leave out the repeated one.")
    guesses = np.concatenate([[0.0], np.cumsum(steps)])
    length, closest, pieces = float(guesses[-1]), np.inf, 1
    chords = np.diff(points, axis=0)
    angles, middles = np.unwrap(np.arctan2(chords[:, 1], chords[:, 0])), 0.5 * (guesses[1:] + guesses[:-1])
    while pieces <= len(points) - 2:
        borders = np.linspace(0.0, length, pieces + 1)
        turns = np.interp(borders, middles, angles)
        start = np.concatenate([points[0], turns[:1], np.diff(turns) / np.diff(borders)])
        result = least_squares(lambda x: _offsets(x, points, guesses)[0], start, x_scale="jac", max_nfev=_MOST_STEPS)
        offsets, along = _offsets(result.x, points, guesses)
        error = float(np.abs(offsets).max())
        if error <= tolerance:
            if np.diff(along).min() < -tolerance:
                place = 1 + int(np.argmin(np.diff(along)))
                hint = f"Point {place} lies before the one before it."
                raise InvalidInput("Lumen points", points, "points in order along the lumen", hint)
            x, y, angle = result.x[:3].tolist()
            return np.diff(borders), result.x[3:], (x, y, angle), along
        closest = min(closest, error)
        pieces = max(pieces + 1, int(1.3 * pieces))
    hint = f"{len(points) - 2} arcs come within {closest:.2g} mm."
    raise InvalidInput("Lumen tolerance", tolerance, "a distance that arcs reach at these points [mm]", hint)


def _offsets(numbers: Array, points: Array, guesses: Array) -> tuple[Array, Array]:
    """Signed distances of points from the line to its left, and the places nearest to them; both ends go on straight.

    numbers: x, y and angle of its start, and the curvatures of pieces of equal lengths.
    """
    length = guesses[-1]
    borders = np.linspace(0.0, length, numbers.size - 2)
    line = Surface(Profile.piecewise_constant(borders, numbers[3:]), (numbers[0], numbers[1]), numbers[2])
    along = guesses.copy()
    for _ in range(_RENEWALS):
        at = np.clip(along, 0.0, length)
        pose = line.pose(at)
        cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        dx, dy = (points - pose[:, :2]).T
        ahead, across = dx * cos + dy * sin, dy * cos - dx * sin
        bend = np.where(at == along, 1.0 - line.curvature(at) * across, 1.0)
        along = at + ahead / np.maximum(bend, 0.2)
    return across, along
