"""Estimates from all runs together and from each run, and the errors of their predictions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rollingjoint.identify.errors import Errors, errors_of, quantities
from rollingjoint.identify.fit import Fit
from rollingjoint.identify.measurements import Measurements
from rollingjoint.identify.parameters import Coefficient
from rollingjoint.identify.profile import LikelihoodProfile

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Estimates:
    """A fit to some runs, with an interval for every coefficient."""

    fit: Fit
    profiles: tuple[LikelihoodProfile, ...]

    @property
    def coefficients(self) -> tuple[Coefficient, ...]:
        """The unknown numbers."""
        return self.fit.model.coefficients

    @property
    def values(self) -> Array:
        """The best values, (p,)."""
        return self.fit.values

    @property
    def intervals(self) -> Array:
        """Lower and upper ends, (p, 2); ends of the searched range where the data set none."""
        return np.array([profile.interval for profile in self.profiles]).reshape(-1, 2)


@dataclass(frozen=True)
class Findings:
    """Estimates from all runs together and from each run.

    Args:
        measurements: the fitted measurements.
        confidence: of the intervals.
        together: one fit to all runs.
        alone: a fit to each run; empty for a single run.
        held_out: for each run, values of all coefficients from the other runs alone; empty for a single run. A value
            per run becomes the mean over the other runs.
    """

    measurements: Measurements
    confidence: float
    together: Estimates
    alone: Mapping[str, Estimates]
    held_out: Mapping[str, Array]

    @property
    def coefficients(self) -> tuple[Coefficient, ...]:
        """The unknown numbers."""
        return self.together.coefficients

    @property
    def values(self) -> dict[str, float]:
        """The best values for all runs together, by label."""
        return {
            coefficient.label: float(value)
            for coefficient, value in zip(self.coefficients, self.together.values, strict=True)
        }

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """Intervals of `values`, by label."""
        ends = zip(self.coefficients, self.together.profiles, strict=True)
        return {coefficient.label: profile.interval for coefficient, profile in ends}

    @cached_property
    def deviations(self) -> dict[str, Array]:
        """Measured minus predicted for all runs, (steps, M) each.

        "nominal": the mechanism as designed; "together": one fit to all runs; "alone": every run with its own fit;
        "held out": every run with the values from the other runs. The last two only with several runs.
        """
        model = self.together.fit.model
        values_by_kind = {"nominal": model.nominal, "together": self.together.values}
        tables = {name: model.readings - model.predictions(values) for name, values in values_by_kind.items()}
        if self.alone:
            tables["alone"] = np.concatenate(
                [
                    estimates.fit.model.readings - estimates.fit.model.predictions(estimates.values)
                    for estimates in self.alone.values()
                ]
            )
            everywhere = {run: model.readings - model.predictions(v) for run, v in self.held_out.items()}
            tables["held out"] = np.concatenate([everywhere[run][self.rows(run)] for run in self.held_out])
        return tables

    def rows(self, run: str | None) -> NDArray[np.int64]:
        """Row numbers of the steps of a run, or of all runs, in tables of all steps."""
        names = [entry.name for entry in self.measurements.runs for _ in entry.steps]
        return np.flatnonzero([run in (None, name) for name in names])

    def errors(self, quantity: str, which: str, run: str | None = None) -> Errors:
        """Errors of one quantity under one kind of values (see `deviations`), of a run or of all."""
        return errors_of(self.measurements, quantity, self.deviations[which][self.rows(run)])

    @cached_property
    def quantities(self) -> list[str]:
        """Names of the fitted quantities."""
        return quantities(self.measurements)
