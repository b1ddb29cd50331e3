"""Curvatures of a mechanism as tables whose pieces end at the knots of changes, too."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.profile import Profile

Array = NDArray[np.float64]
Profiles = list[tuple[Profile | None, Profile | None]]


def profiles_of(chain: AnyChain) -> Profiles:
    """(parent, child) profile of every link in the plane or joint in space, as tables have them; None of hinges."""
    if isinstance(chain, RollingChain):
        return [(link.parent.profile, link.child.profile) for link in chain.links]
    assert isinstance(chain, SpatialChain)
    joints: list[Any] = list(chain.joints)
    return [(j.parent.profile, j.child.profile) if hasattr(j, "child") else (None, None) for j in joints]


def refined(profiles: Profiles, knots: int, curve: str, symmetric: bool) -> tuple[Tensor, Tensor, Tensor]:
    """Breaks (rows, 2, p + 1), coefficients (rows, 2, p, k) and those per free knot, (rows, 2, p, k, f).

    Args:
        profiles: of the surfaces.
        knots: of a change, at equal distances from end to end. curve: "linear" or "cubic" between them.
        symmetric: knots at the same distance from the middle are one.
    """
    half = knots // 2
    free = np.eye(knots)
    if symmetric:
        free = np.equal.outer(np.abs(np.arange(knots) - half), np.arange(half + 1)).astype(float)
    make = Profile.spline if curve == "cubic" else Profile.samples
    tables: list[tuple[Array, Array, list[Array] | None]] = []
    for pair in profiles:
        for profile in pair:
            if profile is None:
                tables.append((np.array([-1.0, 1.0]), np.zeros((1, 1)), None))  # of a hinge, without effect
                continue
            places = np.linspace(*profile.limits, knots)
            breaks = _union(profile.breaks, places)
            moved = [_on(make(_snapped(places, breaks), column), breaks) for column in free.T]
            tables.append((breaks, _on(profile, breaks), moved))
    pieces = max(len(table[1]) for table in tables)
    degrees = max(t.shape[1] for table in tables for t in (table[1], *(table[2] or ())))
    rows = len(profiles)
    breaks = np.stack([np.pad(b, (0, pieces + 1 - len(b)), "edge") for b, _, _ in tables])
    coefficients = np.stack([_padded(c, pieces, degrees) for _, c, _ in tables])
    spread = np.zeros((len(tables), pieces, degrees, free.shape[1]))
    for place, (_, _, columns) in enumerate(tables):
        for knot, column in enumerate(columns or ()):
            spread[place, ..., knot] = _padded(column, pieces, degrees)
    breaks, coefficients, spread = (t.reshape(rows, 2, *t.shape[1:]) for t in (breaks, coefficients, spread))
    return torch.as_tensor(breaks), torch.as_tensor(coefficients), torch.as_tensor(spread)


def _union(breaks: Array, knots: Array) -> Array:
    """Breaks with the knots between them; a knot within 1e-9 of a break is that break."""
    far = np.abs(knots[:, None] - breaks).min(1) > 1e-9
    return np.sort(np.concatenate([breaks, knots[far]]))


def _snapped(knots: Array, breaks: Array) -> Array:
    return np.asarray(breaks[np.abs(knots[:, None] - breaks).argmin(1)])


def _on(profile: Profile, breaks: Array) -> Array:
    """Coefficients of a curvature in pieces between these breaks, which include its own, (p, k)."""
    table = profile.coefficients
    owner = np.clip(np.searchsorted(profile.breaks, breaks[:-1], side="right") - 1, 0, len(table) - 1)
    shifts = breaks[:-1] - profile.breaks[owner]
    degree = table.shape[1]
    binomials = np.array([[math.comb(i, j) for j in range(degree)] for i in range(degree)], float)
    lifted = np.maximum(np.subtract.outer(np.arange(degree), np.arange(degree)), 0)
    return np.einsum("pi,ij,pij->pj", table[owner], binomials, shifts[:, None, None] ** lifted)


def _padded(table: Array, pieces: int, degrees: int) -> Array:
    return np.pad(table, ((0, pieces - len(table)), (0, degrees - table.shape[1])))
