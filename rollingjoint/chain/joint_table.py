"""The geometry of a joint over its angle: validity checks, and the polynomial table that kernels evaluate.

Cells are aligned with the curvature breakpoints of both surfaces and halved until polynomials of degree 9 in each cell
reproduce the exact surfaces to 2e-12 mm.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from rollingjoint.chain.chain import read_only
from rollingjoint.errors import MechanismError
from rollingjoint.kernels.joints import BUCKETS, N_COEFFICIENTS
from rollingjoint.profile import Profile, Surface

Array = NDArray[np.float64]

_TOLERANCE = 2e-12  # mm and rad
_POLE_TOLERANCE = 1e-10  # of the contact's rate e / kappa, relative: only the stiffness depends on it
_LARGEST_CELL = 4.0  # mm; largest cell of the first fit
_SMALLEST_CELL = 1e-5  # mm
_MOST_CELLS = 4000  # about a second; ordinary joints have a few dozen
CROSSING = 1e-9  # mm: how far holes may change places, for rounding
_ANGLE_ROUNDING = 2e-15  # rad; over the relative curvature it is the rounding of a contact's place
_NODES = np.cos(np.pi * (np.arange(N_COEFFICIENTS) + 0.5) / N_COEFFICIENTS)
_PROBES = np.cos(np.pi * np.arange(N_COEFFICIENTS + 1) / N_COEFFICIENTS)
_TO_CHEBYSHEV = np.linalg.inv(chebyshev.chebvander(_NODES, N_COEFFICIENTS - 1))
_TO_POWERS = np.array(
    [np.pad(chebyshev.cheb2poly(row), (0, N_COEFFICIENTS))[:N_COEFFICIENTS] for row in np.eye(N_COEFFICIENTS)]
).T
_PROBE_POWERS = np.vander(_PROBES, N_COEFFICIENTS, increasing=True)


class JointTable(NamedTuple):
    """Cells of one joint in the order of its angle; columns as in kernels.rolling.Chain."""

    cells: Array  # (cells, 4)
    coefficients: Array  # (cells, 10, 8)
    arc_coefficients: Array  # (cells, 10)


def common_range(child: Surface | Profile, parent: Surface | Profile) -> tuple[float, float]:
    """Arc lengths that lie on both surfaces [mm]."""
    return max(child.limits[0], parent.limits[0]), min(child.limits[1], parent.limits[1])


def tabulate(child: Surface, parent: Surface) -> JointTable:
    """The table of the joint where `parent` (distal link) rolls on `child` (proximal link).

    Every tabulated function is linear in the functions of the same profiles placed at the origins of their links, which
    are cached: only new profiles need a fit.

    Raises:
        MechanismError: surfaces so nearly alike that the joint angle does not resolve where they touch, or so long or
            uneven that the table would not end.
    """
    table = profile_table(child.profile, parent.profile)
    angles = np.array([child.angle]), np.array([parent.angle])
    cells, coefficients = np.empty((1, *table.cells.shape)), np.empty((1, *table.coefficients.shape))
    place(table, angles, (np.array([child.start]), np.array([parent.start])), cells, coefficients)
    return JointTable(cells[0], coefficients[0], table.arc_coefficients)


def place(
    table: JointTable, angles: tuple[Array, Array], starts: tuple[Array, Array], cells: Array, coefficients: Array
) -> None:
    """Fill cells (D, cells, 4) and coefficients (D, cells, 10, 8) of two profiles in D places.

    Args:
        table: of the profiles at the origins of their links.
        angles, starts: of the child and of the parent surface, (D,) [rad] and (D, 2) [mm].
        cells, coefficients: to be filled; each design's in one piece of memory.
    """
    (child_angle, parent_angle), (child_start, parent_start) = angles, starts
    turn = child_angle - parent_angle
    cos, sin, c, s = np.cos(turn), np.sin(turn), np.cos(child_angle), np.sin(child_angle)
    x, y = parent_start[:, 0], parent_start[:, 1]
    change = np.zeros((len(turn), 8, 8))  # transposed: rows are multiplied from the right
    change[:, 0, 0], change[:, 1, 0], change[:, 0, 1], change[:, 1, 1] = cos, -sin, sin, cos
    for k in (2, 4, 6):
        change[:, k, k], change[:, k + 1, k], change[:, k, k + 1], change[:, k + 1, k + 1] = c, -s, s, c
    change[:, 0, 4], change[:, 1, 4] = sin * y - cos * x, cos * y + sin * x
    change[:, 0, 5], change[:, 1, 5] = -sin * x - cos * y, sin * y - cos * x
    np.matmul(table.coefficients.reshape(-1, 8), change, out=_flat(coefficients))
    coefficients[:, :, 0, 2:4] += child_start[:, None]
    coefficients[:, :, 0, 4:6] += child_start[:, None]
    cells[...] = table.cells
    cells[..., :3] += turn[:, None, None]


def _flat(coefficients: Array) -> Array:
    """A view of coefficients (D, cells, 10, 8), (D, 10 cells, 8)."""
    count, cells, powers, columns = coefficients.shape
    view = coefficients.reshape(count, cells * powers, columns)
    assert np.may_share_memory(view, coefficients)
    return view


@functools.lru_cache(maxsize=256)
def profile_table(child_profile: Profile, parent_profile: Profile) -> JointTable:
    """The table of two profiles that begin at the origins of their links, along the x axis."""
    child, parent = (Surface(profile, (0.0, 0.0), 0.0) for profile in (child_profile, parent_profile))
    pending = [
        (lo, hi)
        for low, high in itertools.pairwise(_borders(child_profile, parent_profile))
        for lo, hi in itertools.pairwise(np.linspace(low, high, 1 + int(np.ceil((high - low) / _LARGEST_CELL))))
    ]
    done: list[tuple[float, float, Array]] = []
    while pending:
        if len(done) + len(pending) > _MOST_CELLS:
            raise MechanismError(
                f"cells of the joint between s = {pending[0][0]:.4g} and {pending[-1][1]:.4g} mm",
                len(done) + len(pending),
                f"at most {_MOST_CELLS:,} polynomials for both surfaces to 2e-12 mm",
                "Narrow the limits, or make the surfaces smoother or smaller.",
            )
        low, high = (np.array(side) for side in zip(*pending, strict=True))
        coefficients, good = _fit(child, parent, low, high)
        pending = []
        for lo, hi, cell, fits in zip(low, high, coefficients, good, strict=True):
            if fits or hi - lo < _SMALLEST_CELL:
                done.append((lo, hi, cell))
            else:
                middle = 0.5 * (lo + hi)
                pending += [(lo, middle), (middle, hi)]
    done.sort(key=lambda cell: -cell[0])  # the angle falls as s grows
    high_s, low_s = np.array([(hi, lo) for lo, hi, _ in done]).T
    low, high = _angle(child, parent, high_s), _angle(child, parent, low_s)
    coefficients = np.stack([cell for _, _, cell in done])
    cells = np.stack([low, high, 0.5 * (low + high), 2.0 / (high - low)], axis=1)
    return JointTable(*map(read_only, (cells, coefficients[..., :8], coefficients[..., 8])))  # all mechanisms share it


def buckets(cells: Array) -> tuple[float, NDArray[np.int64]]:
    """Equal buckets over a joint's angles: how many per radian, and the first and the last cell of each in turn."""
    low, high = cells[0, 0], cells[-1, 1]
    edges = low + (high - low) * np.arange(BUCKETS + 1) / BUCKETS
    first = np.searchsorted(cells[:-1, 1], edges[:-1] - 1e-9 * (high - low) / BUCKETS, side="right")  # for the lookup
    # The last one begins before the end by more than rounding, so that it is the same however the joint is turned.
    last = np.searchsorted(cells[:-1, 1], [*(edges[1:-1] - 1e-14 * (high - low)), high], side="right")
    return float(BUCKETS / (high - low)), np.stack([first, last], axis=1).ravel()


def check_rolling(joint: int, child: Surface, parent: Surface) -> None:
    """Raise MechanismError unless kappa = u_c - u_p < 0 on the common range (else the links cut into each other)."""
    s, kappa = _largest_kappa(child.profile, parent.profile)
    if not kappa < 0:
        raise MechanismError(
            f"relative curvature of joint {joint} (link {joint} on link {joint + 1}) at s = {s:.4g} mm",
            kappa,
            "u_child - u_parent < 0 on the whole common range",
            "Make the child surface more convex (u more negative), or narrow the limits.",
        )


@functools.lru_cache(maxsize=256)
def _largest_kappa(child: Profile, parent: Profile) -> tuple[float, float]:
    """Arc length and value of the largest relative curvature, in the first piece where it is not below 0."""
    maxima = []
    for lo, hi in itertools.pairwise(_borders(child, parent)):
        s = _extremes(child, parent, lo, np.nextafter(hi, lo))
        kappa = child.curvature(s) - parent.curvature(s)
        worst = int(np.argmax(kappa))
        maxima.append((float(s[worst]), float(kappa[worst])))
    return next((pair for pair in maxima if not pair[1] < 0), max(maxima, key=lambda pair: pair[1]))


def check_gaps(
    joint: int,
    tendons: Sequence[int],
    child: Surface,
    parent: Surface,
    child_holes: Array,
    parent_holes: Array,
    aside: Array | float = 0.0,
) -> None:
    """Raise MechanismError where the distal hole of a tendon falls below the proximal one; holes (tendons, 2).

    aside: distance between the holes across the plane, (tendons,) [mm]; a fall of up to that is no crossing, for the
    gap stays open.
    """
    contact = contacts(child.profile, parent.profile)
    places = child.placed(contact.child_curve), parent.placed(contact.parent_curve)
    height = heights(contact, (child.angle, parent.angle), places, (child_holes, parent_holes))
    room = height + np.reshape(np.abs(aside), (-1, 1))
    tendon, worst = (int(place) for place in np.unravel_index(np.argmin(room), room.shape))
    if room[tendon, worst] < -CROSSING:
        raise MechanismError(
            f"gap of tendon {tendons[tendon]} across joint {joint} with the contact at s = {contact.s[worst]:.4g} mm",
            float(height[tendon, worst]),
            "a positive height [mm]: the holes cross",
            f"Lower the child hole of link {joint}, raise the parent hole of link {joint + 1}, or narrow the limits.",
        )


def heights(
    contact: Contacts, angles: tuple[Any, Any], places: tuple[Array, Array], holes: tuple[Array, Array]
) -> Array:
    """How far distal holes of tendons are above the proximal ones, (..., tendons, contacts) [mm].

    Args:
        contact: of the two profiles.
        angles: of the child and of the parent surface, (...) [rad].
        places: of the contacts on them, (..., contacts, 2) [mm]. holes: (..., tendons, 2) [mm].
    """
    (child_angle, parent_angle), (on_child, on_parent), (child_holes, parent_holes) = angles, places, holes
    theta = np.asarray(child_angle)[..., None] + contact.child_turning
    phi = theta - np.asarray(parent_angle)[..., None] - contact.parent_turning
    theta, phi = theta[..., None, :], phi[..., None, :]
    arm = parent_holes[..., :, None, :] - on_parent[..., None, :, :]
    turned_x = np.cos(phi) * arm[..., 0] - np.sin(phi) * arm[..., 1]
    turned_y = np.sin(phi) * arm[..., 0] + np.cos(phi) * arm[..., 1]
    gap = on_child[..., None, :, :] - child_holes[..., :, None, :]
    height: Array = np.cos(theta) * (gap[..., 1] + turned_y) - np.sin(theta) * (gap[..., 0] + turned_x)
    return height


class Contacts(NamedTuple):
    """Contacts all over a joint, on the curves of its two profiles: (61 or 62, ...)."""

    s: Array
    child_turning: Array
    parent_turning: Array
    child_curve: Array
    parent_curve: Array


@functools.lru_cache(maxsize=256)
def contacts(child: Profile, parent: Profile) -> Contacts:
    """Contacts of two profiles, evenly over the arc lengths that both have."""
    s = np.unique(np.concatenate([np.linspace(*common_range(child, parent), 61), [0.0]]))
    return Contacts(s, child.turning(s), parent.turning(s), child.curve(s), parent.curve(s))


def _borders(child: Profile, parent: Profile) -> Array:
    low, high = common_range(child, parent)
    if not low < high:
        raise MechanismError("common arc length range of a joint", (low, high), "limits of both surfaces that overlap")
    breaks = np.union1d(child.breaks, parent.breaks)
    return np.union1d([low, high], breaks[(breaks > low) & (breaks < high)])


def _extremes(child: Profile, parent: Profile, low: float, high: float) -> Array:
    """Arc lengths where kappa, a polynomial between low and high, can be largest: both ends and stationary points."""
    degree = max(profile.coefficients.shape[1] for profile in (child, parent)) - 1
    if degree < 2:
        return np.array([low, high])
    kappa = chebyshev.Chebyshev.interpolate(lambda s: child.curvature(s) - parent.curvature(s), degree, (low, high))
    stationary = kappa.deriv().roots().real
    return np.concatenate([[low], np.sort(stationary[(stationary > low) & (stationary < high)]), [high]])


def _fit(child: Surface, parent: Surface, low: Array, high: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Polynomials through Chebyshev nodes of every cell, (cells, 10, 9), and whether they are near enough, (cells,)."""
    values = _functions(child, parent, low, high, np.concatenate([_NODES, _PROBES]))
    at_nodes, exact = values[:, : len(_NODES)], values[:, len(_NODES) :]
    coefficients = _TO_POWERS @ (_TO_CHEBYSHEV @ at_nodes)  # two steps: the high terms are small only in the first
    error = np.abs(_PROBE_POWERS @ coefficients - exact)
    pole = np.abs(exact[..., 6:8]).max(axis=(1, 2))
    shape = np.delete(error, (6, 7), axis=-1).max(axis=(1, 2))
    place = shape <= _TOLERANCE + _ANGLE_ROUNDING * pole
    return coefficients, place & (error[..., 6:8].max(axis=(1, 2)) <= _POLE_TOLERANCE * (1 + pole))


def _functions(child: Surface, parent: Surface, low: Array, high: Array, u: Array) -> Array:
    """The tabulated functions at cell coordinates u of the angle, (cells, len(u), 9).

    cos and sin of the angle; contact point and origin of the distal link in the proximal link's frame; rate of the
    contact point; arc length.
    """
    top, bottom = _angle(child, parent, low)[:, None], _angle(child, parent, high)[:, None]
    if not np.all(bottom < top):
        worst = int(np.argmax(bottom - top))
        raise MechanismError(
            f"relative curvature between s = {low[worst]:.4g} and {high[worst]:.4g} mm",
            float((child.curvature(low[worst : worst + 1]) - parent.curvature(low[worst : worst + 1]))[0]),
            "clearly below 0: here the joint angle does not resolve where the surfaces touch",
            "Make the child surface more convex (u more negative), or narrow the limits.",
        )
    phi = 0.5 * (bottom + top) + 0.5 * (top - bottom) * u
    s = _arc_length(child, parent, phi, low[:, None], high[:, None])
    cos, sin = np.cos(phi), np.sin(phi)
    contact, arm = child.point(s), parent.point(s)
    origin_x = contact[..., 0] - (cos * arm[..., 0] - sin * arm[..., 1])
    origin_y = contact[..., 1] - (sin * arm[..., 0] + cos * arm[..., 1])
    theta, kappa = child.tangent_angle(s), child.curvature(s) - parent.curvature(s)
    rate = [np.cos(theta) / kappa, np.sin(theta) / kappa]
    return np.stack([cos, sin, contact[..., 0], contact[..., 1], origin_x, origin_y, *rate, s], axis=-1)


def _angle(child: Surface, parent: Surface, s: Array) -> Array:
    return child.tangent_angle(s) - parent.tangent_angle(s)


def _arc_length(child: Surface, parent: Surface, phi: Array, low: Array, high: Array) -> Array:
    """s where the joint angle is phi, between low and high: Newton's method within a shrinking bracket."""
    last = np.nextafter(high, low)  # a curvature break at the upper border belongs to the next cell
    low, high = np.broadcast_to(low, phi.shape).copy(), np.broadcast_to(high, phi.shape).copy()
    s = 0.5 * (low + high)
    for _ in range(60):
        error = _angle(child, parent, s) - phi
        converged = np.abs(error) <= _ANGLE_ROUNDING * (1 + np.abs(phi))
        if converged.all():
            break
        low, high = np.where(error > 0, s, low), np.where(error > 0, high, s)
        newton = np.clip(s - error / (child.curvature(s) - parent.curvature(s)), low, high)
        s = np.where(converged | (newton != s), newton, 0.5 * (low + high))
    return np.minimum(s, last)
