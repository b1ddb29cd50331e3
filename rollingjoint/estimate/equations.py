"""The normal equations of a history, compiled: measurements come in, forces are eliminated, the minimum comes out."""

from __future__ import annotations

import math

import numpy as np

from rollingjoint.compiled import (
    kernel,
    part,
)
from rollingjoint.kernels.arrays import NEGLIGIBLE


@part(inline=True)
def eliminate(H, columns):
    """Solve H X = columns in place, H symmetric; False where it is not positive definite."""
    n, width = columns.shape
    for i in range(n):
        if not H[i, i] > NEGLIGIBLE:
            return False
        for k in range(i + 1, n):
            factor = H[k, i] / H[i, i]
            for c in range(i + 1, n):
                H[k, c] -= factor * H[i, c]
            for c in range(width):
                columns[k, c] -= factor * columns[i, c]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            factor = H[i, k]
            for c in range(width):
                columns[i, c] -= factor * columns[k, c]
        for c in range(width):
            columns[i, c] /= H[i, i]
    return True


@part(inline=True)
def add(model, track, column, off, sd, row):
    """Add a measurement to the normal equations: it is `off` from what a row expects, with these derivatives."""
    information, slope, robust = track.information[row], track.slope[row], model.law.robust
    sds = model.sds[track.priors[row]]
    residual = abs(off) / sd
    weight = 1.0 if residual <= robust else robust / residual
    cost = 0.5 * residual * residual if residual <= robust else robust * (residual - 0.5 * robust)
    track.cost[row] += cost
    track.misfit[row] += cost
    for k in range(column.size):
        column[k] *= sds[k] / sd
    for i in range(column.size):
        pull = weight * column[i]
        if pull != 0.0:
            slope[i] += pull * off / sd
            for k in range(i + 1):
                information[i, k] += pull * column[k]


@kernel(nogil=True, title="the smoother")
def propose(track, sds, damping, farthest, numbers, volumes):
    """Fill numbers (R, K): the minimum of the normal equations, at most `farthest` standard deviations away in each.

    Args:
        sds: of the priors, (P, K).
        damping: share of its diagonal added to the information, (R,). A row whose equations cannot be solved stays.
        volumes: to be filled with half the logarithm of the determinant of that sum, (R,).
    """
    n_rows, K = track.slope.shape
    L, x = np.empty((K, K)), np.empty(K)
    for row in range(n_rows):
        information, slope = track.information[row], track.slope[row]
        usable, volumes[row] = True, 0.0
        for i in range(K):
            for k in range(i + 1):
                L[i, k] = information[i, k]
            L[i, i] *= 1.0 + damping[row]
            x[i] = slope[i]
        for i in range(K):  # column by column: the inner loops run along rows
            for k in range(i):
                factor = L[i, k]
                for c in range(k):
                    factor -= L[i, c] * L[k, c]
                L[i, k] = factor / L[k, k]
            pivot = L[i, i]
            for c in range(i):
                pivot -= L[i, c] * L[i, c]
            usable = usable and pivot > 0.0
            L[i, i] = math.sqrt(pivot) if pivot > 0.0 else 1.0
            volumes[row] += math.log(L[i, i])
        for i in range(K):
            for c in range(i):
                x[i] -= L[i, c] * x[c]
            x[i] /= L[i, i]
        for i in range(K - 1, -1, -1):
            for c in range(i + 1, K):
                x[i] -= L[c, i] * x[c]
            x[i] /= L[i, i]
        for i in range(K):
            change = min(max(x[i], -farthest), farthest) if usable and math.isfinite(x[i]) else 0.0
            numbers[row, i] = track.numbers[row, i] + change * sds[track.priors[row], i]


@kernel(nogil=True, title="the smoother")
def recall(track, sds, farthest, numbers, forces):
    """Fill the forces (R, T, 2) of all steps where the numbers are changed to these, (R, K); sds as in `propose`."""
    n_rows, K = numbers.shape
    x = np.empty(K)
    for row in range(n_rows):
        units = sds[track.priors[row]]
        for k in range(K):
            x[k] = (numbers[row, k] - track.numbers[row, k]) / units[k] if units[k] > 0.0 else 0.0
        last = track.steps[row] - 1
        forces[row] = math.nan
        for step in range(last, -1, -1):
            if step < last:
                first, second = track.alone[row, step, 0], track.alone[row, step, 1]
                for k in range(K):
                    first -= track.forward[row, step, 0, k] * x[k]
                    second -= track.forward[row, step, 1, k] * x[k]
                x[0], x[1] = min(max(first, -farthest), farthest), min(max(second, -farthest), farthest)
            for axis in range(2):
                forces[row, step, axis] = track.forces[row, step, axis] + x[axis] * units[axis]
