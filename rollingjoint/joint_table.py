"""A joint's geometry over arc length: validity, and the polynomial table that kernels evaluate.

Cells are aligned with the curvature breakpoints of both surfaces and halved until degree-11 polynomials in each cell
reproduce the exact surfaces to 2e-12 mm.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from rollingjoint._kernels.arrays import N_COEFFICIENTS, PHI
from rollingjoint.errors import MechanismError
from rollingjoint.profile import Surface

Array = NDArray[np.float64]

_TOLERANCE = 2e-12  # mm and rad
_SMALLEST_CELL = 1e-3  # mm
_NODES = np.cos(np.pi * (np.arange(N_COEFFICIENTS) + 0.5) / N_COEFFICIENTS)
_PROBES = np.cos(np.pi * np.arange(N_COEFFICIENTS + 1) / N_COEFFICIENTS)
_TO_CHEBYSHEV = np.linalg.inv(chebyshev.chebvander(_NODES, N_COEFFICIENTS - 1))
_TO_POWERS = np.array(
    [np.pad(chebyshev.cheb2poly(row), (0, N_COEFFICIENTS))[:N_COEFFICIENTS] for row in np.eye(N_COEFFICIENTS)]
).T
_PROBE_POWERS = np.vander(_PROBES, N_COEFFICIENTS, increasing=True)


class JointTable(NamedTuple):
    """Cells of one joint: borders (s and phi at both ends) and coefficients (cells, 12, 5) of phi and both points."""

    cells: Array
    coefficients: Array


def common_range(child: Surface, parent: Surface) -> tuple[float, float]:
    """Arc lengths that lie on both surfaces [mm]."""
    return max(child.limits[0], parent.limits[0]), min(child.limits[1], parent.limits[1])


def tabulate(child: Surface, parent: Surface) -> JointTable:
    """The table of the joint where `parent` (distal link) rolls on `child` (proximal link)."""
    borders = _borders(child, parent)
    pending = list(itertools.pairwise(borders))
    done: list[tuple[float, float, Array]] = []
    while pending:
        low, high = (np.array(side) for side in zip(*pending, strict=True))
        coefficients, error = _fit(child, parent, low, high)
        pending = []
        for lo, hi, cell, miss in zip(low, high, coefficients, error, strict=True):
            if miss <= _TOLERANCE or hi - lo < _SMALLEST_CELL:
                done.append((lo, hi, cell))
            else:
                middle = 0.5 * (lo + hi)
                pending += [(lo, middle), (middle, hi)]
    done.sort(key=lambda cell: cell[0])
    s = np.array([(lo, hi) for lo, hi, _ in done])
    phi = child.tangent_angle(s) - parent.tangent_angle(s)
    coefficients = np.stack([cell for _, _, cell in done])
    degree = max(surface.profile.coefficients.shape[1] for surface in (child, parent))
    coefficients[:, degree + 1 :, PHI] = 0.0  # the angle is a polynomial of that degree; what the fit adds is rounding
    return JointTable(np.concatenate([s, phi], axis=1), coefficients)


def check_rolling(joint: int, child: Surface, parent: Surface) -> None:
    """Raise MechanismError unless kappa = u_c - u_p < 0 on the common range (else the links cut into each other)."""
    for lo, hi in itertools.pairwise(_borders(child, parent)):
        s = _extremes(child, parent, lo, np.nextafter(hi, lo))
        kappa = child.curvature(s) - parent.curvature(s)
        worst = int(np.argmax(kappa))
        if not kappa[worst] < 0:
            raise MechanismError(
                f"relative curvature of joint {joint} (link {joint} on link {joint + 1}) at s = {s[worst]:.4g} mm",
                float(kappa[worst]),
                "u_child - u_parent < 0 on the whole common range",
                "Make the child surface more convex (u more negative), or narrow the limits.",
            )


def check_gap(joint: int, tendon: int, child: Surface, parent: Surface, child_hole: Array, parent_hole: Array) -> None:
    """Raise MechanismError where the distal hole of a tendon falls below the proximal one."""
    s = np.unique(np.concatenate([np.linspace(*common_range(child, parent), 61), [0.0]]))
    theta = child.tangent_angle(s)
    phi = theta - parent.tangent_angle(s)
    arm = parent_hole - parent.point(s)
    turned = np.stack(
        [np.cos(phi) * arm[:, 0] - np.sin(phi) * arm[:, 1], np.sin(phi) * arm[:, 0] + np.cos(phi) * arm[:, 1]], 1
    )
    gap = child.point(s) + turned - child_hole
    height = -np.sin(theta) * gap[:, 0] + np.cos(theta) * gap[:, 1]
    worst = int(np.argmin(height))
    if height[worst] < -1e-9:
        raise MechanismError(
            f"gap of tendon {tendon} across joint {joint} with the contact at s = {s[worst]:.4g} mm",
            float(height[worst]),
            "a positive height [mm]: the holes cross",
            f"Lower the child hole of link {joint}, raise the parent hole of link {joint + 1}, or narrow the limits.",
        )


def _borders(child: Surface, parent: Surface) -> Array:
    low, high = common_range(child, parent)
    if not low < high:
        raise MechanismError("common arc length range of a joint", (low, high), "limits of both surfaces that overlap")
    breaks = np.union1d(child.profile.breaks, parent.profile.breaks)
    return np.union1d([low, high], breaks[(breaks > low) & (breaks < high)])


def _extremes(child: Surface, parent: Surface, low: float, high: float) -> Array:
    """Arc lengths where kappa, a polynomial between low and high, can be largest: both ends and stationary points."""
    degree = max(surface.profile.coefficients.shape[1] for surface in (child, parent)) - 1
    if degree < 2:
        return np.array([low, high])
    kappa = chebyshev.Chebyshev.interpolate(lambda s: child.curvature(s) - parent.curvature(s), degree, (low, high))
    stationary = kappa.deriv().roots().real
    return np.concatenate([[low], np.sort(stationary[(stationary > low) & (stationary < high)]), [high]])


def _fit(child: Surface, parent: Surface, low: Array, high: Array) -> tuple[Array, Array]:
    """Polynomials through Chebyshev nodes of every cell, (cells, 12, 5), and their largest error, (cells,)."""
    series = np.einsum("kn,cnq->ckq", _TO_CHEBYSHEV, _functions(child, parent, low, high, _NODES))
    coefficients = np.einsum("kn,cnq->ckq", _TO_POWERS, series)  # two steps: the high terms are small only in the first
    exact = _functions(child, parent, low, high, _PROBES)
    return coefficients, np.abs(np.einsum("pk,ckq->cpq", _PROBE_POWERS, coefficients) - exact).max(axis=(1, 2))


def _functions(child: Surface, parent: Surface, low: Array, high: Array, u: Array) -> Array:
    """phi, child point and parent point at cell coordinates u, (cells, len(u), 5)."""
    s = 0.5 * ((low + high)[:, None] + (high - low)[:, None] * u)
    s = np.clip(s, low[:, None], high[:, None])
    phi = child.tangent_angle(s) - parent.tangent_angle(s)
    return np.concatenate([phi[..., None], child.point(s), parent.point(s)], axis=-1)
