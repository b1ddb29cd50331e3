"""Newton steps in O(n) for long chains without follower forces.

H is diagonal plus semiseparable: H_im = U_i . V_m for i > m, because a load or a tendon couples two joints only through
the part of the chain beyond the later one. With q columns, one per tendon and a few for the loads, the factors of
H = L P Lᵀ follow from one sweep over the joints that carries a (q, q) matrix. `formulas.fill_generators` fills U and V.
Source: docs/theory.md, section 3.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint._numba.jit import part
from rollingjoint._numba.layout import Floats
from rollingjoint.kernels.linear import descent_step

DENSE_JOINTS = 15  # up to here dense: O(n) is faster from 8 links on, but eigenvectors lead out of saddles


class Sweep(NamedTuple):
    """Generators of H and its factors over J joints."""

    diagonal: Annotated[Floats, "J"]
    U: Annotated[Floats, "J", "q"]
    V: Annotated[Floats, "J", "q"]
    W: Annotated[Floats, "J", "q"]  # L_im = U_i . W_m
    pivots: Annotated[Floats, "J"]


class SweepSizes(NamedTuple):
    """Lengths of the axes of a Sweep."""

    J: int
    q: int


@part
def new_sweep(n_joints, q):
    """An empty Sweep with q columns."""
    shape = (n_joints, q)
    return Sweep(np.zeros(n_joints), np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(n_joints))


@part
def factor(sweep, free, shift):
    """Factor H + shift I on the free joints; returns the smallest pivot over the largest diagonal entry, or -1."""
    n_joints, q = sweep.U.shape
    S, row = np.zeros((q, q)), np.empty(q)
    size = 0.0
    for i in range(n_joints):
        if free[i]:
            size = max(size, abs(sweep.diagonal[i]) + shift)
    smallest = np.inf
    for i in range(n_joints):
        if not free[i]:
            continue
        pivot = sweep.diagonal[i] + shift
        for a in range(q):
            row[a] = 0.0
            for b in range(q):
                row[a] += S[a, b] * sweep.U[i, b]
            pivot -= sweep.U[i, a] * row[a]
        if not pivot > 1e-13 * size:
            return -1.0
        smallest = min(smallest, pivot)
        sweep.pivots[i] = pivot
        for a in range(q):
            sweep.W[i, a] = (sweep.V[i, a] - row[a]) / pivot
        for a in range(q):
            for b in range(q):
                S[a, b] += pivot * sweep.W[i, a] * sweep.W[i, b]
    return smallest / size if size > 0.0 else 1.0


@part
def substitute(sweep, free, residual, out):
    """Solve H out = -r with the factors; zero where a joint is held."""
    n_joints, q = sweep.U.shape
    carry = np.zeros(q)
    for i in range(n_joints):
        out[i] = 0.0
        if free[i]:
            value = -residual[i]
            for a in range(q):
                value -= sweep.U[i, a] * carry[a]
            for a in range(q):
                carry[a] += sweep.W[i, a] * value
            out[i] = value
    for a in range(q):
        carry[a] = 0.0
    for i in range(n_joints - 1, -1, -1):
        if free[i]:
            value = out[i] / sweep.pivots[i]
            for a in range(q):
                value -= sweep.W[i, a] * carry[a]
            for a in range(q):
                carry[a] += sweep.U[i, a] * value
            out[i] = value


@part
def first_shift(sweep, free):
    """Factor H with the first shift that makes it positive definite; returns the shift."""
    size = 0.0
    for i in range(sweep.diagonal.size):
        size = max(size, abs(sweep.diagonal[i]))
    shift = 1e-6 * size if size > 0.0 else 1.0
    while factor(sweep, free, shift) <= 1e-10:
        shift *= 4.0
    return shift


@part
def long_step(sweep, free, residual, out):
    """Newton step H out = -r on the free joints, with the first shift that makes H positive definite."""
    if factor(sweep, free, 0.0) <= 1e-10:
        first_shift(sweep, free)
    substitute(sweep, free, residual, out)


def symmetric_direction(chain, H, sweep, free, residual, L, step):
    """The step of a chain without friction: `direction` where H is symmetric."""
    if sweep.diagonal.size > 0:
        long_step(sweep, free, residual, step)
    else:
        descent_step(H, free, residual, L, step)


def unchanged(chain, state, energy, magnitude):
    """`renew` where the line search has no constants."""
    return energy, magnitude


def unlimited(chain, slope, new_slope):
    """`overshoots` where the line search goes by a potential: no step is too long as long as that falls."""
    return False


def same_above(chain, state, U, Q):
    """`fill_upper_generators` where H is symmetric."""
    for i in range(U.shape[0]):
        for a in range(U.shape[1]):
            Q[i, a] = U[i, a]


def no_friction_outside(chain, softness):
    """`soften` where there is none."""


def no_walls(chain):
    """`is_among_walls` of a chain by itself, `rubs_at_walls` of one without walls in space."""
    return False


def whole_step(chain, state, step, is_newtons):
    """`shorten` where a chain has nothing to run into."""
    return 1.0
