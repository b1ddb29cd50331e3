"""The model of measurements: predicted readings at given parameters, and their derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.errors import MechanismError
from rollingjoint.identify.lengths import NearestLengths
from rollingjoint.identify.measurements import Measurements, Run
from rollingjoint.identify.parameters import Coefficient, values_in_run, varied
from rollingjoint.identify.path import Reached, follow, rates_along
from rollingjoint.identify.reading import reading, reading_rates

Array = NDArray[np.float64]

_SMALLEST_MU = 1e-7  # in place of zero, for derivatives by mu
_FAR = 1e3  # residual of every reading where there is no equilibrium, standard deviations


@dataclass(frozen=True)
class MeasurementModel:
    """Measurements and the unknown numbers in them.

    Readings are rows (steps, M): positions, angles, lengths, tensions, see Measurements.readings.
    """

    measurements: Measurements
    coefficients: tuple[Coefficient, ...]

    def select(self, runs: Sequence[str]) -> MeasurementModel:
        """The model of some runs, with the unknown numbers on which they depend."""
        coefficients = tuple(
            coefficient for coefficient in self.coefficients if coefficient.run is None or coefficient.run in runs
        )
        return MeasurementModel(self.measurements.select(runs), coefficients)

    @property
    def nominal(self) -> Array:
        """Values of the mechanism as designed, (p,)."""
        return np.array([coefficient.nominal(self.measurements.mechanism) for coefficient in self.coefficients])

    @property
    def start(self) -> Array:
        """Values where a fit starts, (p,)."""
        return np.array([coefficient.kind.start for coefficient in self.coefficients])

    @property
    def bounds(self) -> Array:
        """Lowest and highest values, (2, p)."""
        return np.array([coefficient.bounds for coefficient in self.coefficients]).reshape(-1, 2).T

    @cached_property
    def readings(self) -> Array:
        """Measured readings, (steps, M); NaN: not read."""
        return self.measurements.readings(self.measurements.runs)

    @cached_property
    def weights(self) -> Array:
        """Factors on the deviations, (steps, M); zero where a quantity was not read or is not fitted."""
        counts = np.array([step.weight for run in self.measurements.runs for step in run.steps])
        weights = np.sqrt(counts)[:, None] / self.measurements.scales
        return np.where(np.isfinite(self.readings), weights, 0.0)

    @cached_property
    def steps(self) -> NDArray[np.int64]:
        """The step that each residual belongs to, (N,)."""
        return np.nonzero(self.weights)[0]

    def residuals(self, values: Array) -> Array:
        """Measured minus predicted in standard deviations, (N,); large where there is no equilibrium."""
        used = self.weights > 0
        deviations = (self.readings - self.predictions(values))[used] * self.weights[used]
        return np.nan_to_num(deviations, nan=_FAR)

    def jacobian(self, values: Array) -> Array:
        """d residuals / d values, (N, p)."""
        slopes = np.concatenate([self._slopes(run, values) for run in self.measurements.runs])
        used = self.weights > 0
        return -np.nan_to_num(slopes[used] * self.weights[used][:, None])

    def predictions(self, values: Array) -> Array:
        """Predicted readings, (steps, M); NaN where there is no equilibrium."""
        return np.concatenate([self._predictions(run, values) for run in self.measurements.runs])

    def equilibria(self, run: Run, values: Array) -> list[Any]:
        """The equilibria of the steps of a run."""
        return [equilibrium for equilibrium, read in self._path(run, self.values_in(run, values)) if read]

    @cached_property
    def _nearest(self) -> NearestLengths:
        return NearestLengths()

    def _path(self, run: Run, parameters: dict[str, Any]) -> list[Reached]:
        mechanism = varied(self.measurements.mechanism, parameters)
        return follow(self.measurements, run, mechanism, parameters["offsets"], self._nearest)

    def values_in(self, run: Run, values: Array) -> dict[str, Any]:
        """The value of every kind of parameter in a run."""
        return values_in_run(self.coefficients, values, run.name, self.measurements.mechanism)

    def _predictions(self, run: Run, values: Array) -> Array:
        parameters, rows = self.values_in(run, values), np.full((len(run.steps), self.readings.shape[1]), np.nan)
        try:
            equilibria = self.equilibria(run, values)
        except MechanismError:  # surfaces that cannot roll on each other
            return rows
        for row, equilibrium in zip(rows, equilibria, strict=True):
            if equilibrium.ok:
                row[:] = reading(equilibrium, parameters)
        return rows

    def _slopes(self, run: Run, values: Array) -> Array:
        """d predictions of a run / d values, (steps, M, p): implicit derivatives, or central differences."""
        slopes = np.zeros((len(run.steps), self.readings.shape[1], len(values)))
        columns = [self._column(coefficient) for coefficient in self.coefficients]
        if any(column is not None for column in columns):
            closed = self._closed_slopes(run, values)
        for place, (coefficient, column) in enumerate(zip(self.coefficients, columns, strict=True)):
            if coefficient.run in (None, run.name):
                slopes[..., place] = self._difference(run, values, place) if column is None else closed[..., column]
        return slopes

    def _column(self, coefficient: Coefficient) -> int | None:
        """The column of the closed slopes of a coefficient; None: it needs differences."""
        m = self.measurements.mechanism.n_tendons
        if coefficient.name == "base_angle":
            return -1
        if not self._closed:
            return None
        return {"offsets": coefficient.tendon, "stiffness": m, "mu": m + 1}.get(coefficient.name)

    @property
    def _closed(self) -> bool:
        """Whether equilibria have derivatives in closed form."""
        searched = self.measurements.given == "lengths" and self.measurements.method == "least_squares"
        unsupported = [name for name in ("constant", "rolling") if self._occurs(name)]  # rates_along lacks their terms
        return not searched and not unsupported

    def _occurs(self, name: str) -> bool:
        """Whether a coefficient of friction is sought or is not zero."""
        mechanism = self.measurements.mechanism
        frictions = [mechanism.friction, *(getattr(tendon, "friction", None) for tendon in mechanism.tendons)]
        present = any(friction is not None and getattr(friction, name) for friction in frictions)
        return present or any(coefficient.name == name for coefficient in self.coefficients)

    def _closed_slopes(self, run: Run, values: Array) -> Array:
        """Derivatives that follow from the equilibria, (steps, M, columns)."""
        parameters = self.values_in(run, values)
        if any(coefficient.name == "mu" for coefficient in self.coefficients):
            parameters["mu"] = max(parameters["mu"], _SMALLEST_MU)
        path = self._path(run, parameters)
        pairs = zip(path, rates_along(path, parameters), strict=True)
        return np.array(
            [reading_rates(reached.equilibrium, rates, parameters) for reached, rates in pairs if reached.read]
        )

    def _difference(self, run: Run, values: Array, place: int) -> Array:
        """Differences of the predictions, (steps, M): central, or one-sided at the end of the range."""
        low, high = self.coefficients[place].bounds
        ends = np.clip(values[place] + np.array([-1.0, 1.0]) * self.coefficients[place].kind.step, low, high)
        below, above = (np.where(np.arange(len(values)) == place, end, values) for end in ends)
        return (self._predictions(run, above) - self._predictions(run, below)) / np.ptp(ends)


Model = MeasurementModel
"""Earlier name, which pickles have."""
