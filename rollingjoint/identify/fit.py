"""Least-squares fits of a model, with variances, correlations and undetermined coefficients.

Source: A. C. Cameron and D. L. Miller, A Practitioner's Guide to Cluster-Robust Inference, 2015, sec. VI: jackknife.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rollingjoint.errors import SolverError
from rollingjoint.identify.model import MeasurementModel

Array = NDArray[np.float64]

_SMALLEST_EFFECT = 1e-7  # of the whole range of a coefficient on the readings, standard deviations; below it: silent
_SINGULAR = 1e-6  # singular values of normalised derivatives below it: directions without effect
_SHARE = 0.1  # smallest component of a coefficient that belongs to such a direction
_SMALLEST_SCALE = 1e-18  # of the mean squared residual, where the model fits to rounding
_AT_BOUND = 1e-4  # of the range


@dataclass(frozen=True)
class Fit:
    """Values that fit the data best.

    Args:
        model: the fitted model.
        values: (p,).
        silent: (p,) True where the data have no information on a coefficient, which keeps its nominal value.
    """

    model: MeasurementModel
    values: Array
    silent: NDArray[np.bool_]

    @cached_property
    def residuals(self) -> Array:
        """Measured minus predicted in standard deviations, (N,)."""
        return self.model.residuals(self.values)

    @cached_property
    def jacobian(self) -> Array:
        """d residuals / d values, (N, p)."""
        return self.model.jacobian(self.values)

    @property
    def cost(self) -> float:
        """Sum of squared residuals."""
        return float(self.residuals @ self.residuals)

    @property
    def scale(self) -> float:
        """Mean squared residual, estimated; 1 with true standard deviations."""
        return 1.0 if self.model.measurements.absolute else self.misfit

    @property
    def misfit(self) -> float:
        """Mean squared residual per degree of freedom: about 1 where the deviations are true and the model is right."""
        return max(self.cost / max(len(self.residuals) - len(self.values), 1), _SMALLEST_SCALE)

    @cached_property
    def n_steps(self) -> int:
        """Steps with at least one fitted reading."""
        return len(np.unique(self.model.steps))

    @cached_property
    def tangled(self) -> list[list[int]]:
        """Groups of coefficients with effects on the readings that cancel: the data cannot tell them apart."""
        heard = np.flatnonzero(~self.silent & self.jacobian.any(axis=0))
        J = self.jacobian[:, heard] / np.linalg.norm(self.jacobian[:, heard], axis=0)
        _, sizes, directions = np.linalg.svd(J, full_matrices=len(J) < len(heard))
        sizes = np.pad(sizes, (0, len(directions) - len(sizes)))
        weak = directions[sizes < _SINGULAR * sizes.max(initial=1.0)]
        return [heard[np.abs(direction) > _SHARE].tolist() for direction in weak]

    @cached_property
    def determined(self) -> NDArray[np.bool_]:
        """(p,) True where the effect of a coefficient on the readings can be told from all others."""
        alone = ~self.silent & self.jacobian.any(axis=0)
        alone[[place for group in self.tangled for place in group]] = False
        return alone

    @cached_property
    def variances(self) -> Array:
        """Variance of each coefficient if all readings were independent, to first order, (p,); NaN: not determined."""
        return self._spread(np.diag(self._covariance) * self.scale)

    @cached_property
    def correlations(self) -> Array:
        """Correlations of the errors of the coefficients, (p, p); NaN where they are not determined."""
        spread = np.sqrt(np.diag(self._covariance))
        full = np.full((len(self.values),) * 2, np.nan)
        full[np.ix_(self.determined, self.determined)] = self._covariance / np.outer(spread, spread)
        return full

    @cached_property
    def inflations(self) -> Array:
        """Variance of each coefficient by the jackknife over steps / variance if all readings were independent, (p,).

        The readings of one step share their causes: links stand on each other. The jackknife leaves out one step at a
        time, to first order, which is right for any dependence within a step. At least 1; infinite where
        all information rests on one step; NaN where a coefficient is not determined.
        """
        J, robust = self.jacobian[:, self.determined], np.zeros_like(self._covariance)
        for step in np.unique(self.model.steps):
            rows = self.model.steps == step
            remainder = np.eye(rows.sum()) - J[rows] @ self._covariance @ J[rows].T
            if np.linalg.cond(remainder) > 1e10:
                return self._spread(np.full(len(robust), np.inf))
            change = self._covariance @ J[rows].T @ np.linalg.solve(remainder, self.residuals[rows])
            robust += np.outer(change, change)
        share = (self.n_steps - 1) / self.n_steps
        return self._spread(np.maximum(share * np.diag(robust) / (self.misfit * np.diag(self._covariance)), 1.0))

    @cached_property
    def _covariance(self) -> Array:
        """Covariance of the determined coefficients for residuals of variance 1."""
        J = self.jacobian[:, self.determined]
        return np.asarray(np.linalg.inv(J.T @ J)) if J.shape[1] else np.empty((0, 0))

    def _spread(self, numbers: Array) -> Array:
        """Numbers of the determined coefficients in the place of each, NaN elsewhere, (p,)."""
        full = np.full(len(self.values), np.nan)
        full[self.determined] = numbers
        return full


def fit(model: MeasurementModel) -> Fit:
    """The values within their ranges that fit the data best.

    Raises:
        SolverError: no equilibrium at some step for any values.
    """
    low, high = model.bounds
    silent = np.linalg.norm(model.jacobian(model.start), axis=0) * (high - low) < _SMALLEST_EFFECT
    values = np.where(silent, model.nominal, model.start)
    result = Fit(model, minimise(model, values, ~silent), silent)
    if not np.all(np.isfinite(model.predictions(result.values)[model.weights > 0])):
        raise SolverError("no equilibrium at some steps: check units and order of what was given, and the mechanism")
    return result


def minimise(model: MeasurementModel, start: Array, free: NDArray[np.bool_], tolerance: float = 1e-12) -> Array:
    """Values of least cost, (p,), with the cost to a relative tolerance; values that are not free stay at the start."""
    from scipy.optimize import least_squares

    def full(part: Array) -> Array:
        values = start.copy()
        values[free] = part
        return values

    if not free.any():
        return start.copy()
    low, high = model.bounds[:, free]
    margin = 1e-6 * (high - low)
    solution = least_squares(
        lambda part: model.residuals(full(part)),
        np.clip(start[free], low + margin, high - margin),
        lambda part: model.jacobian(full(part))[:, free],
        bounds=(low, high),
        x_scale="jac",
        ftol=tolerance,
        xtol=tolerance,
        gtol=tolerance,
        max_nfev=100,
    )
    return _on_bounds(model, full(solution.x), free)


def _on_bounds(model: MeasurementModel, values: Array, free: NDArray[np.bool_]) -> Array:
    """The values, moved onto a bound nearby where that fits no worse (the search stays inside)."""
    for place in np.flatnonzero(free):
        for bound in model.bounds[:, place]:
            moved = values.copy()
            moved[place] = bound
            if abs(values[place] - bound) < _AT_BOUND * np.ptp(model.bounds[:, place]):
                before, after = (np.sum(model.residuals(trial) ** 2) for trial in (values, moved))
                values = moved if after <= before * (1 + 1e-9) else values
    return values
