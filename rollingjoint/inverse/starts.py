"""Equilibria to start from: samples over the tensions within the limits, kept while their mechanism lives."""

from __future__ import annotations

from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.chain import AnyChain
from rollingjoint.kernels.arrays import LARGEST_INPUT
from rollingjoint.statics.solve import solve_tensions_batch

Array = NDArray[np.float64]

SAMPLES = 1024
_MOST_KEPT = 8  # sets of samples per mechanism
_USUAL = 20.0  # N: highest tension of samples where there is no limit, or ten times the lowest one
_SMALLEST = 1e-3  # of the highest tension: lowest one of samples

_kept: WeakKeyDictionary[AnyChain, dict[tuple[bytes, ...], Any]] = WeakKeyDictionary()


def samples_of(chain: AnyChain, table: Array, low: Array, high: Array) -> Any:
    """Stable equilibria under a load table, at most SAMPLES; low, high: of the tensions, (m,) [N]."""
    kept = _kept.setdefault(chain, {})
    key = table.tobytes(), low.tobytes(), high.tobytes()
    if key not in kept:
        while len(kept) >= _MOST_KEPT:
            kept.pop(next(iter(kept)), None)
        kept[key] = sampled(chain, table[None], low, high)
    return kept[key]


class Sample(NamedTuple):
    """Joint angles (J,) [rad] and tensions (m,) [N] of an equilibrium."""

    joint_angles: Array
    tensions: Array


def nearest_sample(chain: AnyChain, table: Array, limits: Array, tip: Array) -> Sample | None:
    """The sample under a load table whose tip is nearest to a place; None where there is none.

    limits: lowest and highest tensions, (2, m) [N].
    """
    if not all(np.all(np.abs(values) <= LARGEST_INPUT) for values in (table, tip)):
        return None
    samples = samples_of(chain, table, *limits)
    away = ((samples.tip - tip) ** 2).sum(axis=1)
    if not np.isfinite(away).any():
        return None
    nearest = int(np.nanargmin(away))
    return Sample(samples.joint_angles[nearest], samples.tensions[nearest])


def sampled(chain: AnyChain, tables: Array, low: Array, high: Array, count: int = SAMPLES) -> Any:
    """Stable equilibria of `count` samples; half of the tensions are drawn uniformly, half by their logarithms.

    tables: load tables, (B, rows, columns), of samples in turn.
    """
    highest = np.where(np.isfinite(high), high, np.maximum(_USUAL, 10.0 * low))
    uniform, logarithmic = np.random.default_rng(0).random((2, count // 2, chain.n_tendons))
    lowest = np.maximum(low, _SMALLEST * highest)
    ratios = np.divide(highest, lowest, out=np.ones_like(highest), where=lowest > 0.0)
    tensions = np.concatenate([low + (highest - low) * uniform, lowest * ratios**logarithmic])
    tables = tables[np.arange(len(tensions)) % len(tables)]
    equilibria = solve_tensions_batch(chain, tensions, tables)
    usable = np.flatnonzero(equilibria.ok)
    if len(usable) in (0, len(tensions)):
        return equilibria
    return solve_tensions_batch(chain, tensions[usable], tables[usable])
