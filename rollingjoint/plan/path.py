"""Paths of targets: tips, poses or shapes, and those in between."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain import se3
from rollingjoint.chain.chain import AnyChain
from rollingjoint.errors import InvalidInput
from rollingjoint.inverse.goal import Goal
from rollingjoint.kernels.arrays import LARGEST_INPUT

Array = NDArray[np.float64]

MOST_STEPS = 100_000


def target_like(mechanism: AnyChain, equilibrium: object, shape: tuple[int, ...]) -> Array:
    """Where an equilibrium is, in the form of targets of this shape: tip, its pose, all links' positions or poses."""
    d, n = mechanism.dimension, mechanism.n_links
    names = {(d,): "tip", (n, d): "positions"}
    if shape in names:
        return np.asarray(getattr(equilibrium, names[shape]))
    poses = np.asarray(equilibrium.poses)  # type: ignore[attr-defined]
    return poses if shape == poses.shape else poses[-1]


def between(
    mechanism: AnyChain, targets: Array, lever: float | None, step: float, others: tuple[Array, ...]
) -> tuple[Array, NDArray[np.int64], list[Array]]:
    """Targets no farther than a step apart, the places of the given ones among them, and other rows in proportion.

    targets: (K, ...). step: root mean square over the links, a turn of 1 rad counted as the lever [mm]. others: rows of
    each target, of which those in between are linear.
    """
    if not (np.abs(targets) <= LARGEST_INPUT).all():
        raise InvalidInput("path", targets, f"finite numbers up to {LARGEST_INPUT:g}")
    coordinates = Goal.of(mechanism, targets, lever, single=False)
    ways = np.diff(coordinates.coordinates, axis=0)
    distances = np.sqrt(np.sum(ways**2, axis=1) / len(coordinates.links))
    total = float(np.sum(np.ceil(distances / step)))
    if total > MOST_STEPS:
        raise InvalidInput("step", step, f"one that makes at most {MOST_STEPS:,} steps of this path, not {total:,.0f}")
    counts = np.maximum(1, np.ceil(distances / step)).astype(int)
    places = np.concatenate([[0], np.cumsum(counts)])
    shares = np.concatenate([[0.0], *(k + np.arange(1, n + 1) / n for k, n in enumerate(counts))])
    return _at(targets, shares, mechanism.dimension), places, [_linear(rows, shares) for rows in others]


def among_walls(targets: Array, bases: Array, shapes: tuple[int, ...], back: bool = False) -> Array:
    """Planar targets in the frame of the base as those in the frame of the walls, or back; bases: (K, 3)."""
    axes = (slice(None), *[None] * (len(shapes) - 1))
    x, y, angle = np.moveaxis(bases, -1, 0)
    cos, sin, x, y, angle = (values[axes] for values in (np.cos(angle), np.sin(angle), x, y, angle))
    result = targets.copy()
    if back:
        u, v = targets[..., 0] - x, targets[..., 1] - y
        result[..., 0], result[..., 1] = cos * u + sin * v, cos * v - sin * u
    else:
        u, v = targets[..., 0], targets[..., 1]
        result[..., 0], result[..., 1] = x + cos * u - sin * v, y + sin * u + cos * v
    if shapes[-1] == 3:
        result[..., 2] += -angle if back else angle
    return result


def _linear(rows: Array, shares: Array) -> Array:
    """Rows (K, ...) at shares from 0 to K - 1."""
    first = np.minimum(shares.astype(int), max(len(rows) - 2, 0))
    later = np.minimum(first + 1, len(rows) - 1)
    part = (shares - first).reshape(-1, *[1] * (rows.ndim - 1))
    return np.asarray(rows[first] + part * (rows[later] - rows[first]))


def _at(targets: Array, shares: Array, dimension: int) -> Array:
    """Targets at shares: places linear, turns at a constant rate about one axis."""
    if dimension == 2 or targets.shape[-1] == 3:
        if dimension == 2 and targets.shape[-1] == 3:
            targets = np.concatenate([targets[..., :2], np.unwrap(targets[..., 2:], axis=0)], axis=-1)
        return _linear(targets, shares)
    result, turns = _linear(targets, shares), targets[..., :3, :3]
    first = np.minimum(shares.astype(int), max(len(targets) - 2, 0))
    later = np.minimum(first + 1, len(targets) - 1)
    part = (shares - first).reshape(-1, *[1] * (targets.ndim - 2))
    way = se3.rotation_vector(turns[later] @ np.swapaxes(turns[first], -1, -2))
    result[..., :3, :3] = se3.rotation(part * way) @ turns[first]
    return result
