"""The formulas of Kalman filters, compiled, R rows side by side; states as in kernels.py."""

from __future__ import annotations

import math

import numpy as np

from rollingjoint.compiled import kernel

UNEXPECTED = -8.0  # evidence of a measurement that a hypothesis cannot predict: about that of four standard deviations


@kernel(nogil=True, title="the controllers' filters")
def update(states, covariances, evidence, predicted, columns, measured, variances):
    """Take measurements of independent noise, one after the other, into the states and their covariances.

    Args:
        states, covariances: (R, states), (R, states, states), changed in place.
        evidence: (R,) logarithm of how likely the measurements were, added in place.
            One of NaN changes no state, and counts as UNEXPECTED.
        predicted, columns: measurements of the model at the states, (R, K), and their derivatives, (R, K, states).
        measured: (R, K). variances: of their noise, (R, K), above 0.
    """
    n_rows, n_states = states.shape
    before, spread = np.empty(n_states), np.empty(n_states)
    for row in range(n_rows):
        before[:] = states[row]
        for k in range(measured.shape[1]):
            column, variance = columns[row, k], variances[row, k]
            surprise = measured[row, k] - predicted[row, k]
            for i in range(n_states):
                surprise -= column[i] * (states[row, i] - before[i])
                spread[i] = 0.0
                for c in range(n_states):
                    spread[i] += covariances[row, i, c] * column[c]
                variance += column[i] * spread[i]
            if not math.isfinite(surprise):
                evidence[row] += UNEXPECTED
                continue
            evidence[row] -= 0.5 * (surprise * surprise / variance + math.log(variance))
            for i in range(n_states):
                gain = spread[i] / variance
                states[row, i] += gain * surprise
                for c in range(n_states):
                    covariances[row, i, c] -= gain * spread[c]


@kernel(nogil=True, title="the controllers' filters")
def forecast(states, covariances, memory, walk):
    """Move states on by a step, in place.

    memory: what is left of every state, (states,). walk: variances of what comes on top, (states,).
    """
    n_rows, n_states = states.shape
    for row in range(n_rows):
        for i in range(n_states):
            states[row, i] *= memory[i]
            for c in range(n_states):
                covariances[row, i, c] *= memory[i] * memory[c]
            covariances[row, i, i] += walk[i]


@kernel(nogil=True, title="the controllers' filters")
def keep_physical(states, radius, low, high):
    """Bring states back, in place: the first two into a circle about 0, all of them into low to high, (states,)."""
    for row in range(len(states)):
        size = math.hypot(states[row, 0], states[row, 1])
        shrink = min(1.0, radius / max(size, 1e-12))
        states[row, 0] *= shrink
        states[row, 1] *= shrink
        for i in range(states.shape[1]):
            states[row, i] = min(max(states[row, i], low[i]), high[i])
