"""Curvature profiles u(s) and the contact surfaces they describe.

A profile is a piecewise polynomial in the arc length s, so its turning angle is exact; positions follow from
Gauss-Legendre quadrature on panels aligned with the breakpoints (error below 1e-12 mm).
Source: docs/theory.md, section 1.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.checks import as_floats
from rollingjoint.errors import InvalidInput, MechanismError

Array = NDArray[np.float64]

LIMIT_TOLERANCE = 1e-9  # mm that an arc length may lie beyond a limit; it then counts as the limit

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_LONGEST = 10_000.0  # mm
_MOST_TURN = 2000.0  # rad, largest curvature times length over the pieces: positions take a panel for each half radian
_MOST_PIECES, _MOST_POWERS = 1000, 32
_PANEL_TURN = 0.5  # rad a quadrature panel may turn; 16 nodes are then exact to rounding


@dataclass(frozen=True, eq=False)
class Profile:
    """Curvature as a piecewise polynomial of arc length; profiles of the same numbers are equal.

    Args:
        breaks: piece borders, (p + 1,), increasing, containing 0 [mm].
        coefficients: (p, k) ascending powers of (s - breaks[i]) [1/mm, 1/mm², ...].
    Raises:
        MechanismError: borders that do not increase or do not contain 0, shapes that disagree, non-finite numbers; more
            than 1,000 pieces, 32 coefficients each, 10,000 mm or 2,000 rad of turning.
    """

    breaks: Array
    coefficients: Array

    def __post_init__(self) -> None:
        breaks = _finite("profile breaks", self.breaks, 1)
        coefficients = _finite("profile coefficients", self.coefficients, 2)
        if breaks.size < 2 or np.any(np.diff(breaks) <= 0):
            raise MechanismError("profile breaks", breaks, "at least two increasing arc lengths [mm]")
        if not breaks[0] <= 0 <= breaks[-1]:
            raise MechanismError(
                "profile limits",
                (float(breaks[0]), float(breaks[-1])),
                "limits that contain s = 0",
                "Shift s so that 0 is on the surface.",
            )
        if coefficients.shape[0] != breaks.size - 1 or coefficients.shape[1] == 0:
            raise MechanismError(
                "profile coefficients", coefficients.shape, f"shape ({breaks.size - 1}, k), one row per piece"
            )
        _check_size(breaks, coefficients)
        for array in (breaks, coefficients):
            array.setflags(write=False)
        object.__setattr__(self, "breaks", breaks)
        object.__setattr__(self, "coefficients", coefficients)

    @classmethod
    def constant(cls, u: float, limits: tuple[float, float] = (-15.0, 15.0)) -> Profile:
        """A circular arc (u < 0: convex child surface) or a straight line (u = 0)."""
        return cls(_limits(limits), _finite("curvature", u, 0)[None, None])

    @classmethod
    def polynomial(cls, coefficients: ArrayLike, limits: tuple[float, float] = (-15.0, 15.0)) -> Profile:
        """u(s) = c[0] + c[1] s + c[2] s² + ... on the limits."""
        breaks, ascending = _limits(limits), _finite("polynomial coefficients", coefficients, 1)
        if ascending.size == 0:
            raise MechanismError("polynomial coefficients", coefficients, "at least one number")
        shifted = np.polynomial.Polynomial(ascending)(np.polynomial.Polynomial([breaks[0], 1.0])).coef
        return cls(breaks, np.atleast_2d(shifted))

    @classmethod
    def piecewise_constant(cls, breaks: ArrayLike, values: ArrayLike) -> Profile:
        """u = values[i] between breaks[i] and breaks[i + 1]."""
        return cls(_finite("profile breaks", breaks, 1), _finite("piecewise-constant values", values, 1)[:, None])

    @classmethod
    def piecewise_polynomial(cls, breaks: ArrayLike, coefficients: ArrayLike) -> Profile:
        """Ascending coefficients of (s - breaks[i]) for each piece; the class's own form."""
        return cls(_finite("profile breaks", breaks, 1), _finite("profile coefficients", coefficients, 2))

    @classmethod
    def spline(cls, knots: ArrayLike, values: ArrayLike) -> Profile:
        """Natural cubic spline through (knots, values)."""
        from scipy.interpolate import CubicSpline

        knots, values = _knots(knots, values)
        return cls(knots, CubicSpline(knots, values, bc_type="natural").c[::-1].T)

    @classmethod
    def samples(cls, s: ArrayLike, u: ArrayLike) -> Profile:
        """Straight lines between sampled curvatures (s, u)."""
        s, u = _knots(s, u)
        return cls(s, np.stack([u[:-1], np.diff(u) / np.diff(s)], axis=1))

    def __repr__(self) -> str:
        pieces, order = self.coefficients.shape
        return f"<Profile: degree {order - 1}, pieces: {pieces}, s from {self.breaks[0]:g} to {self.breaks[-1]:g} mm>"

    @cached_property
    def _numbers(self) -> tuple[bytes, bytes]:
        return (self.breaks + 0.0).tobytes(), (self.coefficients + 0.0).tobytes()  # 0 is -0

    def __eq__(self, other: object) -> bool:
        return self._numbers == other._numbers if isinstance(other, Profile) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._numbers)

    def __reduce__(self) -> tuple[type[Profile], tuple[Array, Array]]:
        """Copies are made anew: read-only as this one, without cached values."""
        return type(self), (self.breaks, self.coefficients)

    @property
    def limits(self) -> tuple[float, float]:
        """First and last arc length [mm]."""
        return float(self.breaks[0]), float(self.breaks[-1])

    def curvature(self, s: ArrayLike) -> Array:
        """u(s), the shape of s [1/mm]; at a jump the value to its right."""
        return self._evaluate(self.coefficients, s)

    def turning(self, s: ArrayLike) -> Array:
        """∫ u ds from 0 to s, the shape of s [rad]."""
        return self._evaluate(self._turning_coefficients, s)

    def curve(self, s: ArrayLike) -> Array:
        """Points of the curve that begins at the origin along the x axis, (..., 2) [mm].

        Raises:
            InvalidInput: s beyond the limits.
        """
        values, (lo, hi) = np.asarray(s, float), self.limits
        if not np.all((values >= lo - LIMIT_TOLERANCE) & (values <= hi + LIMIT_TOLERANCE)):
            raise InvalidInput("arc length s", s, f"values within the surface limits [{lo:g}, {hi:g}] mm")
        at: Array = np.clip(values, lo, hi)
        borders, positions = self._panels
        panel = np.clip(np.searchsorted(borders, at, side="right") - 1, 0, len(borders) - 2)
        return positions[panel] + self._chord(borders[panel], at)

    def _chord(self, begin: Array, end: Array) -> Array:
        """Chord of the curve from begin to end, both within one panel, (..., 2) [mm]."""
        half = 0.5 * (end - begin)[..., None]
        theta = self.turning(begin[..., None] + half * (1 + _NODES))
        return np.concatenate(
            [half * (np.cos(theta) @ _WEIGHTS)[..., None], half * (np.sin(theta) @ _WEIGHTS)[..., None]], axis=-1
        )

    @cached_property
    def _panels(self) -> tuple[Array, Array]:
        """Panel borders and the points there; no panel turns by more than _PANEL_TURN."""
        breaks = np.union1d(self.breaks, [0.0])
        pieces = []
        for lo, hi in itertools.pairwise(breaks):
            steepest = np.abs(self.curvature(np.linspace(lo, np.nextafter(hi, lo), 65))).max()
            count = max(1, int(np.ceil(1.2 * steepest * (hi - lo) / _PANEL_TURN)))
            pieces.append(np.linspace(lo, hi, count + 1)[:-1])
        borders = np.concatenate([*pieces, breaks[-1:]])
        chords = self._chord(borders[:-1], borders[1:])
        positions = np.concatenate([np.zeros((1, 2)), np.cumsum(chords, axis=0)])
        return borders, positions - positions[np.searchsorted(borders, 0.0)]

    @cached_property
    def _turning_coefficients(self) -> Array:
        powers = np.arange(1, self.coefficients.shape[1] + 1)
        integral = np.concatenate([np.zeros((len(self.coefficients), 1)), self.coefficients / powers], axis=1)
        gains = np.polynomial.polynomial.polyval(np.diff(self.breaks), integral.T, tensor=False)
        integral[:, 0] = np.concatenate([[0.0], np.cumsum(gains)[:-1]])
        integral[:, 0] -= self._evaluate(integral, 0.0)
        return integral

    def _evaluate(self, coefficients: Array, s: ArrayLike) -> Array:
        s = np.asarray(s, float)
        piece = np.clip(np.searchsorted(self.breaks, s, side="right") - 1, 0, len(self.breaks) - 2)
        step = s - self.breaks[piece]
        value = np.zeros_like(step)
        for k in range(coefficients.shape[1] - 1, -1, -1):
            value = value * step + coefficients[piece, k]
        return value


@dataclass(frozen=True, eq=False)
class Surface:
    """A contact surface: a curvature profile placed in its link's frame.

    Args:
        profile: curvature over arc length.
        start: position at s = 0, (x, y) [mm].
        angle: tangent angle at s = 0 [rad]. The surface frame has x along the tangent and y along the normal.
    Raises:
        MechanismError: no Profile; a start or an angle that is not finite.
    """

    profile: Profile
    start: tuple[float, float] = (0.0, 10.0)
    angle: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.profile, Profile):
            raise MechanismError("surface profile", self.profile, "a Profile, such as Profile.constant(-0.05)")
        start = _finite("surface start", self.start, 1)
        if start.shape != (2,):
            raise MechanismError("surface start", self.start, "(x, y) [mm]")
        object.__setattr__(self, "start", (float(start[0]), float(start[1])))
        object.__setattr__(self, "angle", float(_finite("surface angle", self.angle, 0)))

    @property
    def limits(self) -> tuple[float, float]:
        """First and last arc length [mm]."""
        return self.profile.limits

    def curvature(self, s: ArrayLike) -> Array:
        """u(s) [1/mm]."""
        return self.profile.curvature(s)

    def tangent_angle(self, s: ArrayLike) -> Array:
        """η(s) = angle + ∫ u, the shape of s [rad]."""
        return self.angle + self.profile.turning(s)

    def point(self, s: ArrayLike) -> Array:
        """Position p(s) in the link frame, (..., 2) [mm].

        Raises:
            InvalidInput: s beyond the limits of the surface.
        """
        return self.placed(self.profile.curve(s))

    def placed(self, curve: Array) -> Array:
        """Points (..., 2) of the profile's curve, in the link frame [mm]."""
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        return curve @ np.array([[cos, sin], [-sin, cos]]) + self.start

    def pose(self, s: ArrayLike) -> Array:
        """Surface frame (x, y, tangent angle) in the link frame, (..., 3) [mm, rad]."""
        return np.concatenate([self.point(s), self.tangent_angle(s)[..., None]], axis=-1)


def _finite(what: str, values: ArrayLike, ndim: int) -> Array:
    """A float copy of values; MechanismError unless all are finite numbers of that many dimensions."""
    allowed = ("a finite number", "a list of finite numbers", "rows of finite numbers, all of one length")[ndim]
    array = as_floats(what, values, allowed, MechanismError)
    if array.ndim != ndim or not np.all(np.isfinite(array)):
        raise MechanismError(what, values, allowed)
    return array


def _check_size(breaks: Array, coefficients: Array) -> None:
    """Raise MechanismError for a surface that would take more than a moment to tabulate."""
    pieces, powers = coefficients.shape
    if pieces > _MOST_PIECES or powers > _MOST_POWERS:
        allowed = f"at most {_MOST_PIECES:,} pieces with {_MOST_POWERS} coefficients each"
        raise MechanismError("shape of the profile coefficients", (pieces, powers), allowed)
    if breaks[-1] - breaks[0] > _LONGEST:
        raise MechanismError("profile length", float(breaks[-1] - breaks[0]), f"at most {_LONGEST:,.0f} mm")
    widths = np.diff(breaks)
    with np.errstate(over="ignore", invalid="ignore"):
        steps = widths * np.linspace(0.0, 1.0, 65)[:, None]
        u = np.polynomial.polynomial.polyval(steps, coefficients.T, tensor=False)
        turn = float((np.abs(u).max(axis=0) * widths).sum())
    if not turn <= _MOST_TURN:
        hint = "Is the curvature in 1/mm? Else narrow the limits."
        allowed = f"at most {_MOST_TURN:g} rad: largest curvature times length, summed over the pieces"
        raise MechanismError("turning of a profile", turn, allowed, hint)


def _limits(limits: ArrayLike) -> Array:
    array = _finite("profile limits", limits, 1)
    if array.shape != (2,) or not array[0] < array[1]:
        raise MechanismError("profile limits", limits, "(first, last) arc length with first < last [mm]")
    return array


def _knots(s: ArrayLike, values: ArrayLike) -> tuple[Array, Array]:
    s, values = _finite("arc lengths s", s, 1), _finite("curvatures u", values, 1)
    if s.size < 2 or s.shape != values.shape or np.any(np.diff(s) <= 0):
        raise MechanismError("arc lengths s", s, f"{values.size} increasing values, one per curvature, at least two")
    return s, values
