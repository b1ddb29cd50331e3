"""The tensions that bring a model's tip nearest to a target, many targets at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agents.controllers.responses import bounded_step, choose, tension_response
from agents.evaluation.controller import Array
from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.solution import Solution
from rollingjoint.load import Load
from rollingjoint.statics.solve import solve_tensions_batch

_PULL = 1e-3  # of the mechanism's length: what a factor e between a tension and its rest may cost in tip error
_CLOSE = 1e-6  # of a tension: smaller steps end the search


def nearest_tensions(
    mechanism: AnyChain,
    targets: Array,
    limits: tuple[float, float],
    rest: Array,
    starts: Array,
    loads: Array | Sequence[Load] = (),
    most_steps: int = 30,
) -> Array:
    """Tensions (B, m) [N] within `limits` at which the model's tip is nearest to the target.

    Levenberg-Marquardt over the logarithms of the tensions, all targets at once. Unloaded, only ratios of tensions
    matter, and more than two tendons leave a choice: a weak pull towards the tensions at rest decides.

    Args:
        mechanism: the model.
        targets: (B, d) [mm].
        limits: lowest and highest tension [N].
        rest, starts: tensions at rest, and the first guess, (B, m) [N].
        loads: load tables, (B, rows, columns), or loads that act on all rows; none by default.
        most_steps: limit of the iterations.
    """
    low, high = np.log(np.maximum(limits, 1e-3))
    pull, calm = (_PULL * mechanism.length) ** 2, np.log(rest)
    best = np.clip(np.log(starts), low, high)
    found: Solution = solve_tensions_batch(mechanism, np.exp(best), loads)
    least, damping = _cost(found, targets, pull, best - calm), np.full(len(best), 1e-3)
    going = np.ones((len(best), 1), bool)
    for _ in range(most_steps):
        rates = tension_response(found) * np.exp(best)[:, None]
        hessian = np.swapaxes(rates, 1, 2) @ rates
        size = pull + damping * np.trace(hessian, axis1=1, axis2=2)
        hessian += size[:, None, None] * np.eye(best.shape[1])
        slope = np.einsum("bim,bi->bm", rates, found.tip - targets) + pull * (best - calm)
        step = going * bounded_step(hessian, slope, low - best, high - best)
        tried = solve_tensions_batch(mechanism, np.exp(best + step), loads, found)
        cost = _cost(tried, targets, pull, best + step - calm)
        better = cost < least
        best, least, found = best + step * better[:, None], np.where(better, cost, least), choose(better, tried, found)
        damping *= np.where(better, 0.1, 10.0)
        going = np.abs(step).max(axis=1, keepdims=True) > _CLOSE
        if not going.any():
            break
    return np.exp(best)


def _cost(equilibria: Solution, targets: Array, pull: float, away: Array) -> Array:
    """What is minimised, (B,) [mm²]."""
    cost = np.sum((equilibria.tip - targets) ** 2, axis=1) + pull * np.sum(away**2, axis=1)
    return np.where(equilibria.ok, cost, np.inf)
