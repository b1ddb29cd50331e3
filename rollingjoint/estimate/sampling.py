"""Samples of a normal distribution within a box, compiled: exact Hamiltonian trajectories that bounce off its faces.

Source: Pakman and Paninski, Exact Hamiltonian Monte Carlo for truncated multivariate Gaussians, J. Comput. Graph. Stat.
23, 2014.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rollingjoint.compiled import kernel, part

Array = NDArray[np.float64]

BURNT = 10  # first samples that are left out
_MOST_BOUNCES = 2000  # in one trajectory
_LEAST_TIME = 1e-10  # between two bounces off the same face
_INSIDE = 1e-6  # of the box: how far inside its faces trajectories begin


def sample_in_boxes(
    precisions: Array, means: Array, low: Array, high: Array, starts: Array, count: int, rng: np.random.Generator
) -> Array:
    """Samples (R, count, K) of R normal distributions, each within its box.

    Args:
        precisions: inverse covariances, (R, K, K), positive definite. means: (R, K), inside the box or not.
        low, high: the box, (K,).
        starts: near which trajectories begin, (R, K).
        rng: source of the samples.
    """
    lower = np.linalg.cholesky(precisions)
    ways = np.ascontiguousarray(np.swapaxes(np.linalg.inv(lower), 1, 2))  # from normal numbers to deviations
    normals = rng.standard_normal((len(means), BURNT + count, means.shape[1]))
    width = high - low
    inside = np.clip(starts, low + _INSIDE * width, high - _INSIDE * width)
    begin = np.einsum("rji,rj->ri", lower, inside - means)
    samples = np.empty((len(means), count, means.shape[1]))
    bounce(ways, np.ascontiguousarray(means), low, high, begin, normals, samples)
    return samples


@kernel(nogil=True, title="the estimates' intervals")
def bounce(ways, means, low, high, begin, normals, samples):
    """Fill the samples. ways: (R, K, K), x = mean + way w; begin: first w, overwritten; normals: first velocities."""
    n_rows, n_moves, K = normals.shape
    speed, here, scale = np.empty(K), np.empty(K), np.empty(K)
    for row in range(n_rows):
        way, w = ways[row], begin[row]
        for k in range(K):
            scale[k] = 0.0
            for c in range(K):
                scale[k] += way[k, c] ** 2
        for move in range(n_moves):
            _fly(way, means[row], low, high, scale, w, normals[row, move], speed, here)
            if move >= BURNT:
                for k in range(K):
                    x = means[row, k]
                    for c in range(K):
                        x += way[k, c] * w[c]
                    samples[row, move - BURNT, k] = min(max(x, low[k]), high[k])


@part
def _fly(way, mean, low, high, scale, w, v, speed, here):
    """Move w along w cos t + v sin t for a quarter of a turn, with bounces; v: overwritten."""
    K, left, last = w.size, 0.5 * math.pi, -1
    for _ in range(_MOST_BOUNCES):
        hit, first = -1, left
        for k in range(K):
            here[k], speed[k] = 0.0, 0.0
            for c in range(K):
                here[k] += way[k, c] * w[c]
                speed[k] += way[k, c] * v[c]
            size = math.hypot(here[k], speed[k])
            for face in (low[k] - mean[k], high[k] - mean[k]):
                if size > abs(face):  # here cos t + speed sin t = face
                    middle, turn = math.atan2(speed[k], here[k]), math.acos(face / size)
                    for angle in (middle - turn, middle + turn):
                        time = angle % (2.0 * math.pi)
                        if time < first and (time > _LEAST_TIME or k != last):
                            leaves = speed[k] * math.cos(time) - here[k] * math.sin(time)
                            outwards = leaves > 0.0 if face == high[k] - mean[k] else leaves < 0.0
                            if outwards:
                                hit, first = k, time
        cos, sin = math.cos(first), math.sin(first)
        for k in range(K):
            w[k], v[k] = cos * w[k] + sin * v[k], cos * v[k] - sin * w[k]
        if hit < 0:
            return
        left, last, pushed = left - first, hit, 0.0
        for c in range(K):
            pushed += way[hit, c] * v[c]
        for c in range(K):
            v[c] -= 2.0 * pushed / scale[hit] * way[hit, c]
