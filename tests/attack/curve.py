"""Contact surfaces by quadrature of their curvature, apart from the project's own tables and panels."""

import itertools

import numpy as np

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_PANEL = 0.5  # mm


class Curve:
    """A surface in its link's frame, from the borders and coefficients of its curvature alone."""

    def __init__(self, surface):
        profile = surface.profile
        self.breaks, self.coefficients = np.array(profile.breaks), np.array(profile.coefficients)
        self.angle, self.start = surface.angle, np.array(surface.start)
        powers = np.arange(1, self.coefficients.shape[1] + 1)
        self.integrals = self.coefficients / powers
        gains = [self._of_piece(i, width) for i, width in enumerate(np.diff(self.breaks))]
        self.before = np.concatenate([[0.0], np.cumsum(gains)])
        self.offset = self._raw(np.zeros(1))[0]
        pieces = itertools.pairwise(self.breaks)
        grids = [np.linspace(low, high, int((high - low) / _PANEL) + 2)[:-1] for low, high in pieces]
        self.knots = np.union1d(np.concatenate([*grids, self.breaks[-1:]]), [0.0])
        chords = self._chords(self.knots[:-1], self.knots[1:])
        at = np.concatenate([np.zeros((1, 2)), np.cumsum(chords, axis=0)])
        self.positions = at - at[np.searchsorted(self.knots, 0.0)]

    def curvature(self, s):
        """Curvature, the shape of s [1/mm]."""
        piece = self._piece(s)
        step, value = s - self.breaks[piece], np.zeros_like(s)
        for k in range(self.coefficients.shape[1] - 1, -1, -1):
            value = value * step + self.coefficients[piece, k]
        return value

    def tangent(self, s):
        """Angle of the tangent, the shape of s [rad]."""
        return self.angle + self._raw(s) - self.offset

    def point(self, s):
        """Points, (..., 2) [mm]."""
        knot = np.clip(np.searchsorted(self.knots, s, side="right") - 1, 0, len(self.knots) - 2)
        local = self.positions[knot] + self._chords(self.knots[knot], s)
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        return self.start + local @ np.array([[cos, sin], [-sin, cos]])

    def _chords(self, begin, end):
        half = 0.5 * (end - begin)
        theta = self._raw(begin[..., None] + half[..., None] * (1.0 + _NODES)) - self.offset
        return half[..., None] * np.stack([np.cos(theta) @ _WEIGHTS, np.sin(theta) @ _WEIGHTS], axis=-1)

    def _piece(self, s):
        return np.clip(np.searchsorted(self.breaks, s, side="right") - 1, 0, len(self.breaks) - 2)

    def _of_piece(self, piece, step):
        value = np.zeros_like(step)
        for k in range(self.integrals.shape[1] - 1, -1, -1):
            value = (value + self.integrals[piece, k]) * step
        return value

    def _raw(self, s):
        piece = self._piece(s)
        return self.before[piece] + self._of_piece(piece, s - self.breaks[piece])
