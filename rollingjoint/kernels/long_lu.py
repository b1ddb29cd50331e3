"""Newton steps in O(n) for long chains with friction, whose Jacobian is not symmetric.

A is diagonal plus semiseparable with different generators in each triangle: A_im = U_i . V_m for i > m and P_i . Q_m
for i < m. The factors of A = L R, without exchange of rows, follow from one sweep over the joints, as in long_chain.py:
L_im = U_i . W_m and R_im = Y_i . Q_m. Source: docs/theory.md, section 9.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint._numba.jit import part
from rollingjoint._numba.layout import Floats
from rollingjoint.kernels.long_chain import first_shift


class LongLu(NamedTuple):
    """Generators of A and its factors over J joints; the diagonal is in the Sweep."""

    U: Annotated[Floats, "J", "p"]
    V: Annotated[Floats, "J", "p"]
    P: Annotated[Floats, "J", "q"]
    Q: Annotated[Floats, "J", "q"]
    W: Annotated[Floats, "J", "p"]
    Y: Annotated[Floats, "J", "q"]
    pivots: Annotated[Floats, "J"]


class LongLuSizes(NamedTuple):
    """Lengths of the axes of a LongLu: p columns below the diagonal and q above it."""

    J: int
    p: int
    q: int


@part
def factor_lu(lu, diagonal, free, shift):
    """Factor A + shift I on the free joints; returns the smallest pivot over the largest diagonal entry, or -1."""
    n_joints, p = lu.U.shape
    q = lu.P.shape[1]
    S, row = np.zeros((p, q)), np.empty(p)
    size = 0.0
    for i in range(n_joints):
        if free[i]:
            size = max(size, abs(diagonal[i]) + shift)
    smallest = np.inf
    for i in range(n_joints):
        if not free[i]:
            continue
        pivot = diagonal[i] + shift
        for a in range(p):
            row[a] = 0.0
            for b in range(q):
                row[a] += S[a, b] * lu.Q[i, b]
            pivot -= lu.U[i, a] * row[a]
        if not pivot > 1e-13 * size:
            return -1.0
        smallest = min(smallest, pivot)
        lu.pivots[i] = pivot
        for b in range(q):
            value = lu.P[i, b]
            for a in range(p):
                value -= lu.U[i, a] * S[a, b]
            lu.Y[i, b] = value
        for a in range(p):
            lu.W[i, a] = (lu.V[i, a] - row[a]) / pivot
            for b in range(q):
                S[a, b] += lu.W[i, a] * lu.Y[i, b]
    return smallest / size if size > 0.0 else 1.0


@part
def substitute_lu(lu, free, residual, out):
    """Solve A out = -r with the factors; zero where a joint is held."""
    n_joints, p = lu.U.shape
    q = lu.P.shape[1]
    carry = np.zeros(max(p, q))
    for i in range(n_joints):
        out[i] = 0.0
        if free[i]:
            value = -residual[i]
            for a in range(p):
                value -= lu.U[i, a] * carry[a]
            for a in range(p):
                carry[a] += lu.W[i, a] * value
            out[i] = value
    for b in range(q):
        carry[b] = 0.0
    for i in range(n_joints - 1, -1, -1):
        if free[i]:
            value = out[i]
            for b in range(q):
                value -= lu.Y[i, b] * carry[b]
            value /= lu.pivots[i]
            for b in range(q):
                carry[b] += lu.Q[i, b] * value
            out[i] = value


@part
def lu_long_step(lu, sweep, free, residual, out):
    """Newton step A out = -r on the free joints; where a pivot is not positive or the step does not descend, shifted.

    The Sweep has the symmetric part of A, and the shift is the first that makes that positive definite.
    """
    if factor_lu(lu, sweep.diagonal, free, 0.0) > 1e-10:
        substitute_lu(lu, free, residual, out)
        slope = 0.0
        for i in range(free.size):
            slope += residual[i] * out[i]
        if slope < 0.0:
            return
    factor_lu(lu, sweep.diagonal, free, first_shift(sweep, free))
    substitute_lu(lu, free, residual, out)
