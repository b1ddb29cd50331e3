"""One lane of a batch: whether its inputs can be solved with, and its stiffness at a given configuration."""

from __future__ import annotations

import numpy as np

from rollingjoint._numba.jit import part
from rollingjoint.kernels.shared.arrays import TendonLaw
from rollingjoint.kernels.shared.formulas import evaluate, load_columns, stiffness
from rollingjoint.kernels.shared.tolerances import LARGEST_INPUT


@part(inline=True)
def resolvable(value):
    """False for NaN and for what is too large to be solved with."""
    return abs(value) <= LARGEST_INPUT


@part
def all_resolvable(values):
    """`resolvable` of every value."""
    for i in range(values.size):
        if not resolvable(values[i]):
            return False
    return True


@part
def valid(law, loads, start, stiffnesses):
    """True when every number can be solved with: no NaN, nothing huge, tension limits in order, no pushing tendon.

    stiffnesses: the columns of the load table that must not be negative.
    """
    if not (all_resolvable(law.command) and all_resolvable(start)):
        return False
    for row in range(loads.shape[0]):
        if not all_resolvable(loads[row]):
            return False
        for column in stiffnesses:
            if loads[row, column] < 0.0:
                return False
    for j in range(law.low.size):
        low, high = law.low[j], law.high[j]
        if not (0.0 <= low <= LARGEST_INPUT and low <= high and law.stiffness[j] > 0.0):
            return False
    return True


@part
def evaluate_unloaded(chain, state):
    """Fill the state at its angles without tensions and without loads."""
    zero = np.zeros(state.length.size)
    evaluate(chain, TendonLaw(zero, np.ones(zero.size), zero, zero), np.zeros((0, load_columns(chain))), state)


@part
def evaluate_at(chain, tensions, elastic, loads, angles, state):
    """Fill the state at joint angles under tensions and their rates d tension / d length."""
    for i in range(angles.size):
        state.angle[i] = angles[i]
    evaluate(chain, TendonLaw(state.length, np.ones(state.length.size), tensions, tensions), loads, state)
    for j in range(elastic.size):
        state.elastic[j] = elastic[j]


@part
def stiffness_at(chain, tensions, elastic, loads, angles, state, H):
    """Fill H at joint angles under tensions and their rates d tension / d length; overwrites the state."""
    evaluate_at(chain, tensions, elastic, loads, angles, state)
    stiffness(chain, loads, state, H)
