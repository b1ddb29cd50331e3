"""Surfaces as polylines that stay within a given distance."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from rollingjoint.errors import MechanismError
from rollingjoint.profile import Surface

Array = NDArray[np.float64]

_MOST_POINTS = 20_000
_SHARE = 0.95  # of the tolerance, for chords; the difference is for rounding in files


def surface_polyline(surface: Surface, tolerance: float) -> Array:
    """Points of a polyline along a surface, nowhere farther from it than the tolerance, (k, 2) [mm].

    They lie on the surface, at both ends and at every curvature break; between two breaks they are evenly spaced. A
    chord over an arc length h is at most κ h² / 8 from the curve, where |u| ≤ κ.

    Raises:
        MechanismError: a surface that needs more than 20000 points.
    """
    counts = [_count(surface, low, high, tolerance) for low, high in itertools.pairwise(surface.profile.breaks)]
    if sum(counts) > _MOST_POINTS:
        allowed = f"a surface that {_MOST_POINTS} points describe to {tolerance:g} mm"
        raise MechanismError("number of points", sum(counts), allowed, "Make it less curved, or raise the tolerance.")
    pieces = zip(itertools.pairwise(surface.profile.breaks), counts, strict=True)
    steps = [np.linspace(low, high, count + 1)[:-1] for (low, high), count in pieces]
    return surface.point(np.concatenate([*steps, surface.profile.breaks[-1:]]))


def _count(surface: Surface, low: float, high: float, tolerance: float) -> int:
    """Chords for one piece; the Chebyshev coefficients of its polynomial bound the curvature."""
    degree = surface.profile.coefficients.shape[1] - 1
    last = np.nextafter(high, low)  # the value at a break belongs to the next piece
    bound = np.abs(chebyshev.Chebyshev.interpolate(surface.curvature, degree, (low, last)).coef).sum()
    return max(1, int(min(np.ceil((high - low) * np.sqrt(bound / (8.0 * _SHARE * tolerance))), 1e9)))
