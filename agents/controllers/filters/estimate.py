"""Means over the hypotheses of a bank, compiled; states as in kernels.py."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from rollingjoint.compiled import Floats, kernel, part


class Estimate(NamedTuple):
    """The estimate of B episodes: means over the hypotheses with an equilibrium of the model.

    Where none has one, tip, tensions and derivatives are zero.
    """

    tip: Annotated[Floats, "B", "d"]  # mm
    tensions: Annotated[Floats, "B", "m"]  # N
    tip_by_command: Annotated[Floats, "B", "d", "m"]
    tensions_by_command: Annotated[Floats, "B", "m", "m"]  # N/mm
    played: Annotated[Floats, "B", "m"]  # commands of the tendons behind their play, mm
    half_widths: Annotated[Floats, "B", "m"]  # of the play, mm


@kernel(nogil=True, title="the controllers' filters")
def average(weights, solved, linear, play, states, changes, at, tips, estimate):
    """Fill tips (B, H, d) [mm] of all hypotheses, and the estimate.

    weights: (B, H), of sum 1. states, play: now. changes: of the states since the model was solved, (R, states).
    at: StateLayout.
    """
    n_episodes, n_hypotheses = weights.shape
    m = solved.tensions.shape[1]
    for values in (estimate.tip, estimate.tensions, estimate.played, estimate.half_widths):
        values[:] = 0.0
    estimate.tip_by_command[:], estimate.tensions_by_command[:] = 0.0, 0.0
    for b in range(n_episodes):
        total = 0.0
        for h in range(n_hypotheses):
            total += weights[b, h] if solved.usable[b * n_hypotheses + h] else 0.0
        for h in range(n_hypotheses):
            row = b * n_hypotheses + h
            tips[b, h] = 0.0
            for j in range(m):
                estimate.played[b, j] += weights[b, h] * play.played[row, j]
                estimate.half_widths[b, j] += weights[b, h] * states[row, at.half_widths + j]
            if solved.usable[row] and total > 0.0:
                _fill_tip(solved, linear, states, changes, at, row, tips[b, h])
                _add_model(solved, linear, weights[b, h] / total, at, row, tips[b, h], estimate, b)


@part
def _fill_tip(solved, linear, states, changes, at, row, tip):
    """The tip under the states of a row (d,) [mm], a linear step from where the model was solved."""
    for axis in range(len(tip)):
        bias = at.bias + axis
        tip[axis] = solved.tips[row, axis] + states[row, bias] - changes[row, bias]
        for i in range(changes.shape[1]):
            tip[axis] += linear.tip[row, axis, i] * changes[row, i]


@part
def _add_model(solved, linear, weight, at, row, tip, estimate, b):
    """Add tip, tensions and their derivatives of a row to the means of episode b."""
    m = solved.tensions.shape[1]
    for axis in range(len(tip)):
        estimate.tip[b, axis] += weight * tip[axis]
        for j in range(m):
            estimate.tip_by_command[b, axis, j] += weight * linear.tip[row, axis, at.offsets + j]
    for j in range(m):
        estimate.tensions[b, j] += weight * solved.tensions[row, j]
        for k in range(m):
            estimate.tensions_by_command[b, j, k] += weight * linear.tensions[row, j, at.offsets + k]
