"""Effects of hidden numbers on the tendons of an arm with friction in its holes, compiled, R rows side by side.

A tendon's friction state z in a link is clip(w - s/δ): w stays while the tendon sticks, and is s/δ plus or minus 1
where it slides. So all that a step hands on to the next are the derivatives of w by the hidden numbers, (J, m, K) per
row. Symbols: T tension, z friction state, s slip, δ presliding, ρ = μ γ with the turn γ of a tendon in a link.
Source: docs/theory.md, section 9.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint.compiled import Floats, Integers, kernel

_STILL = 1e-6  # a friction state below it is zero


class RubbedTendons(NamedTuple):
    """Tendons of R rows after a step with friction."""

    crossed: Annotated[Integers, "m"]  # joints that they cross
    rates: Annotated[Floats, "R", "J", "m"]  # d length / d joint angle, mm/rad
    tensions: Annotated[Floats, "R", "m"]  # at the motor, N
    gap_tensions: Annotated[Floats, "R", "J", "m"]
    states: Annotated[Floats, "R", "J", "m"]
    grips: Annotated[Floats, "R", "J", "m"]  # N
    mu: Annotated[Floats, "R", "m"]


@kernel(nogil=True, title="the smoother of arms")
def add_tendon_causes(tendons, motors_by, states_by, holes, shared, causes):
    """Add the torques of tendons at constant joint angles to causes, (R, J, K) [N·mm per unit].

    Args:
        tendons: RubbedTendons.
        motors_by: derivatives of the tensions at the motors at constant joint angles, (R, m, K).
        states_by: derivatives of w before the step, (R, J, m, K). holes: where the coefficients μ begin.
        shared: whether there is only one.
    """
    n_rows, _, m, K = states_by.shape
    stuck = np.empty(K)
    for row in range(n_rows):
        for j in range(m):
            below = motor = tendons.tensions[row, j]
            if motor <= 0.0:
                continue
            stuck[:] = 0.0
            wound = 0.0
            for i in range(tendons.crossed[j]):
                z, grip = tendons.states[row, i, j], tendons.grips[row, i, j]
                moving = abs(z) > _STILL
                resistance = -math.log(1.0 - z * grip / below) / z if moving else grip / below
                wound += z * resistance / tendons.mu[row, j]
                if abs(z) < 1.0:
                    for k in range(K):
                        stuck[k] += resistance * states_by[row, i, j, k]
                tension, rate = tendons.gap_tensions[row, i, j], tendons.rates[row, i, j]
                share = tension / motor
                for k in range(K):
                    causes[row, i, k] -= rate * (share * motors_by[row, j, k] - tension * stuck[k])
                causes[row, i, holes + (0 if shared else j)] += rate * tension * wound
                below = tension


@kernel(nogil=True, title="the smoother of arms")
def pass_on(tendons, turns, presliding, begins, states_by, lengths_by):
    """Fill the derivatives of lengths, (R, m, K) [mm per unit], and of w after the step, in place.

    Args:
        turns: derivatives of the joint angles, (R, J, K). presliding: δ [mm].
        begins: before any slip: w is z + s/δ with z = 0 in all links.
    """
    n_rows, _, m, K = states_by.shape
    total = np.empty(K)
    for row in range(n_rows):
        for j in range(m):
            total[:] = 0.0
            for i in range(tendons.crossed[j] - 1, -1, -1):
                slides = begins or abs(tendons.states[row, i, j]) >= 1.0
                for k in range(K):
                    total[k] += tendons.rates[row, i, j] * turns[row, i, k]
                if slides:
                    for k in range(K):
                        states_by[row, i, j, k] = total[k] / presliding
            for k in range(K):
                lengths_by[row, j, k] = total[k]


@kernel(nogil=True, title="the smoother of arms")
def solve_rows(A, causes):
    """Solve A X = causes for every row in place, (R, J, J) and (R, J, K); A need not be symmetric, and is used up."""
    n_rows, n, width = causes.shape
    for row in range(n_rows):
        for i in range(n):
            for k in range(i + 1, n):
                factor = A[row, k, i] / A[row, i, i]
                if factor != 0.0:
                    for c in range(i + 1, n):
                        A[row, k, c] -= factor * A[row, i, c]
                    for c in range(width):
                        causes[row, k, c] -= factor * causes[row, i, c]
        for i in range(n - 1, -1, -1):
            for k in range(i + 1, n):
                factor = A[row, i, k]
                for c in range(width):
                    causes[row, i, c] -= factor * causes[row, k, c]
            for c in range(width):
                causes[row, i, c] /= A[row, i, i]


@kernel(nogil=True, title="the smoother of arms")
def add_rows(columns, weights, off, information, slope):
    """Add measurements to normal equations, the lower triangle (R, K, K) and (R, K); 0 is a weight of none.

    columns: derivatives of the expected measurements, (R, M, K). weights, off: of the measurements, (R, M).
    """
    n_rows, count, K = columns.shape
    for row in range(n_rows):
        for j in range(count):
            weight = weights[row, j]
            if weight == 0.0:
                continue
            for i in range(K):
                pull = weight * columns[row, j, i]
                if pull != 0.0:
                    slope[row, i] += pull * off[row, j]
                    for k in range(i + 1):
                        information[row, i, k] += pull * columns[row, j, k]
