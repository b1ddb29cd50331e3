"""A rolling contact as joints of MuJoCo with equality constraints between them.

Where both surfaces are circles, the distal link turns about the two centres, by angles in the ratio of the curvatures:
two hinges, exactly. Elsewhere it turns about its origin, which two slides carry: polynomials of the joint angle of
degree 4, the highest in MuJoCo's constraints, fitted over the range of the joint.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev, polynomial
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.joint_table import common_range
from rollingjoint.profile import Surface

Array = NDArray[np.float64]

DEGREE = 4  # of MuJoCo's joint equality
_NODES = 400


@dataclass(frozen=True)
class Circles:
    """Two circles that roll on each other: two hinges.

    Args:
        rest: pose (x, y, angle) of the distal link in the proximal frame at s = 0 [mm, rad].
        centres: of the two circles in the frame of the distal link at s = 0, (2, 2) [mm].
        rates: turn of each hinge per mm of motion of the contact, (2,) [rad/mm].
        angles: the range of the joint angle [rad].
    """

    rest: Array
    centres: Array
    rates: Array
    angles: tuple[float, float]

    def coordinates(self, phi: ArrayLike) -> Array:
        """Angles of the two hinges at joint angles, (..., 2) [rad]."""
        s = (np.asarray(phi, float) - self.rest[2]) / self.rates.sum()
        return s[..., np.newaxis] * self.rates

    def poses(self, phi: ArrayLike) -> Array:
        """Poses (x, y, angle) of the distal link in the proximal frame at joint angles, (..., 3) [mm, rad]."""
        first, second = np.moveaxis(self.coordinates(phi), -1, 0)
        turned = _turned(self.centres[1] - self.centres[0], first)
        at = self.centres[0] + turned - _turned(self.centres[1], first + second)
        return np.concatenate([self.rest[:2] + _turned(at, self.rest[2]), np.asarray(phi, float)[..., None]], axis=-1)


@dataclass(frozen=True)
class Slides:
    """Any surfaces: a hinge at the origin of the distal link, and two slides that follow it.

    Args:
        rest: as of Circles.
        powers: ascending coefficients of x and y in the proximal frame, (2, 5) [mm], of the joint angle beyond `rest`.
        angles: the range of the joint angle [rad].
    """

    rest: Array
    powers: Array
    angles: tuple[float, float]

    def coordinates(self, phi: ArrayLike) -> Array:
        """Ways of the two slides [mm], and the angle of the hinge [rad], at joint angles, (..., 3)."""
        turn = np.asarray(phi, float) - self.rest[2]
        ways = [polynomial.polyval(turn, coefficients) for coefficients in self.powers]
        return np.stack([*ways, turn], axis=-1)

    def poses(self, phi: ArrayLike) -> Array:
        """Poses (x, y, angle) of the distal link in the proximal frame at joint angles, (..., 3) [mm, rad]."""
        return self.rest + self.coordinates(phi)


def coupling(child: Surface, parent: Surface) -> Circles | Slides:
    """The joints for `parent` (distal link) rolling on `child` (proximal link)."""
    low, high = common_range(child, parent)
    ends = relative_poses(child, parent, np.array([low, high]))[:, 2]
    angles = float(ends.min()), float(ends.max())
    rest = relative_poses(child, parent, np.zeros(1))[0]
    curvatures = [_constant(surface, low, high) for surface in (child, parent)]
    if all(curvatures):
        rates = np.array([1.0, -1.0]) * np.array(curvatures, float)
        distal_centre = _centre(parent, curvatures[1] or np.inf)
        proximal_centre = _turned(_centre(child, curvatures[0] or np.inf) - rest[:2], -rest[2])
        return Circles(rest, np.array([proximal_centre, distal_centre]), rates, angles)
    return Slides(rest, _fitted(child, parent, (low, high), rest), angles)


def relative_poses(child: Surface, parent: Surface, s: Array) -> Array:
    """Exact poses (x, y, angle) of the distal link in the proximal frame at arc lengths, (..., 3) [mm, rad]."""
    phi = child.tangent_angle(s) - parent.tangent_angle(s)
    return np.concatenate([child.point(s) - _turned(parent.point(s), phi), phi[..., np.newaxis]], axis=-1)


def _fitted(child: Surface, parent: Surface, limits: tuple[float, float], rest: Array) -> Array:
    """Powers of both slides: least squares at nodes that are dense at the ends of the range, as Chebyshev's."""
    low, high = limits
    s = 0.5 * (low + high) + 0.5 * (high - low) * np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES)
    ways = relative_poses(child, parent, s) - rest
    half, middle = 0.5 * np.ptp(ways[:, 2]), 0.5 * (ways[:, 2].max() + ways[:, 2].min())
    series = chebyshev.chebfit((ways[:, 2] - middle) / half, ways[:, :2], DEGREE)
    shifted = np.polynomial.Polynomial([-middle / half, 1.0 / half])
    fits = [np.polynomial.Polynomial(chebyshev.cheb2poly(column))(shifted) for column in series.T]
    return np.array([np.pad(fit.coef, (0, DEGREE + 1 - len(fit.coef))) for fit in fits])


def _constant(surface: Surface, low: float, high: float) -> float | None:
    """The curvature of a surface that is part of a circle between these arc lengths; None elsewhere, and for lines."""
    breaks = surface.profile.breaks
    borders = np.concatenate([[low], breaks[(breaks > low) & (breaks < high)], [high]])
    probes = (borders[:-1, np.newaxis] + np.diff(borders)[:, np.newaxis] * np.linspace(0.01, 0.99, 34)).ravel()
    values = surface.curvature(probes)
    return float(values[0]) if values[0] and np.all(values == values[0]) else None


def _centre(surface: Surface, curvature: float) -> Array:
    """Centre of a circular surface in its link's frame, (2,) [mm]."""
    return np.array(surface.start) + np.array([-np.sin(surface.angle), np.cos(surface.angle)]) / curvature


def _turned(vectors: Array, angles: ArrayLike) -> Array:
    """Vectors (..., 2) turned by angles (...) [rad]."""
    cos, sin = np.cos(angles), np.sin(angles)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
