"""Profiles of a fit and the intervals that they give.

Source: D. M. Bates and D. G. Watts, Nonlinear Regression Analysis and Its Applications, ch. 6.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rollingjoint.identify.fit import Fit, minimise

Array = NDArray[np.float64]

_POINTS = 11
_TOLERANCE = 1e-7  # of a sum of squares
_ROOM = 1.3  # half-widths of the interval that a curve shows


@dataclass(frozen=True)
class LikelihoodProfile:
    """Loss of fit at fixed values of one coefficient, with all others fitted anew.

    Args:
        values: of the coefficient, (c,).
        deviances: increase of the sum of squares over its scale and inflation, (c,).
        threshold: the deviance at the ends of the interval.
        interval: the values within; an end of the searched range where the data set none.
        bounded: whether the data set the lower and the upper end.
    """

    values: Array
    deviances: Array
    threshold: float
    interval: tuple[float, float]
    bounded: tuple[bool, bool]


Profile = LikelihoodProfile
"""Earlier name, which pickles have."""


def linear_profile(fit: Fit, place: int, confidence: float) -> LikelihoodProfile:
    """The profile of one coefficient for a linear model: much faster, and accurate where intervals are small."""
    low, high = (float(bound) for bound in fit.model.bounds[:, place])
    threshold, best = _threshold(fit, confidence), float(fit.values[place])
    if not _informed(fit, place):
        return LikelihoodProfile(np.array([low, high]), np.zeros(2), threshold, (low, high), (False, False))
    spread = math.sqrt(_inflation(fit, place) * float(fit.variances[place]))
    ends = best - math.sqrt(threshold) * spread, best + math.sqrt(threshold) * spread
    first, last = max(best - _ROOM * (best - ends[0]), low), min(best + _ROOM * (ends[1] - best), high)
    values = np.linspace(first, last, _POINTS)
    interval = max(ends[0], low), min(ends[1], high)
    return LikelihoodProfile(
        values, ((values - best) / spread) ** 2, threshold, interval, (ends[0] > low, ends[1] < high)
    )


def profile(fit: Fit, place: int, confidence: float) -> LikelihoodProfile:
    """The profile of one coefficient.

    With true deviations the deviance has the chi-squared distribution. Otherwise its scale comes from
    the residuals, inflated as Fit.inflations says, and its square root has Student's distribution; the number of
    degrees of freedom is the number of steps less one.
    """
    low, high = (float(bound) for bound in fit.model.bounds[:, place])
    threshold = _threshold(fit, confidence)
    if not _informed(fit, place):
        return LikelihoodProfile(np.array([low, high]), np.zeros(2), threshold, (low, high), (False, False))
    inflation = _inflation(fit, place)
    width = math.sqrt(threshold * inflation * float(fit.variances[place]))
    deviance = _Deviance(fit, place, fit.scale * inflation)
    best = float(fit.values[place])
    lower, low_bounded = _end(deviance, best, -width, low, threshold)
    upper, high_bounded = _end(deviance, best, width, high, threshold)
    first, last = max(best - _ROOM * (best - lower), low), min(best + _ROOM * (upper - best), high)
    values = np.union1d(np.linspace(first, last, _POINTS), [best])
    return LikelihoodProfile(
        values, np.array([deviance(v) for v in values]), threshold, (lower, upper), (low_bounded, high_bounded)
    )


def _informed(fit: Fit, place: int) -> bool:
    """Whether more than one step of the data carries information on a coefficient."""
    return bool(fit.determined[place]) and math.isfinite(_inflation(fit, place))


def _inflation(fit: Fit, place: int) -> float:
    """Factor on the variance, since the readings of a step share their causes."""
    return 1.0 if fit.model.measurements.absolute else float(fit.inflations[place])


class _Deviance:
    """The deviance as a function of one coefficient; every fit starts from the nearest earlier fit."""

    def __init__(self, fit: Fit, place: int, scale: float) -> None:
        self._fit, self._place, self._scale = fit, place, scale
        self._free = ~fit.silent
        self._free[place] = False
        self._solved = [fit.values]

    def __call__(self, value: float) -> float:
        nearest = min(self._solved, key=lambda values: abs(values[self._place] - value)).copy()
        nearest[self._place] = value
        values = minimise(self._fit.model, nearest, self._free, _TOLERANCE)
        self._solved.append(values)
        return float(np.sum(self._fit.model.residuals(values) ** 2) - self._fit.cost) / self._scale


def _end(
    deviance: Callable[[float], float], best: float, width: float, bound: float, threshold: float
) -> tuple[float, bool]:
    """One end of an interval, and whether the deviance reaches the threshold before the bound."""
    from scipy.optimize import brentq

    inner, step = best, width
    while True:
        outer = best + step
        if (outer - bound) * math.copysign(1.0, width) >= 0:
            outer = bound
        if outer == inner or deviance(outer) >= threshold:
            break
        inner, step = outer, 1.6 * step
    if outer == inner:
        return bound, False
    root = brentq(lambda v: deviance(v) - threshold, inner, outer, xtol=1e-3 * abs(width), rtol=1e-9)
    return float(root), True


def _threshold(fit: Fit, confidence: float) -> float:
    """The deviance at the ends of an interval."""
    from scipy.stats import chi2, t

    if fit.model.measurements.absolute:
        return float(chi2.ppf(confidence, 1))
    freedom = fit.n_steps - 1 if fit.n_steps > 1 else max(len(fit.residuals) - len(fit.values), 1)
    return float(t.ppf((1 + confidence) / 2, freedom) ** 2)
